"""A bar in two halves, each with nodes that they share."""

from mpi4py import MPI

import numpy as np
import scipy.linalg

from flexmbd import meshes
from flexmbd.continuum import ContinuumModel
from flexmbd.export.superelements.superelement import superelement
from flexmbd.forms import solid_linear

STEEL = solid_linear.Parameters(E=2.1e11, nu=0.3, rho=7850.0)
HALF = 0.2
TURNED = np.array([[0.8, -0.6, 0.0], [0.6, 0.8, 0.0], [0.0, 0.0, 1.0]])


def bar(*interfaces, halves=1, comm=MPI.COMM_WORLD, divisions=(3, 2, 2), **options):
    """Three cells of half a bar, 9 nodes in a section."""
    divisions = (halves * divisions[0], *divisions[1:])
    mesh = meshes.block(halves * HALF, 0.05, 0.04, divisions=divisions, comm=comm)
    return ContinuumModel(mesh, solid_linear, STEEL, degree=1, interfaces=interfaces, **options)


def blocks(body, *, moved=0.0):
    """Superelement K, M with the nodes along the mesh's axes, and the nodes' places in the mesh, moved along x."""
    element = superelement(body, nodes=True)
    k = len(element.node)
    turn = scipy.linalg.block_diag(*[body.R_MB] * (2 * len(element.names) + k), np.eye(element.n_modes))
    x = element.x @ body.R_MB.T + body.p_MB_M + [moved, 0.0, 0.0]
    return turn @ element.K @ turn.T, turn @ element.M @ turn.T, x
