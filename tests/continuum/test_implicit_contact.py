"""Surfaces of bodies with history that touch rigid shapes of the machine, solved for at a step's end."""

from mpi4py import MPI

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import flexmbd as fm
from flexmbd import meshes
from flexmbd.continuum import ExplicitContinuum, ImplicitContinuum, Interface, MpiTeam, NonlinearModel
from flexmbd.errors import SceneError
from flexmbd.forms import hencky_plasticity, j2_plasticity, solid_linear
from flexmbd.multibody.bodies.continuum_body import FrameMotion, Scheme

RIGID, AVERAGED = fm.Coupling
IMPLICIT, EXPLICIT = fm.GeneralizedAlpha(), fm.CentralDifference()
H = 2e-3
SCHEME = Scheme(1.0 / 3.0, 4.0 / 9.0, 25.0 / 81.0, 11.0 / 18.0)


def block(kind=ImplicitContinuum, *, coupling=RIGID, comm=MPI.COMM_SELF, **told):
    """A cube of 0.1 m and 1 kg, held by its upper face; its lower one is in z = -0.05."""
    mesh = meshes.block(0.1, 0.1, 0.1, divisions=(2, 2, 2), comm=comm)
    material = hencky_plasticity.Parameters(1e6, 0.3, 1000.0, 1e9, hardening=j2_plasticity.LinearHardening(1e5))
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
        self._p = p + [[0.0, 0.0, -2e-3], [1.5e-3, 0.0, 1e-3]]
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
    """tan 0.5 = 0.55 < 0.7: once its bouncing has died it stands still to round-off."""
    run, _, moved, _, force = incline(0.7, 1.2, h=5e-3)
    still = run.t > 1.0
    assert np.ptp(moved[still], axis=0).max() < 1e-9
    assert abs(moved[-1, 0]) < 1e-3
    assert force[-1] == pytest.approx(9.81 * np.array([-np.sin(0.5), 0.0, np.cos(0.5)]), abs=1e-5)


def pressed(kind, integrator, *, way=1e-3, t_end=0.4, **told):
    """A block that is held is pressed by a plate that rises slowly, and rubbed by one that then moves aside."""
    interior = block(kind, **({"damping": 100.0} if kind is ExplicitContinuum else {}))
    scene = fm.System()
    part = scene.add(fm.ContinuumBody(interior), name="block")
    scene.connect(fm.joint.Fixed(), scene.ground.frame(p=interior.frames[0].p_BI_B), part.frame("z_max"))
    plate = scene.add(fm.RigidBody(100.0, (1.0, 1.0, 1.0)), name="plate")
    rail = scene.connect(fm.joint.Prismatic((0.6, 0.0, 1.0)), scene.ground.frame(p=(0.05, 0.0, -0.05)), plate.frame())
    t = np.linspace(0.0, t_end, 41)
    rail.prescribe(fm.Table(t, way * np.hypot(1.0, 0.6) * (t / t_end) ** 2 * (3.0 - 2.0 * t / t_end)))
    nodes = fm.contact.Nodes(part, "z_min", penalty=2.0, stiffness_ratio=100.0)
    (contact,) = scene.touch(nodes, fm.contact.HalfSpace(plate.frame()), fm.contact.Hard(mu=0.3))
    return scene.simulate(t_end, integrator=integrator, **told), part, contact


def test_implicit_and_explicit_steps_press_alike():
    """Their contact's stiffness in series with the block's: explicit nodes enter by more."""
    ends = []
    for kind, integrator, told in (
        (ImplicitContinuum, IMPLICIT, {"h": 0.02}),
        (ExplicitContinuum, EXPLICIT, {}),
    ):
        run, part, contact = pressed(kind, integrator, **told)
        ends.append(run.outer_forces(part)[contact.name][-1])
    implicit, explicit = ends
    assert implicit[2] > 50.0
    assert abs(implicit[0]) > 10.0
    assert abs(implicit - explicit).max() < 0.05 * implicit[2]


def test_a_run_goes_on_to_the_bit_from_within_a_contact():
    whole, part, contact = pressed(ImplicitContinuum, IMPLICIT, h=0.02, checkpoints=[0.2])
    again, other, _ = pressed(ImplicitContinuum, IMPLICIT, h=0.02, restart=whole.checkpoints[0])
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
    """The circle of contact is 0.6 to 1.2 cells wide. A layer on a rigid base is 1.15 times stiffer (Dimitriadis et al.
    2002, at this depth) where it has no sides, which this slab has at 6.7 times the contact's radius."""
    shares = [force / hertz for force, hertz in map(indented, (4, 6, 8))]
    assert shares[0] < shares[1] < shares[2]
    assert 0.6 < shares[0]
    assert 1.0 < shares[2] < 1.15


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
    (contact,) = scene.touch(fm.contact.Nodes(part, "z_min"), fm.contact.HalfSpace(plate.frame()), fm.contact.Hard(mu=0.2))
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
