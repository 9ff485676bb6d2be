"""Bulk viscosity: a shock's states by Rankine and Hugoniot, its stable step, its account, snapshots, bad input."""

import numpy as np
import pytest
from scipy.optimize import brentq

from flexmbd import meshes
from flexmbd.continuum import BulkViscosity, ExplicitRun, NonlinearModel, RigidPlane, Support
from flexmbd.errors import SceneError
from flexmbd.forms import hencky_plasticity

CELLS, SPEED = 80, 0.05  # of a rod of length 1, whose waves run at 1


def shocked(viscosity):
    """A rod held aside that flies against a wall: P = -ln(stretch) / stretch, which stiffens."""
    mesh = meshes.block(1.0, 1.0 / CELLS, 1.0 / CELLS, divisions=(CELLS, 1, 1))
    material = hencky_plasticity.Parameters(E=1.0, nu=0.0, rho=1.0, yield_stress=1e6)
    return ExplicitRun(
        NonlinearModel(mesh, hencky_plasticity, material, degree=1),
        velocity=(-SPEED, 0.0, 0.0),
        planes=[RigidPlane((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), penalty=None)],
        supports=[Support(f"{axis}_{end}", y=axis == "y", z=axis == "z") for axis in "yz" for end in ("min", "max")],
        bulk_viscosity=viscosity,
    )


def stretches(run):
    """By layers: the middle's place at rest, and its length over that at rest."""
    X, x = run.motion.mesh.X[:, 0], run.motion.x[:, 0]
    at = np.arange(CELLS + 1) / CELLS
    now = np.array([x[abs(X - place) < 1e-6].mean() for place in at])
    return 0.5 * (at[1:] + at[:-1]), np.diff(now) * CELLS


def test_a_shock_has_the_states_of_rankine_and_hugoniot():
    """rho U^2 (1 - stretch) = P and v = U (1 - stretch); without viscosity the rod rings behind the shock."""
    stretch = brentq(lambda s: -np.log(s) / s * (1.0 - s) - SPEED**2, 0.5, 0.99)
    front = 0.6
    duration = front * (1.0 - stretch) / SPEED
    ringing = {}
    for name, viscosity in {"none": None, "both": BulkViscosity(), "quadratic": BulkViscosity(0.0, 1.2)}.items():
        run = shocked(viscosity)
        account = run.simulate(duration)
        place, found = stretches(run)
        behind = found[(place > 0.1) & (place < 0.5)]
        assert behind.mean() == pytest.approx(stretch, rel=3e-4)
        ringing[name] = behind.std()
        # where half of the jump is done
        assert place[np.argmax(found > 0.5 * (1.0 + stretch))] == pytest.approx(front, abs=1.5 / CELLS)
        if viscosity is not None:
            assert account.error < 5e-3
            assert account["viscous"][-1] > 0.0
    assert ringing["both"] < 0.02 * ringing["none"]
    assert ringing["quadratic"] < 0.4 * ringing["none"]


def test_the_stable_step_is_that_of_damped_vibrations():
    """Below h^2 k + 2 h c = 4 the fastest vibrations die away: the limit is found without stepping, and holds."""
    run = shocked(BulkViscosity(0.5, 0.0))
    plain = shocked(None)
    assert run.stable_step < 0.7 * plain.stable_step
    run.motion.v[:] = 1e-6 * np.random.default_rng(3).uniform(-1.0, 1.0, run.motion.v.shape)
    left = []
    for _ in range(5):
        run.simulate(run.t + 40 * run.stable_step, h=0.999 * run.stable_step, outputs=1)
        left.append(run.account["kinetic"][-1] + run.account["elastic"][-1])
    assert (np.diff(left) < 0.0).all()


def go_on(run, steps):
    """As a run does: the limit every five steps."""
    for k in range(steps):
        if k % 5 == 0:
            h = 0.9 * run.motion.renew_limit()
        run.motion.advance(h)
    return run.motion.x.copy()


def test_a_snapshot_goes_on_to_the_bit():
    run = shocked(BulkViscosity())
    go_on(run, 20)
    kept = run.motion.snapshot()
    end = go_on(run, 20)
    go_on(run, 5)
    run.motion.restore(kept)
    np.testing.assert_array_equal(go_on(run, 20), end)


@pytest.mark.parametrize(("linear", "quadratic"), [(-0.1, 1.2), (0.06, float("nan")), ("a", 1.2)])
def test_bad_input(linear, quadratic):
    with pytest.raises(SceneError, match="must be a finite number, at least 0"):
        BulkViscosity(linear, quadratic)
