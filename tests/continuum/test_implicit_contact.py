"""Surfaces of bodies with history that touch rigid shapes of the machine, solved for at a step's end."""

from mpi4py import MPI

import numpy as np
import pytest
from interior_momentum import linear_momentum
from scipy.spatial.transform import Rotation

import flexmbd as fm
from flexmbd import contact, meshes
from flexmbd.continuum import BodyAcceleration, ExplicitContinuum, ImplicitContinuum, Interface, MpiTeam, NonlinearModel
from flexmbd.errors import SceneError
from flexmbd.forms import hencky_plasticity, j2_plasticity, solid_linear, solid_mixed
from flexmbd.multibody.bodies.continuum_body import FrameMotion, Scheme

RIGID, AVERAGED = fm.Coupling
IMPLICIT, EXPLICIT = fm.GeneralizedAlpha(), fm.CentralDifference()
H = 2e-3
SCHEME = Scheme(1.0 / 3.0, 4.0 / 9.0, 25.0 / 81.0, 11.0 / 18.0)


def block(kind=ImplicitContinuum, *, coupling=RIGID, nu=0.3, comm=MPI.COMM_SELF, **told):
    """A cube of 0.1 m and 1 kg, held by its upper face; its lower one is in z = -0.05."""
    mesh = meshes.block(0.1, 0.1, 0.1, divisions=(2, 2, 2), comm=comm)
    material = hencky_plasticity.Parameters(1e6, nu, 1000.0, 1e9, hardening=j2_plasticity.LinearHardening(1e5))
    face = Interface("z_max", coupling=coupling)
    return kind(NonlinearModel(mesh, hencky_plasticity, material, degree=1, interfaces=[face]), **told)


class Motions:
    """Motions of a block's frame and a plate's at the end of a step that presses them together, and near these."""

    def __init__(self, frame):
        rng = np.random.default_rng(3)
        zero = np.zeros((2, 3))
        p = np.array([frame.p_BI_B, [0.03, 0.01, -0.05]])
        self.start = FrameMotion(p, np.tile(np.eye(3), (2, 1, 1)), zero, zero, zero, zero)
        turn = 0.01 * rng.normal(size=(2, 3))
        self._R = Rotation.from_rotvec(turn).as_matrix()
        self._p = p + np.array([[0.0, 0.0, -2e-3], [1.5e-3, 0.0, 1e-3]])
        self._rest = 0.5 * rng.normal(size=(4, 2, 3))

    def at(self, y):
        move, turn = np.split(y.reshape(2, 6), 2, axis=1)
        per_x, per_v = SCHEME.slopes(H)
        R = Rotation.from_rotvec(turn).as_matrix() @ self._R
        v, w, a, alpha = self._rest
        speed = per_v / per_x
        return FrameMotion(
            self._p + move, R, v + speed * move, w + speed * turn, a + move / per_x, alpha + turn / per_x
        )


def obstacle(mu):
    scene = fm.System()
    part = scene.add(fm.ContinuumBody(block()), name="block")
    plate = scene.add(fm.RigidBody(2.0, (0.01, 0.01, 0.02)), name="plate")
    told = fm.contact.Nodes(part, "z_min"), fm.contact.HalfSpace(plate.frame()), fm.contact.Hard(mu=mu)
    (contact,) = scene.touch(*told)
    return contact.obstacle()


@pytest.mark.parametrize("mu", [0.0, 0.05, 5.0])
@pytest.mark.parametrize("coupling", [RIGID, AVERAGED])
def test_the_derivative_of_the_wrenches_knows_contact(coupling, mu):
    """By motions of the body's frame and of the shape's; smooth, where all nodes slide, and where they stick."""
    interior = block(coupling=coupling)
    interior.meet([obstacle(mu)])
    motions = Motions(interior.frames[0])
    interior.begin(0.0, motions.start, np.zeros(3))
    wrenches, slopes = interior.trial(H, H, SCHEME, motions.at(np.zeros(12)))
    assert wrenches.shape == (2, 6)
    assert -wrenches[1, 2] > 10.0
    across = np.linalg.norm(wrenches[1, :3] - (wrenches[1, :3] @ normal(motions)) * normal(motions))
    assert across <= mu * abs(wrenches[1, :3] @ normal(motions)) + 1e-9
    step, found = 1e-7, np.zeros((12, 12))
    for j, unit in enumerate(np.eye(12)):
        there, back = (interior.trial(H, H, SCHEME, motions.at(sign * step * unit))[0] for sign in (1.0, -1.0))
        found[:, j] = (there - back).reshape(-1) / (2 * step)
    assert abs(found - slopes).max() < 2e-6 * abs(slopes).max()
    assert abs(slopes[6:, 6:]).max() > 1e3


def normal(motions):
    return motions.at(np.zeros(12)).R[1][:, 2]


TILT = Rotation.from_rotvec([0.0, 0.5, 0.0]).as_matrix()


def incline(mu, t_end, *, h):
    """A block that is let go on an incline of 0.5 rad; its motion along and across it, and the force that bears it."""
    interior = block()
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    part = scene.add(fm.ContinuumBody(interior), name="block")
    at = scene.ground.frame(p=TILT @ interior.frames[0].p_BI_B, R=TILT)
    scene.connect(fm.joint.Free(), at, part.frame("z_max"))
    floor = fm.contact.HalfSpace(scene.ground.frame(p=TILT @ [0.0, 0.0, -0.05], R=TILT))
    (contact,) = scene.touch(fm.contact.Nodes(part, "z_min"), floor, fm.contact.Hard(mu=mu))
    run = scene.simulate(t_end, h=h, integrator=fm.GeneralizedAlpha(rho=0.5))
    frame = part.frame("z_max")
    moved = (run.position(frame) - run.position(frame)[0]) @ TILT
    return run, part, moved, run.velocity(frame) @ TILT, run.outer_forces(part)[contact.name] @ TILT


def test_a_block_slides_down_an_incline():
    """By g (sin - mu cos), and what it loses is friction's; it bounces a little at first."""
    run, part, moved, v, force = incline(0.2, 0.3, h=2e-3)
    a, t = 9.81 * (np.sin(0.5) - 0.2 * np.cos(0.5)), run.t
    assert v[-1, 0] == pytest.approx(a * t[-1], rel=0.01)
    assert moved[-1, 0] == pytest.approx(a * t[-1] ** 2 / 2, rel=0.01)
    later = t > 0.1
    assert force[later, 0] == pytest.approx(-0.2 * force[later, 2], rel=1e-3)
    lost = run.energies(part)["friction"][-1]
    assert lost == pytest.approx(0.2 * 9.81 * np.cos(0.5) * moved[-1, 0], rel=0.02)


def test_a_block_that_sticks_does_not_creep():
    """tan 0.5 = 0.55 < 0.7: under a weight that has grown slowly it stands still to round-off."""
    t = np.linspace(0.0, 0.8, 81)
    grown = np.minimum(t / 0.2, 1.0)
    factor = fm.Table(t, grown**2 * (3.0 - 2.0 * grown))
    weight = BodyAcceleration((0.0, 0.0, -9.81), name="weight", factor=factor)
    interior = block(loads=[weight])
    scene = fm.System()
    part = scene.add(fm.ContinuumBody(interior), name="block")
    at = scene.ground.frame(p=TILT @ interior.frames[0].p_BI_B, R=TILT)
    scene.connect(fm.joint.Free(), at, part.frame("z_max"))
    floor = fm.contact.HalfSpace(scene.ground.frame(p=TILT @ [0.0, 0.0, -0.05], R=TILT))
    (contact,) = scene.touch(fm.contact.Nodes(part, "z_min"), floor, fm.contact.Hard(mu=0.7))
    run = scene.simulate(0.8, h=0.01, integrator=fm.GeneralizedAlpha(rho=0.0))
    moved, force = run.position(part.frame("z_max")) @ TILT, run.outer_forces(part)[contact.name] @ TILT
    assert np.ptp(moved[run.t > 0.6], axis=0).max() < 1e-9
    assert force[-1] == pytest.approx(9.81 * np.array([-np.sin(0.5), 0.0, np.cos(0.5)]), abs=1e-5)


def pressed(interior, integrator, *, way, slope=0.0, mu=0.0, t_end=0.4, **told):
    """A block that is held is pressed by a plate that rises slowly, and moves aside meanwhile."""
    scene = fm.System()
    part = scene.add(fm.ContinuumBody(interior), name="block")
    scene.connect(fm.joint.Fixed(), scene.ground.frame(p=interior.frames[0].p_BI_B), part.frame("z_max"))
    plate = scene.add(fm.RigidBody(100.0, (1.0, 1.0, 1.0)), name="plate")
    rail = scene.connect(fm.joint.Prismatic((slope, 0.0, 1.0)), scene.ground.frame(p=(0.05, 0.0, -0.05)), plate.frame())
    t = np.linspace(0.0, t_end, 41)
    rail.prescribe(fm.Table(t, way * np.hypot(1.0, slope) * (t / t_end) ** 2 * (3.0 - 2.0 * t / t_end)))
    half_space = fm.contact.HalfSpace(plate.frame())
    (contact,) = scene.touch(fm.contact.Nodes(part, "z_min"), half_space, fm.contact.Hard(mu=mu))
    return scene.simulate(t_end, integrator=integrator, **told), part, contact


@pytest.mark.parametrize("kind", [ImplicitContinuum, ExplicitContinuum])
def test_a_block_and_its_contact_are_springs_in_series(kind):
    """Both ways: the block's E A / L, as nu = 0, and the nodes' springs, whose depths are the same at all of them."""
    implicit = kind is ImplicitContinuum
    interior = block(kind, nu=0.0, **({} if implicit else {"damping": 100.0}))
    if implicit:
        lower = interior.body.layout.node_x[:, 2] < -0.05 + 1e-9
        diagonal = interior.body.tangent(np.zeros(interior.body.layout.n_local), dt=1.0).getDiagonal().array_r
        spring = 10.0 * diagonal.reshape(-1, 3).mean(axis=1)[lower].sum()
    else:
        spring = 0.25 * 0.5 / (1.0 - 0.5 / 4.0) / interior.motion.limit**2  # a quarter of the mass is at the face
    told = {"h": 0.02} if implicit else {}
    run, part, contact = pressed(interior, IMPLICIT if implicit else EXPLICIT, way=1e-4, **told)
    force = run.outer_forces(part)[contact.name][-1]
    assert force[2] == pytest.approx(1e-4 / (0.1 / (1e6 * 0.1**2) + 1.0 / spring), rel=2e-3)


def test_a_run_goes_on_to_the_bit_from_within_a_contact():
    """Some of its nodes slide, some stick."""
    told = {"way": 1e-3, "slope": 0.6, "mu": 0.2, "h": 0.02}
    whole, part, contact = pressed(block(), IMPLICIT, **told, checkpoints=[0.2])
    again, other, _ = pressed(block(), IMPLICIT, **told, restart=whole.checkpoints[0])
    memory = part.interior.snapshot()
    assert memory["touched 0"][:, 3:].any()
    assert all(np.array_equal(value, memory[name]) for name, value in other.interior.snapshot().items())
    first, second = whole.outer_forces(part)[contact.name], again.outer_forces(other)[contact.name]
    assert np.array_equal(first[-1], second[-1])


def indented(n, *, comm=MPI.COMM_SELF, R=0.2, depth=4e-4, width=0.12):
    """The force (N) on a rigid sphere that is pressed into a slab by n x 2n x 2n cells, and Hertz's of a half space."""
    mesh = meshes.block(width, width, width / 2, divisions=(2 * n, 2 * n, n), comm=comm)
    parameters = solid_linear.Parameters(E=1e7, nu=0.3, rho=1000.0)
    body = NonlinearModel(mesh, solid_linear, parameters, degree=1, interfaces=[Interface("z_min")])
    scene = fm.System(team=MpiTeam(comm))
    slab = scene.add(fm.ContinuumBody(ImplicitContinuum(body)), name="slab")
    at = slab.interior.frames[0].p_BI_B
    scene.connect(fm.joint.Fixed(), scene.ground.frame(p=at), slab.frame("z_min"))
    ball = scene.add(fm.RigidBody(1.0, (1e-3, 1e-3, 1e-3)), name="ball")
    top = (width / 2, 0.0, width / 4 + R)
    rail = scene.connect(fm.joint.Prismatic("z"), scene.ground.frame(p=top), ball.frame())
    t = np.linspace(0.0, 0.04, 41)
    rail.prescribe(fm.Table(t, -depth * (t / 0.04) ** 2 * (3.0 - 2.0 * t / 0.04)))
    (contact,) = scene.touch(fm.contact.Nodes(slab, "z_max"), fm.contact.Sphere(ball.frame(), R), fm.contact.Hard())
    run = scene.simulate(0.04, h=8e-3, integrator=IMPLICIT)
    hertz = 4.0 / 3.0 * 1e7 / (1.0 - 0.3**2) * np.sqrt(R) * depth**1.5
    return -run.outer_forces(slab)[contact.name][-1, 2], hertz


def test_a_sphere_is_pressed_into_a_slab_as_hertz_says():
    """The circle of contact has a radius of 0.6 and 0.9 cells; with 1.2 and 1.8 cells the shares are 1.02 and 1.03.

    A layer on a rigid base is 1.15 times stiffer than a half space (Dimitriadis et al. 2002, at this depth); this slab
    has sides as well.
    """
    shares = [force / hertz for force, hertz in map(indented, (4, 6))]
    assert 0.65 < shares[0] < shares[1]
    assert 0.88 < shares[1] < 1.0


@pytest.mark.mpi
def test_all_ranks_together_do_what_one_does():
    one, all_of_them = indented(4)[0], indented(4, comm=MPI.COMM_WORLD)[0]
    assert one == pytest.approx(all_of_them, rel=1e-6)


def test_a_block_and_a_plate_that_fly_keep_their_momentum():
    interior = block()
    scene = fm.System()
    part = scene.add(fm.ContinuumBody(interior), name="block")
    own = interior.frames[0]
    free = scene.connect(fm.joint.Free(), scene.ground.frame(p=own.p_BI_B), part.frame("z_max"))
    free.velocity = [0.3, 0.0, -1.0, 0.0, 0.0, 0.0]
    plate = scene.add(fm.RigidBody(2.0, (0.01, 0.01, 0.02)), name="plate")
    scene.connect(fm.joint.Free(), scene.ground.frame(p=(0.03, 0.0, -0.055)), plate.frame())
    half_space = fm.contact.HalfSpace(plate.frame())
    (contact,) = scene.touch(fm.contact.Nodes(part, "z_min"), half_space, fm.contact.Hard(mu=0.2))
    run = scene.simulate(0.03, rtol=1e-3, integrator=IMPLICIT)
    impulse = np.trapezoid(run.outer_forces(part)[contact.name], run.t, axis=0)
    v = run.velocity(plate.frame())[-1]
    assert v[2] < -0.4
    assert abs(2.0 * v + impulse).max() < 0.02 * impulse[2]
    total = sum(run.energies(part).values()) + run.energy().kinetic
    assert abs(total / total[0] - 1.0).max() < 0.05


def test_what_is_not_done_at_rest_is_refused():
    interior = block()
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    part = scene.add(fm.ContinuumBody(interior), name="block")
    scene.connect(fm.joint.Fixed(), scene.ground.frame(p=interior.frames[0].p_BI_B), part.frame("z_max"))
    floor = fm.contact.HalfSpace(scene.ground.frame(p=(0.0, 0.0, -0.06)))
    scene.touch(fm.contact.Nodes(part, "z_min"), floor, fm.contact.Hard())
    with pytest.raises(SceneError, match=r"'block'.* \(contact 'z_min on ground.*'\): its state at rest"):
        scene.equilibrium()


@pytest.mark.parametrize("kind", [ImplicitContinuum, ExplicitContinuum])
def test_a_body_with_pressures_touches(kind):
    mesh = meshes.block(0.1, 0.1, 0.1, divisions=(1, 1, 1), cell="tetrahedron", comm=MPI.COMM_SELF)
    rubber = solid_mixed.Parameters(E=1e7, nu=0.45, rho=1000.0)
    scene = fm.System()
    interior = kind(NonlinearModel(mesh, solid_mixed, rubber, degree=2, interfaces=[Interface("x_max")]))
    body = scene.add(fm.ContinuumBody(interior), name="rubber")
    flight = scene.connect(fm.joint.Free(), scene.ground.frame(), body.frame("x_max"))
    flight.position, flight.velocity = (0.1, 0, 0, 1, 0, 0, 0), (-5.0, 0, 0, 0, 0, 0)
    scene.touch(contact.Nodes(body, "x_min"), contact.HalfSpace(scene.ground.frame((-5e-4, 0, 0)), "x"), contact.Hard())
    run = scene.simulate(2e-3, **({"h": 2e-5} if kind is ImplicitContinuum else {}))
    force = run.outer_forces(body)["x_min on ground(-0.0005, 0, 0)"][:, 0]
    # what the wall gave is what the body has more: of 1 kg that flew in with 5 m/s
    impulse = np.trapezoid(force, run.t)
    energies = run.energies(body)
    assert force.min() >= 0.0
    assert impulse > 5.0
    assert linear_momentum(interior, run, body.frame("x_max"))[0] == pytest.approx(impulse - 5.0, abs=1e-4 * impulse)
    total = sum(np.asarray(value) for value in energies.values())
    assert abs(total + run.energy().total - (total + run.energy().total)[0]).max() < 0.02 * 12.5
