"""Where the interfaces of a body stand that is deformed when it comes into a machine.

The frame of a rigid interface is that of the undeformed body, moved as its nodes were; they must have moved rigidly.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from flexmbd.continuum.finite_elements.interface import AveragedInterface, FoundInterface
from flexmbd.continuum.history.fresh_body import is_fresh
from flexmbd.continuum.history.nonlinear_model import NonlinearModel
from flexmbd.errors import InterfaceError
from flexmbd.round_off import SAME_PLACE, SIX_DIGITS

FloatArray = NDArray[np.float64]


def present_poses(body: NonlinearModel) -> tuple[FloatArray, FloatArray]:
    """Origins (k, 3) m and axes (k, 3, 3) of the interfaces' frames, in the body's axes. Collective.

    Raises:
        InterfaceError: on all ranks: the nodes of an interface were not displaced as those of a rigid body, or those of
            an averaged one were displaced.
    """
    origins = np.array([found.p for found in body.interfaces])
    axes = np.array([found.R for found in body.interfaces])
    if is_fresh(body):
        return origins, axes
    size = max(body.comm.allgather(float(abs(body.node_x).max(initial=0.0))))
    for k, found in enumerate(body.interfaces):
        before, after = _places(body, found)
        turn = _rotation(before - before.mean(axis=0), after - after.mean(axis=0), size=size)
        origins[k] = after.mean(axis=0) + turn @ (found.p - before.mean(axis=0))
        axes[k] = turn @ found.R
        carried = origins[k] + (before - found.p) @ turn.T
        averaged = isinstance(found, AveragedInterface)
        gap = float(abs(after - (before if averaged else carried)).max())
        if gap <= SAME_PLACE * size:
            continue
        if averaged:
            raise InterfaceError(
                f"averaged interface {found.name!r} of a body that is deformed already: its nodes have moved by up to "
                f"{gap:.3g} m, and a body can begin so only with rigid interfaces (Coupling.RIGID)"
            )
        raise InterfaceError(
            f"interface {found.name!r}: the body is deformed already, there not as a rigid body, but by up to "
            f"{gap:.3g} m; hold that interface, or move it rigidly, where the body is loaded before, or take a body "
            "that is new"
        )
    return origins, axes


def _places(body: NonlinearModel, found: FoundInterface) -> tuple[FloatArray, FloatArray]:
    """(n, 3) m, of an interface's nodes on all ranks, undeformed and now, in the body's axes. Collective."""
    nodes = found.nodes[found.nodes < body.layout.n_owned_nodes]
    rows = np.concatenate(body.comm.allgather(np.hstack([body.layout.node_x[nodes], body.node_x[nodes]])))
    return rows[:, :3], rows[:, 3:]


def _rotation(before: FloatArray, after: FloatArray, *, size: float) -> FloatArray:
    """(3, 3) rotation nearest to what turned arms (n, 3) m; of nodes on a line the least. Not collective."""
    if abs(after - before).max() <= SAME_PLACE * size:
        return np.eye(3)
    spread = np.linalg.svd(before, compute_uv=False)
    if len(spread) > 1 and spread[1] > SIX_DIGITS * spread[0]:
        left, _, right = np.linalg.svd(after.T @ before)
        return np.asarray(left @ np.diag([1.0, 1.0, np.sign(np.linalg.det(left @ right))]) @ right)
    far = int(np.argmax((before**2).sum(axis=1)))
    axis = np.cross(before[far], after[far])
    sine = float(np.linalg.norm(axis))
    if sine == 0.0:
        return np.eye(3)
    angle = np.arctan2(sine, before[far] @ after[far])
    return np.asarray(Rotation.from_rotvec(angle / sine * axis).as_matrix())
