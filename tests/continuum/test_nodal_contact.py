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
GROUND = "z_min on ground"


def block(*, divisions=(2, 2, 2), yield_stress=1e9, E=1e6, planes=(), comm=MPI.COMM_SELF):
    """A cube of 0.1 m and 1 kg, its upper face rigid, whose lower one is in z = -0.05."""
    mesh = meshes.block(0.1, 0.1, 0.1, divisions=divisions, comm=comm)
    material = hencky_plasticity.Parameters(
        E, 0.3, 1000.0, yield_stress, hardening=j2_plasticity.LinearHardening(1e5)
    )
    body = NonlinearModel(mesh, hencky_plasticity, material, degree=1, interfaces=[Interface("z_max")])
    return ExplicitContinuum(body, planes=planes)


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


def test_a_block_on_a_plate_that_flies_keeps_momentum_and_energy():
    """It hits it beside the middle, sliding: both turn; the energy's error is that of a method of order 2."""
    drifts = []
    for share in (0.8, 0.4):
        interior = block()
        scene, part = machine(interior, velocity=[0.3, 0.0, -1.0, 0.0, 0.0, 0.0])
        below = plate(scene, p=(0.02, 0.0, -0.06), velocity=[0.0, 0.1, 0.0, 0.0, 0.0, 0.2])
        (contact,) = scene.touch(
            fm.contact.Nodes(part, "z_min"), fm.contact.HalfSpace(below.frame()), fm.contact.Hard(mu=0.2)
        )
        begun = momentum(scene.at_start(), interior, part, [below])
        begun[:] = 0.0
        own = interior.frames[0]
        run = scene.simulate(0.06, h=share * own_step(interior), integrator=EXPLICIT)
        force = run.outer_forces(part)[contact.name]
        assert force[:, 2].max() > 100.0
        assert force[-1, 2] == 0.0
        expected = np.array([0.3, 0.0, -1.0]) + 2.0 * np.array([0.0, 0.1, 0.0])
        whole = momentum(run, interior, part, [below])
        assert abs(whole[:3] - expected).max() < 1e-12
        spin = np.cross([0.05, 0.0, 0.0], [0.3, 0.0, -1.0]) + 2.0 * np.cross([0.02, 0.0, -0.06], [0.0, 0.1, 0.0])
        spin[2] += 2.0 * 0.01 * 0.2
        drift = abs(whole[3:] - spin).max() / abs(spin).max()
        energies = run.energies(part)
        total = sum(energies.values()) + run.energy().kinetic
        drifts.append((drift, abs(total[-1] - total[0]) / total[0], energies["friction"][-1]))
    print(drifts)
    (first, second) = drifts


def own_step(interior):
    return interior.motion.limit


def test_incline():
    for mu in (0.2, 0.7):
        R = Rotation.from_rotvec([0.0, 0.5, 0.0]).as_matrix()
        interior = block()
        scene, part = machine(interior, gravity=(0.0, 0.0, -9.81), R=R)
        floor = fm.contact.HalfSpace(scene.ground.frame(p=R @ [0.0, 0.0, -0.05], R=R))
        scene.touch(fm.contact.Nodes(part, "z_min"), floor, fm.contact.Hard(mu=mu))
        run = scene.simulate(0.3, integrator=EXPLICIT)
        x = (run.position(part.frame("z_max")) - run.position(part.frame("z_max"))[0]) @ R
        a = 9.81 * (np.sin(0.5) - mu * np.cos(0.5))
        print(mu, x[-1], 0.5 * a * 0.09, run.energies(part)["friction"][-1], run.energies(part)["contact"][-1])
        v = run.velocity(part.frame("z_max")) @ R
        print(v[-1], a * 0.3, len(run.t), abs(v[-50:]).max(axis=0))


def test_plane_is_shape():
    told = []
    for way in range(2):
        planes = [RigidPlane((0.0, 0.0, -0.055), (0.0, 0.0, 1.0))] if way else []
        interior = block(planes=planes)
        scene, part = machine(interior, velocity=[0.0, 0.0, -1.0, 0.0, 3.0, 0.0])
        if not way:
            scene.touch(fm.contact.Nodes(part, "z_min"), fm.contact.HalfSpace(scene.ground.frame(p=(0, 0, -0.055))), fm.contact.Hard())
        run = scene.simulate(0.05, h=4e-4, integrator=EXPLICIT)
        told.append(run.position(part.frame("z_max"))[-1])
        print(told[-1], {k: v[-1] for k, v in run.energies(part).items()}, {k: abs(v).max() for k, v in run.outer_forces(part).items()})
