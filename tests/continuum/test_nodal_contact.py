"""Surfaces of bodies with history that touch rigid shapes of the machine, in explicit steps."""

from mpi4py import MPI

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import flexmbd as fm
from flexmbd import meshes
from flexmbd.continuum import ExplicitContinuum, Interface, MpiTeam, NonlinearModel, RigidPlane
from flexmbd.errors import SceneError
from flexmbd.forms import hencky_plasticity, j2_plasticity

EXPLICIT = fm.CentralDifference()


def block(*, divisions=(2, 2, 2), yield_stress=1e9, E=1e6, planes=(), damping=0.0, comm=MPI.COMM_SELF):
    """A cube of 0.1 m and 1 kg, its upper face rigid, whose lower one is in z = -0.05."""
    mesh = meshes.block(0.1, 0.1, 0.1, divisions=divisions, comm=comm)
    material = hencky_plasticity.Parameters(
        E, 0.3, 1000.0, yield_stress, hardening=j2_plasticity.LinearHardening(1e5)
    )
    body = NonlinearModel(mesh, hencky_plasticity, material, degree=1, interfaces=[Interface("z_max")])
    return ExplicitContinuum(body, planes=planes, damping=damping)


def machine(interior, *, velocity=(0.0,) * 6, gravity=(0.0, 0.0, 0.0), R=None, comm=MPI.COMM_SELF):
    """The block flies; R turns it, and the scene with it."""
    scene = fm.System(gravity=gravity, team=MpiTeam(comm))
    part = scene.add(fm.ContinuumBody(interior), name="block")
    R = np.eye(3) if R is None else R
    at = scene.ground.frame(p=R @ interior.frames[0].p_BI_B, R=R)
    scene.connect(fm.joint.Free(), at, part.frame("z_max")).velocity = velocity
    return scene, part


def plate(scene, *, mass=2.0, p=(0.05, 0.0, -0.06), velocity=(0.0,) * 6):
    body = scene.add(fm.RigidBody(mass, mass * np.array([0.005, 0.005, 0.01])), name="plate")
    scene.connect(fm.joint.Free(), scene.ground.frame(p=p), body.frame()).velocity = velocity
    return body


def momentum(run, interior, part, others):
    """(6,) N s, N m s about the origin, of the body, its frame and rigid bodies, at the run's end."""
    frame, (own,) = part.frame("z_max"), interior.frames
    whole = interior.motion.momentum(np.zeros(3))
    bodies = [(frame, own.mass, own.com, own.inertia)]
    bodies += [(body.frame(), body.mass, np.zeros(3), np.diag(body.inertia)) for body in others]
    for at, mass, com, inertia in bodies:
        R, w = run.rotation(at)[-1], run.angular_velocity(at)[-1]
        arm = R @ com
        p, v = run.position(at)[-1] + arm, run.velocity(at)[-1] + np.cross(w, arm)
        whole = whole + np.append(mass * v, mass * np.cross(p, v) + R @ inertia @ R.T @ w)
    return whole


def test_a_block_that_hits_a_plate_keeps_momentum_and_energy():
    """It hits it beside the middle, sliding: both turn; what is lost is of the method's order, 2."""
    lost, own = [], np.array([0.3, 0.0, -1.0])
    for h in (6e-4, 3e-4):
        interior = block()
        scene, part = machine(interior, velocity=[*own, 0.0, 0.0, 0.0])
        below = plate(scene, p=(0.02, 0.0, -0.06), velocity=[0.0, 0.1, 0.0, 0.0, 0.0, 0.2])
        (contact,) = scene.touch(nodes(part), fm.contact.HalfSpace(below.frame()), fm.contact.Hard(mu=0.2))
        run = scene.simulate(0.06, h=h, integrator=EXPLICIT)
        force = run.outer_forces(part)[contact.name]
        assert force[:, 2].max() > 100.0
        assert force[-1, 2] == 0.0
        whole = momentum(run, interior, part, [below])
        begun = own + 2.0 * np.array([0.0, 0.1, 0.0])
        assert abs(whole[:3] - begun).max() < 1e-12
        spin = np.cross([0.05, 0.0, 0.0], own) + 2.0 * np.cross([0.02, 0.0, -0.06], [0.0, 0.1, 0.0])
        spin[2] += 2.0 * 0.01 * 0.2
        energies = run.energies(part)
        total = sum(energies.values()) + run.energy().kinetic
        assert energies["friction"][-1] > 0.01
        turned, gone = abs(whole[3:] - spin).max() / abs(spin).max(), abs(total / total[0] - 1.0).max()
        lost.append([turned, gone, abs(energies["contact"][-1]) / total[0]])
    coarse, fine = np.array(lost)
    assert (coarse < [1e-5, 2e-2, 3e-3]).all()
    assert (fine < 0.4 * coarse).all()


def nodes(part, **told):
    return fm.contact.Nodes(part, "z_min", **told)


TILT = Rotation.from_rotvec([0.0, 0.5, 0.0]).as_matrix()


def incline(mu, t_end=0.3, **told):
    """A block that is let go on an incline of 0.5 rad; its motion along and across it, and the force that bears it."""
    interior = block(**told)
    scene, part = machine(interior, gravity=(0.0, 0.0, -9.81), R=TILT)
    floor = fm.contact.HalfSpace(scene.ground.frame(p=TILT @ [0.0, 0.0, -0.05], R=TILT))
    (contact,) = scene.touch(nodes(part), floor, fm.contact.Hard(mu=mu))
    run = scene.simulate(t_end, integrator=EXPLICIT)
    frame = part.frame("z_max")
    moved = (run.position(frame) - run.position(frame)[0]) @ TILT
    return run.t, moved, run.velocity(frame) @ TILT, run.outer_forces(part)[contact.name] @ TILT


def test_a_block_slides_down_an_incline():
    """It is let go undeformed and bounces a little; where it bears it rubs by mu N; on the mean it goes as if rigid."""
    t, moved, v, force = incline(0.2)
    later = t > 0.1  # at first its vibrations are as fast as it slides
    assert force[later, 0].sum() == pytest.approx(-0.2 * force[later, 2].sum(), rel=1e-2)
    a = 9.81 * (np.sin(0.5) - 0.2 * np.cos(0.5))
    assert v[-1, 0] == pytest.approx(a * t[-1], rel=0.015)
    assert moved[-1, 0] == pytest.approx(a * t[-1] ** 2 / 2, rel=0.01)


def test_a_block_that_sticks_does_not_creep():
    """tan 0.5 = 0.55 < 0.7: once its bouncing has died it stands still to round-off; the ground bears its weight."""
    t, moved, _, force = incline(0.7, 1.0, damping=300.0)
    still = t > 0.8
    assert still.sum() > 50
    assert np.ptp(moved[still], axis=0).max() < 1e-9
    assert abs(moved[-1, 0]) < 1e-3
    assert force[-1] == pytest.approx(9.81 * np.array([-np.sin(0.5), 0.0, np.cos(0.5)]), abs=1e-4)


def test_a_plane_is_a_half_space_at_rest():
    """And what rolls over any shape of the machine that is the same there: a half space on a cart that stands."""
    told = []
    for way in ("plane", "shape", "body", "box"):
        planes = [RigidPlane((0.0, 0.0, -0.055), (0.0, 0.0, 1.0), name="floor")] if way == "plane" else []
        scene, part = machine(block(planes=planes), velocity=[0.0, 0.0, -1.0, 0.0, 3.0, 0.0])
        floor = {"name": "floor"}
        if way == "shape":
            half_space = fm.contact.HalfSpace(scene.ground.frame(p=(0.0, 0.0, -0.055)))
            scene.touch(nodes(part, **floor), half_space, fm.contact.Hard())
        elif way in ("body", "box"):
            heavy = plate(scene, mass=1e9, p=(0.05, 0.0, -0.155))
            on = heavy.frame(p=(0.0, 0.0, 0.1) if way == "body" else (0.0, 0.0, 0.0))
            shape = fm.contact.HalfSpace(on) if way == "body" else fm.contact.Box(on, (1.0, 1.0, 0.2))
            scene.touch(nodes(part, **floor), shape, fm.contact.Hard())
        run = scene.simulate(0.05, h=4e-4, integrator=EXPLICIT)
        frame = part.frame("z_max")
        told.append(np.hstack([run.position(frame), run.outer_forces(part)["floor"] / 1e3]))
    assert abs(told[0][:, 5]).max() > 0.1
    assert abs(told[1] - told[0]).max() < 1e-12
    assert abs(told[2] - told[0]).max() < 1e-6
    assert abs(told[3] - told[2]).max() < 1e-12


def bouncing_ball(*, comm=MPI.COMM_SELF, **told):
    """A rigid ball of steel falls on a soft slab that yields, and slides over it."""
    mesh = meshes.block(0.2, 0.2, 0.05, divisions=(8, 8, 2), comm=comm)
    material = hencky_plasticity.Parameters(1e8, 0.3, 1000.0, 5e5, hardening=j2_plasticity.LinearHardening(1e6))
    body = NonlinearModel(mesh, hencky_plasticity, material, degree=1, interfaces=[Interface("z_min")])
    interior = ExplicitContinuum(body)
    scene = fm.System(gravity=(0.0, 0.0, -9.81), team=MpiTeam(comm))
    slab = scene.add(fm.ContinuumBody(interior), name="slab")
    at = interior.frames[0].p_BI_B
    scene.connect(fm.joint.Fixed(), scene.ground.frame(p=at), slab.frame("z_min"))
    ball = scene.add(fm.RigidBody(0.5, 2e-4 * np.ones(3)), name="ball")
    free = scene.connect(fm.joint.Free(), scene.ground.frame(p=(0.1, 0.01, 0.0561)), ball.frame())
    free.velocity = [0.5, 0.0, -2.0, 0.0, 0.0, 0.0]
    (contact,) = scene.touch(
        fm.contact.Nodes(slab, "z_max"), fm.contact.Sphere(ball.frame(), 0.03), fm.contact.Hard(mu=0.3)
    )
    return scene, slab, ball, contact, scene.simulate(0.012, integrator=EXPLICIT, **told)


def test_a_ball_bounces_off_a_slab_that_yields():
    """Its energy goes into the slab, most of it for good; nothing else is lost, and friction turns it."""
    _, slab, ball, contact, run = bouncing_ball()
    energies, machine_has = run.energies(slab), run.energy()
    total = sum(energies.values()) + machine_has.kinetic + machine_has.gravitational
    begun = machine_has.kinetic[0]
    assert energies["plastic"][-1] > 0.1 * begun
    assert abs(total - total[0]).max() < 0.02 * begun
    v, w = run.velocity(ball.frame()), run.angular_velocity(ball.frame())
    assert 0.2 < v[-1, 2] < 1.9
    assert w[-1, 1] > 0.0
    force = run.outer_forces(slab)[contact.name]
    impulse = np.trapezoid(force, run.t, axis=0)
    expected = 0.5 * (v[0] - v[-1]) + 0.5 * np.array([0.0, 0.0, -9.81]) * run.t[-1]
    assert abs(impulse - expected).max() < 1e-9


def test_a_run_goes_on_to_the_bit_from_within_a_contact():
    whole = bouncing_ball(checkpoints=[2e-3])
    again = bouncing_ball(restart=whole[-1].checkpoints[0])
    memory = whole[1].interior.snapshot()
    assert memory["shape 0"].any()
    assert np.array_equal(again[-1].x[-1], whole[-1].x[-1])
    assert all(np.array_equal(part, memory[name]) for name, part in again[1].interior.snapshot().items())
    force = whole[-1].outer_forces(whole[1])[whole[3].name]
    assert abs(force[whole[-1].t < 2e-3][-1]).max() > 1.0


@pytest.mark.mpi
def test_all_ranks_together_do_what_one_does():
    one, all_of_them = bouncing_ball(), bouncing_ball(comm=MPI.COMM_WORLD)
    x, y = one[-1].x[-1], all_of_them[-1].x[-1]
    assert abs(x - y).max() < 1e-8
    first, second = (told[-1].outer_forces(told[1])[told[3].name] for told in (one, all_of_them))
    assert abs(first - second).max() < 1e-6 * abs(first).max()


def test_a_light_plate_shortens_the_stable_step():
    """Between the springs of the block's nodes it vibrates faster than the block: the run stays calm all the same."""
    kept = []
    for mass in (2.0, 0.01):
        interior = block()
        scene, part = machine(interior, velocity=[0.0, 0.0, -1.0, 0.0, 0.0, 0.0])
        below = plate(scene, mass=mass, p=(0.05, 0.0, -0.0500001))
        scene.touch(nodes(part), fm.contact.HalfSpace(below.frame()), fm.contact.Hard(mu=0.2))
        run = scene.simulate(0.02, integrator=EXPLICIT)
        total = sum(run.energies(part).values()) + run.energy().kinetic
        kept.append((len(run.t), abs(total / total[0] - 1.0).max()))
    (many, first), (more, second) = kept
    assert more > 1.5 * many
    assert max(first, second) < 0.05


def test_nodes_know_every_shape():
    """By its own numbers: distances by closed forms, and nothing inside is outside of the box of candidates."""
    scene, part = machine(block())
    at = scene.ground.frame(p=(0.0, 0.0, -9.0))
    square = np.array([(-0.2, -0.1), (0.2, -0.1), (0.2, 0.1), (-0.2, 0.1)])
    faces = fm.contact.ConvexPolytope(at, [(x, y, z) for x, y in square for z in (-0.3, 0.3)]).polytope
    triangles = [(face[0], face[k], face[k + 1]) for face in faces.faces for k in (1, 2)]
    p = np.random.default_rng(2).uniform(-0.4, 0.4, (400, 3))
    r, along = np.hypot(p[:, 0], p[:, 1]), np.maximum(abs(p[:, 2]) - 0.15, 0.0)
    inside_box = (abs(p) - [0.2, 0.1, 0.3]).max(axis=1)
    shapes = {
        fm.contact.HalfSpace(at, normal="x"): p[:, 0],
        fm.contact.Sphere(at, 0.2): np.linalg.norm(p, axis=1) - 0.2,
        fm.contact.HollowSphere(at, 0.2): 0.2 - np.linalg.norm(p, axis=1),
        fm.contact.Cylinder(at, 0.2): r - 0.2,
        fm.contact.HollowCylinder(at, 0.2): 0.2 - r,
        fm.contact.Capsule(at, 0.2, 0.3): np.hypot(r, along) - 0.2,
        fm.contact.Box(at, (0.4, 0.2, 0.6)): inside_box,
        fm.contact.Disc(at, 0.2, thickness=0.3): np.maximum(r - 0.2, abs(p[:, 2]) - 0.15),
        fm.contact.Profile(at, square): (abs(p[:, :2]) - [0.2, 0.1]).max(axis=1),
        fm.contact.TriangleSurface(at, faces.vertices + faces.middle, triangles, crease_angle=0.0): inside_box,
    }
    for (shape, expected), contact in zip(
        shapes.items(), scene.touch(nodes(part), list(shapes), fm.contact.Hard()), strict=True
    ):
        obstacle = contact.obstacle()
        found = obstacle.distances(p)
        inside = expected < 0.0
        assert inside.any(), type(shape)
        assert found[inside, 0] == pytest.approx(expected[inside], abs=1e-12), type(shape)
        assert np.array_equal(found[:, 0] < 0.0, inside)
        assert np.linalg.norm(found[:, 1:], axis=1) == pytest.approx(1.0, abs=1e-12)
        low, high = obstacle.box
        assert ((p > low) & (p < high)).all(axis=1)[inside].all(), type(shape)


def test_wrong_contacts_are_refused():
    scene, part = machine(block())
    ground = scene.ground.frame(p=(0.0, 0.0, -0.2))
    floor, hard = fm.contact.HalfSpace(ground), fm.contact.Hard()
    with pytest.raises(SceneError, match=r"no group of facets 'bottom'; it has .*'z_min'"):
        fm.contact.Nodes(part, "bottom")
    with pytest.raises(SceneError, match="penalty must be None or between 0 and 3"):
        nodes(part, penalty=4.0)
    with pytest.raises(SceneError, match=r"must be a fm\.ContinuumBody"):
        fm.contact.Nodes(fm.RigidBody(1.0, (1.0, 1.0, 1.0)), "z_min")
    with pytest.raises(SceneError, match=r"touch by fm\.contact\.Hard"):
        scene.touch(nodes(part), floor, fm.contact.PowerLaw(k=1e5))
    with pytest.raises(SceneError, match=r"restitution = 0\.5 is of rigid bodies"):
        scene.touch(nodes(part), floor, fm.contact.Hard(restitution=0.5))
    with pytest.raises(SceneError, match=r"what .* touch"):
        scene.touch(nodes(part), fm.contact.Vertex(ground), hard)
    with pytest.raises(SceneError, match="has no thickness"):
        scene.touch(nodes(part), fm.contact.Disc(ground, 0.1), hard)
    with pytest.raises(SceneError, match=r"what .* touch"):
        scene.touch(nodes(part), fm.contact.Nodes(part, "x_min"), hard)
    scene.touch(nodes(part), floor, hard)
    with pytest.raises(SceneError, match="already"):
        scene.touch(nodes(part), floor, hard)
    light = plate(scene, p=(0.0, 0.0, -0.2))
    with pytest.raises(SceneError, match="gives way: give a penalty"):
        scene.touch(nodes(part, penalty=None), fm.contact.HalfSpace(light.frame()), hard)
    scene.touch(nodes(part), fm.contact.Sphere(light.frame(), 0.01), hard)
    with pytest.raises(SceneError, match=r"touches a shape or a body that gives way .*'z_min on plate'"):
        scene.simulate(1e-3, integrator=fm.CentralDifference(subcycle=True))
    other, stranger = machine(block())
    with pytest.raises(SceneError, match="not in this scene"):
        other.touch(nodes(part), fm.contact.HalfSpace(other.ground.frame()), hard)
    inside = fm.contact.HalfSpace(other.ground.frame(p=(0.0, 0.0, -0.04)))
    other.touch(nodes(stranger), inside, hard)
    with pytest.raises(SceneError, match=r"'z_min on ground.*' *: the body begins 0.01 m inside what it touches"):
        other.simulate(1e-3, integrator=EXPLICIT)


def test_nodes_of_a_frame_do_not_stop_by_themselves():
    scene, part = machine(block())
    floor = fm.contact.HalfSpace(scene.ground.frame(p=(-0.2, 0.0, 0.0)), normal="x")
    scene.touch(fm.contact.Nodes(part, "x_min", penalty=None), floor, fm.contact.Hard())
    with pytest.raises(SceneError, match="move with a frame"):
        scene.simulate(1e-3, integrator=EXPLICIT)
