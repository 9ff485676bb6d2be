"""A quarter of a thick ring: its grid, sizes and groups, and what is refused."""

from mpi4py import MPI

import dolfinx
import numpy as np
import pytest
from measures import area, extents, moments, n_cells, n_owned, nodes_of, volume

from flexmbd import meshes
from flexmbd.continuum.compat import geometry_degree
from flexmbd.errors import MeshError

pytestmark = pytest.mark.mpi

HEIGHT, OUTER, INNER = 0.03, 0.2, 0.12
EXACT = {
    "inner": np.pi / 2 * INNER * HEIGHT,
    "outer": np.pi / 2 * OUTER * HEIGHT,
    "x_min": (OUTER - INNER) * HEIGHT,
    "y_min": (OUTER - INNER) * HEIGHT,
    "bottom": np.pi / 4 * (OUTER**2 - INNER**2),
    "top": np.pi / 4 * (OUTER**2 - INNER**2),
}


def errors(around, degree):
    """Of the areas and the volume; everything else about the ring is checked."""
    ring = meshes.quarter_ring(HEIGHT, OUTER, INNER, divisions=(3, around, 2), degree=degree)
    assert ring.mesh.topology.cell_name() == "hexahedron"
    assert geometry_degree(ring.mesh) == degree
    assert n_cells(ring) == 3 * around * 2
    assert n_owned(ring, 3, ring.cells("ring")) == n_cells(ring)
    assert ring.facet_groups.keys() == EXACT.keys()
    assert extents(ring) == pytest.approx(np.array([[0.0, 0.0, 0.0], [OUTER, OUTER, HEIGHT]]), abs=1e-12)
    for name, radius in (("inner", INNER), ("outer", OUTER)):
        assert np.hypot(*nodes_of(ring, name)[:, :2].T) == pytest.approx(radius, rel=1e-9)
    for name, axis, place in (("x_min", 0, 0.0), ("y_min", 1, 0.0), ("bottom", 2, 0.0), ("top", 2, HEIGHT)):
        assert nodes_of(ring, name)[:, axis] == pytest.approx(place, abs=1e-12)
    ring.mesh.topology.create_connectivity(2, 3)
    boundary = dolfinx.mesh.exterior_facet_indices(ring.mesh.topology)
    assert np.array_equal(np.sort(ring.facet_tags.indices), np.sort(boundary))
    # the first moments along x and y are alike, and those of a ring as near as its volume is
    first = moments(ring)[0, 1:3]
    assert first[0] == pytest.approx(first[1], rel=1e-9)
    assert first[0] == pytest.approx((OUTER**3 - INNER**3) / 3 * HEIGHT, rel=0.05 if degree == 1 else 1e-3)
    found = {name: abs(area(ring, name) / exact - 1) for name, exact in EXACT.items()}
    return found | {"volume": abs(volume(ring) / (EXACT["top"] * HEIGHT) - 1)}


@pytest.mark.parametrize(("degree", "gain"), [(1, 3.9), (2, 14.0)])
def test_quarter_ring(degree, gain):
    """Twice the cells around gain 4 with straight cells and 16 with curved ones; plane walls are exact."""
    coarse, fine = errors(4, degree), errors(8, degree)
    for name in EXACT.keys() | {"volume"}:
        if name in ("x_min", "y_min"):
            assert coarse[name] < 1e-12
        else:
            assert fine[name] < coarse[name] / gain
    assert fine["volume"] < (0.01 if degree == 1 else 1e-4)


def test_equal_intervals():
    ring = meshes.quarter_ring(HEIGHT, OUTER, INNER, divisions=(4, 3, 2))
    x = ring.mesh.geometry.x
    for values, low, high, count in (
        (np.hypot(x[:, 0], x[:, 1]), INNER, OUTER, 4),
        (np.arctan2(x[:, 1], x[:, 0]), 0.0, np.pi / 2, 3),
        (x[:, 2], 0.0, HEIGHT, 2),
    ):
        place = (values - low) / (high - low) * count
        assert place == pytest.approx(np.round(place), abs=1e-9)
        everywhere = set().union(*MPI.COMM_WORLD.allgather(set(np.round(place).astype(int))))
        assert everywhere == set(range(count + 1))


@pytest.mark.parametrize(
    ("call", "pattern"),
    [
        (lambda: meshes.quarter_ring(0.1, 1, 1.0, divisions=(1, 1, 1)), "inner_radius must be below outer_radius, 1 m"),
        (lambda: meshes.quarter_ring(-0.1, 1, 0.5, divisions=(1, 1, 1)), "height must be a positive"),
        (lambda: meshes.quarter_ring(0.1, 1, 0.5, divisions=(1, 1)), "divisions"),
        (lambda: meshes.quarter_ring(0.1, 1, 0.5, divisions=(1, 0, 1)), "divisions"),
        (lambda: meshes.quarter_ring(0.1, 1, 0.5, divisions=(1, 1, 1), degree=3), "degree of the geometry"),
    ],
)
def test_bad_arguments(call, pattern):
    with pytest.raises(MeshError, match=pattern):
        call()


@pytest.mark.parametrize("other", [0.6, -1.0])
def test_an_argument_of_one_rank_only(other):
    if MPI.COMM_WORLD.size == 1:
        return
    with pytest.raises(MeshError, match=f"is 0.5 on rank 0 and {other} on rank 1"):
        meshes.quarter_ring(other if MPI.COMM_WORLD.rank == 1 else 0.5, 2.0, 1.0, divisions=(1, 1, 1))
