"""Beams of discrete elements in a linearised machine: a rod on a pin, without its weight and with it."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
import scipy.linalg

import flexmbd as fm
from flexmbd.beams import DiscreteFrame, discrete_body

LENGTH, E, RHO, AREA, SECOND = 2.0, 1e9, 1200.0, 1e-3, 1e-7
G = 9.81


def rod(divisions=12):
    section = SimpleNamespace(
        E=E, nu=0.3, rho=RHO, A=AREA, Iy=SECOND, Iz=SECOND, Iyz=0.0, J=2e-7, ky=np.inf, kz=np.inf,
        orientation=(1.0, 0.0, 0.0),
    )
    points = {"root": (0.0, 0.0, 0.0), "tip": (0.0, 0.0, -LENGTH)}
    return DiscreteFrame(points, {"rod": [("root", "tip")]}, {"rod": section}, divisions)


def hung(gravity, ratio):
    lumped = rod()
    record = discrete_body(lumped, interfaces=["root", "tip"], frame="root", damping_ratio=ratio, damping_held=["root"])
    scene = fm.System(gravity=(0.0, 0.0, -gravity))
    body = scene.add(fm.FlexibleBody(record), name="rod")
    scene.connect(fm.joint.Revolute("y"), scene.ground.frame(), body.frame("root"), name="pin")
    return scene, body, lumped


def test_a_pinned_rod_vibrates_as_its_matrices_say():
    """The record is held at its root, the machine's rod is pinned: the joint's coordinate and the modes together."""
    scene, _, lumped = hung(0.0, 0.0)
    lin = scene.linearize()
    free = np.ones(len(lumped.K), bool)
    free[[0, 1, 2, 3, 5]] = False  # the root's, but for its turn about y
    rates = scipy.linalg.eigvalsh(lumped.K[np.ix_(free, free)], lumped.M[np.ix_(free, free)])
    found = np.sort(np.abs(lin.eigenvalues()))[2::2]
    np.testing.assert_allclose(found, np.sqrt(rates[1:]), rtol=1e-7)
    assert np.abs(lin.eigenvalues()[:2]).max() < 1e-6 * found[0]
    # and nearly as a pinned and free beam of Euler and Bernoulli: tan(b) = tanh(b)
    bending = 3.926602312**2 * np.sqrt(E * SECOND / (RHO * AREA)) / LENGTH**2
    assert np.abs(found / bending - 1.0).min() < 0.01


def test_a_hanging_rod_stretches_and_swings():
    """Its tip by rho g L^2 / 2 E; it swings as a rigid rod, nearly."""
    scene, body, _ = hung(G, 0.02)
    eq = scene.equilibrium()
    stretch = -eq.position(body.frame("tip"))[2] - LENGTH
    assert stretch == pytest.approx(RHO * G * LENGTH**2 / (2.0 * E), rel=1e-9)
    lin = scene.linearize(about=eq, outputs=[fm.output.Position(body.frame("tip"))])
    assert lin.frequencies()[0] == pytest.approx(np.sqrt(1.5 * G / LENGTH) / (2.0 * np.pi), rel=1e-2)
    assert lin.damping_ratios()[-1] == pytest.approx(0.02, rel=0.3)
