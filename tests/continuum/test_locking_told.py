"""Linear cells that may be too stiff are told, with about how much: against Bernoulli's beam."""

import warnings

import numpy as np
import pytest

import flexmbd as fm
from flexmbd import forms, meshes
from flexmbd.continuum import ContinuumModel, Interface, Roller, SymmetryPlane
from flexmbd.reduction import craig_bampton, guyan


def told_of(mesh, nu, *, degree=1, reduce=guyan, supports=(), **options):
    """What is told, and the record."""
    material = forms.solid_linear.Parameters(E=2.1e11, nu=nu, rho=7850.0)
    model = ContinuumModel(
        mesh, forms.solid_linear, material, degree=degree, interfaces=[Interface("x_min")], supports=supports
    )
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        body = reduce(model, frame="x_min", **options)
    return [str(one.message) for one in told if one.category is fm.LockingWarning], body


CASES = [(0.3, (20, 1, 1)), (0.4999, (20, 2, 2)), (0.3, (40, 2, 2)), (0.3, (8, 1, 1)), (0.49, (60, 3, 3))]


@pytest.mark.parametrize(("nu", "divisions"), CASES)
def test_about_how_much_too_high_a_frequency_is(nu, divisions):
    """Of a slender beam: the excess over Bernoulli's frequency within a third."""
    mesh = meshes.block(1.0, 0.05, 0.05, divisions=divisions)
    (text,), body = told_of(mesh, nu, reduce=craig_bampton, modes=2)
    exact = 1.8751**2 / (2.0 * np.pi) * np.sqrt(2.1e11 * 0.05**2 / 12.0 / 7850.0)
    excess = 100.0 * (float(body.frequencies(clamped=["x_min"])[0]) / exact - 1.0)
    assert "degree=2" in text
    assert float(text.split("some ")[1].split()[0]) == pytest.approx(excess, rel=0.34)


@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
@pytest.mark.parametrize("size", [1e-3, 1.0, 1e3])
def test_four_cells_through_each_thickness_are_not_told(cell, size):
    def block(through):
        return meshes.block(size, 0.4 * size, 0.2 * size, divisions=(10, 6, through), cell=cell)

    assert not told_of(block(4), 0.3)[0]
    assert "Poisson's ratio is 0.46" in told_of(block(4), 0.46)[0][0]
    assert "3 cells lie" in told_of(block(3), 0.3)[0][0]
    assert "2 cells lie" in told_of(block(2), 0.3)[0][0]
    assert "one cell lies" in told_of(block(1), 0.3)[0][0]


def test_a_plane_of_symmetry_is_no_surface():
    """Two cells of a half are four of the whole."""
    half = meshes.block(1.0, 0.4, 0.1, divisions=(10, 6, 2))
    assert "2 cells lie" in told_of(half, 0.3)[0][0]
    for supports, count in (([SymmetryPlane("z_min", (0, 0, 1))], 0), ([Roller("z_min", (0, 1, 0))], 1)):
        assert len(told_of(half, 0.3, supports=supports)[0]) == count


def test_quadratic_cells_are_not_told():
    block = meshes.block(1.0, 0.1, 0.1, divisions=(6, 1, 1))
    assert not told_of(block, 0.4999, degree=2)[0]
    assert told_of(block, 0.4999)[0]


@pytest.mark.mpi
def test_ranks_count_cells_together():
    """Which is told on rank 0 alone."""
    from mpi4py import MPI

    comm = MPI.COMM_WORLD
    for through, told in ((4, 0), (3, 1)):
        block = meshes.block(1.0, 0.4, 0.2, divisions=(10, 6, through), cell="hexahedron", comm=comm)
        assert len(told_of(block, 0.3)[0]) == (told if comm.rank == 0 else 0)
