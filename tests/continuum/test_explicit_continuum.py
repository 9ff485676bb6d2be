"""Bodies with history between frames, explicitly: against multipliers, against a run of their own, to the bit."""

from mpi4py import MPI

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import flexmbd as fm
from flexmbd import meshes
from flexmbd.continuum import ExplicitContinuum, ExplicitRun, Interface, MpiTeam, NonlinearModel, RigidPlane, Support
from flexmbd.continuum.finite_elements.lumping import lumped_mass
from flexmbd.errors import InterfaceError, SceneError
from flexmbd.forms import hencky_plasticity, j2_plasticity
from flexmbd.multibody.bodies.continuum_body import ExplicitInterior, FrameMotion

PART = fm.RigidBody(30.0, np.array([[1.0, 0.1, 0.0], [0.1, 1.5, -0.2], [0.0, -0.2, 2.0]]), (0.2, -0.05, 0.1))
EXPLICIT = fm.CentralDifference()


def body(form=hencky_plasticity, names=("x_max",), *, E=1e6, yield_stress=2e4, comm=MPI.COMM_SELF):
    mesh = meshes.block(1.0, 0.3, 0.4, divisions=(3, 1, 1), comm=comm)
    material = form.Parameters(E, 0.3, 1000.0, yield_stress, hardening=j2_plasticity.LinearHardening(1e5))
    return NonlinearModel(mesh, form, material, degree=1, interfaces=[Interface(name) for name in names])


def machine(interior, *, velocity, at, gravity=(0.0, 0.0, 0.0), comm=MPI.COMM_SELF):
    scene = fm.System(gravity=gravity, team=MpiTeam(comm))
    part = scene.add(fm.ContinuumBody(interior), name="part")
    frame = part.frame(interior.frames[0].name)
    free = scene.connect(fm.joint.Free(), scene.ground.frame(p=at), frame)
    free.velocity = velocity
    return scene, frame


def skew(r):
    return np.array([[0.0, -r[2], r[1]], [r[2], 0.0, -r[0]], [-r[1], r[0], 0.0]])


def test_it_is_an_explicit_interior():
    assert isinstance(ExplicitContinuum(body()), ExplicitInterior)


def test_the_frame_has_the_mass_of_its_part_and_its_nodes():
    """Eq. 51, from point masses one by one."""
    interior = ExplicitContinuum(body(), rigid_parts={"x_max": PART})
    frame = interior.frames[0]
    masses, X = interior.motion.masses, interior.motion.mesh.X
    near = X[:, 0] > 1.0 - 1e-9
    m, r = masses[near], X[near] - frame.p_BI_B
    mass = m.sum() + 30.0
    com = (m @ r + 30.0 * np.array(PART.com)) / mass
    inertia = PART.inertia - 30.0 * skew(np.array(PART.com) - com) @ skew(np.array(PART.com) - com)
    inertia = inertia - sum(mi * skew(ri - com) @ skew(ri - com) for mi, ri in zip(m, r, strict=True))
    assert frame.mass == pytest.approx(mass, rel=1e-13)
    assert interior.mass + m.sum() == pytest.approx(120.0, rel=1e-12)
    assert abs(frame.com - com).max() < 1e-13
    assert abs(frame.inertia - inertia).max() < 1e-12


def test_local_elimination_equals_explicit_multipliers():
    """Small motions of a block with a rigid part: seed equations with the multipliers of the bonds kept."""
    soft = body(j2_plasticity, yield_stress=1e9)
    n, m = soft.n_owned, lumped_mass(soft)
    K = np.array([soft.force(1e-6 * unit) / 1e-6 for unit in np.eye(n)]).T
    soft.revert()
    interior = ExplicitContinuum(soft, rigid_parts={"x_max": PART})
    P, X, size = interior.frames[0].p_BI_B, interior.motion.mesh.X, 1e-7
    near = np.flatnonzero(X[:, 0] > 1.0 - 1e-9)
    # unknowns: all nodes, and the rigid part by its centre of mass; velocity of its point p: v + w x (p - com)
    com = P + np.array(PART.com)
    M = np.zeros((n + 6, n + 6))
    M[range(n), range(n)] = m
    M[n : n + 3, n : n + 3], M[n + 3 :, n + 3 :] = 30.0 * np.eye(3), PART.inertia
    C = np.zeros((3 * len(near), n + 6))
    for k, node in enumerate(near):
        rows = slice(3 * k, 3 * k + 3)
        C[rows, 3 * node : 3 * node + 3] = np.eye(3)
        C[rows, n : n + 3], C[rows, n + 3 :] = -np.eye(3), skew(X[node] - com)
    saddle = np.block([[M, C.T], [C, np.zeros((len(C), len(C)))]])
    stiff = np.zeros_like(M)
    stiff[:n, :n] = K
    w = size * np.array([3.0, -2.0, 4.0])
    start = np.zeros(n + 6)
    for k, x in enumerate(X):
        start[3 * k : 3 * k + 3] = np.cross(w, x - P) + size * np.array([1.0, 2.0, -1.0])
    start[n : n + 3] = np.cross(w, com - P) + size * np.array([1.0, 2.0, -1.0])
    start[n + 3 :] = w
    # the far end moves on its own way
    far = np.flatnonzero(X[:, 0] < 1e-9)
    start.reshape(-1, 3)[far] += size * np.array([20.0, -10.0, 5.0])
    h, steps = 0.5 * interior.stable_step(), 100
    q, v = np.zeros(n + 6), start

    def accelerations(q):
        return np.linalg.solve(saddle, np.append(-stiff @ q, np.zeros(len(C))))[: n + 6]

    a = accelerations(q)
    for _ in range(steps):
        q = q + h * v + h * h / 2 * a
        last, a = a, accelerations(q)
        v = v + h / 2 * (last + a)

    begin = interior.begin

    def pushed(t, motion, gravity):
        wrenches = begin(t, motion, gravity)
        interior.motion.v[far] += size * np.array([20.0, -10.0, 5.0])
        return wrenches

    interior.begin = pushed  # type: ignore[method-assign]
    scene, frame = machine(interior, velocity=[*(size * np.array([1.0, 2.0, -1.0])), *w], at=P)
    run = scene.simulate(h * steps, h=h, integrator=EXPLICIT)
    moved = run.position(frame)[-1] - P
    expected = q[n : n + 3] - np.cross(q[n + 3 :], com - P)
    assert abs(moved - expected).max() < 1e-5 * abs(expected).max()
    free = np.setdiff1d(np.arange(n // 3), near)
    assert abs(interior.motion.x - X - q[:n].reshape(-1, 3))[free].max() < 1e-5 * abs(q).max()


@pytest.mark.parametrize("form", [hencky_plasticity, j2_plasticity])
def test_a_free_body_in_a_machine_keeps_its_momentum_and_flies_as_alone(form):
    """A block that turns and is pushed down by its weight; alone, all its nodes are free, and its strains small."""
    stiff = {"E": 1e8, "yield_stress": 1e9}
    interior = ExplicitContinuum(body(form, **stiff))
    P, w, v0 = interior.frames[0].p_BI_B, np.array([1.0, -2.0, 3.0]), np.array([0.3, -0.2, 0.1])
    g = np.array([0.0, 0.0, -9.81])
    h = 0.5 * interior.stable_step()
    scene, frame = machine(interior, velocity=[*v0, *w], at=P, gravity=g)
    run = scene.simulate(300 * h, h=h, integrator=EXPLICIT)
    alone = ExplicitRun(body(form, **stiff), velocity=lambda x: v0 + np.cross(w, x - P), gravity=g)
    alone.simulate(300 * h, h=h, outputs=1)
    assert abs(interior.motion.x - alone.motion.x)[interior.motion.mesh.X[:, 0] < 0.99].max() < 2e-5
    # the whole momentum: that of nodes that are free, and that of the frame with the nodes bonded to it
    T, mass = 300 * h, interior.frames[0].mass
    bonded = mass * run.velocity(frame)[-1] + mass * np.cross(
        run.angular_velocity(frame)[-1], run.rotation(frame)[-1] @ interior.frames[0].com
    )
    whole = interior.motion.momentum(np.zeros(3))[:3] + bonded
    begun = 120.0 * (v0 + np.cross(w, [-0.5, 0.0, 0.0]))
    assert abs(whole - begun - 120.0 * g * T).max() < 1e-9 * abs(begun).max()


def test_one_step_of_the_machine_is_several_of_the_body():
    """A frame that is pulled evenly and turns: four steps at once are four by themselves, and their mean push."""
    whole, parts = ExplicitContinuum(body()), ExplicitContinuum(body())
    P, v, a = whole.frames[0].p_BI_B, np.array([1.0, 0.5, -0.5]), np.array([20.0, 0.0, 10.0])
    w = np.array([0.0, 0.0, 8.0])

    def frames(t):
        zero = np.zeros((1, 3))
        R = Rotation.from_rotvec(t * w).as_matrix()
        return FrameMotion((P + t * v + t * t / 2 * a)[None], R[None], (v + t * a)[None], w[None], a[None], zero)

    h = 0.9 * whole.stable_step()
    for interior in (whole, parts):
        interior.begin(0.0, frames(0.0), np.zeros(3))
    at_once = whole.advance(4 * h, frames(0.0), frames(4 * h))
    pushes = [parts.advance(h, frames(k * h), frames((k + 1) * h)) for k in range(4)]
    size = abs(at_once.end).max()
    assert size > 100.0
    assert abs(at_once.end - pushes[-1].end).max() < 1e-11 * size
    assert abs(at_once.mean - np.mean([push.mean for push in pushes], axis=0)).max() < 1e-11 * size
    assert abs(at_once.mean - at_once.end).max() > 1e-3 * size
    assert abs(whole.motion.x - parts.motion.x).max() < 1e-13


def test_a_snapshot_goes_on_to_the_bit():
    planes, supports = [RigidPlane((-0.02, 0.0, 0.0), (1.0, 0.0, 0.0))], [Support("y_min", y=True)]
    told = []
    for _ in range(2):
        interior = ExplicitContinuum(body(), planes=planes, supports=supports)
        scene, frame = machine(interior, velocity=[-3.0, 0.0, 0.5, 0.0, 0.0, 0.0], at=interior.frames[0].p_BI_B)
        run = scene.simulate(0.05, h=5e-4, integrator=EXPLICIT, checkpoints=[0.02])
        told.append((run.position(frame)[-1], interior.energies(), interior.snapshot()))
        if len(told) == 1:
            again = scene.simulate(0.05, h=5e-4, integrator=EXPLICIT, restart=run.checkpoints[0])
            told.append((again.position(frame)[-1], interior.energies(), interior.snapshot()))
    for p, energies, memory in told[1:]:
        assert np.array_equal(p, told[0][0])
        assert energies == told[0][1]
        assert all(np.array_equal(part, told[0][2][name]) for name, part in memory.items())
    assert told[0][1]["plastic"] > 0.0
    assert told[0][1]["contact"] != 0.0


@pytest.mark.mpi
def test_all_ranks_together_do_what_one_does():
    """From a checkpoint on as well."""
    told = []
    for comm in (MPI.COMM_WORLD, MPI.COMM_SELF):
        interior = ExplicitContinuum(body(comm=comm), rigid_parts={"x_max": PART})
        at, velocity = interior.frames[0].p_BI_B, [0.3, 0.1, 0.5, 1.0, -6.0, 8.0]
        scene, frame = machine(interior, velocity=velocity, at=at, comm=comm)
        run = scene.simulate(0.2, h=1e-3, integrator=EXPLICIT, checkpoints=[0.1])
        again = scene.simulate(0.2, h=1e-3, integrator=EXPLICIT, restart=run.checkpoints[0])
        energies = np.array([*interior.energies().values()])
        told.append((run.position(frame)[-1], again.position(frame)[-1], energies))
    (p, p_again, energies), (q, _, alone) = told
    assert abs(p - q).max() < 1e-10
    assert abs(p_again - p).max() < 1e-12
    assert abs(energies - alone).max() < 1e-9 * abs(alone).max()
    assert alone[2] > 0.0


def test_bad_input():
    with pytest.raises(InterfaceError, match="needs an interface"):
        ExplicitContinuum(body(names=()))
    with pytest.raises(InterfaceError, match=r"rigid parts \['left'\]"):
        ExplicitContinuum(body(), rigid_parts={"left": PART})
    interior = ExplicitContinuum(body())
    scene, _ = machine(interior, velocity=[0.0] * 6, at=interior.frames[0].p_BI_B)
    with pytest.raises(SceneError, match="above the stable step"):
        scene.simulate(0.1, h=1.1 * interior.stable_step(), integrator=EXPLICIT)
