"""Steps of statics that pass through nothing: what bodies that touch allow of Newton's step."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.kernels.base.arrays import Work
from flexmbd.multibody.kernels.reading.force_tables import element_numbers, passable_contacts
from flexmbd.multibody.kernels.sampling.passing import GAP, N_PASSING, SHARE, TOUCH, passing_shares
from flexmbd.multibody.linear.balance import moved, step_size
from flexmbd.multibody.plan.compiled_scene import CompiledScene

FloatArray = NDArray[np.float64]

_PIECE = 0.3  # rad, or of the machine's extent: of a step along which contacts are asked anew
_PIECES = 1000  # at most


@dataclass(frozen=True)
class Passing:
    """How much of a step may be gone.

    Attributes:
        share: of the step; infinite where it passes through nothing.
        contact: the name of the contact that allows no more; empty without any.
        gap: m, of that before the step; negative where it overlaps.
        meets: whether the step comes nearer to something that it may touch, or presses it.
    """

    share: float = np.inf
    contact: str = ""
    gap: float = 0.0
    meets: bool = False

    @property
    def told(self) -> str:
        """The contact and its gap."""
        how = f"{self.gap:.3g} m apart" if self.gap > 0.0 else f"pressed in by {-self.gap:.3g} m"
        return f"{self.contact}, {how}"


def passing(scene: CompiledScene, work: Work, x: FloatArray, step: FloatArray) -> Passing:
    """How much of a step (nv,) from x (nx,) may be gone before a contact would be on the far side of what it meets.

    Half of the way to the middle of what is met is allowed from outside, half of what is left of it from inside; so
    that no gap closes and opens again on the other side, and what is pressed in is not pushed through.
    """
    rows = passable_contacts(scene.plan)
    if not len(rows) or not np.isfinite(step).all():
        return Passing()
    found = np.zeros((len(rows), N_PASSING))
    passing_shares(scene.plan, work, rows, x, np.ascontiguousarray(step), found)
    least, meets = int(np.argmin(found[:, SHARE])), bool((found[:, TOUCH] < np.inf).any())
    if not found[least, SHARE] < np.inf:
        return Passing(meets=meets)
    name = scene.element_names[element_numbers(scene.plan, [int(rows[least])])[0]]
    return Passing(float(found[least, SHARE]), name, float(found[least, GAP]), meets)


def passing_on_the_way(
    scene: CompiledScene, work: Work, x: FloatArray, step: FloatArray, sizes: FloatArray
) -> Passing:
    """As ``passing``, of a step so long that angles turn on the way: piece by piece; ``sizes`` (nv,): motions'.

    Raises:
        SceneError: on the way the loops do not close.
    """
    size = step_size(sizes, step)
    if not len(passable_contacts(scene.plan)) or not np.isfinite(size):
        return Passing()
    pieces, found = min(max(1, int(np.ceil(min(size / _PIECE, _PIECES)))), _PIECES), Passing()
    for k in range(pieces):
        place = x if k == 0 else moved(scene, work, x, (k / pieces) * step)
        found = passing(scene, work, place, step / pieces)
        if found.share < 1.0:
            return replace(found, share=(k + found.share) / pieces)
    return replace(found, share=np.inf)
