"""Couplings of joint coordinates: linear relations that hold from the start on."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol, runtime_checkable

from flexmbd.errors import SceneError
from flexmbd.multibody.joint.protocol import Joint, step_slices

if TYPE_CHECKING:
    from flexmbd.multibody.joint.connection import Connection


@dataclass(frozen=True, eq=False)
class Term:
    """``share`` times a coordinate of a joint.

    Attributes:
        connection: the joint.
        index: which of its coordinates.
        share: the factor.
    """

    connection: Connection
    index: int
    share: float


@runtime_checkable
class CoordinateCoupling(Protocol):
    """The sum of ``terms`` keeps the value that it has at the start."""

    @property
    def name(self) -> str:
        """In messages."""

    @property
    def terms(self) -> tuple[Term, ...]:
        """The terms of the sum."""


def coordinate_place(joint: Joint, index: int) -> tuple[int, int]:
    """The step of a joint that has its velocity ``index``, and which of the step's it is.

    Raises:
        SceneError: it has no such velocity, or that of a ball, which is no coordinate's rate.
    """
    for k, (step, (_, v)) in enumerate(zip(joint.steps, step_slices(joint.steps), strict=True)):
        if v.start <= index < v.start + len(step.pair.columns):
            return k, index - v.start
    raise SceneError(f"a {type(joint).__name__} has no coordinate {index} of one number, as an angle or a length")


def single_coordinate(connection: Connection, *, angular: bool, what: str) -> int:
    """Index of the only angle, or the only displacement, among a joint's coordinates.

    Raises:
        SceneError: the joint has none, or several; ``what`` names the coupling.
    """
    joint = connection.joint
    found = [k for k, turns in enumerate(joint.angular) if turns == angular]
    if len(found) != 1:
        kind = "rotation" if angular else "translation"
        raise SceneError(
            f"{what}: joint {connection.name!r} is a {type(joint).__name__}; a joint with exactly one "
            f"{kind} among its coordinates is needed"
        )
    return found[0]
