"""The spin-up of a slender arm to above its first frequency, as a reduced solid (Simo & Vu-Quoc 1986).

Against a planar geometrically exact beam of 160 elements: least lag -0.573860 m at 6.7625 s, mean extension of the
steady rotation 5.13976e-4 m.
"""

from __future__ import annotations

from dataclasses import replace

from mpi4py import MPI

import numpy as np
import pytest

import flexmbd as fm
from flexmbd import forms, meshes
from flexmbd.continuum import ContinuumModel, Interface
from flexmbd.reduction import craig_bampton

LENGTH, SIDE = 10.0, 0.0774597
OMEGA, RAMP = 6.0, 15.0
TURN = 2.0 * np.pi / RAMP


def arm(cells):
    material = forms.solid_linear.Parameters(E=4.6667e9, nu=1.0 / 6.0, rho=200.0)
    mesh = meshes.block(
        LENGTH, SIDE, SIDE, divisions=(cells, 1, 1), cell="hexahedron", degree=1, comm=MPI.COMM_SELF
    )
    ends = [Interface("x_min"), Interface("x_max")]
    return craig_bampton(
        ContinuumModel(mesh, forms.solid_linear, material, degree=2, interfaces=ends), modes=10, frame="x_min"
    )


def angle(t):
    if t < RAMP:
        return OMEGA / RAMP * (0.5 * t * t + (np.cos(TURN * t) - 1.0) / TURN**2)
    return OMEGA * (t - 0.5 * RAMP)


def speed(t):
    return OMEGA / RAMP * (t - np.sin(TURN * t) / TURN) if t < RAMP else OMEGA


def acceleration(t):
    return OMEGA / RAMP * (1.0 - np.cos(TURN * t)) if t < RAMP else 0.0


def lag(record, *, end, h):
    """Times, and the tip's displacement along and across the straight arm."""
    scene = fm.System()
    body = scene.add(fm.FlexibleBody(record), name="arm")
    hub = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), body.frame("x_min"))
    hub.prescribe(fm.Motion(*map(fm.compiled, (angle, speed, acceleration))))
    run = scene.simulate(end, h=h)
    tip = np.einsum("tji,tj->ti", run.rotation(body.frame()), run.position(body.frame("x_max")))
    return run.t, tip[:, 0] - LENGTH, tip[:, 1]


@pytest.mark.parametrize(("cells", "within"), [(20, 1e-2), (40, 2e-3)])
def test_with_stretch(cells, within):
    """By steps of 0.01 s, somewhat longer than the period of the first mode along the arm."""
    t, u, v = lag(arm(cells), end=20.0, h=0.01)
    assert v.min() == pytest.approx(-0.573860, rel=within)
    assert t[v.argmin()] == pytest.approx(6.7625, abs=0.05)
    assert u[t >= RAMP].mean() == pytest.approx(5.13976e-4, rel=2 * within)


def test_without_it_gives_way():
    record = replace(arm(20), stretch=None)
    t, _, v = lag(record, end=9.0, h=0.01)
    assert np.abs(v).max() > LENGTH / 2
    # all was well while the hub was slow
    assert np.abs(v[t < 4.0]).max() < 0.4
