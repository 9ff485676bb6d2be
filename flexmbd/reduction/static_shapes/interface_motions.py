"""Motions of interfaces: the dofs that they bind, by which motions, and their averages."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from flexmbd.continuum.finite_elements.interface import AveragedInterface, FoundInterface, RigidInterface
from flexmbd.continuum.finite_elements.linear_model import LinearModel
from flexmbd.continuum.matrices.blocks import FloatArray


def rigidly_bound(interfaces: Sequence[FoundInterface]) -> list[RigidInterface]:
    """Those whose dofs move as a rigid frame does."""
    return [one for one in interfaces if isinstance(one, RigidInterface)]


def averaged(interfaces: Sequence[FoundInterface]) -> list[AveragedInterface]:
    """Those whose frame moves as their dofs do in the mean."""
    return [one for one in interfaces if isinstance(one, AveragedInterface)]


def rigid_coordinates(
    interfaces: Sequence[FoundInterface], *, origin: FloatArray, axes: FloatArray
) -> FloatArray:
    """(6 b, 6) the interfaces' motions in a rigid motion of the body about `origin`, along `axes`."""
    coordinates = np.tile(np.eye(6), (len(interfaces), 1))
    for i, interface in enumerate(interfaces):
        arm = axes.T @ (interface.p - origin)
        coordinates[6 * i : 6 * i + 3, 3:] = np.cross(np.eye(3), arm).T
    return coordinates


def rigid_columns(
    model: LinearModel, interfaces: Sequence[FoundInterface], *, axes: FloatArray
) -> FloatArray:
    """(owned dofs, 6 b) unit motions of the rigid interfaces on the dofs they bind, else zero."""
    motions = np.zeros((model.n_owned, 6 * len(interfaces)), order="F")
    for i, interface in enumerate(interfaces):
        if isinstance(interface, RigidInterface):
            dofs = interface.dofs[interface.dofs < model.n_owned]
            motions[dofs, 6 * i : 6 * i + 6] = model.rigid_motions(interface.p, axes)[dofs]
    return motions


def average_columns(
    model: LinearModel, interfaces: Sequence[FoundInterface], *, axes: FloatArray
) -> FloatArray:
    """(owned dofs, 6 a) C^T of the averaged interfaces, for motions along `axes`."""
    held = averaged(interfaces)
    columns = np.zeros((model.n_owned, 6 * len(held)), order="F")
    turn = np.kron(np.eye(2), axes)
    for i, interface in enumerate(held):
        owned = interface.dofs < model.n_owned
        columns[interface.dofs[owned], 6 * i : 6 * i + 6] = interface.average[owned] @ turn
    return columns
