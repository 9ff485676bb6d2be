"""A small block that lies askew, with three interfaces, and its unreduced model."""

from __future__ import annotations

from mpi4py import MPI

import numpy as np
import scipy.sparse
from full_model import FullModel

from flexmbd import meshes
from flexmbd.continuum import ContinuumModel, Interface
from flexmbd.continuum.compat import cell_nodes
from flexmbd.continuum.grid.tagged_mesh import from_arrays
from flexmbd.forms import solid_linear

ALUMINIUM = solid_linear.Parameters(E=7.0e10, nu=0.33, rho=2700.0)
LENGTH, WIDTH, HEIGHT = 0.4, 0.06, 0.1
DIVISIONS = (5, 1, 2)


def turned(a, b, c):
    """A rotation whose columns are along no axis."""
    q, r = np.linalg.qr(np.array([[1.0, a, b], [c, 1.0, a], [b, c, 1.0]]))
    q = q * np.sign(np.diag(r))
    return q * np.linalg.det(q)


TURN = turned(0.5, 0.3, -0.6)
SHIFT = np.array([0.3, -0.2, 0.5])


def local(x):
    """Coordinates along the block, (3, n), of points (3, n)."""
    return TURN.T @ (x - SHIFT[:, None])


def on_pad(x):
    x, _, z = local(x)
    # the middle one of five rows of cells
    return (z > HEIGHT / 2 - 1e-6) & (abs(x - LENGTH / 2) < 0.6 * LENGTH / DIVISIONS[0])


GROUPS = {
    "root": lambda x: local(x)[0] < 1e-6,
    "tip": lambda x: local(x)[0] > LENGTH - 1e-6,
    "pad": on_pad,
}

INTERFACES = {
    "root": Interface("root", axes=turned(0.2, -0.4, 0.1)),
    "tip": Interface("tip", axes=turned(-0.3, 0.1, 0.7), origin=TURN @ [0.45, 0.0, 0.02] + SHIFT),
    "pad": Interface("pad"),
}


def bracket(*names, interfaces=None, comm=MPI.COMM_WORLD, degree=2):
    """The block in tetrahedra with some of the interfaces, all by default."""
    source = meshes.block(
        LENGTH, WIDTH, HEIGHT, divisions=DIVISIONS, cell="tetrahedron", comm=MPI.COMM_SELF
    )
    points = source.mesh.geometry.x @ TURN.T + SHIFT
    mesh = from_arrays(comm, points, cell_nodes(source.mesh), degree=1, facet_groups=GROUPS)
    if interfaces is None:
        interfaces = [INTERFACES[name] for name in names or INTERFACES]
    return ContinuumModel(mesh, solid_linear, ALUMINIUM, degree=degree, interfaces=interfaces)


def transformation(full: FullModel, *, axes):
    """Sparse (3 n, 6 b + free), from the interfaces' motions in `axes` and the free dofs."""
    interfaces = full.model.interfaces
    t = full.bound([(GROUPS[one.name](full.x.T), one.p) for one in interfaces])
    free = t.shape[1] - 6 * len(interfaces)
    turns = [axes] * (2 * len(interfaces))
    return t @ scipy.sparse.block_diag([*turns, scipy.sparse.eye_array(free)])
