"""A fixed joint: the child is bonded to the parent."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from flexmbd.multibody.joint.protocol import Row
from flexmbd.multibody.kernels import layout as at


@dataclass(frozen=True)
class Fixed:
    """No relative motion; no coordinates."""

    axis: ClassVar[str] = "z"
    kind: ClassVar[int] = at.FIXED
    start: ClassVar[tuple[float, ...]] = ()
    velocity_names: ClassVar[tuple[str, ...]] = ()
    angular: ClassVar[tuple[bool, ...]] = ()
    reversible: ClassVar[bool] = True
    rows: ClassVar[tuple[Row, ...]] = (
        (at.ROW_TRANSLATION, 0, "translation x"),
        (at.ROW_TRANSLATION, 1, "translation y"),
        (at.ROW_TRANSLATION, 2, "translation z"),
        (at.ROW_AXIS, 0, "rotation x"),
        (at.ROW_AXIS, 1, "rotation y"),
        (at.ROW_AXIS, 2, "rotation z"),
    )
