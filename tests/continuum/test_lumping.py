"""Lumped masses: positive, of the exact total, and those of the rules they claim."""

import dataclasses
import types

from mpi4py import MPI

import basix.ufl
import dolfinx.fem.petsc
import micropolar
import numpy as np
import pytest
import saddle_point
import ufl
from dof_keys import everywhere, keys
from dolfinx import fem
from full_model import gather

from flexmbd import meshes
from flexmbd.continuum import ContinuumModel
from flexmbd.continuum.finite_elements.lumping import lumped_mass
from flexmbd.continuum.grid.tagged_mesh import from_arrays
from flexmbd.errors import FormulationError
from flexmbd.forms import solid_linear

RHO = 1200.0
MATERIAL = solid_linear.Parameters(E=3.0e9, nu=0.28, rho=RHO)
CASES = [("tetrahedron", 1), ("tetrahedron", 2), ("hexahedron", 1), ("hexahedron", 2)]


def bent(cell, degree, comm=MPI.COMM_WORLD):
    """A block whose cells are not all alike: its nodes are moved, and curved where the degree allows."""
    mesh = meshes.block(0.3, 0.1, 0.2, divisions=(3, 2, 2), cell=cell, degree=degree, comm=comm)
    x = mesh.mesh.geometry.x
    x[:] += 0.01 * np.stack([np.sin(20 * x[:, 1]), np.cos(15 * x[:, 2]), np.sin(9 * x[:, 0] * x[:, 1])], axis=1)
    return mesh


def model(cell, degree, geometry=None, form=solid_linear, material=MATERIAL, comm=MPI.COMM_WORLD):
    return ContinuumModel(bent(cell, geometry or degree, comm), form, material, degree=degree)


def volume(body):
    return body.comm.allreduce(fem.assemble_scalar(fem.form(1.0 * ufl.dx(domain=body.mesh.mesh, degree=12))))


def total(body, lumped, component):
    return body.comm.allreduce(lumped[body.displacement_dofs[: body.n_owned_nodes, component]].sum())


@pytest.mark.mpi
@pytest.mark.parametrize(("cell", "degree"), CASES)
def test_entries_are_positive_and_the_total_is_exact(cell, degree):
    body = model(cell, degree)
    lumped = lumped_mass(body)
    assert lumped.shape == (body.n_owned,)
    assert (lumped > 0).all()
    for component in range(3):
        assert total(body, lumped, component) == pytest.approx(RHO * volume(body), rel=1e-12)


@pytest.mark.mpi
@pytest.mark.parametrize(("cell", "degree"), CASES)
def test_entries_do_not_depend_on_the_number_of_ranks(cell, degree):
    world, alone = (model(cell, degree, comm=comm) for comm in (MPI.COMM_WORLD, MPI.COMM_SELF))
    found, expected = (everywhere(body, lumped_mass(body)) for body in (world, alone))
    assert abs(found - expected).max() < 1e-13 * expected.max()


@pytest.mark.mpi
@pytest.mark.parametrize("cell", ["tetrahedron", "hexahedron"])
def test_linear_cells_of_any_shape_keep_the_centre_of_mass(cell):
    """As row sums do, for x is the sum of its nodes' shape functions; a scaled diagonal of tapered cells does not."""
    mesh = bent(cell, 1)
    points = mesh.mesh.geometry.x
    points[:, 1:] *= np.stack([1 + 2 * points[:, 0], 1 + points[:, 0] + 3 * points[:, 1]], axis=1)
    body = ContinuumModel(mesh, solid_linear, MATERIAL, degree=1)
    lumped, domain = lumped_mass(body), body.mesh.mesh
    x = ufl.SpatialCoordinate(domain)
    nodes = body.space.tabulate_dof_coordinates()[: body.n_owned_nodes]
    for component in range(3):
        masses = lumped[body.displacement_dofs[: body.n_owned_nodes, component]]
        for axis in range(3):
            wanted = RHO * body.comm.allreduce(fem.assemble_scalar(fem.form(x[axis] * ufl.dx(degree=6))))
            assert body.comm.allreduce(masses @ nodes[:, axis]) == pytest.approx(wanted, rel=1e-12)


def row_sums(body):
    return np.asarray(gather(body.M).sum(axis=1)).ravel()


@pytest.mark.mpi
def test_the_trap_row_sums_of_quadratic_tetrahedra_are_not_positive_at_vertices():
    """They are -1/20 of each cell's mass at its vertices, 1/5 at its edges; so they are not taken."""
    body = model("tetrahedron", 2, geometry=1)
    sums = row_sums(body)
    first = body.M.getOwnershipRange()[0]
    cells = body.space.dofmap.list[: body.mesh.mesh.topology.index_map(3).size_local]
    owned = cells[cells < body.n_owned_nodes]
    vertices = np.unique(cells[:, :4][cells[:, :4] < body.n_owned_nodes])
    others = np.setdiff1d(owned, vertices)
    assert sums[first + 3 * vertices].max(initial=-1.0) < 0
    assert sums[first + 3 * others].min(initial=1.0) > 0


@pytest.mark.mpi
def test_linear_tetrahedra_follow_the_rule_of_the_vertices():
    """DOLFINx's own rule with its points there, assembled by it."""
    body = model("tetrahedron", 1)
    u, v = ufl.TrialFunction(body.space), ufl.TestFunction(body.space)
    dx = ufl.dx(metadata={"quadrature_rule": "vertex", "quadrature_degree": 1})
    matrix = dolfinx.fem.petsc.assemble_matrix(fem.form(RHO * ufl.inner(u, v) * dx))
    matrix.assemble()
    expected = matrix.getDiagonal().array
    assert abs(lumped_mass(body) - expected).max(initial=0) < 1e-13 * expected.max(initial=1)
    # and so do the sums of the rows
    first = body.M.getOwnershipRange()[0]
    sums = row_sums(body)[first : first + body.n_owned]
    assert abs(lumped_mass(body) - sums).max(initial=0) < 1e-13 * expected.max(initial=1)


@pytest.mark.parametrize(("cell", "degree"), [("tetrahedron", 2), ("hexahedron", 2)])
def test_quadratic_cells_scale_the_diagonal_cell_by_cell(cell, degree):
    """Against the same in a space whose cells share no nodes, where the diagonal is that of each cell."""
    body = model(cell, degree, comm=MPI.COMM_SELF)
    domain = body.mesh.mesh
    element = basix.ufl.element("Lagrange", cell, degree, discontinuous=True)
    broken = fem.functionspace(domain, element)
    u, v = ufl.TrialFunction(broken), ufl.TestFunction(broken)
    matrix = fem.assemble_matrix(fem.form(RHO * u * v * ufl.dx(metadata={"quadrature_degree": 12}))).to_dense()
    places = broken.dofmap.list
    expected = np.zeros(body.n_owned_nodes)
    for cell_nodes, own in zip(body.space.dofmap.list, places, strict=True):
        block = matrix[np.ix_(own, own)]
        np.add.at(expected, cell_nodes, block.sum() * np.diag(block) / np.trace(block))
    found = lumped_mass(body).reshape(-1, 3)
    assert abs(found - expected[:, None]).max() < 1e-12 * expected.max()


@pytest.mark.mpi
def test_one_straight_cell_by_hand():
    """Of a quadratic tetrahedron 1/36 of its mass at each vertex and 4/27 at each edge."""
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 2, 0], [0, 0, 3.0]])
    mesh = from_arrays(MPI.COMM_WORLD, points, [[0, 1, 2, 3]], degree=1, facet_groups={})
    body = ContinuumModel(mesh, solid_linear, MATERIAL, degree=2)
    lumped = lumped_mass(body)
    x = np.repeat(body.node_x[: body.n_owned_nodes], 3, axis=0)
    vertex = (abs(x[:, None] - points).max(axis=2) < 1e-12).any(axis=1)
    assert lumped == pytest.approx(np.where(vertex, RHO / 36, RHO * 4 / 27), rel=1e-13)


@pytest.mark.mpi
def test_rotations_have_inertia_and_pressures_none():
    p = micropolar.Parameters()
    body = model("tetrahedron", 2, form=micropolar, material=p)
    lumped, own = lumped_mass(body), keys(body)[: body.n_owned]
    turn = own[:, 4] >= 3
    assert (lumped > 0).all()
    found = body.comm.allreduce(np.array([lumped[~turn].sum(), lumped[turn].sum()]))
    assert found == pytest.approx(3 * p.rho * volume(body) * np.array([1, p.j]), rel=1e-12)

    q = saddle_point.Parameters()
    body = model("tetrahedron", 2, form=saddle_point, material=q)
    lumped, pressure = lumped_mass(body), keys(body)[: body.n_owned, 0] == 3
    assert (lumped[~pressure] > 0).all()
    assert not lumped[pressure].any()
    assert total(body, lumped, 1) == pytest.approx(q.rho * volume(body), rel=1e-12)


@pytest.mark.mpi
def test_two_materials():
    mesh = bent("tetrahedron", 1)
    count = mesh.mesh.topology.index_map(3)
    every = np.arange(count.size_local + count.num_ghosts, dtype=np.int32)
    heavy = dolfinx.mesh.compute_midpoints(mesh.mesh, 3, every)[:, 0] < 0.15
    tags = dolfinx.mesh.meshtags(mesh.mesh, 3, every, np.where(heavy, 1, 2).astype(np.int32))
    mesh = dataclasses.replace(mesh, cell_tags=tags, cell_groups={"heavy": 1, "light": 2})
    light = dataclasses.replace(MATERIAL, rho=1.0)
    body = ContinuumModel(mesh, {"heavy": (solid_linear, MATERIAL), "light": (solid_linear, light)}, degree=2)
    lumped = lumped_mass(body)
    assert (lumped > 0).all()
    ones = np.zeros(body.n_owned)
    ones[body.displacement_dofs[: body.n_owned_nodes, 0]] = 1.0
    vector = body.M.createVecRight()
    vector.array[:] = ones
    assert total(body, lumped, 0) == pytest.approx((body.M * vector).dot(vector), rel=1e-12)


@pytest.mark.mpi
def test_density_that_is_not_positive_is_refused():
    form = types.ModuleType("hollow")

    def kinetic_energy(v, p):
        x = ufl.SpatialCoordinate(ufl.domain.extract_unique_domain(v))
        return [(p.rho * (x[0] - 0.1) * ufl.inner(v, v), solid_linear.Quadrature(5))]

    form.__dict__.update({**vars(solid_linear), "__name__": "hollow", "kinetic_energy": kinetic_energy})
    body = model("tetrahedron", 2, form=form)
    with pytest.raises(FormulationError, match="hollow: the mass cannot be lumped: unknowns 0 to 2"):
        lumped_mass(body)
