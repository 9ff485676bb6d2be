"""A meshed connecting rod in a slider-crank: it tends to the rigid mechanism as it stiffens."""

from __future__ import annotations

from dataclasses import replace

from mpi4py import MPI

import numpy as np
import pytest
from machines import CRANK, slider_position

import flexmbd as fm
from flexmbd import meshes
from flexmbd.continuum import ContinuumModel, Interface
from flexmbd.forms import solid_linear
from flexmbd.reduction import craig_bampton

SPEED, RAMP = 100.0, 0.04  # rad/s, s


@fm.compiled
def angle(t):
    s = min(t, RAMP)
    w = 2.0 * np.pi / RAMP
    return SPEED / RAMP * (0.5 * s**2 + (np.cos(w * s) - 1.0) / w**2) + SPEED * (t - s)


@fm.compiled
def speed(t):
    s = min(t, RAMP)
    w = 2.0 * np.pi / RAMP
    return SPEED / RAMP * (s - np.sin(w * s) / w)


@fm.compiled
def acceleration(t):
    return SPEED / RAMP * (1.0 - np.cos(2.0 * np.pi / RAMP * t)) if t < RAMP else 0.0


@pytest.fixture(scope="module")
def rod():
    mesh = meshes.connecting_rod(length=0.3, h=16e-3, comm=MPI.COMM_SELF)
    steel = solid_linear.Parameters(E=2.1e11, nu=0.3, rho=7850.0)
    # exactly on the bores' axes, which the centroids of the meshed bores miss by a micrometre
    interfaces = [
        Interface("big_end", origin=(0.0, 0.0, 0.0)),
        Interface("small_end", origin=(0.3, 0.0, 0.0)),
    ]
    model = ContinuumModel(mesh, solid_linear, steel, degree=2, interfaces=interfaces)
    return craig_bampton(model, modes=4, frame="big_end")


def machine(rod):
    scene = fm.System(gravity=(0.0, -9.81, 0.0))
    crank = scene.add(fm.RigidBody(0.9, (4e-4, 6e-4, 8e-4), (0.02, 0.0, 0.0)), name="crank")
    conrod = scene.add(fm.FlexibleBody(rod), name="conrod")
    piston = scene.add(fm.RigidBody(0.5, (2e-4, 2e-4, 2e-4)), name="piston")
    turn = fm.joint.Revolute("z")
    j1 = scene.connect(turn, scene.ground.frame(), crank.frame())
    scene.connect(turn, crank.frame(p=(CRANK, 0, 0)), conrod.frame("big_end"))
    scene.connect(turn, conrod.frame("small_end"), piston.frame())
    scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(), piston.frame(), name="guide")
    j1.prescribe(fm.Motion(angle, speed, acceleration))
    return scene, piston, j1


def stiffer(rod, factor):
    """The rod of another Young's modulus."""
    stretch = replace(rod.stretch, P=factor * rod.stretch.P)
    return replace(rod, stiffness=factor * rod.stiffness, stretch=stretch)


def test_it_tends_to_the_rigid_mechanism(rod):
    """The slider's deviation from the closed form falls as one over Young's modulus."""
    deviations = []
    for factor in (1e-2, 1.0, 1e2):
        scene, piston, j1 = machine(stiffer(rod, factor))
        run = scene.simulate(0.06, rtol=1e-5)
        assert run.stats.constraint_residual < 1e-2 * 1e-5
        x = run.position(piston.frame())[:, 0]
        late = run.t > RAMP
        deviations.append(np.abs(x - slider_position(run.beta(j1)))[late].max())
    ratios = np.array(deviations[:-1]) / deviations[1:]
    assert deviations[1] > 1e-8
    np.testing.assert_allclose(ratios, 100.0, rtol=0.2)


def test_the_axial_deviation_is_that_of_the_piston_force(rod):
    """Quasi-static: the rod's end moves by its static flexibility times the piston's inertia."""
    scene, piston, j1 = machine(rod)
    run = scene.simulate(0.06, rtol=1e-6)
    late = run.t > RAMP
    deviation = run.position(piston.frame())[late, 0] - slider_position(run.beta(j1))[late]
    angle_late = run.beta(j1)[late]
    # slider acceleration of the rigid mechanism, to first order in crank over rod
    slider = -CRANK * SPEED**2 * (np.cos(angle_late) + CRANK / 0.3 * np.cos(2 * angle_late))
    tip = rod.interface("small_end").modes
    flexibility = float(tip[0] @ (tip[0] / rod.stiffness))  # m/N along x at the small end
    # the piston and about a third of the rod's mass hang on the rod: a push at the small end
    estimate = -(0.5 + rod.mass / 3.0) * slider * flexibility
    assert np.corrcoef(deviation, estimate)[0, 1] > 0.9
    assert 0.7 < np.ptp(deviation) / np.ptp(estimate) < 1.4
