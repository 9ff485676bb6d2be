"""Exact beams with a temperature: free, bent by a gradient, held, and over time."""

import numpy as np
import pytest

import flexmbd as fm
from flexmbd import forms
from flexmbd.errors import SceneError

ALPHA, E, LENGTH, SIDE = 1.2e-5, 2e11, 1.0, 0.01
BAR = forms.beam_timoshenko.Parameters.rectangle(E, 0.3, 7800.0, width=SIDE, height=SIDE, orientation=(0.0, 1.0, 0.0))


def cantilever(strain, *, held=False, divisions=8):
    scene = fm.System(gravity=(0.0, 0.0, 0.0))
    ends = {"foot": (0.0, 0.0, 0.0), "tip": (LENGTH, 0.0, 0.0)}
    beam = fm.ExactBeam(ends, {"bar": [("foot", "tip")]}, {"bar": BAR}, divisions, strain={"bar": strain})
    beam = scene.add(beam, name="beam")
    scene.connect(fm.joint.Fixed(), scene.ground.frame(), beam.frame("foot"))
    if held:
        scene.connect(fm.joint.Fixed(), scene.ground.frame(p=(LENGTH, 0.0, 0.0)), beam.frame("tip"))
    return scene, beam


@pytest.mark.parametrize("side", [0, 1])
def test_a_gradient_bends_a_beam_to_an_arc(side):
    """By alpha times the gradient, away from the warm side: fibres there are longer, as far as they lie out."""
    gradient = 5e4  # K/m, so that the arc is long
    along = (gradient, 0.0) if side == 0 else (0.0, gradient)
    scene, beam = cantilever(fm.thermal_strain(ALPHA, 100.0, gradient=along))
    tip = scene.equilibrium().position(beam.frame("tip"))
    curvature, length = ALPHA * gradient, LENGTH * (1.0 + ALPHA * 100.0)
    # per length at rest: the arc is stretched, and its angle is that of the curvature over the length at rest
    angle = curvature * LENGTH
    wanted = np.zeros(3)
    wanted[0], wanted[1 + side] = length * np.sin(angle) / angle, -length * (1.0 - np.cos(angle)) / angle
    assert tip == pytest.approx(wanted, abs=1e-9)


def test_a_beam_between_walls_is_pressed_and_buckles():
    """By E A alpha dT, and at 4 pi^2 I / (A L^2 alpha), less shear: the lowest eigenvalue changes its sign."""
    scene, beam = cantilever(fm.thermal_strain(ALPHA, 10.0), held=True)
    loads = scene.simulate(1e-6).resultants(beam)[0]  # in balance as it begins
    assert loads[:, 0] == pytest.approx(-E * SIDE**2 * ALPHA * 10.0, rel=1e-9)
    critical = 4.0 * np.pi**2 * SIDE**2 / 12.0 / (LENGTH**2 * ALPHA)
    lowest = []
    for share in (0.97, 1.03):
        scene, _ = cantilever(fm.thermal_strain(ALPHA, share * critical), held=True, divisions=24)
        lowest.append(min(-(np.asarray(scene.linearize().eigenvalues()) ** 2).real))
    assert lowest[0] > 0.0 > lowest[1]


def test_a_temperature_over_time_is_followed():
    """Slowly: the tip is where free expansion puts it, by each kind of function."""
    from scipy.interpolate import PPoly

    rises = (
        fm.Sine(50.0, 2.0, offset=10.0),
        fm.Table([0.0, 0.5, 1.0], [0.0, 60.0, 80.0]),
        PPoly(np.array([[80.0], [0.0]]), [0.0, 1.0]),
    )
    at_end = (10.0 + 50.0 * np.sin(2.0), 80.0, 80.0)
    for rise, wanted in zip(rises, at_end, strict=True):
        strain = fm.thermal_strain(ALPHA, rise)
        assert not any(strain[1:])
        scene, beam = cantilever(strain, divisions=2)
        run = scene.simulate(1.0, rtol=1e-5)
        assert run.position(beam.frame("tip"))[-1, 0] - LENGTH == pytest.approx(ALPHA * wanted, rel=1e-2)


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ((np.nan,), "alpha must be"),
        ((1e-5, "warm"), "rise is a finite number"),
        ((1e-5, lambda t: t), "goes into strain= itself"),
    ],
)
def test_what_is_no_temperature_is_refused(given, told):
    with pytest.raises(SceneError, match=told):
        fm.thermal_strain(*given)
    with pytest.raises(SceneError, match="gradient must be"):
        fm.thermal_strain(1e-5, gradient=(1.0,))
