"""Bodies with history that touch each other in implicit steps: nodes on facets, solved for together."""

from mpi4py import MPI

import numpy as np
import pytest
from interior_momentum import linear_momentum
from scipy.spatial.transform import Rotation

import flexmbd as fm
from flexmbd import meshes
from flexmbd.continuum import (
    ExplicitContinuum,
    ImplicitContinuum,
    Interface,
    LinearSolver,
    MpiTeam,
    NonlinearModel,
    Preconditioner,
)
from flexmbd.errors import SceneError
from flexmbd.forms import hencky_plasticity, j2_plasticity, solid_enhanced, solid_micropolar
from flexmbd.multibody.bodies.continuum_body import FrameMotion, Scheme
from flexmbd.multibody.contact.nodes import interior_forces

RIGID, AVERAGED = fm.Coupling
DAMPED = fm.GeneralizedAlpha(rho=0.0)
H = 2e-3
SCHEME = Scheme(1.0 / 3.0, 4.0 / 9.0, 25.0 / 81.0, 11.0 / 18.0)
CUBE = (0.1, 0.1, 0.1)


def model(n, face, *, sizes=CUBE, E=1e6, nu=0.3, yields=1e9, coupling=RIGID, cell="hexahedron", comm=MPI.COMM_SELF):
    mesh = meshes.block(*sizes, divisions=n, cell=cell, comm=comm)
    material = hencky_plasticity.Parameters(E, nu, 1000.0, yields, hardening=j2_plasticity.LinearHardening(1e5))
    ends = [Interface(one, coupling=coupling) for one in np.atleast_1d(face)]
    return NonlinearModel(mesh, hencky_plasticity, material, degree=1, interfaces=ends)


class Pile:
    """Bodies on each other along z, from above, apart by ``gap``; the uppermost one is held by its top, others below.

    Each one's lower nodes touch the next one's upper facets.  ``turn``: of the whole, from its axes to inertial ones.
    """

    def __init__(self, models, *, heights=0.1, offset=0.0, gap=0.0, mu=0.0, turn=None, ratio=10.0):
        self.interiors = [ImplicitContinuum(one) for one in models]
        self.scene = fm.System(team=MpiTeam(models[0].comm))
        self.bodies = [self.scene.add(fm.ContinuumBody(one), name=f"body {k}") for k, one in enumerate(self.interiors)]
        self.turn = np.eye(3) if turn is None else turn
        heights = np.broadcast_to(heights, len(models))
        middles = np.cumsum(heights[::-1])[::-1] - heights / 2.0
        self.places = [np.array([offset * (k == 0), 0.0, z - (k > 0) * gap]) for k, z in enumerate(middles)]
        self.contacts = []
        for upper, lower in zip(self.bodies, self.bodies[1:], strict=False):
            nodes = fm.contact.Nodes(upper, "z_min", stiffness_ratio=ratio)
            facets = fm.contact.SurfaceFacets(lower, "z_max")
            self.contacts += self.scene.touch(nodes, facets, fm.contact.Hard(mu=mu))

    def place(self, k, i=0):
        """Ground's and the body's frame of an interface."""
        own = self.interiors[k].frames[i]
        at = self.turn @ (self.places[k] + own.p_BI_B)
        return self.scene.ground.frame(p=at, R=self.turn), self.bodies[k].frame(own.name)

    def let_fly(self, velocity):
        for k in range(len(self.bodies)):
            v = np.asarray(velocity if k == 0 else (0.0, 0.0, 0.0))
            self.scene.connect(fm.joint.Free(), *self.place(k)).velocity = [*v, 0.0, 0.0, 0.0]
        return self

    def press(self, way, *, till=0.16, t_end=0.3, back=0.0, h=0.02, **told):
        """The lowest one's bottom is held; the uppermost one's top goes down by a way, and back by a part of it."""
        self.scene.connect(fm.joint.Fixed(), *self.place(-1))
        rail = self.scene.connect(fm.joint.Prismatic("z"), *self.place(0))
        t = np.linspace(0.0, t_end, 31)
        s, r = np.minimum(t / till, 1.0), np.clip((t - till) / (t_end - till), 0.0, 1.0)
        rail.prescribe(fm.Table(t, -way * (s**2 * (3.0 - 2.0 * s) - back * r**2 * (3.0 - 2.0 * r))))
        return self.scene.simulate(t_end, h=h, integrator=DAMPED, **told)

    def force(self, run, k=0, body=0):
        return run.outer_forces(self.bodies[body])[self.contacts[k].name]

    def energies(self, run):
        found = [run.energies(body) for body in self.bodies]
        return {name: sum(one[name] for one in found) for name in found[0]}


@pytest.mark.parametrize(("coupling", "mu"), [(RIGID, 0.0), (RIGID, 5.0), (AVERAGED, 0.05)])
def test_the_derivative_of_the_wrenches_knows_both_bodies(coupling, mu):
    """By motions of the frames of both; smooth, where all nodes slide, and where they stick.

    Tolerance: of central differences of 1e-7 m and rad, whose wrenches are solved to 1e-11.
    """
    models = [model((2, 2, 1), "z_max", coupling=coupling), model((3, 3, 1), "z_min", coupling=coupling)]
    pile = Pile(models, offset=0.01, mu=mu)
    interior_forces(pile.bodies, pile.contacts)
    upper, lower = pile.interiors
    rng, zero = np.random.default_rng(3), np.zeros((2, 3))
    p = np.array([place + one.frames[0].p_BI_B for place, one in zip(pile.places, pile.interiors, strict=True)])
    turned = Rotation.from_rotvec(0.01 * rng.normal(size=(2, 3))).as_matrix()
    moved, rest = p + np.array([[0.0, 0.0, -2e-3], [1.5e-3, 0.0, 1e-3]]), 0.5 * rng.normal(size=(4, 2, 3))

    def at(y):
        move, turn = np.split(y.reshape(2, 6), 2, axis=1)
        per_x, per_v = SCHEME.slopes(H)
        R, (v, w, a, alpha) = Rotation.from_rotvec(turn).as_matrix() @ turned, rest
        speed = per_v / per_x
        return FrameMotion(
            moved + move, R, v + speed * move, w + speed * turn, a + move / per_x, alpha + turn / per_x
        )

    def other(motion):
        return FrameMotion(*(part[::-1].copy() for part in motion))

    start = FrameMotion(p, np.tile(np.eye(3), (2, 1, 1)), zero, zero, zero, zero)
    upper.begin(0.0, start, np.zeros(3))
    lower.begin(0.0, other(start), np.zeros(3))

    def answer(y):
        (one, by_one), (two, by_two) = (
            upper.trial(H, H, SCHEME, at(y)), lower.trial(H, H, SCHEME, other(at(y)))
        )  # fmt: skip
        assert not one[1].any()
        assert not two[1].any()
        return np.concatenate([one[0], two[0]]), np.vstack([by_one[:6], np.roll(by_two[:6], 6, axis=1)])

    wrenches, slopes = answer(np.zeros(12))
    step = 1e-7
    columns = [(answer(step * unit)[0] - answer(-step * unit)[0]) / (2.0 * step) for unit in np.eye(12)]
    assert abs(np.array(columns).T - slopes).max() < 1e-8 * abs(slopes).max()
    assert abs(slopes[6:, :6]).max() > 500.0
    assert wrenches.shape == (12,)


@pytest.mark.parametrize(
    ("E", "turn"),
    [((1e6, 4e6), (0.0, 0.0, 0.0)), ((4e8, 1e6), (0.4, -0.7, 0.2))],
)
def test_like_meshes_pass_a_uniform_pressure(E, turn):
    """Hooke's two blocks and the contact in series, which is a spring of the nodes'; they slide by unlike strains.

    Of a given force a body's energy is least where the stress is uniform.  Strains are 2e-4.
    """
    heights = np.array([0.1, 0.05])
    models = [
        model((2, 2, 1), face, sizes=(0.1, 0.1, height), E=one, coupling=AVERAGED)
        for face, height, one in zip(("z_max", "z_min"), heights, E, strict=True)
    ]
    pile = Pile(models, heights=heights, turn=Rotation.from_rotvec(turn).as_matrix(), ratio=100.0)
    run = pile.press(2e-5)
    force = pile.force(run)[-1] @ pile.turn
    assert abs(force[:2]).max() < 1e-4 * force[2]
    compliances = heights / (np.array(E) * 0.01)
    stored = pile.energies(run)["contact"][-1]
    touch = 2.0 * stored / force[2] ** 2
    assert touch < 0.02 * compliances.sum()
    assert force[2] == pytest.approx(2e-5 / (compliances.sum() + touch), rel=1e-3)
    for body, compliance in zip(pile.bodies, compliances, strict=True):
        assert run.energies(body)["elastic"][-1] == pytest.approx(0.5 * compliance * force[2] ** 2, rel=5e-3)
    assert np.array_equal(pile.force(run), -pile.force(run, body=1))


def test_unlike_meshes_pass_the_force_within_a_hundredth():
    """Patch test: nodes of the finer mesh, 4 by 4 cells on 3 by 3, of one material; the error is 0.5 %."""
    models = [model((4, 4, 2), "z_max", coupling=AVERAGED), model((3, 3, 2), "z_min", coupling=AVERAGED)]
    pile = Pile(models, ratio=100.0)
    run = pile.press(4e-5)
    force, compliance = pile.force(run)[-1, 2], 0.1 / (1e6 * 0.01)
    assert force == pytest.approx(4e-5 / (2.0 * compliance), rel=0.01)
    for body in pile.bodies:
        assert run.energies(body)["elastic"][-1] == pytest.approx(0.5 * compliance * force**2, rel=0.01)


def test_two_bars_that_meet_exchange_their_speeds():
    """As waves say: a force rho c A v for 2 L / c; momentum to the round-off of what is solved for.

    Of waves that cells disperse 2 % of the speed stays in vibrations.
    """
    n, L, v = 24, 0.3, 0.05
    models = [model((1, 1, n), face, sizes=(0.02, 0.02, L), nu=0.0) for face in ("z_max", "z_min")]
    pile = Pile(models, heights=L, gap=1e-5)
    for k, speed in enumerate((-v, v)):
        pile.scene.connect(fm.joint.Prismatic("z"), *pile.place(k)).velocity = speed
    c = np.sqrt(1e6 / 1000.0)
    run = pile.scene.simulate(2.5 * L / c, h=0.5 * L / n / c, integrator=fm.GeneralizedAlpha(rho=0.5))
    force, m = pile.force(run)[:, 2], 1000.0 * 4e-4 * L
    impulse = np.trapezoid(force, run.t)
    momenta = [
        linear_momentum(one, run, pile.place(k)[1])[2] for k, one in enumerate(pile.interiors)
    ]
    assert momenta == pytest.approx([m * v, -m * v], rel=0.02)
    assert abs(sum(momenta)) < 1e-10 * m * v
    assert impulse == pytest.approx(2.0 * m * v, rel=0.01)
    inside = (run.t > 0.3 * L / c) & (run.t < 1.7 * L / c)
    assert force[inside].mean() == pytest.approx(1000.0 * c * 4e-4 * v, rel=0.01)
    pressed = run.t[force > 0.5 * force[inside].mean()]
    assert np.ptp(pressed) == pytest.approx(2.0 * L / c, rel=0.03)
    energy = sum(pile.energies(run).values()) + run.energy().kinetic
    assert energy.min() > 0.97 * energy[0]
    assert energy.max() < (1.0 + 1e-4) * energy[0]


def dragged(*, comm=MPI.COMM_SELF, t_end=0.08, **told):
    """A cube is pressed onto a slab of another mesh, and drawn along over it by a cart."""
    models = [
        model((2, 2, 1), "z_max", comm=comm),
        model((5, 3, 1), "z_min", sizes=(0.25, 0.14, 0.04), E=4e6, comm=comm),
    ]
    pile = Pile(models, heights=(0.1, 0.04), offset=-0.05, mu=0.3)
    pile.scene.connect(fm.joint.Fixed(), *pile.place(1))
    ground, frame = pile.place(0)
    cart = pile.scene.add(fm.RigidBody(1.0, (0.01, 0.01, 0.01)), name="cart")
    t = np.linspace(0.0, 0.3, 61)
    drive = fm.Table(t, 0.1 * t**2 / (t + 0.05))
    pile.scene.connect(fm.joint.Prismatic("x"), ground, cart.frame()).prescribe(drive)
    s = np.minimum(t / 0.1, 1.0)
    pile.scene.connect(fm.joint.Prismatic("z"), cart.frame(), frame).prescribe(
        fm.Table(t, -2e-4 * s**2 * (3.0 - 2.0 * s))
    )
    return pile, pile.scene.simulate(t_end, h=0.01, integrator=DAMPED, **told)


def test_a_cube_is_dragged_at_mu_times_its_load():
    """Coulomb's force at each instant at which it slides; and its work is what is lost."""
    pile, run = dragged(t_end=0.2)
    force = pile.force(run)
    late = run.t > 0.1
    assert force[late, 2].min() > 10.0
    assert force[late, 0] == pytest.approx(-0.3 * force[late, 2], rel=2e-3)
    lost, x = pile.energies(run)["friction"], run.position(pile.place(0)[1])[:, 0]
    assert lost[-1] - lost[late][0] == pytest.approx(-np.trapezoid(force[late, 0], x[late]), rel=0.01)


def test_a_run_that_rubs_goes_on_to_the_bit():
    pile, whole = dragged(checkpoints=[0.04])
    _, again = dragged(restart=whole.checkpoints[0])
    assert np.array_equal(again.x[-1], whole.x[-1])
    assert abs(pile.force(whole)[whole.t < 0.04][-1, [0, 2]]).min() > 0.0


@pytest.mark.mpi
def test_coupled_bodies_on_all_ranks_do_what_they_do_on_one():
    one, all_of_them = dragged()[-1], dragged(comm=MPI.COMM_WORLD)[-1]
    assert abs(one.x[-1] - all_of_them.x[-1]).max() < 1e-9


def test_three_that_touch_are_springs_in_series():
    """The middle one touches both others: nodes of its own below, facets above; held by a frame that flies with it."""
    E, heights = (1e6, 2e6, 4e6), np.array([0.05, 0.1, 0.05])
    models = [
        model((1, 1, 1), face, sizes=(0.1, 0.1, height), E=one, nu=0.0, coupling=AVERAGED)
        for face, height, one in zip(("z_max", "x_min", "z_min"), heights, E, strict=True)
    ]
    pile = Pile(models, heights=heights, ratio=100.0)
    pile.scene.connect(fm.joint.Prismatic("z"), *pile.place(1))
    run = pile.press(4e-5)
    upper, lower = pile.force(run, 0)[-1, 2], pile.force(run, 1, 1)[-1, 2]
    assert upper == pytest.approx(lower, rel=1e-3)
    compliance = (heights / (np.array(E) * 0.01)).sum()
    touch = 2.0 * pile.energies(run)["contact"][-1] / upper**2
    assert touch < 0.03 * compliance
    assert upper == pytest.approx(4e-5 / (compliance + touch), rel=2e-3)
    assert set(run.outer_forces(pile.bodies[1])) == {one.name for one in pile.contacts}


def test_of_two_the_softer_one_yields():
    """Uniform stress beyond yield, by linear hardening, and back by a fifth of the way: its strain stays.

    The way over the length, equal ones, is (s - Y) / H + s / E + s / E'; on the way back without the first.
    """
    E, stiff, H, Y, way = 1e6, 1e7, 1e5, 1e3, 4e-4
    models = [
        model((1, 1, 1), "z_max", E=stiff, coupling=AVERAGED),
        model((1, 1, 1), "z_min", E=E, yields=Y, coupling=AVERAGED),
    ]
    pile = Pile(models, ratio=100.0)
    run = pile.press(way, back=0.2)
    stress, down = pile.force(run)[:, 2] / 0.01, int(np.searchsorted(run.t, 0.16 - 1e-9))
    most = (way / 0.1 + Y / H) / (1.0 / H + 1.0 / E + 1.0 / stiff)
    assert stress[down] == pytest.approx(most, rel=3e-3)
    touch = 0.01 * (1.0 / E + 1.0 / stiff)
    assert stress[down] - stress[-1] == pytest.approx(0.2 * way / 0.1 / (1.0 / E + 1.0 / stiff + touch), rel=0.01)
    found = run.energies(pile.bodies[1])["plastic"]
    assert found[-1] == pytest.approx(found[down], rel=1e-3)
    assert found[-1] > 2e-3
    assert not run.energies(pile.bodies[0])["plastic"].any()


def momenta(interior):
    """(6,) linear and angular momentum about the origin, of all nodes with what frames have of them, spins included."""
    now, turning = interior._state, interior._nodes.turning
    p = interior._nodes.inertia(now.v)
    found = np.append(p.sum(axis=0), np.cross(now.x[: len(p)], p).sum(axis=0))
    if turning is not None:
        Q, w = now.turns.Q[: len(p)], now.turns.w[: len(p)]
        spins = turning.inertia.momenta(np.einsum("nba,nb->na", Q, w))
        found[3:] += np.einsum("nab,nb->na", Q, spins).sum(axis=0)
    return found


def test_two_cubes_that_hit_each_other_askew_keep_momentum():
    """Beside each other by a tenth, sliding, turned in space.

    Linear momentum to what is solved for, angular momentum to a hundred thousandth; energy falls with steps.
    """
    lost, turn = [], Rotation.from_rotvec([0.3, 0.8, -0.4]).as_matrix()
    for h in (1e-3, 5e-4):
        pile = Pile([model((2, 2, 2), "z_max"), model((3, 3, 3), "z_min")], offset=0.01, gap=1e-3, mu=0.2, turn=turn)
        pile.let_fly((0.2, 0.0, -1.0))
        run = pile.scene.simulate(0.03, h=h, integrator=fm.GeneralizedAlpha(rho=1.0))
        energy = sum(pile.energies(run).values()) + run.energy().kinetic
        assert pile.energies(run)["friction"][-1] > 1e-4
        lost.append(abs(energy / energy[0] - 1.0).max())
        begun = turn @ [0.2, 0.0, -1.0]  # of 1 kg
        begun = np.append(begun, np.cross(turn @ (pile.places[0] + [0.05, 0.0, 0.0]), begun))
        gained = sum(momenta(one) for one in pile.interiors) - begun
        assert abs(momenta(pile.interiors[1])[:3]).max() > 0.1
        assert abs(gained[:3]).max() < 1e-8
        assert abs(gained[3:]).max() < 1e-5 * np.linalg.norm(begun[3:])
    assert lost[1] < 0.7 * lost[0] < 2e-3


def test_rotations_meet_fields_of_cells():
    """A foam with rotations of its own hits bricks with strains of their own: both momenta, spins among them.

    In steps in which the phase of its rotations' own vibration goes on by 0.6 rad 3e-4 of angular momentum is lost; in
    halves of these 1.5e-4.
    """
    p = solid_micropolar.Parameters(E=1e6, nu=0.25, rho=1000.0, coupling=1e5, length=0.02, micro_inertia=1e-3)
    foam = NonlinearModel(
        meshes.block(*CUBE, divisions=(2, 2, 1), comm=MPI.COMM_SELF), solid_micropolar, p, degree=1,
        interfaces=[Interface("z_max")],
    )  # fmt: skip
    bricks = NonlinearModel(
        meshes.block(*CUBE, divisions=(3, 3, 1), comm=MPI.COMM_SELF), solid_enhanced,
        solid_enhanced.Parameters(E=1e6, nu=0.3, rho=1000.0), degree=1, interfaces=[Interface("z_min")],
    )  # fmt: skip
    pile = Pile([foam, bricks], offset=0.03, gap=1e-4, mu=0.2).let_fly((0.02, 0.0, -0.1))
    run = pile.scene.simulate(0.02, h=1e-3, integrator=fm.GeneralizedAlpha(rho=1.0))
    begun = np.array([0.02, 0.0, -0.1])
    begun = np.append(begun, np.cross(pile.places[0] + [0.05, 0.0, 0.0], begun))
    gained = sum(momenta(one) for one in pile.interiors) - begun
    assert momenta(pile.interiors[1])[2] < -0.03
    assert pile.energies(run)["friction"][-1] > 1e-6
    assert abs(gained[:3]).max() < 1e-10
    assert abs(gained[3:]).max() < 5e-4 * np.linalg.norm(begun[3:])


def test_a_start_after_one_that_was_refused_is_looked_at_by_itself():
    """The lower one begins in the upper one, is refused, and begins beneath it."""
    pile = Pile([model((1, 1, 1), "z_max"), model((1, 1, 1), "z_min")])
    interior_forces(pile.bodies, pile.contacts)
    upper, lower = pile.interiors
    still = np.zeros((2, 3))

    def place(k, dz):
        p = np.array([pile.places[i] + pile.interiors[i].frames[0].p_BI_B for i in (k, 1 - k)])
        p[0, 2] += dz
        return FrameMotion(p, np.tile(np.eye(3), (2, 1, 1)), still, still, still, still)

    upper.begin(0.0, place(0, 0.0), np.zeros(3))
    with pytest.raises(SceneError, match=r"begins 0\.01 m inside"):
        lower.begin(0.0, place(1, 0.01), np.zeros(3))
    upper.begin(0.0, place(0, 0.0), np.zeros(3))
    lower.begin(0.0, place(1, -0.01), np.zeros(3))


def test_wrong_pairs_in_implicit_steps_are_refused():
    hard = fm.contact.Hard()
    apart = Pile([model((1, 1, 1), "z_max"), model((1, 1, 1), "z_min")], gap=-0.01).let_fly(np.zeros(3))
    with pytest.raises(SceneError, match=r"z_min on body 1\.z_max.*begins 0\.01 m inside"):
        apart.scene.simulate(1e-3)
    still = Pile([model((1, 1, 1), "z_max"), model((1, 1, 1), "z_min")]).let_fly(np.zeros(3))
    with pytest.raises(SceneError, match=r"contact 'z_min on body 1\.z_max'\): its state at rest"):
        still.scene.equilibrium()
    for kinds, told, match in (
        ((ImplicitContinuum, ExplicitContinuum), {}, "where both step alike"),
        ((ImplicitContinuum, ImplicitContinuum), {"preconditioner": Preconditioner.MULTIGRID}, "Preconditioner.FACTOR"),
    ):
        scene, bodies = fm.System(), []
        for k, (kind, face) in enumerate(zip(kinds, ("z_max", "z_min"), strict=True)):
            solver = {"solver": LinearSolver(**told)} if told else {}
            bodies.append(scene.add(fm.ContinuumBody(kind(model((1, 1, 1), face), **solver)), name=f"body {k}"))
            scene.connect(fm.joint.Free(), scene.ground.frame(p=(0.0, 0.0, 0.15 - 0.2 * k)), bodies[-1].frame(face))
        scene.touch(fm.contact.Nodes(bodies[0], "z_min"), fm.contact.SurfaceFacets(bodies[1], "z_max"), hard)
        with pytest.raises(SceneError, match=match):
            scene.simulate(1e-3)
