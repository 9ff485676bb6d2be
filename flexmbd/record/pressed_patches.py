"""A reduced body pressed at its contact patches: static equilibrium without friction, by complementarity.

Held at its frame and otherwise free, the patches move by A f under normal forces f, A = Phi K^-1 Phi^T + G, and touch
or not: gap + A f >= 0, f >= 0, and one of the two is zero. A is symmetric and positive, so there is one answer. It is
found by Newton's method on the set of patches that touch, with pivots of single patches where that does not come
nearer (block principal pivoting: Judice & Pires 1994, doi:10.1016/0305-0548(94)90106-6).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike, NDArray

from flexmbd.brief import brief
from flexmbd.errors import ConvergenceError, RecordError
from flexmbd.given import checked, numbers, shown
from flexmbd.record.contact_patches import ContactPatches
from flexmbd.record.reduced_body import ReducedBody
from flexmbd.round_off import EQUAL

FloatArray = NDArray[np.float64]

# Newton steps without a smaller number of wrong patches, after which single ones are changed; and steps for each patch.
_PATIENCE, _STEPS = 3, 20


@dataclass(frozen=True, eq=False)
class PressedPatches:
    """Contact patches in static equilibrium.

    Attributes:
        force: (p,) N, along the normals; zero of patches that do not touch.
        pressure: (p,) Pa, the same over the patches' areas.
        gap: (p,) m, what is left of the gaps; zero of patches that touch.
        q: (n,) modal coordinates, which hold the displacement less what the residual flexibility adds at the patches.
    """

    force: FloatArray
    pressure: FloatArray
    gap: FloatArray
    q: FloatArray

    __repr__ = brief


@checked("body", error=RecordError)
def press(body: ReducedBody, *, gap: ArrayLike, normal: ArrayLike) -> PressedPatches:
    """Press a body that is held at its frame against a rigid obstacle without friction. Not collective.

    Statics of small displacements, that of the full model with any number of modes. Against a half space with a point
    x and the outward normal e, in B, gap = (body.contact.x - x) @ e and normal = e.

    Args:
        body: with contact patches, and a frame on an interface.
        gap: (p,) m between each patch's centroid and the obstacle along its normal; negative where they overlap.
        normal: (3,) or (p, 3) in B, in which the obstacle pushes the patches, against their outward normals; of any
            length but zero.

    Raises:
        RecordError: there are no contact patches, the body floats, an argument does not fit, or the obstacle would
            pull a patch.
        ConvergenceError: the patches that touch are not found.
    """
    patches = contact_patches(body)
    if body.frame is None:
        raise RecordError(
            "this body's frame floats on the mean axis, where nothing holds it against what presses it; reduce it with "
            "frame=, the interface that is held"
        )
    count = len(patches.area)
    gaps, normals = numbers(gap), numbers(normal)
    if gaps.shape != (count,) or not np.isfinite(gaps).all():
        raise RecordError(f"gap must be ({count},) finite numbers, one for each patch, got {shown(gap)}")
    lengths = np.linalg.norm(normals, axis=-1) if normals.shape in ((3,), (count, 3)) else np.zeros(1)
    if not (np.isfinite(lengths).all() and lengths.min() > 0.0):
        raise RecordError(f"normal must be (3,) or ({count}, 3) finite numbers, none of them zero, got {shown(normal)}")
    units = np.broadcast_to(normals / lengths[..., None], (count, 3))
    across = np.einsum("pba,pb->pa", patches.axes, units)
    modal = np.einsum("pa,pan->pn", across, patches.phi)
    residual = np.einsum("pa,paqb,qb->pq", across, patches.G.reshape(count, 3, count, 3), across)
    force, left = _complementary((modal / body.stiffness) @ modal.T + residual, gaps)
    pulled = np.flatnonzero((force > 0.0) & (across[:, 0] > -EQUAL))
    if len(pulled):
        k = int(pulled[0])
        raise RecordError(
            f"the obstacle would pull patch {k}, of {patches.names[patches.surface[k]]!r}, along {units[k]}: it pushes "
            f"against the patch's outward normal {patches.axes[k, :, 0]}; turn `normal` round, or give what the "
            "obstacle does not meet a large gap"
        )
    return PressedPatches(force, force / patches.area, left, (modal.T @ force) / body.stiffness)


def contact_patches(body: ReducedBody) -> ContactPatches:
    """The contact patches of a body.

    Raises:
        RecordError: it has none.
    """
    if body.contact is None:
        raise RecordError(
            "this record has no contact patches; reduce the part again with craig_bampton(..., contact=[Patch(name, "
            "size=...)]): they need the factor of its stiffness, which no record holds"
        )
    return body.contact


def _complementary(A: FloatArray, b: FloatArray) -> tuple[FloatArray, FloatArray]:
    """f >= 0 with A f + b >= 0 and one of the two zero, and A f + b; A symmetric and positive."""
    count = len(b)
    inside = np.zeros(count, dtype=bool)
    fewest, patience = count + 1, _PATIENCE
    for _ in range(100 + _STEPS * count):
        f = np.zeros(count)
        if inside.any():
            f[inside] = scipy.linalg.solve(A[np.ix_(inside, inside)], -b[inside], assume_a="pos")
        left = A @ f + b
        left[inside] = 0.0
        # each beside values of its own unit
        pulls, overlaps = f < -EQUAL * abs(f).max(), left < -EQUAL * abs(b).max()
        wrong = np.flatnonzero(pulls | overlaps)
        if len(wrong) == 0:
            return np.maximum(f, 0.0), np.maximum(left, 0.0)
        if len(wrong) < fewest:
            fewest, patience = len(wrong), _PATIENCE
        elif patience > 0:
            patience -= 1
        else:
            wrong = wrong[-1:]
        inside[wrong] = ~inside[wrong]
    raise ConvergenceError("which contact patches touch was not found; are two of them one and the same surface?")
