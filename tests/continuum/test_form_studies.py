"""Studies of a form for its report: against closed forms of a cell and of bending, and known properties of elements."""

import numpy as np
import pytest

from flexmbd.continuum.contract.formulation import load_form
from flexmbd.continuum.contract_suite.cell_spectrum import cell_spectrum
from flexmbd.continuum.contract_suite.convergence import convergence
from flexmbd.continuum.contract_suite.inf_sup import inf_sup
from flexmbd.continuum.contract_suite.locking_study import (
    RATIOS,
    THICKNESSES,
    bending_locking,
    thin_surface_locking,
    volumetric_locking,
)
from flexmbd.continuum.contract_suite.trial_mesh import DIMENSION, Family, bar_mesh, family_mesh


def volume(mesh):
    import ufl
    from dolfinx import fem

    return fem.assemble_scalar(fem.form(fem.Constant(mesh, 1.0) * ufl.dx(domain=mesh, degree=8)))


@pytest.mark.parametrize("cell", DIMENSION)
@pytest.mark.parametrize("family", Family)
def test_meshes_fill_the_same_body(cell, family):
    mesh = family_mesh(cell, family, n=3)
    assert volume(mesh) == pytest.approx(1.0, rel=1e-12)
    x = mesh.geometry.x
    sides = [[0.0, 0.0, 0.0], [float(k < DIMENSION[cell]) for k in range(3)]]
    np.testing.assert_allclose([x.min(axis=0), x.max(axis=0)], sides, atol=1e-14)
    even = family_mesh(cell, Family.REGULAR, n=3).geometry.x
    if family in (Family.DISTORTED, Family.TRAPEZOIDAL):
        assert abs(np.sort(x, axis=0) - np.sort(even, axis=0)).max() > 0.02


def test_trapezoids_stay_trapezoids_when_refined():
    """Opposite edges of a cell differ by the same share however fine the mesh is."""
    for n in (4, 8):
        x = family_mesh("quadrilateral", Family.TRAPEZOIDAL, n=n).geometry.x
        heights = [np.diff(np.sort(x[np.isclose(x[:, 0], k / n), 1]))[1] * n for k in (1, 2)]
        np.testing.assert_allclose(sorted(heights), [0.5, 1.5])


@pytest.mark.parametrize(("cell", "degree", "order"), [("hexahedron", 1, 2), ("tetrahedron", 2, 3)])
def test_orders_of_the_linear_solid(cell, degree, order):
    form = load_form("solid_linear")
    for family in Family:
        found = convergence(form, cell, degree, family=family)
        assert (found.fault, len(found.errors), found.claimed) == ("", 4, order)
        assert abs(found.order - order) < 0.1


def test_a_pressure_in_each_hexahedron_loses_order_on_trapezoids():
    """Arnold, Boffi and Falk 2002: spaces of the reference cell do not hold what they should on trapezoids."""
    form = load_form("solid_mixed")
    found = {one: convergence(form, "hexahedron", 1, family=one).order for one in (Family.REGULAR, Family.TRAPEZOIDAL)}
    assert found[Family.REGULAR] == pytest.approx(2.0, abs=0.1)
    assert found[Family.TRAPEZOIDAL] < 1.6


def test_bending_of_linear_bricks_is_too_stiff_by_the_known_factor():
    """Cook, Malkus & Plesha 1989, section 6.14: 1 / (1 + nu) (1 / (1 - nu) + (a / b)^2 / 2), here where a / b rules."""
    form = load_form("solid_linear")
    found = bending_locking(form, "hexahedron", 1)
    slender = 0.125 / np.array(THICKNESSES)
    np.testing.assert_allclose(found.results[2:], slender[2:] ** 2 / 2 / 1.3, rtol=0.02)
    # of the energy round-off leaves eps (L / t)^4: that of displacements of a bent bar, over its strains
    left = 10 * np.finfo(float).eps / np.array(THICKNESSES) ** 4 + 1e-9
    assert (abs(np.array(bending_locking(form, "hexahedron", 2).results) - 1.0) < left).all()
    assert volume(bar_mesh("tetrahedron", n=3, thickness=0.1)) == pytest.approx(0.01)


def test_locking_of_volume():
    """A form of displacements loses its order as nu approaches 1/2; one with a pressure keeps error and order."""
    mixed, plain = (volumetric_locking(load_form(name), "hexahedron", 2) for name in ("solid_mixed", "solid_linear"))
    assert [one.values for one in (*mixed, *plain)] == [RATIOS] * 4
    assert mixed[0].results[-1] < 1.1 * mixed[0].results[0]
    assert min(mixed[1].results) > 2.9
    assert plain[0].results[-1] > 2.0 * plain[0].results[0]
    assert plain[1].results[0] > 2.9
    assert plain[1].results[-1] < 2.5


def test_what_cannot_be_studied_says_why():
    assert "no parameter E and no nu" in volumetric_locking(load_form("solid_orthotropic"), "hexahedron", 1)[0].fault
    assert thin_surface_locking(load_form("beam_timoshenko"), "interval", 1).fault == (
        "not tried: the form has no parameter t"
    )


def test_thin_plates():
    """Bathe and Dvorkin's shear from edges does not lock; bending that `plane_stress` adds does, as its page says."""
    plate, plane = (
        thin_surface_locking(load_form(name), "triangle", degree)
        for name, degree in (("plate_mitc", 1), ("plane_stress", 2))
    )
    np.testing.assert_allclose(plate.results, plate.results[0], rtol=0.03)
    assert plane.results[-1] > 3.0 * plane.results[0]


def test_inf_sup_numbers():
    """Those of Taylor and Hood's pair stay; those of a pressure in each brick fall, and some are never felt."""
    form = load_form("solid_mixed")
    stable, wrong = inf_sup(form, "tetrahedron", 2), inf_sup(form, "hexahedron", 1)
    assert set(stable.zeros) == {1}
    assert min(stable.numbers) > 0.15
    assert stable.numbers[-1] > 0.95 * stable.numbers[-2]
    assert min(wrong.zeros) > 1
    assert wrong.numbers[-1] < 0.4 * wrong.numbers[0]
    assert inf_sup(load_form("solid_linear"), "tetrahedron", 1) is None


def test_eigenvalues_of_a_brick():
    """Of a unit cube: the bulk motion E / (2 (1 - 2 nu)), five shears of E / (2 (1 + nu)), and the trace; nu = 0.3."""
    found = cell_spectrum(load_form("solid_linear"), "hexahedron", 1, distorted=False)
    assert (len(found.values), found.zeros) == (24, 6)
    values = np.array(found.values)
    assert values[-1] == 1.0
    assert np.sum(abs(values - (1.0 - 2 * 0.3) / (1.0 + 0.3)) < 1e-12) >= 5
    lame, shear = 0.3 / 1.3 / 0.4, 1.0 / 2.6
    assert values.sum() == pytest.approx(24 * (lame + 4 * shear) / 9 * 2 * (1 - 2 * 0.3))
    assert cell_spectrum(load_form("solid_linear"), "hexahedron", 1, distorted=True).zeros == 6


def test_a_cell_with_too_few_points_has_motions_without_energy(tmp_path):
    from pathlib import Path

    text = (Path(__file__).parents[1] / "data" / "own_solid.py").read_text()
    path = tmp_path / "few.py"
    path.write_text(text.replace("return [(energy, Quadrature(degree))]", "return [(energy, Quadrature(1))]"))
    assert cell_spectrum(load_form(path), "hexahedron", 1, distorted=False).zeros == 6 + 12
