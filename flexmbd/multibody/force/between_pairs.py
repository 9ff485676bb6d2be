"""A law of one's own between all pairs of a group of frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmbd.errors import SceneError
from flexmbd.given import checked, is_list, numbers, refuse_other
from flexmbd.multibody.bodies.body import Frame
from flexmbd.multibody.force.protocol import ElementTable, OffJoints
from flexmbd.multibody.functions.compiled_function import Compiled, Signature


@checked("name")
@dataclass(frozen=True, eq=False)
class BetweenPairs(OffJoints):
    """A force along the line between the origins of any two of a group of frames, by a compiled law.

    Each pair is asked once, and both get the same force with opposite signs along their line, which makes neither
    linear nor angular momentum.  One element does for the whole group.

    Attributes:
        group: its frames, two at least, of which no two may meet where the law has no value there.
        law: ``fm.compiled`` f(t, data, a, b, r, rate, out), which writes what pushes the pair apart (N) into out[0] and
            returns the energy (J) that the pair stores, or nothing; see `flexmbd.compiled`.
        own: (n, k) numbers of each frame, as masses, charges or radii: the law's a and b; (n,) where k is 1.
        data: (m,) numbers that all pairs share.
        name: in messages.

    Raises:
        SceneError: no group of frames, a law that is none, or numbers that are not as many as the frames.
    """

    group: Sequence[Frame]
    law: Compiled
    own: ArrayLike = ()
    data: ArrayLike = ()
    name: str = ""

    def __post_init__(self) -> None:
        self.check()

    @property
    def frames(self) -> tuple[Frame, ...]:
        """The group."""
        return tuple(self.group)

    @property
    def what(self) -> str:
        """Its name in messages."""
        return f"BetweenPairs {self.name or self.law.name!r}"

    def check(self) -> None:
        """Raise SceneError for no group, a law that is none, or numbers that are not as many as the frames."""
        check_group(self.group, Frame, f"BetweenPairs {self.name}".rstrip(), "frames, as body.frame()")
        if not (isinstance(self.law, Compiled) and self.law.signature is Signature.PAIR):
            raise SceneError(
                f"BetweenPairs {self.name or ''}: its law must be made by flexmbd.compiled of a function of "
                f"(t, data, a, b, r, rate, out), got {self.law!r:.60}"
            )
        self._own()
        data = numbers(self.data)
        if data.ndim > 1 or not np.isfinite(data).all():
            raise SceneError(f"{self.what}: data must be a list of finite numbers, got {self.data!r:.60}")
        self._try_law(data.ravel())

    def assemble(self, table: ElementTable) -> None:
        """One row."""
        table.pairs(self.law, self.what, self.group, own=self._own(), numbers=numbers(self.data).ravel())

    def _try_law(self, data: NDArray[np.float64]) -> None:
        """Ask the law once in Python, where numbers that it reads and that are not there show."""
        own = self._own()
        try:
            with np.errstate(all="ignore"):
                self.law.source(0.0, data, own[0], own[1], 1.0, 0.0, np.zeros(1))
        except IndexError as reason:
            raise SceneError(
                f"{self.what}: its law reads more numbers than it is given, {len(data)} of data and {own.shape[1]} of "
                f"own for each frame: {reason}"
            ) from reason
        except ArithmeticError:  # as it may be at this distance
            return

    def _own(self) -> NDArray[np.float64]:
        """(n, k) numbers of each frame."""
        own = numbers(self.own)
        if own.size == 0:
            return np.zeros((len(self.group), 0))
        if own.ndim not in (1, 2) or len(own) != len(self.group) or not np.isfinite(own).all():
            raise SceneError(
                f"{self.what}: own takes finite numbers of each of the {len(self.group)} frames, (n,) or (n, k), got "
                f"shape {own.shape}"
            )
        return own.reshape(len(own), -1)


def check_group(group: object, kind: type, what: str, wanted: str) -> None:
    """Raise SceneError unless ``group`` is a list of two or more different ones of a kind."""
    if not is_list(group) or len(group) < 2:  # type: ignore[arg-type]
        raise SceneError(f"{what}: a group is a list of two or more {wanted}, got {group!r:.60}")
    for one in group:  # type: ignore[attr-defined]
        refuse_other(one, kind, f"{what}: one of the group", wanted=wanted)
    if len({id(one) for one in group}) < len(group):  # type: ignore[attr-defined, arg-type]
        raise SceneError(f"{what}: the group has one twice")
