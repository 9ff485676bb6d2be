"""Redundant loops: reported by name, and loads shared by the smallest multipliers."""

from __future__ import annotations

import numpy as np
import pytest
from machines import slider_crank

from flexmbd.multibody.kernels.layout import new_work
from flexmbd.multibody.scene_matrices import constraint_jacobian


def test_the_smallest_multipliers_move_the_machine_alike():
    """A planar slider-crank of 3-D joints: two of five rows hold it, all share the load."""
    scene, _, crank = slider_crank(axis="y")
    crank.velocity = 20.0
    start = scene.start()
    run = scene.simulate(0.1, rtol=1e-6)
    full, kept = start.unreduced, start.scene
    assert run.multipliers.shape[1] == len(full.row_names) == 5
    assert len(kept.row_names) == 2
    work = new_work(full.plan)
    independent = [full.row_names.index(name) for name in kept.row_names]
    for k in (0, len(run.t) // 2, len(run.t) - 1):
        jacobian = constraint_jacobian(full, work, run.x[k])
        load = jacobian.T @ run.multipliers[k]
        alone, _, rank, _ = np.linalg.lstsq(jacobian[independent].T, load, rcond=None)
        assert rank == 2
        # nothing of the load is lost, and no other share is smaller: no part lies in the kernel
        assert jacobian[independent].T @ alone == pytest.approx(load, abs=1e-9 * np.abs(load).max())
        weight = np.array([1.0, 1.0, 1.0, 1.0 / full.extent, 1.0 / full.extent])
        weighted = weight * run.multipliers[k]
        _, _, vt = np.linalg.svd((jacobian / weight[:, None]).T)
        assert np.abs(vt[2:] @ weighted).max() < 1e-9 * np.abs(weighted).max()
    named = scene.explain()
    for name in kept.redundant:
        assert name in named
