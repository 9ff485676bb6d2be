"""Every kind of constraint row: its wrench and its wrench's variation against differences of its value."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import flexmbd as fm
from flexmbd.multibody.kernels.base import kinds
from flexmbd.multibody.kernels.base.arrays import new_work
from flexmbd.multibody.kernels.elements.penalty import PENALTY
from flexmbd.multibody.kernels.elements.table import element_wrench, element_wrench_variation, kind_of
from flexmbd.multibody.kernels.physics.constraint_laws import row_value, row_wrench, row_wrench_variation

DATA = 0.37
KINDS = {
    **{f"translation {k}": (kinds.ROW_TRANSLATION, k) for k in range(3)},
    **{f"direction {k}": (kinds.ROW_DIRECTION, k) for k in range(9)},
    **{f"axis {k}": (kinds.ROW_AXIS, k) for k in range(3)},
    "angle": (kinds.ROW_ANGLE, 0),
    "screw": (kinds.ROW_SCREW, 0),
    "distance": (kinds.ROW_DISTANCE, 0),
    "touch": (kinds.ROW_TOUCH, 0),
}
ROLLING = {f"roll {k}": (kinds.ROW_ROLL, k) for k in range(2)}


@pytest.fixture(scope="module")
def plan():
    """Any plan: the rows read their parameters in its data."""
    scene = fm.System()
    body = scene.add(fm.RigidBody(1.0, (1.0, 1.0, 1.0)))
    scene.connect(fm.joint.Revolute(), scene.ground.frame(), body.frame())
    return scene.compile().scene.plan.replace(data=np.array([0.0, DATA]))


def row_of(kind, index):
    return np.array([0, 0, kind, index, 1, kinds.LEVEL_POSITION, -1])


def places(seed):
    rng = np.random.default_rng(seed)
    d, dd, dtheta = rng.standard_normal((3, 3))
    R = Rotation.from_rotvec(rng.standard_normal(3)).as_matrix()
    return d, R, dd, dtheta


def moved(d, R, dd, dtheta, step):
    return d + step * dd, Rotation.from_rotvec(step * dtheta).as_matrix() @ R


def flat(d, R):
    return tuple(map(float, d)), tuple(map(float, R.ravel()))


def differences(function, step=1e-3):
    """Derivative at 0 by central differences of order 6."""
    weights = ((1, 0.75), (2, -0.15), (3, 1.0 / 60.0))
    return sum(w * (function(k * step) - function(-k * step)) for k, w in weights) / step


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("name", KINDS)
def test_wrench_is_the_gradient_of_the_value(plan, name, seed):
    row, (d, R, dd, dtheta) = row_of(*KINDS[name]), places(seed)
    force, torque = row_wrench(plan.data, row, *flat(d, R))
    expected = differences(lambda s: row_value(plan.data, row, *flat(*moved(d, R, dd, dtheta, s))))
    assert np.dot(force, dd) + np.dot(torque, dtheta) == pytest.approx(expected, abs=1e-10)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("name", {**KINDS, **ROLLING})
def test_variation_is_the_wrench_s_derivative(plan, name, seed):
    row, (d, R, dd, dtheta) = row_of(*{**KINDS, **ROLLING}[name]), places(seed)
    change = row_wrench_variation(plan.data, row, *flat(d, R), tuple(dd), tuple(dtheta))  # type: ignore[call-arg]
    expected = differences(
        lambda s: np.array(row_wrench(plan.data, row, *flat(*moved(d, R, dd, dtheta, s))))
    )
    np.testing.assert_allclose(np.array(change), expected, atol=1e-9)


@pytest.mark.parametrize("k", range(2))
def test_rolling_rows_are_the_velocity_of_the_lowest_point(plan, k):
    """The rim's point that lies lowest, found by search, as a point of the disc."""
    d, R, rate, spin = places(5)
    force, torque = row_wrench(plan.data, row_of(kinds.ROW_ROLL, k), *flat(d, R))
    angle = np.linspace(0.0, 2.0 * np.pi, 2_000_001)
    rim = DATA * (np.outer(np.cos(angle), R[:, 0]) + np.outer(np.sin(angle), R[:, 1]))
    arm = rim[np.argmin(rim[:, 2])]
    velocity = rate + np.cross(spin, arm)
    assert np.dot(force, rate) + np.dot(torque, spin) == pytest.approx(velocity[k], abs=1e-5)
    touch = row_value(plan.data, row_of(kinds.ROW_TOUCH, 0), *flat(d, R))
    assert touch == pytest.approx(d[2] + arm[2], abs=1e-10)


@pytest.mark.parametrize("turns", [-7, -1, 0, 1, 12])
def test_screw_holds_over_turns(plan, turns):
    """On the screw, turns of any number leave the residual 0; off it, the distance along it."""
    angle = 2.0 * math.pi * turns + 1.1
    R = Rotation.from_rotvec([0.0, 0.0, angle]).as_matrix()
    row = row_of(kinds.ROW_SCREW, 0)
    for off in (0.0, 0.2, -0.3):
        value = row_value(plan.data, row, *flat(np.array([0.3, 0.1, DATA * angle + off]), R))
        assert value == pytest.approx(off, abs=1e-12)


def test_angle_is_the_turn_about_z(plan):
    """A turn about z by any angle, then one about an axis across z, which leaves it."""
    row = row_of(kinds.ROW_ANGLE, 0)
    for angle in (-3.0, -0.4, 2.9):
        turn = Rotation.from_rotvec([0.9, -1.3, 0.0]) * Rotation.from_rotvec([0.0, 0.0, angle])
        value = row_value(plan.data, row, *flat(np.zeros(3), turn.as_matrix()))
        assert value == pytest.approx(angle, abs=1e-14)


@pytest.mark.parametrize("name", {**KINDS, **ROLLING})
def test_penalty_wrench_and_its_variation(plan, name):
    """-(k phi + c d phi/dt) times the unit wrench; the variation by differences of it."""
    kind, index = {**KINDS, **ROLLING}[name]
    level = kinds.LEVEL_VELOCITY if name in ROLLING else kinds.LEVEL_POSITION
    held = np.array([0, 0, kind, index, 1, level, -1])
    stiffness, damping = (0.0 if name in ROLLING else 30.0), 7.0
    penalised = plan.replace(data=np.array([0.0, DATA, stiffness, damping]), penalties=held[None])
    work = new_work(penalised)
    row = np.array([kind_of(PENALTY), 0, 0, -1, -1, -1, 2, 0, 0, 0, 0])
    d, R, dd, dtheta = places(1)
    rate, spin, drate, dspin = np.random.default_rng(2).standard_normal((4, 3))

    def wrench(s):
        place = flat(*moved(d, R, dd, dtheta, s))
        speeds = tuple(rate + s * drate), tuple(spin + s * dspin)
        return np.array(element_wrench(penalised, work, row, *place, *speeds))  # type: ignore[call-arg]

    unit = np.array(row_wrench(plan.data, held, *flat(d, R)))
    pull = stiffness * row_value(plan.data, held, *flat(d, R)) + damping * np.sum(unit * [rate, spin])
    np.testing.assert_allclose(wrench(0.0), -pull * unit, atol=1e-12 * abs(pull))
    changes = (tuple(map(float, c)) for c in (rate, spin, dd, dtheta, drate, dspin))
    change = element_wrench_variation(penalised, work, row, *flat(d, R), *changes, 1e-6)  # type: ignore[call-arg]
    np.testing.assert_allclose(np.array(change), differences(wrench), atol=1e-7)
