"""StressField: stress on the mesh of a body at one instant, as plain arrays."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol, runtime_checkable

from flexmbd.record.groups import FloatArray, IntArray
from flexmbd.record.pictured import PicturedField

if TYPE_CHECKING:
    from flexmbd.record.reduced_body import ReducedBody


@dataclass(frozen=True, eq=False)
class StressField(PicturedField):
    """Displacement and stress of a body at its mesh nodes, in body axes; `show` draws it.

    Stress jumps from cell to cell; the values here are plain averages over the cells that share
    a node, good to look at.  ``max`` is not averaged: it is the largest value in any cell.

    Attributes:
        node: (k,) node numbers of the mesh's input, ascending: no partition matters.
        x: (k, 3) m, undeformed node positions.
        triangle: (t, 3) the surface as rows of ``x``, oriented outwards.
        displacement: (k, 3) m, against the body frame.
        stress: (k, 3, 3) Pa, Cauchy stress.
        von_mises: (k,) Pa, averages of the cells' von Mises stresses.
        max: Pa, the largest von Mises stress in any cell.
        max_x: (3,) m, where that is, undeformed.
    """

    node: IntArray
    x: FloatArray
    triangle: IntArray
    displacement: FloatArray
    stress: FloatArray
    von_mises: FloatArray
    max: float
    max_x: FloatArray

    def __repr__(self) -> str:
        """How many nodes, and the largest stress."""
        place = ", ".join(f"{x:.4g}" for x in self.max_x)
        return f"<StressField at {len(self.x)} nodes: at most {self.max:.6g} Pa, at ({place}) m>"


@runtime_checkable
class StressModel(Protocol):
    """A model that turns modal coordinates into a stress field: a ContinuumModel."""

    def stress_field(
        self, body: ReducedBody, q: FloatArray, *, heat: Mapping[str, float] | None = None
    ) -> StressField:
        """Stress on the mesh at modal coordinates q (n,), and at factors of the record's temperatures by name.

        Factors are handed over where the record has temperatures (`Heat`) alone.
        """
