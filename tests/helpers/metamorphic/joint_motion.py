"""What each joint allows, written down a second time: poses, free motions and rows, from the definitions in docs.

A joint leads from F on its parent to G on its child.  Twists are (angular velocity, rate of p_FG), both in F's axes.
"""

from __future__ import annotations

import numpy as np
import scipy.linalg
from scipy.spatial.transform import Rotation

import flexmbd as fm

X, Y, Z = np.eye(3)
NONE = np.zeros(3)


def turned(axis, angle):
    return Rotation.from_rotvec(np.asarray(axis) * angle).as_matrix()


def quaternion(R):
    """Scalar first, of positive scalar part."""
    q = np.roll(Rotation.from_matrix(R).as_quat(), 1)
    return q if q[0] >= 0.0 else -q


def of_quaternion(q):
    return Rotation.from_quat(np.roll(q, -1)).as_matrix()


def kind(joint):
    return type(joint).__name__


#: How many numbers draw a pose of each joint: its coordinates, or for the others any that name its poses.
CHART = {
    "Revolute": 1, "Prismatic": 1, "Screw": 1, "Cylindrical": 2, "Planar": 3, "Universal": 2, "Spherical": 3,
    "Fixed": 0, "Free": 6, "Distance": 5, "PointOnPlane": 5, "PointOnLine": 4, "ConstantVelocity": 2,
    "RollingDisc": 5,
}  # fmt: skip


def pose_of(joint, c):
    """R_FG (3, 3), p_FG_F (3,) from numbers (CHART); balls and free joints by rotation vectors."""
    T = np.asarray(joint.turn)
    R, p = _POSES[kind(joint)](joint, np.asarray(c, float))
    return T @ R @ T.T, T @ p


_POSES = {
    "Revolute": lambda j, c: (turned(Z, c[0]), NONE),
    "Prismatic": lambda j, c: (np.eye(3), c[0] * Z),
    "Screw": lambda j, c: (turned(Z, c[0]), j.pitch * c[0] * Z),
    "Cylindrical": lambda j, c: (turned(Z, c[1]), c[0] * Z),
    "Planar": lambda j, c: (turned(Z, c[2]), c[0] * X + c[1] * Y),
    "Universal": lambda j, c: (turned(Z, c[0]) @ turned(X, c[1]), NONE),
    "Spherical": lambda j, c: (turned(c, 1.0), NONE),
    "Fixed": lambda j, c: (np.eye(3), NONE),
    "Free": lambda j, c: (turned(c[3:], 1.0), c[:3]),
    "Distance": lambda j, c: (
        turned(c[2:], 1.0),
        j.length * np.array([np.cos(c[0]) * np.cos(c[1]), np.sin(c[0]) * np.cos(c[1]), np.sin(c[1])]),
    ),
    "PointOnPlane": lambda j, c: (turned(c[2:], 1.0), c[0] * X + c[1] * Y),
    "PointOnLine": lambda j, c: (turned(c[1:], 1.0), c[0] * Z),
    "ConstantVelocity": lambda j, c: (turned(c[0] * X + c[1] * Y, 1.0), NONE),
    "RollingDisc": lambda j, c: _on_the_plane(j.radius, c),
}


def _on_the_plane(radius, c):
    """A disc that leans by at least a quarter of a right angle and stands on the plane."""
    tilt = 0.5 * np.pi * (0.25 + 0.5 / (1.0 + c[2] ** 2))
    R = turned(Z, c[3]) @ turned(X, tilt) @ turned(Z, c[4])
    return R, np.array([c[0], c[1], radius * np.sin(tilt)])


def coordinates_of(joint, R, p):
    """The joint's coordinates in a pose, as flexmbd gives them; () where it has none."""
    T = np.asarray(joint.turn)
    R, p = T.T @ R @ T, T.T @ p
    angle = np.arctan2(R[1, 0], R[0, 0])
    return {
        "Revolute": lambda: [angle],
        "Prismatic": lambda: [p[2]],
        "Screw": lambda: [angle],
        "Cylindrical": lambda: [p[2], angle],
        "Planar": lambda: [p[0], p[1], angle],
        "Universal": lambda: [angle, np.arctan2(R[2, 1], R[2, 2])],
        "Spherical": lambda: quaternion(R),
        "Free": lambda: [*p, *quaternion(R)],
    }.get(kind(joint), lambda: ())()


def free_motions(joint, R, p):
    """(6, f) twists per unit of each joint velocity in a pose, in flexmbd's order."""
    T = np.asarray(joint.turn)
    r, q = T.T @ R @ T, T.T @ p
    angle = np.arctan2(r[1, 0], r[0, 0])
    turn_z, slide = np.concatenate([Z, NONE]), [np.concatenate([NONE, e]) for e in np.eye(3)]
    turns = [np.concatenate([e, NONE]) for e in r.T]  # velocities of balls are in G's axes
    columns = {
        "Revolute": lambda: [turn_z],
        "Prismatic": lambda: [slide[2]],
        "Screw": lambda: [turn_z + joint.pitch * slide[2]],
        "Cylindrical": lambda: [slide[2], turn_z],
        "Planar": lambda: [slide[0], slide[1], turn_z],
        "Universal": lambda: [turn_z, np.concatenate([turned(Z, angle) @ X, NONE])],
        "Spherical": lambda: turns,
        "Fixed": lambda: [],
        "Free": lambda: [*slide, *turns],
        "Distance": lambda: scipy.linalg.null_space(np.concatenate([NONE, q])[None]).T,
        "PointOnPlane": lambda: [slide[0], slide[1], *turns],
        "PointOnLine": lambda: [slide[2], *turns],
        "ConstantVelocity": lambda: scipy.linalg.null_space(
            np.vstack([slide, np.concatenate([Z + r[:, 2], NONE])])  # w lies in the plane that halves their angle
        ).T,
        "RollingDisc": lambda: [np.concatenate([e, -np.cross(e, _to_the_ground(joint, r))]) for e in np.eye(3)],
    }[kind(joint)]()
    both = scipy.linalg.block_diag(T, T)
    return both @ np.array(columns).reshape(-1, 6).T


def _to_the_ground(joint, R):
    """From a disc's centre to where it touches the plane."""
    steep = Z - R[:, 2] * R[2, 2]
    return -joint.radius * steep / np.linalg.norm(steep)


def rows(joint, R, p):
    """(m, 6) orthonormal: what vanishes for every twist that the joint allows."""
    allowed = free_motions(joint, R, p)
    return np.eye(6) if allowed.shape[1] == 0 else scipy.linalg.null_space(allowed.T).T


def rates_of(joint, R, p, twist):
    """The joint's velocities of a twist that it allows, as flexmbd gives them; () where it has none."""
    if not joint.velocity_names:
        return np.zeros(0)
    return np.linalg.lstsq(free_motions(joint, R, p), twist, rcond=None)[0]


# ------------------------------------------------------------------------------------------------ the inverse joints


def inverse(joint):
    """The joint that says the same with parent and child exchanged; None where there is none."""
    if isinstance(joint, fm.joint.Universal):
        return fm.joint.Universal(joint.second, joint.first)
    same = ("Revolute", "Prismatic", "Screw", "Cylindrical", "Planar", "Spherical", "Fixed", "Free", "Distance")
    return joint if kind(joint) in (*same, "ConstantVelocity") else None


def exchanged(joint, coordinate):
    """Which coordinate of the inverse joint is minus this one; None where none is."""
    name = kind(joint)
    if name == "Universal":
        return 1 - coordinate
    return coordinate if name in ("Revolute", "Prismatic", "Screw", "Cylindrical") or coordinate == 2 else None


def along(joint):
    """A twist (6,) in F's axes that moves the joint's two frames without telling, or None: see ``slid``."""
    return {"Revolute": Z, "Cylindrical": Z, "Screw": Z, "PointOnLine": None}.get(kind(joint))


def slid(joint, d):
    """How far (3,) both frames may be moved by d (3,), in the frames' own axes: the part that the joint cannot tell."""
    T = np.asarray(joint.turn)
    name = kind(joint)
    if name in ("Prismatic", "Fixed"):
        return d
    if name in ("Revolute", "Screw", "Cylindrical", "Planar"):
        return T[:, 2] * (T[:, 2] @ d)
    return np.zeros(3)


def mirrored(joint, M):
    """The same joint between frames that a mirror M (3, 3) shows, whose own axes are mirrored likewise."""
    name = kind(joint)
    if name in ("Spherical", "Fixed", "Free", "Distance", "RollingDisc"):  # of the disc's frames y alone is turned
        return joint
    axes = M @ np.asarray(joint.turn)
    if name == "Universal":
        return fm.joint.Universal(tuple(axes[:, 2]), tuple(axes[:, 0]))
    axis = tuple(axes[:, 2])
    return fm.joint.Screw(-joint.pitch, axis) if name == "Screw" else type(joint)(axis)


def with_axes_turned(joint, S):
    """The same joint between frames turned by S (3, 3); None where a frame's own axes mean something."""
    name = kind(joint)
    if name in ("Spherical", "Fixed", "Free", "Distance"):
        return joint
    if name == "Universal":
        first, second = np.asarray(joint.turn)[:, 2], np.asarray(joint.turn)[:, 0]
        return fm.joint.Universal(tuple(S.T @ first), tuple(S.T @ second))
    if name == "RollingDisc":
        return None
    axis = tuple(S.T @ np.asarray(joint.turn)[:, 2])
    return fm.joint.Screw(joint.pitch, axis) if name == "Screw" else type(joint)(axis)
