"""A solid cantilever that swings to a third of its length, by thirteen coordinates and by an exact beam."""

from __future__ import annotations

import warnings

from mpi4py import MPI

import numpy as np
import pytest

import flexmbd as fm
from flexmbd import forms, meshes
from flexmbd.continuum import ContinuumModel, Interface
from flexmbd.reduction import ModalDerivatives, craig_bampton

LENGTH, SIDE, E, RHO, END = 1.0, 0.04, 2.0e9, 1000.0, 0.5
FORCE = E * SIDE**4 / 12.0 / LENGTH**2  # bends the tip by 30 % of the length at rest


@pytest.fixture(scope="module")
def model():
    mesh = meshes.block(
        LENGTH, SIDE, SIDE, divisions=(20, 1, 1), cell="hexahedron", degree=1, comm=MPI.COMM_SELF
    )
    form = forms.st_venant_kirchhoff
    ends = [Interface("x_min"), Interface("x_max")]
    return ContinuumModel(mesh, form, form.Parameters(E=E, nu=0.0, rho=RHO), degree=2, interfaces=ends)


LOADS = {"x_max.y": FORCE, "x_max.rz": 0.3 * FORCE * LENGTH}


@pytest.fixture(scope="module")
def record(model):
    """Of a machine that moves in the plane of the loads."""
    return craig_bampton(model, modes=4, frame="x_min", nonlinear=ModalDerivatives(LOADS, plane=True))


@pytest.fixture(scope="module")
def spatial(model):
    """Of one that bends it in this plane and pushes aside."""
    return craig_bampton(model, modes=4, frame="x_min", nonlinear=ModalDerivatives(LOADS))


def beam():
    """The same by twenty exact elements."""
    section = forms.beam_timoshenko.Parameters.rectangle(
        E, 0.0, RHO, width=SIDE, height=SIDE, orientation=(0.0, 1.0, 0.0)
    )
    points = {"x_min": (0.0, 0.0, 0.0), "x_max": (LENGTH, 0.0, 0.0)}
    return fm.ExactBeam(points, {"rod": [("x_min", "x_max")]}, {"rod": section}, 20)


def pushed(body, force, torque=(0.0, 0.0, 0.0)):
    """A scene with the body held at its start, and pushed at its end."""
    scene = fm.System()
    scene.add(body, name="blade")
    scene.connect(fm.joint.Fixed(), scene.ground.frame(), body.frame("x_min"))
    scene.add_force(fm.force.FrameForce(body.frame("x_max"), force=force, torque=torque))
    return scene


def swing(body, *, share=0.65, aside=0.0):
    """Place (101, 3) and rotation (101, 3, 3) of the tip, by a force of a third of the first frequency."""
    push, t = fm.Sine(share * FORCE, 2.0 * np.pi * 3.0), np.linspace(0.0, END, 101)
    run = pushed(body, (0.0, push, aside * FORCE)).simulate(END, rtol=1e-6)
    return run.position(body.frame("x_max"), t=t), run.rotation(body.frame("x_max"), t=t)


def test_bent_by_a_third_of_its_length(record):
    """Within 0.5 % of the largest deflection at every instant, and 1 % of the largest angle."""
    exact, turned = swing(beam())
    place, rotation = swing(fm.FlexibleBody(record))
    assert record.n_modes <= 15
    assert np.abs(exact[:, 1]).max() > 0.29 * LENGTH
    assert np.abs(place - exact).max() < 0.005 * np.abs(exact[:, 1]).max()
    angle, expected = (np.arctan2(R[:, 1, 0], R[:, 0, 0]) for R in (rotation, turned))
    assert np.abs(angle - expected).max() < 0.01 * np.abs(expected).max()


def test_more_than_it_was_reduced_for_is_told(record):
    with pytest.warns(fm.RangeWarning, match=r"'blade' stores .* more than the .* J up to which it was compared"):
        swing(fm.FlexibleBody(record), share=1.5)


def test_equilibria_beyond_what_it_was_reduced_for_are_told(record):
    """One of them, and a path whose end is."""
    scene = pushed(fm.FlexibleBody(record), (0.0, lambda t: t * FORCE, 0.0))
    with warnings.catch_warnings():
        warnings.simplefilter("error", fm.RangeWarning)
        scene.equilibrium(t=1.0)
    with pytest.warns(fm.RangeWarning, match=r"'blade' stores .* more than the .* J up to which it was compared"):
        scene.equilibrium(t=1.5)
    with pytest.warns(fm.RangeWarning, match=r"'blade' stores"):
        scene.equilibrium(path=fm.Continuation(to=1.5))


ASIDE = [
    ((0.0, 1.0, 0.1), (0.0, 0.0, 0.0)),
    ((0.0, 1.0, 0.3), (0.0, 0.0, 0.0)),
    ((0.0, 1.0, 0.0), (0.1, 0.0, 0.0)),
    ((0.0, 1.0, 0.0), (0.0, 0.1, 0.0)),
    ((0.0, 0.0, 0.3), (0.0, 0.0, 0.0)),
]


def at_rest(body, force, torque):
    """(3,) m: place of the tip under shares of the load by which it is bent, and of its moment."""
    state = pushed(body, FORCE * np.array(force), FORCE * LENGTH * np.array(torque)).equilibrium()
    return state.position(body.frame("x_max"))


@pytest.mark.parametrize(("force", "torque"), ASIDE)
def test_bent_it_gives_way_aside(spatial, force, torque):
    """To a load across that of the range, and to moments, as an exact beam does: within 3 % of what they add."""
    exact, place = (at_rest(body, force, torque) for body in (beam(), fm.FlexibleBody(spatial)))
    assert abs(exact[2]) > 0.005 * LENGTH
    assert np.abs(place - exact).max() < 0.03 * abs(exact[2])


def test_a_body_for_the_plane_says_that_it_locks(record):
    """Bent by a third of its length it is several times too stiff across."""
    with pytest.warns(fm.RangeWarning, match=r"'blade' locks at t = 0 s: shapes that it has not"):
        place = at_rest(fm.FlexibleBody(record), *ASIDE[1])
    assert place[2] < 0.5 * at_rest(beam(), *ASIDE[1])[2]


def test_bent_it_swings_aside(spatial):
    """As an exact beam that is pushed across: within 2 % of its largest deflection."""
    (exact, _), (place, _) = swing(beam(), aside=0.1), swing(fm.FlexibleBody(spatial), aside=0.1)
    assert np.abs(exact[:, 2]).max() > 0.05 * LENGTH
    assert np.abs(place - exact).max() < 0.02 * np.abs(exact[:, 1]).max()
