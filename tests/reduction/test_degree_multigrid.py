"""Multigrid whose coarser levels are elements of lower degrees: its parts, and how many iterations it needs."""

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import pytest
from dolfinx import fem

from flexmbd import meshes
from flexmbd.continuum import ContinuumModel, Interface
from flexmbd.continuum.finite_elements.lower_degree import next_lower, nodal_interpolation
from flexmbd.errors import ConvergenceError
from flexmbd.forms import solid_linear
from flexmbd.reduction import Solver, guyan
from flexmbd.reduction.modes.davidson import DavidsonSearch
from flexmbd.reduction.static_shapes import conjugate_gradients, interior_stiffness
from flexmbd.reduction.static_shapes.body_statics import body_statics
from flexmbd.reduction.static_shapes.degree_inverse import DegreeInverse

pytestmark = pytest.mark.mpi

COMM = MPI.COMM_WORLD
STEEL = solid_linear.Parameters(E=2.1e11, nu=0.3, rho=7850.0)


def block(divisions, *, degree=2, size=(1.0, 0.2, 0.3), cell="hexahedron", ends=("x_min", "x_max")):
    mesh = meshes.block(*size, divisions=divisions, cell=cell)
    return ContinuumModel(mesh, solid_linear, STEEL, degree=degree, interfaces=[Interface(one) for one in ends])


@pytest.mark.parametrize(("cell", "degree"), [("hexahedron", 2), ("tetrahedron", 2)])
def test_interpolation_between_degrees(cell, degree):
    """Against DOLFINx's own interpolation."""
    space = block((3, 2, 2), degree=degree, cell=cell).space
    lower = next_lower(space)
    assert lower.ufl_element().basix_element.degree == degree - 1
    fine, coarse = fem.Function(space), fem.Function(lower)
    owned = 3 * lower.dofmap.index_map.size_local
    coarse.x.array[:owned] = np.random.default_rng(COMM.rank).normal(size=owned)
    coarse.x.scatter_forward()
    fine.interpolate(coarse)
    values = np.vstack(COMM.allgather(coarse.x.array[:owned].reshape(-1, 3)))
    found = (nodal_interpolation(lower, space) @ values).reshape(-1)
    assert abs(found - fine.x.array[: len(found)]).max() < 1e-13


def test_no_degree_below_the_first():
    assert next_lower(block((2, 1, 1), degree=1).space) is None


def iterations(monkeypatch, model):
    """Of the static shapes by conjugate gradients."""
    counts = []
    original = conjugate_gradients.ConjugateGradients._iterate

    def counted(self, *arguments, **named):
        x, count = original(self, *arguments, **named)
        counts.append(count)
        return x, count

    monkeypatch.setattr(conjugate_gradients.ConjugateGradients, "_iterate", counted)
    guyan(model, frame="x_min", geometric_stiffness=False, solver=Solver.ITERATIVE)
    monkeypatch.undo()
    return max(counts)


def test_iterations_grow_neither_with_the_mesh_nor_with_slenderness(monkeypatch):
    cases = ((4, 2, 2), 0.4), ((8, 4, 4), 0.4), ((60, 2, 2), 6.0)
    coarse, fine, slender = (
        iterations(monkeypatch, block(divisions, size=(length, 0.2, 0.2))) for divisions, length in cases
    )
    assert fine <= coarse + 3
    assert slender <= coarse + 3
    assert max(fine, slender) < 25


@pytest.mark.parametrize(("degree", "cell"), [(2, "tetrahedron"), (2, "hexahedron")])
def test_as_by_a_factor(degree, cell):
    """Loads of any number and size, also none, on a body that is held, and on one that six dofs hold."""
    for ends in (("x_min", "x_max"), ()):
        model = block((4, 2, 2), degree=degree, cell=cell, ends=ends)
        loads = np.random.default_rng(COMM.rank).normal(size=(model.n_owned, 11)) * np.logspace(-9, 9, 11)
        loads[:, 4] = 0.0
        found = []
        for solver in (Solver.DIRECT, Solver.ITERATIVE):
            with body_statics(model, frame=ends[0] if ends else None, solver=solver) as statics:
                found.append(np.vstack(COMM.allgather(statics.static_response(loads))))
        exact, u = found
        assert not u[:, 4].any()
        size = abs(exact).max(axis=0)
        size[4] = 1.0
        assert (abs(u - exact).max(axis=0) / size).max() < 1e-10


@pytest.mark.parametrize(("thickness", "quick"), [(0.2, True), (0.002, False)])
def test_taken_where_a_factor_takes_long_and_cells_are_not_thin(monkeypatch, thickness, quick):
    model = block((6, 3, 3), size=(0.4, 0.2, thickness))
    assert guyan(model, frame="x_min", geometric_stiffness=False).provenance["solver"] == "direct"
    monkeypatch.setattr(interior_stiffness, "_WORTH", 1e3)
    chosen = guyan(model, frame="x_min", geometric_stiffness=False).provenance["solver"]
    assert chosen == (DegreeInverse.name if quick else "direct")


def test_thin_cells_are_told_early():
    """Cells of 1 to 1e-2, of which multigrid would take thousands of iterations."""
    model = block((4, 2, 2), size=(0.4, 0.2, 0.002))
    with pytest.raises(ConvergenceError, match=r"after (60|120|180) iterations.*thin"):
        guyan(model, frame="x_min", geometric_stiffness=False, solver=Solver.ITERATIVE)


def test_modes_that_a_start_does_not_see():
    """Of a diagonal matrix, from vectors with every second entry; a search from generic ones brings the others."""
    mass = PETSc.Mat().createConstantDiagonal((60, 60), 1.0, comm=COMM).convert("aij")
    first, end = mass.getOwnershipRange()
    values = np.arange(first, end)[:, None] + 1.0
    start = np.random.default_rng(COMM.rank).normal(size=(end - first, 2)) * (values % 2.0)
    search = DavidsonSearch(
        lambda block: values * block,
        mass,
        lambda block: block / (values + 0.3),
        lambda block: 1e-16 * values * abs(block),
        lambda block: block,
        start=np.asfortranarray(start),
        size=60,
        limit=100,
    )
    search.find(3)
    assert search.eigenvalues[:3] == pytest.approx([1.0, 3.0, 5.0])
    search.search_again()
    assert search.eigenvalues[:5] == pytest.approx([1.0, 2.0, 3.0, 4.0, 5.0])


def test_round_off_of_rigid_motions_does_not_grow_among_modes():
    """Of a matrix with two zeros along which an approximate inverse leaves 1e-15: where little is new that is much."""
    mass = PETSc.Mat().createConstantDiagonal((40, 40), 1.0, comm=COMM).convert("aij")
    first, end = mass.getOwnershipRange()
    values = np.maximum(np.arange(first, end)[:, None] - 1.0, 0.0)
    rigid = values == 0.0
    noise = np.random.default_rng(COMM.rank)

    def nearly_inverse(block):
        left = 1e-15 * noise.normal(size=block.shape)
        return np.asfortranarray(np.where(rigid, left, block / (values + 0.3)))

    search = DavidsonSearch(
        lambda block: values * block,
        mass,
        nearly_inverse,
        lambda block: 1e-16 * values * abs(block),
        lambda block: np.asfortranarray(np.where(rigid, 0.0, block)),
        start=np.asfortranarray(noise.normal(size=(end - first, 3))),
        size=38,
        limit=100,
    )
    for count in (10, 25, 38):
        search.find(count)
        search.search_again()
        assert search.eigenvalues[:count] == pytest.approx(np.arange(1.0, count + 1.0))
