"""Plate and tube of tetrahedra and hexahedra: sizes, groups, curved cells."""

from mpi4py import MPI

import dolfinx
import numpy as np
import pytest
from measures import area, extents, n_cells, n_owned, nodes_of, volume

from flexmbd import meshes
from flexmbd.continuum.compat import geometry_degree
from flexmbd.errors import MeshError

pytestmark = pytest.mark.mpi

COMM = MPI.COMM_WORLD
CELLS = ("tetrahedron", "hexahedron")


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize(("cell", "in_each"), [("hexahedron", 1), ("tetrahedron", 6)])
def test_plate(cell, in_each, degree):
    plate = meshes.plate(0.3, 0.2, 0.004, h=0.0501, through=2, cell=cell, degree=degree)
    assert n_cells(plate) == 6 * 4 * 2 * in_each
    assert geometry_degree(plate.mesh) == degree
    assert volume(plate) == pytest.approx(0.3 * 0.2 * 0.004, rel=1e-12)
    corners = np.array([[0, -0.1, -0.002], [0.3, 0.1, 0.002]])
    assert extents(plate) == pytest.approx(corners, abs=1e-15)
    areas = {"x_min": 8e-4, "x_max": 8e-4, "y_min": 12e-4, "y_max": 12e-4, "z_min": 0.06, "z_max": 0.06}
    assert plate.facet_groups.keys() == areas.keys()
    for name, exact in areas.items():
        assert area(plate, name) == pytest.approx(exact, rel=1e-12)
        axis, end = "xyz".index(name[0]), name.endswith("max")
        assert nodes_of(plate, name)[:, axis] == pytest.approx(corners[int(end), axis], abs=1e-15)
    assert n_owned(plate, 3, plate.cells("plate")) == n_cells(plate)


LENGTH, OUTER, INNER = 0.3, 0.05, 0.04
EXACT = {
    "start": np.pi * (OUTER**2 - INNER**2),
    "end": np.pi * (OUTER**2 - INNER**2),
    "inner": 2 * np.pi * INNER * LENGTH,
    "outer": 2 * np.pi * OUTER * LENGTH,
}


@pytest.mark.parametrize("cell", CELLS)
def test_tube(cell):
    """Halving h gains h^2 with straight cells and h^4 with curved ones, on every face."""
    errors = {}
    for h, degree in ((0.02, 1), (0.02, 2), (0.01, 2)):
        tube = meshes.tube(LENGTH, OUTER, INNER, h=h, cell=cell, degree=degree)
        assert tube.mesh.topology.cell_name() == cell
        assert geometry_degree(tube.mesh) == degree
        assert tube.facet_groups.keys() == EXACT.keys()
        assert n_owned(tube, 3, tube.cells("tube")) == n_cells(tube)
        for name, radius in (("inner", INNER), ("outer", OUTER)):
            x = nodes_of(tube, name)
            assert np.hypot(x[:, 1], x[:, 2]) == pytest.approx(radius, rel=1e-9)
        for name, place in (("start", 0.0), ("end", LENGTH)):
            assert nodes_of(tube, name)[:, 0] == pytest.approx(place, abs=1e-12)
        errors[h, degree] = {name: abs(area(tube, name) / EXACT[name] - 1) for name in EXACT}
        errors[h, degree]["volume"] = abs(volume(tube) / (EXACT["end"] * LENGTH) - 1)
        tube.mesh.topology.create_connectivity(2, 3)
        boundary = dolfinx.mesh.exterior_facet_indices(tube.mesh.topology)
        assert np.array_equal(np.sort(tube.facet_tags.indices), np.sort(boundary))
    for name in errors[0.02, 1]:
        assert errors[0.02, 2][name] < errors[0.02, 1][name] / 20
        assert errors[0.01, 2][name] < errors[0.02, 2][name] / 8


def test_tube_of_hexahedra_has_edges_up_to_h():
    # around: quarters of 0.0785 m; through: 0.01 m; along: 0.3 m
    tube = meshes.tube(LENGTH, OUTER, INNER, h=0.009, cell="hexahedron", degree=1)
    assert n_cells(tube) == 4 * 9 * 2 * 34
    coarse = meshes.tube(LENGTH, OUTER, INNER, h=1.0, cell="hexahedron", degree=1)
    assert n_cells(coarse) == 8


@pytest.mark.parametrize(
    ("call", "pattern"),
    [
        (lambda: meshes.plate(1, 1, -1, h=1), "thickness must be a positive"),
        (lambda: meshes.plate(1, 1, 1, h=1, through=1.5), "through must be a positive whole"),
        (lambda: meshes.plate(1, 1, 1, h=1, cell="quad"), "cell must be"),
        (lambda: meshes.tube(1, 1, "a", h=1), "inner_radius must be a positive"),
        (lambda: meshes.tube(1, 1, 1.0, h=1), "inner_radius must be below outer_radius, 1 m, got 1"),
        (lambda: meshes.tube(1, 2, 1, h=1, degree=0), "degree of the geometry"),
    ],
)
def test_bad_arguments(call, pattern):
    with pytest.raises(MeshError, match=pattern):
        call()


@pytest.mark.parametrize(
    "call",
    [
        lambda h: meshes.plate(1, 1, 1, h=h),
        lambda h: meshes.tube(1, 2, 1, h=h),
        lambda h: meshes.beam(1, 1, 1, h=h),
        lambda h: meshes.block(1, 1, h, divisions=(1, 1, 1)),
        lambda h: meshes.connecting_rod(h=h),
        lambda h: meshes.crank(h=h),
    ],
)
@pytest.mark.parametrize("other", [0.6, -1.0, None])
def test_an_argument_of_one_rank_only(call, other):
    """Rank 1 has another size, or a bad one: an error on all ranks, and nobody waits."""
    if COMM.size == 1:
        return
    with pytest.raises(MeshError, match=f"is 0.5 on rank 0 and {other} on rank 1"):
        call(other if COMM.rank == 1 else 0.5)
    assert COMM.allreduce(1) == COMM.size
