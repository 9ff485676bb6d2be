"""The assembled drawing: where each body lies, and the frames of joints that are given by one place and axis in it.

Entered by ``machine_assembly`` alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmbd.errors import SceneError
from flexmbd.given import numbers
from flexmbd.multibody.bodies.body import FlexibleBody, Frame, Ground, RigidBody
from flexmbd.multibody.bodies.continuum_body import ContinuumBody
from flexmbd.multibody.bodies.pseudo_rigid_body import PseudoRigidBody
from flexmbd.multibody.exact_beam import ExactBeam
from flexmbd.multibody.joint.protocol import AlongAxis, Joint
from flexmbd.multibody.kernels.base import kinds
from flexmbd.rotation import Axis, check_rotation, z_onto
from flexmbd.round_off import EQUAL

FloatArray = NDArray[np.float64]
DrawnBody = Ground | RigidBody | FlexibleBody | PseudoRigidBody | ContinuumBody | ExactBeam
DRAWN_BODIES = (Ground, RigidBody, FlexibleBody, PseudoRigidBody, ContinuumBody, ExactBeam)

#: Share of a body's size within which a place names one of its interfaces: what a drawing's numbers are rounded to.
_ROUNDED = 1e-3


@dataclass(frozen=True, eq=False)
class BodyPose:
    """Where the drawing has a body frame: p_WB (3,) m and R_WB (3, 3), in the ground's axes."""

    p: FloatArray
    R: FloatArray


def drawn_pose(body: DrawnBody, p: ArrayLike | None, R: ArrayLike | None) -> BodyPose:
    """The pose of a body by what a user gives of it; of a flexible body by default that of its mesh, else the ground's.

    Raises:
        SceneError: not three finite numbers, or no rotation.
    """
    what = f"body {body.name!r}"
    of_mesh = isinstance(body, FlexibleBody)
    place = (body.record.p_MB_M if of_mesh else np.zeros(3)) if p is None else numbers(p)  # type: ignore[union-attr]
    if place.shape != (3,) or not np.isfinite(place).all():
        raise SceneError(f"{what}: its place p in the drawing must be three finite numbers (m), got {p!r:.60}")
    if R is None:
        return BodyPose(place, body.record.R_MB if of_mesh else np.eye(3))  # type: ignore[union-attr]
    return BodyPose(place, check_rotation(R, f"{what}: its turn R in the drawing"))


def drawn_frames(
    joint: Joint, ends: Sequence[tuple[DrawnBody, BodyPose]], *, at: ArrayLike, axis: Axis | None, what: str
) -> list[Frame]:
    """The frames F and G of a joint on both bodies, which fall together in the drawing.

    Args:
        joint: the joint.
        ends: both bodies and their poses.
        at: (3,) m, the joint's place in the ground's axes.
        axis: of the joint, in the ground's axes; None: the joint's own axes are those of the ground.
        what: the joint's name in messages.

    Raises:
        SceneError: no place, an axis that the joint does not have, a joint whose frames lie apart, or a body that
            cannot be held there.
    """
    place = numbers(at)
    if place.shape != (3,) or not np.isfinite(place).all():
        raise SceneError(f"{what}: `at` must be three finite numbers (m) in the ground's axes, got {at!r:.60}")
    _refuse_apart(joint, what)
    axes = _axes(joint, axis, what)
    held = [_interface(body, pose, place, what) for body, pose in ends]
    found = [where for where in held if where is not None]
    place = found[0].p if found else place  # what the interface of a body has is the joint's place
    return [_frame(body, pose, place, axes, where) for (body, pose), where in zip(ends, held, strict=True)]


@dataclass(frozen=True, eq=False)
class _Interface:
    """A frame that a body has; ``p`` (3,) m its place in the drawing, ``R_BF`` its axes in the undeformed body."""

    frame: Frame
    p: FloatArray
    R_BF: FloatArray


def _axes(joint: Joint, axis: Axis | None, what: str) -> FloatArray:
    """(3, 3) axes of both frames in the drawing, so that the joint's own axis lies along ``axis``."""
    if axis is None:
        return np.eye(3)
    if not isinstance(joint, AlongAxis):
        raise SceneError(
            f"{what}: a {type(joint).__name__} has no single axis; leave out `axis`, and give those that it "
            "has in the ground's axes, as Universal(first, second)"
        )
    try:
        along = z_onto(axis)
    except SceneError as reason:
        raise SceneError(f"{what}: {reason}") from reason
    return along @ joint.turn.T


def _refuse_apart(joint: Joint, what: str) -> None:
    """Raise SceneError where the joint does not hold with G on F."""
    apart = [row.name for row in joint.rows if row.kind in (kinds.ROW_DISTANCE, kinds.ROW_TOUCH)]
    if apart:
        raise SceneError(
            f"{what}: the frames of a {type(joint).__name__} lie apart ({apart[0]}), so that one place does not tell "
            "where both are; give frames, body.frame(p=...)"
        )


def _interface(body: DrawnBody, pose: BodyPose, place: FloatArray, what: str) -> _Interface | None:
    """The frame of a body that lies at a place of the drawing; None of bodies that can be held anywhere.

    Raises:
        SceneError: a body that has frames of its own has none there.
    """
    if isinstance(body, FlexibleBody):
        frames = [(body.frame(one.name), one.p_BI_B, one.R_BI) for one in body.record.interfaces]
    elif isinstance(body, ContinuumBody):
        own = body.interior.frames
        frames = [(body.frame(one.name), one.p_BI_B, one.R_BI) for one in own]
    elif isinstance(body, ExactBeam):
        frames = [(body.frame(name), x, np.eye(3)) for name, x in zip(body.mesh.names, body.mesh.x, strict=True)]
    else:
        return None
    if not frames:
        raise SceneError(f"{what}: body {body.name!r} has no interface to be held at")
    places = pose.p + np.array([p for _, p, _ in frames]) @ pose.R.T
    size = max(float(np.linalg.norm(places - places.mean(axis=0), axis=1).max()), _gyration(body))
    away = np.linalg.norm(places - place, axis=1)
    nearest = int(np.argmin(away))
    if away[nearest] > max(_ROUNDED * size, EQUAL * float(np.linalg.norm(places[nearest]))):
        here, there = (", ".join(f"{value:.6g}" for value in one) for one in (place, places[nearest]))
        raise SceneError(
            f"{what}: in the drawing body {body.name!r} has no interface at ({here}) m; the nearest, "
            f"{frames[nearest][0].label}, lies {away[nearest]:.3g} m away, at ({there}). Give its place, or where the "
            "drawing has the body: scene.add(body, p=..., R=...)"
        )
    frame, _, R = frames[nearest]
    return _Interface(frame, places[nearest], R)


def _gyration(body: FlexibleBody | ContinuumBody | ExactBeam) -> float:
    """Radius of gyration (m) of a body with a single frame, which has no size by its frames."""
    if not isinstance(body, FlexibleBody):
        return 0.0
    first, second = body.moments()
    return float(np.sqrt(max(np.trace(second) / body.mass - first @ first / body.mass**2, 0.0)))


def _frame(body: DrawnBody, pose: BodyPose, place: FloatArray, axes: FloatArray, held: _Interface | None) -> Frame:
    """The frame on a body at a place with axes (3, 3) of the drawing."""
    R_BF = pose.R.T @ axes
    if held is None:
        return body.frame(p=pose.R.T @ (place - pose.p), R=R_BF)  # type: ignore[union-attr, call-arg]
    turn = held.R_BF.T @ R_BF
    return replace(held.frame, R_BF=held.frame.R_BF @ turn)
