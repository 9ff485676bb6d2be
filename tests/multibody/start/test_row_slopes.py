"""Slopes of constraint rows, by sweeps over the machine and row by row, against the rows' own rates."""

from __future__ import annotations

import numpy as np
import pytest
from particles import particle_body

import flexmbd as fm
from flexmbd.multibody.kernels.base.arrays import new_work
from flexmbd.multibody.kernels.physics.joints import retract
from flexmbd.multibody.plan.scene_matrices import constraint_slopes, constraint_values


def ladder(windows: int, *, soft: bool = False) -> fm.System:
    """Windows that share their bars, and a gear between the first two; with ``soft`` a reduced body at the end."""
    scene, hinge = fm.System(gravity=(0.0, -9.81, 0.0)), fm.joint.Revolute("z")
    left, right, drives = scene.ground.frame(), scene.ground.frame(p=(1.0, 0.0, 0.0)), []
    for _ in range(windows):
        rail, rung, other = (scene.add(fm.RigidBody(1.0, (0.1, 0.1, 0.1), (0.0, -0.5, 0.0))) for _ in range(3))
        drives.append(scene.connect(hinge, left, rail.frame()))
        scene.connect(fm.joint.Universal("z", "x"), rail.frame(p=(0.0, -1.0, 0.0)), rung.frame())
        scene.connect(hinge, rung.frame(p=(1.0, 0.0, 0.0)), other.frame(p=(0.0, -1.0, 0.0)))
        scene.connect(hinge, right, other.frame())
        left, right = rail.frame(p=(0.0, -1.0, 0.0)), other.frame(p=(0.0, -1.0, 0.0))
    scene.couple(fm.joint.Gear(drives[0], drives[1], 0.5))
    if soft:
        arm = scene.add(fm.FlexibleBody(particle_body(3, modes=3).record))
        scene.connect(fm.joint.Spherical(), left, arm.frame("root"))
        scene.connect(fm.joint.Distance(2.0), right, arm.frame("tip"))
    return scene


@pytest.mark.parametrize("soft", [False, True])
@pytest.mark.parametrize("windows", [3, 30])
def test_slopes_times_velocities_are_the_rates_of_the_rows(windows: int, soft: bool) -> None:
    scene = ladder(windows, soft=soft).compile().scene
    work, random = new_work(scene.plan), np.random.default_rng(windows)
    x = np.empty(scene.nx)
    retract(scene.plan, scene.start, random.uniform(-0.3, 0.3, scene.nv), x)
    slopes = constraint_slopes(scene, work, x)
    assert (scene.row_structure.paths is not None) == (windows > 10)
    for _ in range(3):
        v = random.normal(size=scene.nv)
        assert slopes.times(v) == pytest.approx(constraint_values(scene, work, x, v)[1], abs=1e-11)
