"""A solid cantilever that swings to a third of its length, by thirteen coordinates and by an exact beam."""

from __future__ import annotations

import warnings
from dataclasses import replace

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
def record():
    mesh = meshes.block(
        LENGTH, SIDE, SIDE, divisions=(20, 1, 1), cell="hexahedron", degree=1, comm=MPI.COMM_SELF
    )
    form = forms.st_venant_kirchhoff
    ends = [Interface("x_min"), Interface("x_max")]
    model = ContinuumModel(mesh, form, form.Parameters(E=E, nu=0.0, rho=RHO), degree=2, interfaces=ends)
    loads = {"x_max.y": FORCE, "x_max.rz": 0.3 * FORCE * LENGTH}
    return craig_bampton(model, modes=4, frame="x_min", nonlinear=ModalDerivatives(loads))


def swing(body, root, tip, *, share=0.65, towards=(0.0, 1.0, 0.0)):
    """Place (101, 3) and rotation (101, 3, 3) of the tip, by a force of a third of the first frequency."""
    scene = fm.System()
    scene.add(body, name="blade")
    scene.connect(fm.joint.Fixed(), scene.ground.frame(), body.frame(root))
    push = tuple(fm.Sine(share * FORCE * part, 2.0 * np.pi * 3.0) if part else 0.0 for part in towards)
    scene.add_force(fm.force.FrameForce(body.frame(tip), force=push))
    run, t = scene.simulate(END, rtol=1e-6), np.linspace(0.0, END, 101)
    return run.position(body.frame(tip), t=t), run.rotation(body.frame(tip), t=t)


def exact_beam():
    section = forms.beam_timoshenko.Parameters.rectangle(
        E, 0.0, RHO, width=SIDE, height=SIDE, orientation=(0.0, 1.0, 0.0)
    )
    points = {"root": (0.0, 0.0, 0.0), "tip": (LENGTH, 0.0, 0.0)}
    return fm.ExactBeam(points, {"rod": [("root", "tip")]}, {"rod": section}, 20)


def test_bent_by_a_third_of_its_length(record):
    """Within 0.5 % of the largest deflection at every instant, and 1 % of the largest angle."""
    exact, turned = swing(exact_beam(), "root", "tip")
    with warnings.catch_warnings():
        warnings.simplefilter("error", fm.RangeWarning)
        place, rotation = swing(fm.FlexibleBody(record), "x_min", "x_max")
    assert record.n_modes <= 15
    assert np.abs(exact[:, 1]).max() > 0.29 * LENGTH
    assert np.abs(place - exact).max() < 0.005 * np.abs(exact[:, 1]).max()
    angle, expected = (np.arctan2(R[:, 1, 0], R[:, 0, 0]) for R in (rotation, turned))
    assert np.abs(angle - expected).max() < 0.01 * np.abs(expected).max()


def test_more_than_it_was_reduced_for_is_told(record):
    with pytest.warns(fm.RangeWarning, match=r"'blade' stores .* more than the .* J up to which it was compared"):
        swing(fm.FlexibleBody(record), "x_min", "x_max", share=1.5)


@pytest.mark.parametrize(("share", "towards"), [(0.65, (0, 0, 1)), (0.02, (0, 0, 1)), (0.65, (0, 1, 0.01))])
def test_bending_out_of_the_stated_plane_is_told(record, share, towards):
    """Once, where the motion is far from the exact beam's: by 84 %, 63 % and 1 % of its deflection."""
    exact, _ = swing(exact_beam(), "root", "tip", share=share, towards=towards)
    with pytest.warns(fm.RangeWarning, match=r"'blade' locks at t = .* give ModalDerivatives loads") as told:
        place, _ = swing(fm.FlexibleBody(record), "x_min", "x_max", share=share, towards=towards)
    assert np.abs(place - exact).max() > 0.01 * np.abs(exact[:, 1:]).max()
    assert sum("locks" in str(one.message) for one in told) == 1


def test_noise_between_equal_loads_is_no_direction_that_it_was_reduced_for(record):
    """A second load as the first but for 1e-10 aside, as solvers leave it."""
    loads = record.nonlinear.compared
    aside = next(one for one in record.interfaces if one.name == "x_max").modes[2]
    noise = 1e-10 * np.linalg.norm(loads[:, 0]) / np.linalg.norm(aside) * aside
    noisy = replace(record.nonlinear, compared=np.column_stack([loads, loads[:, 0] + noise]))
    with pytest.warns(fm.RangeWarning, match="'blade' locks"):
        swing(fm.FlexibleBody(replace(record, nonlinear=noisy)), "x_min", "x_max", share=0.02, towards=(0, 0, 1))


def test_a_load_aside_of_no_weight_is_not_told(record):
    """The same to 0.5 % as in the plane; nor is a pull along the axis, which locks nothing."""
    exact, _ = swing(exact_beam(), "root", "tip", towards=(0.0, 1.0, 1e-6))
    with warnings.catch_warnings():
        warnings.simplefilter("error", fm.RangeWarning)
        place, _ = swing(fm.FlexibleBody(record), "x_min", "x_max", towards=(0.0, 1.0, 1e-6))
        swing(fm.FlexibleBody(record), "x_min", "x_max", towards=(1.0, 0.0, 0.0))
    assert np.abs(place - exact).max() < 0.005 * np.abs(exact[:, 1]).max()


def test_equilibria_beyond_what_it_was_reduced_for_are_told(record):
    """One of them, and a path whose end is."""
    scene = fm.System()
    blade = scene.add(fm.FlexibleBody(record), name="blade")
    scene.connect(fm.joint.Fixed(), scene.ground.frame(), blade.frame("x_min"))
    scene.add_force(fm.force.FrameForce(blade.frame("x_max"), force=(0.0, lambda t: t * FORCE, 0.0)))
    with warnings.catch_warnings():
        warnings.simplefilter("error", fm.RangeWarning)
        scene.equilibrium(t=1.0)
    with pytest.warns(fm.RangeWarning, match=r"'blade' stores .* more than the .* J up to which it was compared"):
        scene.equilibrium(t=1.5)
    with pytest.warns(fm.RangeWarning, match=r"'blade' stores"):
        scene.equilibrium(path=fm.Continuation(to=1.5))
