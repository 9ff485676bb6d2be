"""Meshes that are placed and joined, and what is not."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from welded_plates import DEPTH, LENGTH, WIDTH, plate

from flexmbd import meshes
from flexmbd.continuum.grid.pieces import check_connected
from flexmbd.errors import MeshError


@pytest.mark.mpi
def test_joined_meshes_keep_groups_and_volumes():
    part = plate(divisions=(3, 2))
    turned = Rotation.from_euler("z", 90, degrees=True).as_matrix()
    moved = meshes.placed(part, p=(1.0, 2.0, 3.0), R=turned)
    joined = meshes.join({"one": part, "two": moved})
    assert set(joined.facet_groups) == {f"{n}.{g}" for n in ("one", "two") for g in part.facet_groups}
    assert set(joined.cell_groups) == {"one.sheet", "two.sheet"}
    assert joined.in_pieces
    low = np.min(joined.comm.allgather(joined.mesh.geometry.x.min(axis=0)), axis=0)
    high = np.max(joined.comm.allgather(joined.mesh.geometry.x.max(axis=0)), axis=0)
    np.testing.assert_allclose(low, [0.0, -WIDTH / 2, -DEPTH / 2], atol=1e-15)
    np.testing.assert_allclose(high, [1.0 + WIDTH / 2, 2.0 + LENGTH, 3.0 + DEPTH / 2], rtol=1e-15)
    count = joined.comm.allreduce(len(joined.facets("two.top")))
    assert count >= 6
    with pytest.raises(MeshError, match=r"falls into 2 pieces.*weld them"):
        check_connected(joined.mesh)


def tetrahedra():
    return meshes.block(1.0, 1.0, 1.0, divisions=(1, 1, 1), cell="tetrahedron")


@pytest.mark.parametrize(
    ("parts", "told"),
    [
        (lambda: {"one": plate()}, "two meshes or more"),
        (lambda: {"one": plate(), "": plate()}, "a part has no name"),
        (lambda: {"one": plate(), "two": meshes.sheet(1.0, 1.0, divisions=(1, 1))}, "solids alone are welded"),
        (lambda: {"one": plate(), "two": tetrahedra()}, "'two' has"),
        (
            lambda: {"a": meshes.join({"b": plate(), "c": plate()}), "a.b": plate()},
            "two groups would be 'a.b.bottom', of part 'a' and of part 'a.b'",
        ),
    ],
)
def test_parts_that_are_not_joined(parts, told):
    with pytest.raises(MeshError, match=told):
        meshes.join(parts())


def test_places_that_are_none():
    with pytest.raises(MeshError, match="p must be three lengths"):
        meshes.placed(plate(), p=(1.0, 2.0))
    with pytest.raises(MeshError, match="R must be a rotation"):
        meshes.placed(plate(), R=np.diag([1.0, 1.0, -1.0]))
