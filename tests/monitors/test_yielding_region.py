"""The cuts that are proposed from a run's largest utilisations."""

from __future__ import annotations

import dataclasses

from mpi4py import MPI

import numpy as np
import pytest

import flexmbd as fm
from flexmbd import meshes
from flexmbd.continuum import ContinuumModel, Interface
from flexmbd.errors import SceneError
from flexmbd.forms import solid_linear
from flexmbd.reduction import Keep, craig_bampton

STEEL = solid_linear.Parameters(E=2.1e11, nu=0.0, rho=7850.0)
LENGTH, WIDTH, HEIGHT = 0.6, 0.01, 0.02
DEPTH = np.hypot(WIDTH, HEIGHT)
MODULUS = WIDTH * HEIGHT**2 / 6.0
FORCE, STRESS = 250.0, 1.5e8


@pytest.fixture(scope="module")
def history():
    """Of a cantilever along x that carries 250 N at its end; the body frame's axes are another three."""
    mesh = meshes.block(LENGTH, WIDTH, HEIGHT, divisions=(60, 1, 2), comm=MPI.COMM_SELF)
    axes = [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]
    ends = [Interface("x_min", axes=axes), Interface("x_max")]
    model = ContinuumModel(mesh, solid_linear, STEEL, degree=2, interfaces=ends)
    record = craig_bampton(model, modes=0, frame="x_min", keep=Keep(stress=True), geometric_stiffness=False)
    scene = fm.System()
    arm = scene.add(fm.FlexibleBody(record), name="arm")
    scene.connect(fm.joint.Fixed(), scene.ground.frame(), arm.frame("x_min"))
    run = scene.simulate(1e-4, rtol=1e-2)
    force = np.concatenate([record.R_MB.T @ (0.0, 0.0, FORCE), np.zeros(3)])
    q = record.interface("x_max").modes.T @ force / record.stiffness
    x = np.array(run.x)
    x[:, run.scene.index.modes[arm].x] = q
    loaded = dataclasses.replace(run, x=x)
    return fm.YieldMonitor(arm, yield_stress=STRESS, clearance=None).over(loaded)


def with_peaks(history, *ranges):
    """The same, with yield where x lies in ranges."""
    x = history.watched_x[:, 0]
    high = np.any([(x > low - 1e-9) & (x < high + 1e-9) for low, high in ranges], axis=0)
    return dataclasses.replace(history, peak=np.where(high, 1.2, 0.1))


def test_cantilever(history):
    """F (l - x) / Z above 0.9 of the yield stress, and a depth more, from the clamped end on."""
    (slab,) = fm.yielding_slabs(history)
    reach = LENGTH - 0.9 * STRESS * MODULUS / FORCE
    assert slab.axis == pytest.approx((1.0, 0.0, 0.0), abs=1e-9)
    assert slab.start == -np.inf
    assert slab.end == pytest.approx(reach + DEPTH, abs=0.006)  # nodes every 5 mm
    assert slab.cuts == (slab.end,)
    lower = fm.yielding_slabs(history, threshold=0.5)[0]
    assert lower.end - slab.end == pytest.approx(0.4 * STRESS * MODULUS / FORCE, abs=0.006)
    wider = fm.yielding_slabs(history, depth=0.1)[0]
    assert wider.end - slab.end == pytest.approx(0.1 - DEPTH, abs=1e-5)


def test_in_the_middle(history):
    (slab,) = fm.yielding_slabs(with_peaks(history, (0.2, 0.3)))
    assert slab.cuts == pytest.approx((0.2 - DEPTH, 0.3 + DEPTH), rel=1e-4)
    inside = slab(np.array([[0.17, 0.19, 0.25, 0.31, 0.33], np.zeros(5), np.zeros(5)]))
    np.testing.assert_array_equal(inside, [False, True, True, True, False])


def test_two_places_and_one(history):
    """Apart as long as an elastic piece of a depth fits between them."""
    apart = fm.yielding_slabs(with_peaks(history, (0.1, 0.2), (0.27, 0.35)))
    expected = [(0.1 - DEPTH, 0.2 + DEPTH), (0.27 - DEPTH, 0.35 + DEPTH)]
    assert [slab.cuts for slab in apart] == [pytest.approx(ends, rel=1e-4) for ends in expected]
    joined = fm.yielding_slabs(with_peaks(history, (0.1, 0.2), (0.25, 0.35)))
    assert [slab.cuts for slab in joined] == [pytest.approx((0.1 - DEPTH, 0.35 + DEPTH), rel=1e-4)]


def test_near_the_ends(history):
    (slab,) = fm.yielding_slabs(with_peaks(history, (0.035, 0.1)))
    assert slab.cuts == pytest.approx((0.1 + DEPTH,), rel=1e-4)
    (slab,) = fm.yielding_slabs(with_peaks(history, (0.05, 0.57)))
    assert slab.cuts == pytest.approx((0.05 - DEPTH,), rel=1e-4)
    (slab,) = fm.yielding_slabs(with_peaks(history, (0.04, 0.57)))
    assert slab.cuts == ()


def test_across(history):
    """Along another axis the depth is the part's extent across that one."""
    peaks = np.where(history.watched_x[:, 2] > 0.0, 1.2, 0.1)
    (slab,) = fm.yielding_slabs(dataclasses.replace(history, peak=peaks), axis=(0.0, 0.0, -2.0))
    assert slab.axis == (0.0, 0.0, -1.0)
    assert slab.cuts == ()


def test_nothing_yields(history):
    assert fm.yielding_slabs(dataclasses.replace(history, peak=0.5 * np.ones(len(history.watched)))) == ()


@pytest.mark.parametrize("how", [{"threshold": 0.0}, {"depth": -1.0}, {"threshold": float("nan")}])
def test_bad_input(history, how):
    with pytest.raises(SceneError, match=f"{next(iter(how))} must be (positive|a finite number)"):
        fm.yielding_slabs(history, **how)
    with pytest.raises(SceneError, match="axis must be three finite numbers"):
        fm.yielding_slabs(history, axis=(1.0, 0.0))
