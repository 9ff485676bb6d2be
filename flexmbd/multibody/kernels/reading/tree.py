"""Readers of a plan's tree: joints and modes of each link, parents and children."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.kernels.base import kinds
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.arrays import Plan

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

class TreeJoint(NamedTuple):
    """The inboard joint of a link of the tree.

    Attributes:
        row: of the link.
        x, v: all its entries in the configuration and in the velocity.
        plain_x, plain_v: those that add.
        quaternion, spin: a quaternion in x and its angular velocity in v (axes of the link); None where there is none.
        is_hinge: whether its only coordinate turns and does not slide.
        is_free: whether it holds nothing.
    """

    row: int
    x: slice
    v: slice
    plain_x: slice
    plain_v: slice
    quaternion: slice | None
    spin: slice | None
    is_hinge: bool
    is_free: bool


class ModalPlace(NamedTuple):
    """Where the modal coordinates of a flexible body lie: row of the tree, entries in x and in v."""

    row: int
    x: slice
    v: slice


class MembraneStretch(NamedTuple):
    """Membrane strains c q + q C q / 2 of a body: where q lies in x and v, c (s, n) and C (s, n, n)."""

    x: slice
    v: slice
    slope: FloatArray
    second: FloatArray


def tree_joint(plan: Plan, row: int) -> TreeJoint:
    """The inboard joint of a link."""
    link = plan.tree[row]
    x, v, plain, o = (int(link[k]) for k in (at.JOINT_X, at.JOINT_V, at.JOINT_ADDS, at.JOINT_DATA))
    turns = link[at.JOINT_TURN] == kinds.TURN_BALL
    turns_about_z = link[at.JOINT_TURN] == kinds.TURN_ABOUT_Z
    return TreeJoint(
        row,
        slice(x, x + plain + 4 * turns),
        slice(v, v + plain + 3 * turns),
        slice(x, x + plain),
        slice(v, v + plain),
        slice(x + plain, x + plain + 4) if turns else None,
        slice(v + plain, v + plain + 3) if turns else None,
        bool(turns_about_z and plain == 1 and not plan.data[o + 1 : o + 4].any()),
        bool(link[at.JOINT_SIZE] == 6),
    )


def tree_joints(plan: Plan) -> Iterator[TreeJoint]:
    """The inboard joints of all links, parents before children."""
    return (tree_joint(plan, row) for row in range(len(plan.tree)))


def joint_frame(plan: Plan, row: int, *, on_parent: bool = False) -> int:
    """Row of ``plan.frames`` of the inboard joint's frame on a link, or on its parent."""
    return int(plan.tree[row, at.FRAME_PARENT if on_parent else at.FRAME_CHILD])


def parents(plan: Plan) -> IntArray:
    """(links,) row of each link's parent, -1 the ground; parents come before children."""
    return plan.tree[:, at.PARENT]


def outboard(plan: Plan, root: int) -> set[int]:
    """Rows of a link and of all that it carries."""
    found = {root}
    for row, parent in enumerate(parents(plan)):
        if parent in found:
            found.add(row)
    return found


def masses(plan: Plan) -> FloatArray:
    """(links,) kg."""
    return plan.rigid[: len(plan.tree), at.MASS]


def shaft_inertias(plan: Plan) -> list[tuple[int, float]]:
    """One-dimensional inertias: a coordinate's place in v, kg m^2 or kg."""
    return [(int(row[at.SHAFT_V]), float(row[at.SHAFT_INERTIA])) for row in plan.shafts]


def second_moment(plan: Plan, row: int) -> tuple[FloatArray, FloatArray]:
    """Centre of mass (3,) (m) and second moment about it (3, 3) (kg m^2) of an undeformed link that has mass."""
    first = plan.rigid[row, at.FIRST_MOMENT : at.SECOND_MOMENT]
    about_frame = np.zeros((3, 3))
    about_frame[np.triu_indices(3)] = plan.rigid[row, at.SECOND_MOMENT :]
    about_frame += np.triu(about_frame, 1).T
    mass = plan.rigid[row, at.MASS]
    return first / mass, about_frame - np.outer(first, first) / mass


def frame_owner(plan: Plan, frame: int) -> int:
    """Row of the link that carries a frame, -1 the ground."""
    return int(plan.frame_of[frame, at.FRAME_BODY])


def rotates(plan: Plan, row: int) -> bool:
    """Whether any joint between the ground and the frame of a link turns it."""
    return bool(plan.tree[row, at.ROTATION] != kinds.NONROTATING)


def modal_places(plan: Plan) -> Iterator[ModalPlace]:
    """The modal coordinates of all flexible bodies, in the order of the tree."""
    for row in map(int, np.flatnonzero(plan.tree[:, at.FLEX] >= 0)):
        link = plan.tree[row]
        n, x, v = int(plan.flex[link[at.FLEX], at.N_MODES]), int(link[at.MODAL_X]), int(link[at.MODAL_V])
        yield ModalPlace(row, slice(x, x + n), slice(v, v + n))


def flexible_row(plan: Plan, row: int) -> IntArray:
    """The row of ``plan.flex`` of a flexible body's link, for ``kernels.physics.elasticity``."""
    found: IntArray = plan.flex[plan.tree[row, at.FLEX]]
    return found


def has_modal_damping(plan: Plan) -> bool:
    """Whether some body's modes have forces by their rates: damping, or gyroscopic ones."""
    return bool((plan.flex[:, at.MODAL_DAMPING] >= 0).any())


def membrane_stretches(plan: Plan) -> Iterator[MembraneStretch]:
    """Of all bodies that have any, in the order of the tree."""
    for place in modal_places(plan):
        flex = flexible_row(plan, place.row)
        n, count, first = int(flex[at.N_MODES]), int(flex[at.N_STRETCH]), int(flex[at.STRETCH])
        if count == 0:
            continue
        triangle = n * (n + 1) // 2
        stored = plan.modal[first : first + count * (n + triangle)].reshape(count, n + triangle)
        second = np.zeros((count, n, n))
        i, j = np.tril_indices(n)
        second[:, i, j] = second[:, j, i] = stored[:, n:]
        yield MembraneStretch(place.x, place.v, stored[:, :n].copy(), second)


def mode_places(first: int, modes: FloatArray) -> tuple[int, int]:
    """Offsets of the rows of a frame's modes (6, n) or (12, n) that begin at ``first``: motion, and strain or -1."""
    return first, (first + modes[:6].size if len(modes) == 12 else -1)


def move_frames(extended: Plan, plan: Plan, p: FloatArray, R: FloatArray) -> None:
    """Bring the frames of ``with_frame(plan, ...)`` up to date with those of ``plan``, its last at p (3,), R (3, 3)."""
    extended.frames[:-1] = plan.frames
    extended.frames[-1] = np.concatenate([p, R.ravel()])


def with_frame(plan: Plan, row: int, p: FloatArray, R: FloatArray, modes: FloatArray | None = None) -> Plan:
    """``plan`` with one more frame, its last.

    Args:
        plan: the plan.
        row: of the link that carries the frame, -1 the ground.
        p: (3,) m, its place in the undeformed body.
        R: (3, 3) rotation from its axes to the body's.
        modes: (6, n) its displacement and rotation per unit modal coordinate, or (12, n) with its face's strain; None
            where it does not deform.
    """
    place = np.concatenate([p, R.ravel()])
    places = (-1, -1) if modes is None else mode_places(len(plan.modal), modes)
    return plan.replace(
        frames=np.vstack([plan.frames, place]),
        frame_of=np.vstack([plan.frame_of, [row, *places]]),
        modal=plan.modal if modes is None else np.concatenate([plan.modal, modes.ravel()]),
    )
