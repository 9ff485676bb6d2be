"""What facets do to the nodes that come through them in a step: a push out of them, and friction by bristles.

Contact begins where a node comes through the facets from before them, so that what comes from beside them, behind
their plane, is not thrown out.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum.interior.facet_search import NearFacets
from flexmbd.continuum.interior.nodal_push import push
from flexmbd.round_off import SAME_PLACE

FloatArray = NDArray[np.float64]

# The part of a step's way by which a point may have been behind facets already when it comes through them.
_OF_WAY = 0.1


@dataclass(frozen=True, eq=False)
class FacetPush:
    """The contact of points with facets at a step's end, for springs of unit stiffness.

    Attributes:
        found: the points that touch.
        met, rubbed: (n, 3) m, out of the facets and across.
        memory: (all points, 4) m, the stretch of the points' bristles; and 1 of those that touch.
    """

    found: NearFacets
    met: FloatArray
    rubbed: FloatArray
    memory: FloatArray


def comes_through(
    found: NearFacets, went: FloatArray, touching: NDArray[np.bool_], *, size: float
) -> NDArray[np.bool_]:
    """(n,) which points behind facets touched them before, or were before them when the step began.

    That is told by the way of a step, to second order, so that a small part of it is allowed for.
    """
    before = found.depth + np.einsum("ij,ij->i", went, found.normal)
    allowed = SAME_PLACE * size + _OF_WAY * np.sqrt((went**2).sum(axis=1))
    return np.asarray(touching | (before <= allowed))


def push_out(
    found: NearFacets, went: FloatArray, memory: FloatArray, *, friction: float, size: float
) -> FacetPush:
    """Push points out.

    Args:
        found: points that are behind facets.
        went: (n, 3) m, how far each of them went in the step against the place where it touches.
        memory: (all points, 4), of the step before.
        friction: Coulomb's coefficient.
        size: m, of the body, by which places are told from round-off.
    """
    entered = comes_through(found, went, memory[found.points, 3] > 0.0, size=size)
    found, went = found.some(entered), went[entered]
    held = memory[found.points, :3] + went
    held -= np.einsum("ij,ij->i", held, found.normal)[:, None] * found.normal
    still = np.zeros_like(held)
    met, rubbed = push(
        found.depth, found.normal, still, still, h=1.0, reach=1.0, stiffness=1.0, friction=friction, stretch=held
    )
    kept = np.zeros_like(memory)
    kept[found.points] = np.column_stack([-rubbed, np.ones(len(held))])
    return FacetPush(found, met, rubbed, kept)
