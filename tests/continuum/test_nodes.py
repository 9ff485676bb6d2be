"""Numbers of displacement nodes and the boundary's triangles, on one rank and on two."""

from itertools import combinations

from mpi4py import MPI

import numpy as np
import pytest

from flexmbd import meshes
from flexmbd.continuum import ContinuumModel
from flexmbd.continuum.compat import cell_nodes
from flexmbd.continuum.finite_elements.nodes import boundary_triangles, node_numbers
from flexmbd.continuum.grid.tagged_mesh import from_arrays
from flexmbd.forms import solid_linear

MATERIAL = solid_linear.Parameters(E=3.0e9, nu=0.28, rho=1200.0)
SIZE = (0.3, 0.1, 0.2)
CASES = [
    ("hexahedron", 1, 1),
    ("hexahedron", 1, 2),
    ("hexahedron", 2, 2),
    ("tetrahedron", 1, 1),
    ("tetrahedron", 1, 2),
    ("tetrahedron", 2, 2),
]


def block(cell, degree, comm=MPI.COMM_WORLD):
    return meshes.block(*SIZE, divisions=(3, 1, 2), cell=cell, degree=degree, comm=comm)


def unassembled(mesh, degree):
    """A model whose matrices nobody looks at: a form without stiffness would be refused."""
    return ContinuumModel(mesh, solid_linear, MATERIAL, degree=degree)


def shuffled(degree):
    """The block's tetrahedra with the nodes in another order, and the points in that order."""
    mesh = block("tetrahedron", degree, MPI.COMM_SELF).mesh
    order = np.random.default_rng(1).permutation(len(mesh.geometry.x))
    points = mesh.geometry.x[order]
    cells = np.argsort(order)[cell_nodes(mesh)]
    if degree == 2:
        # basix lists the edges 23, 13, 12, 03, 02, 01
        cells = cells[:, [0, 1, 2, 3, 9, 8, 7, 6, 5, 4]]
    return points, cells, from_arrays(MPI.COMM_WORLD, points, cells, degree=degree, facet_groups={})


@pytest.mark.mpi
@pytest.mark.parametrize(("geometry", "degree"), [(1, 1), (1, 2), (2, 2)])
def test_nodes_of_the_mesh_have_their_row_in_the_input(geometry, degree):
    points, _, mesh = shuffled(geometry)
    model = unassembled(mesh, degree)
    numbers = node_numbers(model)
    x = model.space.tabulate_dof_coordinates()
    known = numbers < len(points)
    assert abs(points[numbers[known]] - x[known]).max() < 1e-14
    owned = np.concatenate(model.comm.allgather(numbers[: model.n_owned // 3]))
    assert np.array_equal(np.sort(owned), np.arange(len(owned)))


@pytest.mark.mpi
def test_middles_are_numbered_in_the_order_of_their_vertices():
    points, cells, mesh = shuffled(1)
    model = unassembled(mesh, 2)
    pairs = sorted(
        {tuple(sorted(pair)) for cell in cells for pair in combinations(cell.tolist(), 2)}
    )
    expected = np.vstack([points, points[np.array(pairs)].mean(axis=1)])
    x = model.space.tabulate_dof_coordinates()
    assert abs(expected[node_numbers(model)] - x).max() < 1e-14


@pytest.mark.mpi
@pytest.mark.parametrize(("cell", "geometry", "degree"), CASES)
def test_numbers_do_not_depend_on_the_number_of_ranks(cell, geometry, degree):
    world, alone = (
        unassembled(block(cell, geometry, comm), degree) for comm in (MPI.COMM_WORLD, MPI.COMM_SELF)
    )
    expected = np.empty_like(alone.space.tabulate_dof_coordinates())
    expected[node_numbers(alone)] = alone.space.tabulate_dof_coordinates()
    found = world.space.tabulate_dof_coordinates()
    assert abs(expected[node_numbers(world)] - found).max() < 1e-14


@pytest.mark.mpi
@pytest.mark.parametrize(("cell", "geometry", "degree"), CASES)
def test_triangles_cover_the_box_and_look_outwards(cell, geometry, degree):
    """Area, volume by the divergence theorem, and each edge once in either direction."""
    model = unassembled(block(cell, geometry), degree)
    triangles = boundary_triangles(model)
    a, b, c = np.moveaxis(model.space.tabulate_dof_coordinates()[triangles], 1, 0)
    normal = np.cross(b - a, c - a) / 2
    length, width, height = SIZE
    area = model.comm.allreduce(np.linalg.norm(normal, axis=1).sum())
    volume = model.comm.allreduce(np.einsum("ti,ti", normal, (a + b + c) / 3) / 3)
    assert area == pytest.approx(2 * (length * width + width * height + height * length), rel=1e-12)
    assert volume == pytest.approx(length * width * height, rel=1e-12)

    numbers = node_numbers(model)[triangles]
    edges = np.concatenate([numbers[:, [0, 1]], numbers[:, [1, 2]], numbers[:, [2, 0]]])
    every = np.concatenate(model.comm.allgather(edges))
    assert len(np.unique(every, axis=0)) == len(every)
    assert {tuple(edge) for edge in every} == {tuple(edge[::-1]) for edge in every}
    facets = 2 * (3 * 1 + 1 * 2 + 2 * 3) * (1 if cell == "hexahedron" else 2)
    assert len(every) // 3 == facets * (2 if cell == "hexahedron" else 1) * (
        4 if degree == 2 else 1
    )
