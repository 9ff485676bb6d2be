"""Beams of finite elements in a linearised machine: frequencies and damping ratios in closed form."""

from __future__ import annotations

from mpi4py import MPI

import numpy as np
import pytest
from scipy.optimize import brentq

import flexmbd as fm
from flexmbd import meshes
from flexmbd.continuum import ContinuumModel, Interface
from flexmbd.forms import beam_timoshenko as beam
from flexmbd.reduction import KelvinVoigtDamping, craig_bampton

LENGTH, WIDTH, HEIGHT, E, RHO = 1.0, 0.012, 0.008, 2e10, 1500.0
TAU = 2e-5  # s
SECTION = beam.Parameters.rectangle(E, 0.3, RHO, width=WIDTH, height=HEIGHT, orientation=(0.0, 1.0, 0.0))


def hung(joint):
    """A beam along x with Kelvin and Voigt's damping, by its start on the ground."""
    mesh, ends = meshes.line(LENGTH, divisions=24, comm=MPI.COMM_SELF), [Interface("start"), Interface("end")]
    model = ContinuumModel(mesh, beam, SECTION, degree=2, interfaces=ends)
    record = craig_bampton(model, modes=24, frame="start", damping=KelvinVoigtDamping(TAU))
    scene = fm.System()
    body = scene.add(fm.FlexibleBody(record), name="beam")
    scene.connect(joint, scene.ground.frame(), body.frame("start"), name="root")
    return scene, body


def roots(function, first, last):
    """Of a function with one root in each half turn."""
    return np.array([brentq(function, k * np.pi, (k + 1) * np.pi, xtol=1e-14) for k in range(first, last)])


def bending(beta, depth):
    """Hz of a thin beam; what shear and rotary inertia take off is of the order of (beta depth)^2."""
    return beta**2 / (2.0 * np.pi) * np.sqrt(E * depth**2 / (12.0 * RHO)) / LENGTH**2


def nearest(values, wanted):
    return values[np.argmin(abs(values[:, None] / wanted - 1.0), axis=0)]


def test_a_cantilever_vibrates_and_loses_as_kelvin_and_voigt_say():
    scene, body = hung(fm.joint.Fixed())
    lin = scene.linearize(outputs=[fm.output.Position(body.frame("end"))])
    found = lin.frequencies()
    beta = roots(lambda b: np.cos(b) + 1.0 / np.cosh(b), 0, 4)
    assert beta[:2] == pytest.approx([1.875104068711961, 4.694091132974175], rel=1e-12)
    for depth in (WIDTH, HEIGHT):
        expected = bending(beta, depth)
        off = 1.0 - nearest(found, expected) / expected
        # the first order of Timoshenko's correction: rotary inertia and shear, (1 + 2.6 / 0.85) r^2 beta^2 / 2
        assert (off > 0.0).all()
        assert off.max() < 2.5 * (beta[-1] * depth / LENGTH) ** 2 / 12.0 + 1e-5
    stretching = np.sqrt(E / RHO) / (4.0 * LENGTH)
    # from above, by what the modes that are left out would take
    assert 0.0 < nearest(found, np.array([stretching]))[0] / stretching - 1.0 < 5e-5
    # whatever the shape: (K + s tau K) q + s^2 M q = 0
    swings = lin.damping_ratios()
    assert len(swings) > 12
    np.testing.assert_allclose(swings, np.pi * found * TAU, rtol=1e-7)


def test_a_pinned_beam_turns_freely_and_loses_alike():
    scene, _ = hung(fm.joint.Revolute("z"))
    lin = scene.linearize()
    assert (abs(lin.eigenvalues()) < 1e-4).sum() == 2
    expected = bending(roots(lambda b: np.sin(b) - np.cos(b) * np.tanh(b), 1, 3), WIDTH)
    assert nearest(lin.frequencies(), expected) == pytest.approx(expected, rel=2e-3)
    np.testing.assert_allclose(lin.damping_ratios(), np.pi * lin.frequencies() * TAU, rtol=1e-7)
