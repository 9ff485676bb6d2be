"""Numbers of no material in SI units are told, right ones are not."""

import warnings

import numpy as np
import pytest

import flexmbd as fm
from flexmbd import forms, meshes
from flexmbd.continuum import ContinuumModel
from flexmbd.continuum.finite_elements.elastic_sums import elastic_sums


def told_of(mesh, form, parameters, *, degree=1):
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        ContinuumModel(mesh, form, parameters, degree=degree)
    return [str(one.message) for one in told if one.category is fm.UnitWarning]


def block(size=1.0):
    return meshes.block(size, 0.1 * size, 0.1 * size, divisions=(4, 2, 2))


@pytest.mark.parametrize(
    ("E", "rho", "words"),
    [
        (2.1e5, 7850.0, "m/s at a density of 7.85e+03"),  # E in MPa
        (2.1e11, 7.85e-9, "density is 7.85e-09"),  # rho in t/mm^3
        (2.1e5, 7.85e-9, "density is 7.85e-09"),  # both
        (2.1e11, 7.85, "faster than through diamond"),  # rho in g/cm^3
        (2.1e11, 7.85e6, "density is 7.85e+06"),  # rho in g/m^3
    ],
)
@pytest.mark.parametrize("size", [1e-3, 1.0])
def test_steel_in_other_units_is_told(E, rho, words, size):
    (text,) = told_of(block(size), forms.solid_linear, forms.solid_linear.Parameters(E=E, nu=0.3, rho=rho))
    assert words in text
    assert "kg/m^3 (steel 7850)" in text


MATERIALS = {
    "steel": (2.1e11, 0.3, 7850.0), "lead": (1.6e10, 0.44, 11340.0), "osmium": (5.5e11, 0.25, 22590.0),
    "diamond": (1.05e12, 0.1, 3510.0), "beryllium": (2.87e11, 0.03, 1850.0), "rubber": (1e6, 0.4999, 1100.0),
    "foam": (1e5, 0.1, 20.0), "aerogel": (1e6, 0.2, 2.0), "wood": (1.2e10, 0.3, 500.0), "unit": (1.0, 0.3, 1.0),
    "gel": (1e3, 0.49, 1000.0),
}  # fmt: skip


@pytest.mark.parametrize("name", MATERIALS)
def test_materials_are_not_told(name):
    E, nu, rho = MATERIALS[name]
    assert not told_of(block(), forms.solid_linear, forms.solid_linear.Parameters(E=E, nu=nu, rho=rho))


def test_beams_are_told_by_the_speed_of_waves():
    """They have no volume, and so no density."""
    form, line = forms.beam_timoshenko, meshes.line(1.0, divisions=4)
    for E, rho, count in ((2.1e11, 7850.0, 0), (1e6, 1100.0, 0), (2.1e11, 7.85e-9, 1), (2.1e11, 7.85, 1)):
        section = form.Parameters.rectangle(E, 0.3, rho, width=0.02, height=0.01, orientation=(0.0, 1.0, 0.0))
        assert len(told_of(line, form, section)) == count


@pytest.mark.parametrize(("E", "rho", "count"), [(2.1e11, 7850.0, 0), (2.1e11, 7.85, 1), (1e6, 1100.0, 0)])
def test_surfaces_are_told_by_the_stiffness_in_their_plane(E, rho, count):
    """Whatever holds them against bending out of it, or keeps their volume."""
    form, sheet = forms.plane_stress, meshes.sheet(1.0, 0.5, divisions=(4, 2), cell="quadrilateral")
    for more in ({}, {"out_of_plane": 1e6}, {"nu": 0.4999, "plane_strain": True}):
        parameters = form.Parameters(**{"E": E, "nu": 0.3, "rho": rho, "t": 0.01, **more})
        assert len(told_of(sheet, form, parameters, degree=2)) == count


def test_sums_are_those_of_the_material():
    """Shear and bulk modulus times the volume."""
    mesh = meshes.block(0.3, 0.2, 0.1, divisions=(3, 2, 2), cell="tetrahedron")
    material = forms.solid_linear.Parameters(E=3e9, nu=0.35, rho=900.0)
    model = ContinuumModel(mesh, forms.solid_linear, material, degree=2)
    sums = elastic_sums(mesh, model.layout, model.K, model.M)
    assert sums.volume == pytest.approx(0.006, rel=1e-12)
    assert sums.mass == pytest.approx(5.4, rel=1e-12)
    assert sums.shear == pytest.approx(0.006 * 3e9 / 2.7, rel=1e-9)
    assert sums.bulk == pytest.approx(0.006 * 3e9 / 0.9, rel=1e-9)
    assert sums.poisson == pytest.approx(0.35, rel=1e-9)
    assert sums.wave_speed == pytest.approx(np.sqrt(3e9 * 2.6 / 2.7 / 900.0), rel=1e-9)
