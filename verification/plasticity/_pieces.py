"""Bodies of one brick, and what is read from bodies."""

from __future__ import annotations

from types import ModuleType
from typing import Any

from mpi4py import MPI

import numpy as np
from scipy.spatial.transform import Rotation

from flexmbd import meshes
from flexmbd.continuum import NonlinearModel


def brick(form: ModuleType, parameters: Any) -> NonlinearModel:
    """A cube of one brick, [0, 1] x [-1/2, 1/2]^2."""
    mesh = meshes.block(1.0, 1.0, 1.0, divisions=(1, 1, 1), comm=MPI.COMM_SELF)
    return NonlinearModel(mesh, form, parameters, degree=1)


def node_at(body: NonlinearModel, place: tuple[float, float, float]) -> int:
    """The node nearest to a place of the undeformed body."""
    return int(np.argmin(np.linalg.norm(body.layout.node_x - place, axis=1)))


def places_of(body: NonlinearModel, dofs: np.ndarray) -> np.ndarray:
    """(k, 3) Undeformed places of the nodes that dofs belong to."""
    node = np.empty(body.layout.n_local, dtype=int)
    node[body.displacement_dofs] = np.arange(len(body.displacement_dofs))[:, None]
    return np.asarray(body.layout.node_x[node[dofs]])

def deform(body: NonlinearModel, x: np.ndarray, to: np.ndarray) -> np.ndarray:
    """One step to a homogeneous deformation; the stress at its end.

    Args:
        body: of any history.
        x: (n, 3) its nodes' places at rest.
        to: (3, 3) deformation gradient from there.

    Returns:
        (3, 3) Cauchy stress at the first point, in the unit of the moduli.
    """
    body.commit((x @ to.T - x).ravel() - body.displacement)
    return np.asarray(body.stress()[0][0, 0])


def turned(degrees: float) -> np.ndarray:
    """(3, 3) rotation about an axis that is none of a cube's."""
    axis = np.array([2.0, -1.0, 1.0]) / np.sqrt(6.0)
    return np.asarray(Rotation.from_rotvec(np.radians(degrees) * axis).as_matrix())
