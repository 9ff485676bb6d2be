"""Steps larger than a form integrates well, as it tells, are cut; the forms of this package take any."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from flexmbd import meshes
from flexmbd.continuum.contract.formulation import load_form
from flexmbd.continuum.history.nonlinear_model import NonlinearModel
from flexmbd.continuum.history.trial_errors import LargeIncrementError
from flexmbd.continuum.slow_loading.static_path import follow, prescribed_dofs
from flexmbd.errors import PathError
from flexmbd.forms import hencky_plasticity, j2_plasticity, updated_lagrangian

HEIGHT, BORE, OUTER = 0.02, 0.1, 0.2  # m
YIELD = 60e6  # Pa

# The updated Lagrangian form with `increment_size`: shears of a hundredth.
LIMITED = load_form(Path(__file__).parents[1] / "data" / "limited_shear.py")


def ring(form=updated_lagrangian, *, strength=YIELD):
    """A quarter of a thick cylinder in plane strain, the held dofs, and what opens its bore by its own radius."""
    parameters = form.Parameters(E=210e9, nu=0.3, rho=7800.0, yield_stress=strength)
    mesh = meshes.quarter_ring(HEIGHT, OUTER, BORE, divisions=(6, 6, 1))
    body = NonlinearModel(mesh, form, parameters, degree=1)
    bore = prescribed_dofs(body, {"inner": "xy"})
    held = np.union1d(bore, prescribed_dofs(body, {"x_min": "x", "y_min": "y", "bottom": "z", "top": "z"}))
    place = np.zeros(body.layout.n_local)
    place[body.displacement_dofs] = body.layout.node_x
    return body, held, np.where(np.isin(held, bore), place[held], 0.0)


def opened(form, opening, **options):
    """A path to that opening, and the pressure at its end over the limit pressure."""
    body, held, outward = ring(form)
    path = follow(body, [opening], prescribed=held, displacement=lambda t: t * outward, **options)
    inner = BORE * (1.0 + opening)
    # the work of the reactions on a further opening, over that of a pressure of 1 Pa
    pressure = path.steps[-1].reactions @ outward / (0.5 * np.pi * inner * HEIGHT * BORE)
    outer = np.sqrt(OUTER**2 - BORE**2 + inner**2)
    return path, pressure / (2.0 / np.sqrt(3.0) * YIELD * np.log(outer / inner))


@pytest.mark.parametrize("opening", [0.2, 1.0])
def test_a_cylinder_that_is_opened_at_once(opening):
    """The limit pressure 2 / sqrt(3) yield stress ln(outer / inner) radius, in the steps of the logarithmic form."""
    path, share = opened(updated_lagrangian, opening)
    other, reference = opened(hencky_plasticity, opening)
    assert len(path.steps) <= 3 * len(other.steps)
    assert share == pytest.approx(1.0, abs=0.01)
    assert share == pytest.approx(reference, abs=1e-3)


def test_steps_that_are_too_large_are_cut():
    """A fifth of the bore's radius is a shear of 0.28 there: at least 19 steps."""
    path, share = opened(LIMITED, 0.2)
    assert path.cuts > 0
    assert len(path.steps) >= 19
    assert share == pytest.approx(1.0, abs=0.01)


def test_a_small_opening_is_one_step():
    path, share = opened(LIMITED, 0.002)
    assert (len(path.steps), path.cuts) == (1, 0)
    assert share == pytest.approx(1.0, abs=0.02)


def test_where_steps_may_not_be_cut_it_is_refused():
    body, held, outward = ring(LIMITED)
    with pytest.raises(PathError, match=r"the largest that the formulation integrates accurately, in cell \d+") as told:
        follow(body, [0.2], prescribed=held, displacement=lambda t: t * outward, smallest=0.6)
    assert told.value.path.steps == []
    np.testing.assert_array_equal(body.displacement, 0.0)


def test_what_counts_is_the_size_that_the_form_tells():
    mesh = meshes.block(1.0, 1.0, 1.0, divisions=(1, 1, 1), cell="hexahedron", degree=1)
    body = NonlinearModel(mesh, LIMITED, LIMITED.Parameters(E=2.0, nu=0.3, rho=1.0, yield_stress=1.0), degree=1)

    def increment(gradient):
        u = np.zeros(body.layout.n_local)
        u[body.displacement_dofs] = body.layout.node_x @ np.asarray(gradient).T
        return u

    shear = 0.01 / np.sqrt(2.0) * np.diag([1.0, -1.0, 0.0])
    body.check_increment(increment(0.98 * shear))
    with pytest.raises(LargeIncrementError, match=r"the step is 1\.0\d times the largest"):
        body.check_increment(increment(1.02 * shear))
    body.check_increment(increment([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [0.0, 0.0, 0.0]]))  # a quarter turn


@pytest.mark.parametrize("form", [hencky_plasticity, j2_plasticity, updated_lagrangian])
def test_forms_that_take_any_step_are_left_alone(form):
    body, held, outward = ring(form)
    path = follow(body, [0.02], prescribed=held, displacement=lambda t: t * outward)
    assert (len(path.steps), path.cuts) == (1, 0)
