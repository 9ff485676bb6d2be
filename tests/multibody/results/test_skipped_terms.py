"""What ``explain`` says is skipped: the kernels do not read it, and what is left out exerts nothing."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from particles import particle_body

import flexmbd as fm
from flexmbd.multibody.kernels.base.arrays import new_work
from flexmbd.multibody.kernels.forward_dynamics import articulated_layout as to
from flexmbd.multibody.kernels.forward_dynamics.articulated import forward_dynamics
from flexmbd.multibody.kernels.inverse_dynamics.residual import residual

IN_PLANE = "out of the plane of the hinges"
IDENTITY = "rotations between the axes of"


def _chain(axes: str, *, force: Callable[[fm.joint.Connection], object] | None = None) -> fm.System:
    """Three links on joints: x, y, z a hinge about that axis, p a slide along z."""
    scene = fm.System(gravity=(0.3, -9.81, 0.2))
    frame = scene.ground.frame()
    for axis in axes:
        body = scene.add(fm.RigidBody(1.3, (0.02, 0.03, 0.04), (0.2, 0.1, 0.0)))
        joint = fm.joint.Prismatic("z") if axis == "p" else fm.joint.Revolute(axis)  # type: ignore[arg-type]
        connection = scene.connect(joint, frame, body.frame())
        connection.position, connection.velocity = 0.4, 1.7
        if force is not None:
            scene.add_force(force(connection))  # type: ignore[type-var]
        frame = body.frame(p=(0.5, 0.0, 0.0))
    return scene


def _accelerations(scene: fm.System, spoilt: str, columns: slice) -> np.ndarray:
    """The start's accelerations by a recursion whose table ``spoilt`` holds NaN in some columns."""
    start = scene.start()
    plan = start.scene.plan
    work, aw = new_work(plan), to.new_articulated_work(plan)
    getattr(aw, spoilt)[:, columns] = np.nan
    a = np.zeros(start.scene.nv)
    forward_dynamics(plan, work, aw, start.x, start.v, a, np.zeros(0))
    return a


#: Entries of the inertia tensor xx .. zz that turning about z does not ask for.
OUT_OF_PLANE = slice(to.C_INERTIA, to.C_INERTIA + 5)
PARENTS_AXES = slice(to.X_R, to.X_R + 9)


@pytest.mark.parametrize(("axes", "planar"), [("zzz", True), ("z", True), ("zyz", False), ("zpz", False)])
def test_parallel_hinges_ask_for_no_inertia_out_of_their_plane(axes: str, planar: bool) -> None:
    scene = _chain(axes)
    found = _accelerations(scene, "constant", OUT_OF_PLANE)
    assert (IN_PLANE in scene.explain()) == planar == bool(np.isfinite(found).all())
    if planar:
        np.testing.assert_allclose(found, scene.start().a, rtol=1e-12)


@pytest.mark.parametrize(("axes", "aligned"), [("zpz", 3), ("pzz", 3), ("zyz", 1)])
def test_joints_along_their_parents_axes_turn_nothing(axes: str, aligned: int) -> None:
    scene = _chain(axes)
    assert f"{IDENTITY} {aligned} of 3 joints" in scene.explain()
    found = _accelerations(scene, "axes", PARENTS_AXES)
    assert bool(np.isfinite(found).all()) == (aligned == 3)


def _idle(connection: fm.joint.Connection) -> list[object]:
    child, ground = connection.child, connection.parent
    return [
        fm.force.JointSpring(connection, 0.0, rest=0.3),
        fm.force.JointDamper(connection, 0.0),
        fm.force.JointFriction(connection, 0.0, regularisation=1e-3),
        fm.force.SpringDamper(ground, child, 0.0, 0.1),
        fm.force.Bushing(ground, child, np.zeros(6)),
        fm.force.FrameForce(child, (0.0, 0.0, 0.0)),
    ]


@pytest.mark.parametrize("which", range(6))
def test_forces_that_exert_nothing_have_no_rows(which: int) -> None:
    scene = _chain("zzz", force=lambda connection: _idle(connection)[which])
    compiled = scene.compile().scene
    assert len(compiled.plan.elements) == 0
    assert len(compiled.idle_elements) == 3
    assert "3 force elements that exert nothing" in scene.explain()
    bare = _chain("zzz").simulate(0.1, integrator=fm.ExplicitRungeKutta())
    np.testing.assert_array_equal(scene.simulate(0.1, integrator=fm.ExplicitRungeKutta()).x, bare.x)


def test_a_spring_that_may_get_a_stiffness_keeps_its_row() -> None:
    springs: list[fm.force.JointSpring] = []

    def spring(connection: fm.joint.Connection, stiffness: float = 0.0) -> fm.force.JointSpring:
        springs.append(fm.force.JointSpring(connection, stiffness))
        return springs[-1]

    scene = _chain("zzz", force=spring)
    machine = scene.compile(parameters={"k": [fm.parameter.OfForce(springs[1], "stiffness")]})
    assert len(machine.scene.plan.elements) == 1
    assert len(machine.scene.idle_elements) == 2
    method = fm.ExplicitRungeKutta()
    stiff = _chain("zzz", force=lambda connection: spring(connection, 40.0 if len(springs) == 4 else 0.0))
    np.testing.assert_array_equal(
        machine.simulate(0.1, integrator=method, k=40.0).x, stiff.simulate(0.1, integrator=method).x
    )
    without = _chain("zzz").simulate(0.1, integrator=method)
    np.testing.assert_array_equal(machine.simulate(0.1, integrator=method).x, without.x)
    assert not np.array_equal(machine.simulate(0.1, integrator=method, k=40.0).x, without.x)


def test_a_force_may_vanish_in_a_variant() -> None:
    laid: list[fm.force.FrameForce] = []

    def push(connection: fm.joint.Connection) -> fm.force.FrameForce:
        laid.append(fm.force.FrameForce(connection.child, (0.0, 2.0, 0.0)))
        return laid[-1]

    scene, method = _chain("zyz", force=push), fm.ExplicitRungeKutta()
    machine = scene.compile(parameters={"push": [fm.parameter.OfForce(one, "force") for one in laid]})
    without = _chain("zyz").simulate(0.1, integrator=method)
    found = machine.simulate(0.1, integrator=method, push=(0.0, 0.0, 0.0))
    np.testing.assert_allclose(found.x[-1], without.x[-1], rtol=1e-9)
    assert np.abs(machine.simulate(0.1, integrator=method).x[-1] - without.x[-1]).max() > 1e-3


@pytest.mark.parametrize("damping", [0.0, 0.3])
@pytest.mark.parametrize("stretched", [(), (1, 2)])
def test_resting_frames_leave_springs_and_dampers(damping: float, stretched: tuple[int, ...]) -> None:
    """K q + D dq/dt where nothing stiffens; on a frame that rests there is no more."""
    record = particle_body(3, modes=4, damping=damping, stretched=stretched).record
    scene = fm.System()
    body = scene.add(fm.FlexibleBody(record))
    scene.connect(fm.joint.Fixed(), scene.ground.frame(), body.frame("root"))
    text = scene.explain()
    assert ("modal damping (zero)" in text) == (damping == 0.0)
    assert ("geometric stiffening (in no record" in text) == (not stretched)
    assert "Coriolis and centrifugal terms" in text
    compiled = scene.compile().scene
    rng = np.random.default_rng(1)
    q, rate, out = rng.standard_normal(4) * 0.1, rng.standard_normal(4), np.zeros(compiled.nv)
    residual(compiled.plan, new_work(compiled.plan), q, rate, np.zeros(4), np.zeros(0), out)
    linear = record.stiffness * q + record.damping @ rate
    assert np.allclose(out, linear, rtol=1e-12, atol=1e-12) == (not stretched)
