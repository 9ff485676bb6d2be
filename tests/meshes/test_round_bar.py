"""A quarter of a round bar: its groups, its volume, and no flat cells."""

from mpi4py import MPI

import numpy as np
import pytest
import ufl
from dolfinx import fem

from flexmbd import meshes
from flexmbd.errors import MeshError

COMM = MPI.COMM_WORLD


def area(bar, name):
    ds = ufl.Measure("ds", domain=bar.mesh, subdomain_data=bar.facet_tags)
    return COMM.allreduce(fem.assemble_scalar(fem.form(fem.Constant(bar.mesh, 1.0) * ds(bar.facet_groups[name]))))


@pytest.mark.mpi
def test_volume_and_faces():
    for n in (2, 6):
        bar = meshes.round_bar(2.0, 5.0, divisions=(n, 2, 3))
        # a quarter of the polygon of 8 n sides
        section, edge = n * 2.0**2 * np.sin(np.pi / (4 * n)), 4.0 * np.sin(np.pi / (8 * n))
        exact = {"x_min": 10.0, "y_min": 10.0, "z_min": section, "z_max": section, "side": 5.0 * 2 * n * edge}
        assert bar.facet_groups.keys() == exact.keys()
        for name, value in exact.items():
            assert area(bar, name) == pytest.approx(value, rel=1e-12)
        volume = fem.assemble_scalar(fem.form(fem.Constant(bar.mesh, 1.0) * ufl.dx(domain=bar.mesh)))
        assert COMM.allreduce(volume) == pytest.approx(5.0 * section, rel=1e-12)
        lack = {2: 0.026, 6: 0.0029}[n]
        assert 1.0 - section / np.pi == pytest.approx(lack, rel=0.02)
        assert COMM.allreduce(bar.mesh.topology.index_map(3).size_local) == 3 * (n * n + 4 * n)


def test_bad_input():
    with pytest.raises(MeshError, match="radius"):
        meshes.round_bar(0.0, 1.0, divisions=(2, 2, 2))
    with pytest.raises(MeshError, match="divisions"):
        meshes.round_bar(1.0, 1.0, divisions=(2, 0, 2))
