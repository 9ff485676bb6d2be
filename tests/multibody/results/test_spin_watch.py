"""A body without modes that spins: warned of where what its shapes lack of the stiffening matters."""

import re
import warnings
from functools import partial

import numpy as np
import pytest
import scipy.linalg
from numpy.polynomial import Polynomial

import flexmbd as fm
from flexmbd import meshes
from flexmbd.continuum import ContinuumModel, Interface
from flexmbd.ensemble import Sampled
from flexmbd.forms import solid_linear
from flexmbd.reduction import craig_bampton

# No lateral contraction that the ends would hinder; metres, and millimetres, tonnes and seconds.
STEEL = {
    1.0: solid_linear.Parameters(E=2.1e11, nu=0.0, rho=7850.0),
    1e3: solid_linear.Parameters(E=2.1e5, nu=0.0, rho=7.85e-9),
}

# How blades are mounted: their axes z, x, y along the inertial x, y, z.
TURNED = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])


def too_high(spin):
    """By how much the square of the lowest frequency of a clamped beam is, by the two static shapes of its tip.

    Its tension is uniform, the mean of rho A w^2 (L^2 - x^2) / 2, in the place of that; w is over the first frequency.
    """
    shapes = Polynomial([0.0, 0.0, 3.0, -2.0]), Polynomial([0.0, 0.0, -1.0, 1.0])
    tension = Polynomial([0.5, 0.0, -0.5])
    stiffness, mass = products([one.deriv(2) for one in shapes]), products(shapes)
    added, machine = (products([one.deriv() for one in shapes], one) for one in (tension, 1.0 / 3.0))
    square = spin**2 * scipy.linalg.eigh(stiffness, mass, eigvals_only=True)[0]
    values, modes = scipy.linalg.eigh(stiffness + square * added, mass)
    return square * modes[:, 0] @ (machine - added) @ modes[:, 0] / values[0]


def products(fields, weight=1.0):
    wholes = [[(a * b * weight).integ() for b in fields] for a in fields]
    return np.array([[one(1.0) - one(0.0) for one in row] for row in wholes])


def blade(modes, unit):
    mesh = meshes.block(0.8 * unit, 0.02 * unit, 0.01 * unit, divisions=(16, 2, 1))
    ends = [Interface("x_min"), Interface("x_max")]
    model = ContinuumModel(mesh, solid_linear, STEEL[unit], degree=2, interfaces=ends)
    return craig_bampton(model, modes=modes, frame="x_min")


@pytest.fixture(scope="module", params=[1.0, 1e3], ids=["m", "mm"])
def blades(request):
    return {modes: blade(modes, request.param) for modes in (0, 1)}


def turning(record, spin, *, ask, axis="z"):
    """A way to ask about a blade that turns at a rate (rad/s)."""
    scene = fm.System()
    body = scene.add(fm.FlexibleBody(record), name="blade")
    hub = scene.connect(fm.joint.Revolute(axis), scene.ground.frame(R=TURNED), body.frame("x_min"))
    hub.velocity = spin
    if ask is started_in_balance:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", fm.RangeWarning)
            body.q = scene.equilibrium().q(body)
    return lambda: ask(scene)


def simulated(scene):
    scene.simulate(t_end=0.02, rtol=1e-4)


def linearized(scene):
    return scene.linearize(about=scene.equilibrium())


def started_in_balance(scene):
    return scene.linearize()


def told(record, spin, *, ask=simulated, axis="z"):
    """What is said of a blade that turns."""
    return said(turning(record, spin, ask=ask, axis=axis))


def said(ask):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", fm.RangeWarning)
        ask()
    return [str(one.message) for one in caught if issubclass(one.category, fm.RangeWarning)]


def percents(texts):
    return [float(re.search(r"off by about \+([\d.]+) %", text)[1]) for text in texts]


@pytest.mark.parametrize("axis", ["y", "z", (0.0, 0.8, -0.6)])
def test_a_body_without_modes_is_told_of_once_where_it_matters(blades, axis):
    first = blades[0].stiffness[0] ** 0.5
    texts = told(blades[0], 0.35 * first, axis=axis)
    assert "flexible body 'blade'" in texts[0]
    assert percents(texts) == pytest.approx([100.0 * too_high(0.35)], rel=0.02)
    assert not told(blades[0], 0.14 * first, axis=axis)


@pytest.mark.parametrize("ask", [fm.System.equilibrium, linearized, started_in_balance])
def test_steady_motions_are_told_of_as_runs_are(blades, ask):
    first = blades[0].stiffness[0] ** 0.5
    assert percents(told(blades[0], 0.35 * first, ask=ask)) == pytest.approx([100.0 * too_high(0.35)], rel=0.02)
    assert not told(blades[0], 0.14 * first, ask=ask)


def test_a_campbell_diagram_tells_once_at_the_lowest_speed_where_it_matters(blades):
    shares = np.array([0.1, 0.2, 0.3, 0.4])
    speeds = shares * blades[0].stiffness[0] ** 0.5
    texts = said(lambda: fm.campbell(lambda speed: turning(blades[0], speed, ask=linearized)(), speeds))
    assert percents(texts) == pytest.approx([100.0 * too_high(0.2)], rel=0.03)
    assert len(said(lambda: [turning(blades[0], speed, ask=linearized)() for speed in speeds])) == 3


def test_variants_are_told_of_as_runs_are(blades):
    """Those that run in the arrays of the ones before, each by itself; of an ensemble one."""
    first = blades[0].stiffness[0] ** 0.5
    scene = fm.System()
    body = scene.add(fm.FlexibleBody(blades[0]), name="blade")
    hub = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(R=TURNED), body.frame("x_min"))
    hub.velocity = 0.0
    machine = scene.compile(parameters={"spin": [fm.parameter.InitialVelocity(hub)]})
    asked = {"t_end": 0.01, "rtol": 1e-4, "integrator": fm.ExplicitRungeKutta()}
    machine.simulate(**asked, spin=0.0)
    fast = said(lambda: [machine.simulate(**asked, spin=share * first) for share in (0.14, 0.35, 0.36)])
    assert percents(fast) == pytest.approx([100.0 * too_high(0.35), 100.0 * too_high(0.36)], rel=0.02)
    for turn in (Sampled(fm.output.Position(hub), 0.01), lambda run: run.beta(hub)[-1]):
        many = said(partial(machine.ensemble, {"spin": np.full(5, 0.35 * first)}, {"turn": turn}, workers=1, **asked))
        assert percents(many) == pytest.approx([100.0 * too_high(0.35)], rel=0.02)


@pytest.mark.parametrize("ask", [simulated, linearized])
def test_a_mode_completes_it(blades, ask):
    assert not told(blades[1], blades[0].stiffness[0] ** 0.5, ask=ask)
