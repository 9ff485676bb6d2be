"""Parts that cannot be reduced are refused on every rank with one message; a rank without cells takes part."""

from mpi4py import MPI

import numpy as np
import pytest

from flexmbd import meshes
from flexmbd.continuum import ContinuumModel, Interface
from flexmbd.continuum.compat import cell_nodes
from flexmbd.continuum.grid import tagged_mesh
from flexmbd.errors import InterfaceError, MeshError, ReductionError
from flexmbd.forms import solid_linear
from flexmbd.reduction import Solver, Truncation, craig_bampton
from flexmbd.reduction.static_shapes import memory

pytestmark = pytest.mark.mpi

COMM = MPI.COMM_WORLD
STEEL = solid_linear.Parameters(E=2.1e11, nu=0.3, rho=7850.0)


def joined(shift):
    """Two bars of three bricks, 0.1 m wide and high, the second one moved; nodes at one place are one node."""
    source = meshes.block(0.3, 0.1, 0.1, divisions=(3, 1, 1), comm=MPI.COMM_SELF).mesh
    points, cells = source.geometry.x, cell_nodes(source)
    points, cells = np.vstack([points, points + shift]), np.vstack([cells, cells + len(points)])
    _, first, of_all = np.unique(np.round(points, 9), axis=0, return_index=True, return_inverse=True)
    foot = {"foot": lambda x: (x[0] < 1e-9) & (x[1] < 0.1)}
    return tagged_mesh.from_arrays(
        COMM, points[first], of_all.reshape(-1)[cells], cell="hexahedron", degree=1, facet_groups=foot
    )


@pytest.mark.parametrize(
    "shift",
    [(0.0, 1.0, 0.0), (0.3, 0.1, 0.0), (0.3, 0.1, 0.1)],
    ids=["two pieces", "joined by an edge, a hinge", "joined by a node, a ball"],
)
def test_pieces_and_mechanisms_inside_a_part(shift):
    with pytest.raises(MeshError, match="falls into 2 pieces that share no facet"):
        joined(np.array(shift))


def test_interfaces_that_share_nodes():
    mesh = meshes.block(0.3, 0.1, 0.1, divisions=(3, 2, 2))
    with pytest.raises(InterfaceError, match="share"):
        ContinuumModel(mesh, solid_linear, STEEL, degree=1, interfaces=[Interface("x_min"), Interface("y_min")])


def bar():
    mesh = meshes.block(0.2, 0.1, 0.1, divisions=(2, 1, 1))
    return ContinuumModel(mesh, solid_linear, STEEL, degree=1, interfaces=[Interface("x_min")])


def test_more_modes_than_there_are():
    """Beside the held face are two sections of four nodes."""
    with pytest.raises(ReductionError, match="1000 fixed-interface modes were asked for, and the interior has 24 dofs"):
        craig_bampton(bar(), modes=1000, frame="x_min")
    body = craig_bampton(bar(), modes=Truncation(below_hz=1e12), frame="x_min", geometric_stiffness=False)
    assert body.n_modes == 24
    assert body.provenance["completeness"] == "counted, 24 below 1e+12 Hz"


def test_memory_that_does_not_suffice(monkeypatch):
    """On one rank alone: all refuse."""
    model = bar()
    if COMM.rank == COMM.size - 1:
        monkeypatch.setattr(memory, "available_memory", lambda: 1000)
    with pytest.raises(ReductionError, match=r"multigrid .* would take \d+ MB, and 0 MB are available"):
        craig_bampton(model, modes=2, frame="x_min", solver=Solver.ITERATIVE)


@pytest.mark.parametrize("solver", list(Solver))
def test_a_rank_without_cells(solver):
    """Two bricks: on three ranks one has none."""
    found = []
    for comm in (MPI.COMM_SELF, COMM):
        mesh = meshes.block(0.2, 0.1, 0.1, divisions=(2, 1, 1), comm=comm)
        model = ContinuumModel(mesh, solid_linear, STEEL, degree=2, interfaces=[Interface("x_min")])
        found.append(craig_bampton(model, modes=6, frame="x_min", geometric_stiffness=False, solver=solver))
    alone, together = found
    assert together.stiffness == pytest.approx(alone.stiffness, rel=1e-9)
