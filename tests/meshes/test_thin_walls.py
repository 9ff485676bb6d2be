"""Walls of bricks from surfaces of quadrilaterals: sizes, folds, sides, groups, and what is refused."""

from mpi4py import MPI

import numpy as np
import pytest
import ufl
from dolfinx import fem

from flexmbd import meshes
from flexmbd.continuum.compat import cell_nodes
from flexmbd.errors import MeshError


def grid(n, m, place):
    """Points and cells, lexicographic, of a grid of n x m cells; ``place`` (i, j) in the unit square -> x, y, z."""
    i, j = (v.ravel() for v in np.meshgrid(np.linspace(0, 1, n + 1), np.linspace(0, 1, m + 1), indexing="ij"))
    row = np.arange((n + 1) * (m + 1)).reshape(n + 1, m + 1)
    cells = np.stack([row[a : a + n, b : b + m].ravel() for b in (0, 1) for a in (0, 1)], axis=1)
    return np.stack([np.broadcast_to(v, i.shape) for v in place(i, j)], axis=1).astype(float), cells


def surface(points, cells, **groups):
    return meshes.from_arrays(MPI.COMM_WORLD, points, cells, cell="quadrilateral", degree=1, facet_groups=groups)


def area(wall, name):
    ds = ufl.Measure("ds", domain=wall.mesh, subdomain_data=wall.facet_tags)
    form = fem.form(fem.Constant(wall.mesh, 1.0) * ds(wall.facet_groups[name]))
    return wall.comm.allreduce(fem.assemble_scalar(form))


def volume(wall):
    return wall.comm.allreduce(fem.assemble_scalar(fem.form(fem.Constant(wall.mesh, 1.0) * ufl.dx)))


def third_edges(wall):
    corners = wall.mesh.geometry.x[cell_nodes(wall.mesh)]
    return np.linalg.norm(corners[:, 4:] - corners[:, :4], axis=2)


@pytest.mark.mpi
def test_a_sheet_becomes_a_plate():
    sheet = meshes.sheet(1.0, 0.5, divisions=(4, 2))
    wall = meshes.wall(sheet, 0.01, layers=2, offset=0.5)
    assert set(wall.facet_groups) == {"x_min", "x_max", "y_min", "y_max", "top", "bottom"}
    assert set(wall.cell_groups) == {"sheet"}
    assert volume(wall) == pytest.approx(0.005, rel=1e-12)
    assert area(wall, "top") == pytest.approx(0.5, rel=1e-12)
    assert area(wall, "x_min") == pytest.approx(0.005, rel=1e-12)
    z = wall.mesh.geometry.x[:, 2]
    low, high = wall.comm.allreduce(z.min(), op=MPI.MIN), wall.comm.allreduce(z.max(), op=MPI.MAX)
    assert (low, high) in (pytest.approx((0.0, 0.01), abs=1e-15), pytest.approx((-0.01, 0.0), abs=1e-15))
    np.testing.assert_allclose(third_edges(wall), 0.005, rtol=1e-12)


@pytest.mark.mpi
def test_a_fold_keeps_its_thickness_whatever_side_cells_face():
    points, cells = grid(6, 2, lambda i, j: (np.minimum(2 * i, 1), 0.5 * j, np.maximum(2 * i - 1, 0)))
    flip = np.random.default_rng(3).random(len(cells)) < 0.5
    cells[flip] = cells[flip][:, [0, 2, 1, 3]]
    wall = meshes.wall(surface(points, cells, end=lambda x: x[2] > 1 - 1e-9), 0.02)
    # two plates of 1 m by 0.5 m whose middles meet: mitred, so that neither the volume nor a face has a step
    assert volume(wall) == pytest.approx(0.02, rel=1e-12)
    assert sorted(area(wall, name) for name in ("top", "bottom")) == pytest.approx([0.99, 1.01], rel=1e-12)
    assert area(wall, "end") == pytest.approx(0.01, rel=1e-12)


def test_a_cylinder_and_its_own_normals():
    place = lambda i, j: (np.cos(np.pi / 2 * i), np.sin(np.pi / 2 * i), j)  # noqa: E731
    radial = lambda x: x * [[1.0], [1.0], [0.0]]  # noqa: E731
    lean, square = (meshes.wall(surface(*grid(8, 2, place)), 0.1, normals=n) for n in (None, radial))
    radii = np.linalg.norm(square.mesh.geometry.x[:, :2], axis=1)
    np.testing.assert_allclose(np.unique(radii.round(12)), [0.95, 1.05])
    assert abs(square.mesh.geometry.x[:, :2]).min() < 1e-15  # both rims lie in their planes of symmetry
    assert 1e-3 < abs(lean.mesh.geometry.x[:, :2]).min() < 0.05


def test_a_thickness_that_tapers():
    wall = meshes.wall(surface(*grid(4, 1, lambda i, j: (2 * i, j, 0.0))), lambda x: 0.02 - 0.005 * x[0])
    assert volume(wall) == pytest.approx(2 * 0.015, rel=1e-12)


def test_a_moebius_strip_has_one_side():
    def place(i, j):
        turn, along = np.pi * i, 2 * np.pi * i
        across = 0.4 * (j - 0.5)
        radius = 1 + across * np.cos(turn)
        return radius * np.cos(along), radius * np.sin(along), across * np.sin(turn)

    points, cells = grid(16, 2, place)
    seam = {48 + j: 2 - j for j in range(3)}  # its last row of nodes is the first, the other way round
    cells = np.vectorize(lambda k: seam.get(k, k))(cells)
    with pytest.raises(MeshError, match="one side only"):
        meshes.wall(surface(points[:48], cells), 0.01)


def test_three_plates_at_an_edge_are_refused():
    points, cells = grid(2, 1, lambda i, j: (2 * i - 1, j, 0.0))
    points = np.vstack([points, [[0, 0, 1], [0, 1, 1]]])
    with pytest.raises(MeshError, match="branches: 3 cells meet"):
        meshes.wall(surface(points, np.vstack([cells, [[2, 6, 3, 7]]])), 0.01)


def test_a_wall_thicker_than_the_bend():
    place = lambda i, j: (0.1 * np.cos(np.pi / 2 * i), 0.1 * np.sin(np.pi / 2 * i), j)  # noqa: E731
    bent = surface(*grid(8, 1, place))
    with pytest.raises(MeshError, match="inside out"):
        meshes.wall(bent, 0.25)
    outwards = meshes.wall(bent, 0.25, offset=0.5)  # to one side there is room
    assert volume(outwards) > 0.0


@pytest.mark.parametrize("thickness", [0.0, -1e-3, np.inf, "1 mm", lambda x: x[0] - 0.5, lambda x: 0.1])
def test_thicknesses_that_are_none(thickness):
    with pytest.raises(MeshError, match="thickness"):
        meshes.wall(meshes.sheet(1.0, 1.0, divisions=(2, 2)), thickness)


def test_triangles_and_solids_are_refused():
    for part in (meshes.sheet(1.0, 1.0, divisions=(2, 2), cell="triangle"), meshes.block(1, 1, 1, divisions=(1, 1, 1))):
        with pytest.raises(MeshError, match="quadrilaterals of degree 1"):
            meshes.wall(part, 0.1)


def test_normals_that_lie_in_the_surface():
    with pytest.raises(MeshError, match="60 degrees"):
        meshes.wall(meshes.sheet(1.0, 1.0, divisions=(2, 2)), 0.1, normals=lambda x: [[1.0], [0.0], [0.0]] + 0 * x)
