"""A point's place, velocity and acceleration through three flexible parents (Anthonis & Ramon 2003, eq. 1-6)."""

from __future__ import annotations

import numpy as np
import pytest
from mixed_machine import along
from particles import particle_body
from scipy.linalg import polar
from scipy.spatial.transform import Rotation

import flexmbd as fm
from flexmbd.multibody.kernels.base.arrays import new_work
from flexmbd.multibody.kernels.physics.joints import retract
from flexmbd.multibody.kernels.sampling.series import frame_series
from flexmbd.multibody.linear.output_equations import output_derivatives
from flexmbd.multibody.plan.compiled_scene import add_probe

POINT = np.array([0.07, -0.2, 0.11])
TURN = Rotation.from_rotvec([0.3, -0.5, 0.8])
# central differences of order 8: first and second derivatives
FIRST = ((1, 4.0 / 5.0), (2, -1.0 / 5.0), (3, 4.0 / 105.0), (4, -1.0 / 280.0))
SECOND = ((1, 8.0 / 5.0), (2, -1.0 / 5.0), (3, 8.0 / 315.0), (4, -1.0 / 560.0))


def boom(*, nonlinear=False):
    """Three flexible bodies, each on the tip of the one before, and a rigid one on the last tip."""
    scene = fm.System()
    sizes = ((31, 3), (32, 2), (33, 4))
    records = [particle_body(seed, modes=n, stretched=(0,), nonlinear=nonlinear).record for seed, n in sizes]
    bodies = [scene.add(fm.FlexibleBody(record), name=f"beam {k}") for k, record in enumerate(records)]
    nozzle = scene.add(fm.RigidBody(0.3, (0.01, 0.01, 0.01)), name="nozzle")
    ground = scene.ground.frame(p=(0.2, 0.1, -0.3), R=TURN.as_matrix())
    links = [
        scene.connect(fm.joint.Revolute("x"), ground, bodies[0].frame("root")),
        scene.connect(fm.joint.Spherical(), bodies[0].frame("tip"), bodies[1].frame("root")),
        scene.connect(fm.joint.Prismatic("y"), bodies[1].frame("tip"), bodies[2].frame("root")),
        scene.connect(fm.joint.Revolute("z"), bodies[2].frame("tip"), nozzle.frame()),
    ]
    return scene.compile().scene, records, bodies, nozzle, links


def turned(record, tip, q):
    """How the modes turn a tip: by their rotations, or by the polar rotation of its face's motion."""
    theta = tip.modes[3:] @ q
    if record.nonlinear is None:
        return Rotation.from_rotvec(theta)
    xx, yy, zz, yz, xz, xy = record.nonlinear.face_strain[1] @ q
    A = np.cross(np.eye(3), theta) + np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return Rotation.from_matrix(polar(np.eye(3) + A)[0])


def place(compiled, records, bodies, links, x):
    """(3,) the point's place: sums of vectors turned by products of rotations, by hand."""
    joints = [x[compiled.index.joints[link].x] for link in links]
    q = [x[compiled.index.modes[body].x] for body in bodies]
    ball = Rotation.from_quat(joints[1][[1, 2, 3, 0]])
    hinges = [Rotation.from_rotvec(joints[k][0] * np.eye(3)[axis]) for k, axis in ((0, 0), (3, 2))]
    turns = [hinges[0], ball, Rotation.identity(), hinges[1]]
    slides = [np.zeros(3), np.zeros(3), np.array([0.0, joints[2][0], 0.0]), np.zeros(3)]
    p, R = np.array([0.2, 0.1, -0.3]), TURN
    for k, (turn, slide) in enumerate(zip(turns, slides, strict=True)):
        p, R = p + R.apply(slide), R * turn
        if k < 3:
            tip = records[k].interface("tip")
            p = p + R.apply(tip.p_BI_B + tip.modes[:3] @ q[k])
            R = R * turned(records[k], tip, q[k]) * Rotation.from_matrix(tip.R_BI)
    return p + R.apply(POINT)


def state(compiled, seed):
    rng = np.random.default_rng(seed)
    x = np.empty(compiled.nx)
    retract(compiled.plan, compiled.start, 0.4 * rng.standard_normal(compiled.nv), x)
    return x, *rng.standard_normal((2, compiled.nv))


@pytest.mark.parametrize("nonlinear", [False, True])
@pytest.mark.parametrize("seed", range(3))
def test_place_velocity_and_acceleration(seed, nonlinear):
    compiled, records, bodies, nozzle, links = boom(nonlinear=nonlinear)
    x, v, a = state(compiled, seed)
    h = 0.01
    curve = {
        k: place(compiled, records, bodies, links, along(compiled, x, v, a, k * h)) for k in range(-4, 5)
    }
    velocity = sum(weight * (curve[k] - curve[-k]) for k, weight in FIRST) / h
    acceleration = sum(weight * (curve[k] - 2.0 * curve[0] + curve[-k]) for k, weight in SECOND) / h**2
    plan, out = add_probe(compiled, nozzle.frame(POINT)), np.zeros((1, 21))
    frame_series(plan, new_work(plan), len(plan.frames) - 1, x[None], v[None], a[None], out)
    np.testing.assert_allclose(out[0, :3], curve[0], atol=1e-13)
    np.testing.assert_allclose(out[0, 12:15], velocity, rtol=1e-8, atol=1e-8)
    np.testing.assert_allclose(out[0, 18:21], acceleration, rtol=1e-7, atol=1e-7)


@pytest.mark.parametrize("nonlinear", [False, True])
@pytest.mark.parametrize("seed", range(2))
def test_what_each_coordinate_changes_of_place_and_velocity(seed, nonlinear):
    """L and G of the outputs: dp = L xi and dv = L dv + G xi, against differences by each coordinate."""
    compiled, records, bodies, nozzle, links = boom(nonlinear=nonlinear)
    x, v, _ = state(compiled, seed)
    frame = nozzle.frame(POINT)
    plan = add_probe(compiled, frame)

    def motion(x):
        out = np.zeros((1, 21))
        frame_series(plan, new_work(plan), len(plan.frames) - 1, x[None], v[None], np.zeros((1, compiled.nv)), out)
        return out[0]

    h, places, velocities = 0.02, [], []
    for unit in np.eye(compiled.nv):
        moved = {k: along(compiled, x, unit, 0.0 * unit, k * h) for k in range(-4, 5) if k}
        there = {k: place(compiled, records, bodies, links, one) for k, one in moved.items()}
        places.append(sum(weight * (there[k] - there[-k]) for k, weight in FIRST) / h)
        rates = {k: motion(one)[12:15] for k, one in moved.items()}
        velocities.append(sum(weight * (rates[k] - rates[-k]) for k, weight in FIRST) / h)
    found = output_derivatives(compiled, x, v, fm.output.Velocity(frame))
    np.testing.assert_allclose(found.L, np.array(places).T, atol=1e-10)
    np.testing.assert_allclose(found.G, np.array(velocities).T, atol=1e-9)
