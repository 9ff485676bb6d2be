"""A model about a loaded static state: its tangent stiffness, and its nodes and frames where the state has them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

from petsc4py import PETSc

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmbd.continuation.newton import CLOSE, Correction, newton
from flexmbd.continuum.contract.dof_layout import DofLayout
from flexmbd.continuum.finite_elements.field_conditions import FieldConditions
from flexmbd.continuum.finite_elements.interface import AveragedInterface, FoundInterface, RigidInterface
from flexmbd.continuum.finite_elements.linear_model import LinearModel, StaticState
from flexmbd.continuum.matrices.blocks import inner, total
from flexmbd.errors import ConvergenceError

FloatArray = NDArray[np.float64]

# Newton steps for the place of an averaged frame: quadratic from a neighbouring place, and cheap.
_FOLLOWING = 8


class PrestressedModel(LinearModel):
    """A model that moves by small displacements about a loaded static state; made by `prestressed`.

    Its `K` is the tangent stiffness at the state, for loads that keep their size and direction in the body frame; its
    `layout` has the nodes at their places in the state, and its `interfaces` are the frames there.  All else is that of
    the model at rest.
    """

    def __init__(
        self,
        model: LinearModel,
        state: StaticState,
        stiffness: PETSc.Mat,
        *,
        conditions: FieldConditions | None = None,
    ) -> None:
        """Of a model at rest, with the conditions on a field about the state; not collective."""
        rest = model.layout
        layout = MovedLayout(
            rest.space,
            rest.node_space,
            rest.displacement_dofs,
            rest.fields,
            rest.rigid_motion,
            rest,
            state.displacement[rest.displacement_dofs],
        )
        super().__init__(
            model.forms,
            model.parameters,
            layout=layout,
            interfaces=state.interfaces,
            K=stiffness,
            M=model.M,
            state=state,
            supports=model.supports,
            conditions=conditions,
        )


def turning_forces(
    model: LinearModel, state: StaticState, interfaces: Sequence[FoundInterface], *, axes: ArrayLike
) -> FloatArray:
    """The stiffness against rotations of rigid interfaces' frames by the forces inside them. Collective.

    In a rotation by theta the nodes at r from the frame's origin move by theta x r + theta x (theta x r) / 2.
    The second part has a work with the forces f of the state that is (theta . S theta - tr S theta . theta) / 2,
    S the symmetric part of the sum of f r^T.

    Args:
        model: about the state.
        state: its static state.
        interfaces: b of them.
        axes: (3, 3) rotation; motions are along and about its columns.

    Returns:
        (owned dofs, 6 b) nodal forces, N and per rad, on the dofs that rigid interfaces bind.
    """
    turn = np.asarray(axes, dtype=float)
    forces = np.zeros((model.n_owned, 6 * len(interfaces)), order="F")
    for i, interface in enumerate(interfaces):
        if not isinstance(interface, RigidInterface):
            continue
        work = turning_stiffness(model, interface, balance=state.balance, axes=turn)
        dofs = interface.dofs[interface.dofs < model.n_owned]
        motions = model.rigid_motions(interface.p, turn)[dofs]
        forces[dofs, 6 * i : 6 * i + 6] = motions @ np.linalg.solve(inner(model.comm, motions, motions), work)
    return forces


def turning_stiffness(
    model: LinearModel, interface: RigidInterface, *, balance: FloatArray, axes: FloatArray
) -> FloatArray:
    """The stiffness of `turning_forces` against motions of one interface's frame. Collective.

    Args:
        model: about the state.
        interface: rigid.
        balance: (owned dofs,) N, as in `StaticState`.
        axes: (3, 3) rotation; motions are along and about its columns.

    Returns:
        (6, 6) N m per rad, zero for translations; the same on every rank.
    """
    nodes = interface.nodes[interface.nodes < model.n_owned_nodes]
    f = balance[model.displacement_dofs[nodes]]
    moments = total(model.comm, f.T @ (model.node_x[nodes] - interface.p))
    moments = axes.T @ (0.5 * (moments + moments.T)) @ axes
    work = np.zeros((6, 6))
    work[3:, 3:] = moments - np.trace(moments) * np.eye(3)
    return work


@dataclass(frozen=True, eq=False)
class MovedLayout(DofLayout):
    """The dofs of a space whose nodes have moved.

    Attributes:
        base: at rest.
        moved: (local nodes including ghosts, 3) m, by which the displacement's nodes have moved.
    """

    base: DofLayout
    moved: FloatArray

    @cached_property
    def node_x(self) -> FloatArray:
        """(local nodes including ghosts, 3) m, positions of the displacement's nodes."""
        x: FloatArray = self.base.node_x + self.moved
        return x

    def rigid_columns(self, origin: ArrayLike, axes: ArrayLike) -> FloatArray:
        """The six unit rigid motions from there; see `DofLayout.rigid_columns`. Collective at the first call."""
        columns = self.base.rigid_columns(origin, axes)
        for i, axis in enumerate(np.asarray(axes, dtype=float).T):
            columns[self.displacement_dofs, 3 + i] += np.cross(axis, self.moved)
        return columns


def followed_average(
    model: LinearModel, rest: AveragedInterface, near: FoundInterface, displacement: FloatArray
) -> AveragedInterface:
    """An averaged interface at a finite displacement. Collective.

    Its frame (p, R) moves such that in its own axes the average of what the nodes have moved is zero,
    C (R^T (x + u - p) - (x - p_rest)) = 0, and its small motions are those that follow from it.

    Args:
        model: at rest.
        rest: the interface there.
        near: the same interface with p and R to begin with.
        displacement: (local dofs including ghosts,) of the model.

    Raises:
        ConvergenceError: on all ranks: the nodes have moved as no frame could follow.
    """
    follower = _FrameFollower(model, rest, displacement)
    found = newton(follower, _FollowedFrame(near.p, near.R @ rest.R.T), most=_FOLLOWING, close=CLOSE)
    if not found.is_solution:
        raise ConvergenceError(f"no place of the averaged interface {rest.name!r} was found where its nodes have moved")
    place = found.place
    return replace(rest, p=place.p, R=place.turn @ rest.R, average=follower.average(place))


@dataclass(frozen=True, eq=False)
class _FollowedFrame:
    """Where an averaged frame is, p (3,) m, and by what it has turned, (3, 3)."""

    p: FloatArray
    turn: FloatArray


class _FrameFollower:
    """The place of an averaged interface's frame as a problem for Newton's method. All of it is collective."""

    def __init__(self, model: LinearModel, rest: AveragedInterface, displacement: FloatArray) -> None:
        self._model, self._rest, self._dofs = model, rest, model.displacement_dofs[rest.nodes]
        self._columns = np.zeros((model.layout.n_local, 6))
        self._columns[rest.dofs] = rest.average
        self._own = rest.nodes < model.n_owned_nodes
        self._arms = model.node_x[rest.nodes] - rest.p
        self._x = model.node_x[rest.nodes] + displacement[self._dofs]
        squares = np.array([np.sum(self._arms[self._own] ** 2), np.count_nonzero(self._own)])
        square, count = total(model.comm, squares)
        self._length = np.sqrt(square / count)

    def is_solved(self, here: _FollowedFrame, *, close: bool) -> bool:
        return close

    def correction(self, here: _FollowedFrame) -> Correction[FloatArray]:
        """A step (6,) of the frame, along and about the axes at rest; its size is in rad, or of the nodes' distance."""
        deformed = (self._x - here.p) @ here.turn - self._arms
        lacking = np.einsum("kaj,ka->j", self._columns[self._dofs[self._own]], deformed[self._own])
        step = np.linalg.solve(self._of_rigid(here), total(self._model.comm, lacking))
        size = max(np.linalg.norm(step[:3]) / self._length, np.linalg.norm(step[3:]))
        return Correction(np.asarray(step, dtype=float), float(size))

    def moved(self, here: _FollowedFrame, correction: Correction[FloatArray], *, close: bool) -> _FollowedFrame:
        step = correction.change
        return _FollowedFrame(here.p + step[:3], here.turn + turn_less_one(step[3:]) @ here.turn)

    def average(self, here: _FollowedFrame) -> FloatArray:
        """(dofs, 6) the average by which the frame moves on from there."""
        columns = self._columns.copy()
        columns[self._dofs] = self._turned(here) @ np.linalg.inv(self._of_rigid(here)).T
        return np.asarray(columns[self._rest.dofs])

    def _turned(self, here: _FollowedFrame) -> FloatArray:
        return np.einsum("ab,kbj->kaj", here.turn, self._columns[self._dofs])

    def _of_rigid(self, here: _FollowedFrame) -> FloatArray:
        """(6, 6) by which the average changes as the frame moves, in the axes at rest."""
        motions = np.zeros((len(self._dofs), 3, 6))
        motions[:, :, :3] = np.eye(3)
        motions[:, :, 3:] = np.cross(np.eye(3)[:, None], self._x - here.p).transpose(1, 2, 0)
        own = self._own
        return total(self._model.comm, np.einsum("kaj,kac->jc", self._turned(here)[own], motions[own]))


def turn_less_one(rotation: FloatArray) -> FloatArray:
    """(3, 3) R - 1 of the rotation vector (3,), exact to the last digits for small angles too."""
    half = np.linalg.norm(rotation) / 2.0
    spin = np.cross(np.eye(3), rotation)
    turned: FloatArray = np.sinc(2.0 * half / np.pi) * spin + 0.5 * np.sinc(half / np.pi) ** 2 * (spin @ spin)
    return turned
