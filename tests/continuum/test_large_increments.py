"""Steps larger than the updated Lagrangian form integrates well are cut, and refused where nobody cuts them."""

from __future__ import annotations

import numpy as np
import pytest

from flexmbd import meshes
from flexmbd.continuum.history.nonlinear_model import NonlinearModel
from flexmbd.continuum.history.trial_errors import LargeIncrementError
from flexmbd.continuum.slow_loading.static_path import follow, prescribed_dofs
from flexmbd.errors import PathError
from flexmbd.forms import hencky_plasticity, j2_plasticity, updated_lagrangian

HEIGHT, BORE, OUTER = 0.02, 0.1, 0.2  # m
YIELD = 60e6  # Pa


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


def opened(opening):
    body, held, outward = ring()
    path = follow(body, [opening], prescribed=held, displacement=lambda t: t * outward)
    inner = BORE * (1.0 + opening)
    # the work of the reactions on a further opening, over that of a pressure of 1 Pa
    pressure = path.steps[-1].reactions @ outward / (0.5 * np.pi * inner * HEIGHT * BORE)
    outer = np.sqrt(OUTER**2 - BORE**2 + inner**2)
    return path, pressure / (2.0 / np.sqrt(3.0) * YIELD * np.log(outer / inner))


def test_a_cylinder_that_is_opened_by_a_fifth_at_once():
    """The limit pressure 2 / sqrt(3) yield stress ln(outer / inner) radius: in one step it would be 45 % too much."""
    path, share = opened(0.2)
    assert path.cuts > 0
    assert share == pytest.approx(1.0, abs=0.01)


def test_a_small_opening_is_one_step():
    path, share = opened(0.002)
    assert (len(path.steps), path.cuts) == (1, 0)
    assert share == pytest.approx(1.0, abs=0.02)


def test_where_steps_may_not_be_cut_it_is_refused():
    body, held, outward = ring()
    with pytest.raises(PathError, match=r"times as large as the formulation integrates well, in cell \d+") as told:
        follow(body, [0.2], prescribed=held, displacement=lambda t: t * outward, smallest=0.6)
    assert told.value.path.steps == []
    np.testing.assert_array_equal(body.displacement, 0.0)


@pytest.mark.parametrize("unit", [1.0, 1e-6])
def test_what_counts_is_the_flow_against_the_strength(unit):
    """The largest shear has (K + 2/3 G) |d|^2 = 0.1 of the yield stress; turning and swelling are none."""
    E, nu, strength = 210e9 * unit, 0.3, 240e6 * unit
    p = updated_lagrangian.Parameters(E=E, nu=nu, rho=1.0, yield_stress=strength)
    mesh = meshes.block(1.0, 1.0, 1.0, divisions=(1, 1, 1), cell="hexahedron", degree=1)
    body = NonlinearModel(mesh, updated_lagrangian, p, degree=1)
    limit = np.sqrt(0.1 * strength / (E / (3 * (1 - 2 * nu)) + E / (3 * (1 + nu))))  # of |d|

    def increment(gradient):
        u = np.zeros(body.layout.n_local)
        u[body.displacement_dofs] = body.layout.node_x @ np.asarray(gradient).T
        return u

    shear = limit / np.sqrt(2.0) * np.diag([1.0, -1.0, 0.0])
    body.check_increment(increment(0.98 * shear))
    with pytest.raises(LargeIncrementError, match=r"the step is 1\.0\d times as large"):
        body.check_increment(increment(1.02 * shear))
    body.check_increment(increment([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [0.0, 0.0, 0.0]]))  # a quarter turn
    body.check_increment(increment(0.1 * np.eye(3)))


@pytest.mark.parametrize("form", [hencky_plasticity, j2_plasticity])
def test_forms_that_take_any_step_are_left_alone(form):
    body, held, outward = ring(form)
    path = follow(body, [0.02], prescribed=held, displacement=lambda t: t * outward)
    assert (len(path.steps), path.cuts) == (1, 0)
