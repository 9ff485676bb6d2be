"""A quarter of a square tube: its groups, its volume, and its dent."""

from mpi4py import MPI

import numpy as np
import pytest
import ufl
from dolfinx import fem

from flexmbd import meshes
from flexmbd.continuum import compat
from flexmbd.errors import MeshError

COMM = MPI.COMM_WORLD
WIDTH, WALL, LENGTH = 0.06, 0.003, 0.12
SIDE = WIDTH / 2 - WALL
GOOD = {"divisions": (4, 2, 12), "fold": 0.02, "dent": 5e-4}


def total(form):
    return COMM.allreduce(fem.assemble_scalar(fem.form(form)))


@pytest.mark.mpi
def test_volume_and_faces():
    tube = meshes.crash_tube(WIDTH, WALL, LENGTH, divisions=(4, 2, 12), fold=0.02, dent=1e-12)
    section = (WIDTH**2 - (WIDTH - 2 * WALL) ** 2) / 4
    ds = ufl.Measure("ds", domain=tube.mesh, subdomain_data=tube.facet_tags)
    one = fem.Constant(tube.mesh, 1.0)
    exact = {"x_min": WALL * LENGTH, "y_min": WALL * LENGTH, "z_min": section, "z_max": section}
    assert tube.facet_groups.keys() == exact.keys()
    for name, value in exact.items():
        assert total(one * ds(tube.facet_groups[name])) == pytest.approx(value, rel=1e-9)
    assert total(one * ufl.dx(domain=tube.mesh)) == pytest.approx(section * LENGTH, rel=1e-9)
    assert COMM.allreduce(tube.mesh.topology.index_map(3).size_local) == (2 * 4 * 2 + 4) * 12


def test_one_pair_of_walls_is_dented_inwards_and_the_other_outwards():
    tube = meshes.crash_tube(WIDTH, WALL, LENGTH, comm=MPI.COMM_SELF, **GOOD)
    x = tube.mesh.geometry.x
    middle = abs(x[:, 2] - 0.01) < 1e-12
    outer_y = x[middle & (x[:, 0] == 0.0), 1].max()
    outer_x = x[middle & (x[:, 1] == 0.0), 0].max()
    assert outer_y == pytest.approx(WIDTH / 2 - 5e-4, rel=1e-12)
    assert outer_x == pytest.approx(WIDTH / 2 + 5e-4, rel=1e-12)
    corner = x[(x[:, 0] > SIDE * 1.02) & (x[:, 1] > SIDE * 1.02)]
    assert set(np.unique(np.round(corner[:, 0], 9))) == {0.0285, 0.03}
    behind = x[x[:, 2] > 0.021]
    assert behind[:, :2].max() == pytest.approx(WIDTH / 2, rel=1e-12)
    # no cell is turned inside out by the dent
    cells = compat.cell_nodes(tube.mesh)
    low = x[cells[:, 0]]
    edges = [x[cells[:, k]] - low for k in (1, 2, 4)]
    assert (np.einsum("ki,ki->k", np.cross(edges[0], edges[1]), edges[2]) > 0.0).all()


@pytest.mark.mpi
def test_mitred_cells_go_round_the_corner():
    tube = meshes.crash_tube(WIDTH, WALL, LENGTH, divisions=(4, 2, 12), fold=0.02, dent=1e-12, mitred=True)
    section = (WIDTH**2 - (WIDTH - 2 * WALL) ** 2) / 4
    ds = ufl.Measure("ds", domain=tube.mesh, subdomain_data=tube.facet_tags)
    one = fem.Constant(tube.mesh, 1.0)
    exact = {"x_min": WALL * LENGTH, "y_min": WALL * LENGTH, "z_min": section, "z_max": section}
    for name, value in exact.items():
        assert total(one * ds(tube.facet_groups[name])) == pytest.approx(value, rel=1e-9)
    assert total(one * ufl.dx(domain=tube.mesh)) == pytest.approx(section * LENGTH, rel=1e-9)
    assert COMM.allreduce(tube.mesh.topology.index_map(3).size_local) == 2 * 4 * 2 * 12


def test_third_edges_of_mitred_cells_lie_across_the_wall():
    tube = meshes.crash_tube(WIDTH, WALL, LENGTH, comm=MPI.COMM_SELF, mitred=True, **GOOD)
    x = tube.mesh.geometry.x
    at = x[compat.cell_nodes(tube.mesh)]
    edges = [at[:, k] - at[:, 0] for k in (1, 2, 4)]
    assert (np.einsum("ki,ki->k", np.cross(edges[0], edges[1]), edges[2]) > 0.0).all()
    # outwards from half a layer to half a layer, along z none of it; the mitre goes both ways
    assert np.ptp(at[:, [0, 4], 2], axis=1).max() < 1e-15
    across = abs(edges[2][:, :2])
    assert across.max(axis=1) == pytest.approx(WALL / 2, rel=1e-12)
    assert sorted(set(np.round(across.min(axis=1) / WALL, 9))) == [0.0, 0.5]
    middle = abs(x[:, 2] - 0.01) < 1e-12
    assert x[middle & (x[:, 0] == 0.0), 1].max() == pytest.approx(WIDTH / 2 - 5e-4, rel=1e-12)
    assert x[middle & (x[:, 1] == 0.0), 0].max() == pytest.approx(WIDTH / 2 + 5e-4, rel=1e-12)


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"wall": 0.03}, "wall must be below half the width"),
        ({"fold": 0.2}, "fold must be"),
        ({"dent": 0.004}, "dent below"),
        ({"mitred": True, "divisions": (19, 1, 12)}, "take up to 18"),
    ],
)
def test_bad_input(change, named):
    with pytest.raises(MeshError, match=named):
        meshes.crash_tube(**({"width": WIDTH, "wall": WALL, "length": LENGTH} | GOOD | change))
