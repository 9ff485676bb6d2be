"""A model about a loaded static state: its tangent stiffness, and its nodes and frames where the state has them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

from petsc4py import PETSc

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmbd.continuum.contract.dof_layout import DofLayout
from flexmbd.continuum.finite_elements.interface import AveragedInterface, FoundInterface, RigidInterface
from flexmbd.continuum.finite_elements.linear_model import LinearModel, StaticState
from flexmbd.continuum.matrices.blocks import inner, total

FloatArray = NDArray[np.float64]

# Newton steps for the place of an averaged frame: quadratic from a neighbouring place, and cheap.
_FOLLOWING = 8


class PrestressedModel(LinearModel):
    """A model that moves by small displacements about a loaded static state; made by `prestressed`.

    Its `K` is the tangent stiffness at the state, for loads that keep their size and direction in the body frame; its
    `layout` has the nodes at their places in the state, and its `interfaces` are the frames there.  All else is that of
    the model at rest.
    """

    def __init__(self, model: LinearModel, state: StaticState, stiffness: PETSc.Mat) -> None:
        """Of a model at rest; not collective."""
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
    """
    columns = np.zeros((model.layout.n_local, 6))
    columns[rest.dofs] = rest.average
    dofs = model.displacement_dofs[rest.nodes]
    own = rest.nodes < model.n_owned_nodes
    arms, x = model.node_x[rest.nodes] - rest.p, model.node_x[rest.nodes] + displacement[dofs]
    p, turn = near.p, near.R @ rest.R.T
    for _ in range(_FOLLOWING):
        average = np.einsum("ab,kbj->kaj", turn, columns[dofs])
        deformed = (x - p) @ turn - arms
        lack = total(model.comm, np.einsum("kaj,ka->j", columns[dofs[own]], deformed[own]))
        motions = np.zeros((len(dofs), 3, 6))
        motions[:, :, :3] = np.eye(3)
        motions[:, :, 3:] = np.cross(np.eye(3)[:, None], x - p).transpose(1, 2, 0)
        of_rigid = total(model.comm, np.einsum("kaj,kac->jc", average[own], motions[own]))
        step = np.asarray(np.linalg.solve(of_rigid, lack), dtype=float)
        p, turn = p + step[:3], np.asarray(turn + turn_less_one(step[3:]) @ turn)
    columns[dofs] = average @ np.linalg.inv(of_rigid).T
    return replace(rest, p=p, R=turn @ rest.R, average=columns[rest.dofs])


def turn_less_one(rotation: FloatArray) -> FloatArray:
    """(3, 3) R - 1 of the rotation vector (3,), exact to the last digits for small angles too."""
    half = np.linalg.norm(rotation) / 2.0
    spin = np.cross(np.eye(3), rotation)
    turned: FloatArray = np.sinc(2.0 * half / np.pi) * spin + 0.5 * np.sinc(half / np.pi) ** 2 * (spin @ spin)
    return turned
