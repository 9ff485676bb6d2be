"""The record's contact patches: where a body may be touched, and its flexibility there beside that of the modes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmbd.brief import brief
from flexmbd.round_off import SEVEN_DIGITS

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class ContactPatches:
    """Optional group ``contact/``: patches of the surface that may be touched, and the residual flexibility there.

    A force on a patch is spread evenly over its facets; what does work on it is the patch's mean displacement. Under
    forces f (3 p,) along the patches' axes, patch by patch normal, first and second tangent, the patches move by

        u = Phi q + G f,    Phi = phi as a (3 p, n) matrix,

    and the modal coordinates have the forces Phi^T f. G is what the modes leave out of the static response (MacNeal
    1971): symmetric, without mass, the same for every body frame. So statics is that of the full model with any number
    of modes, and the gap between a patch and what it touches is gap of the modes + (n^T G n) times the normal force.

    Attributes:
        names: (c,) of the surfaces.
        surface: (p,) which of these each patch is of, from 0.
        x: (p, 3) m, centroids, undeformed, in B.
        axes: (p, 3, 3) columns: mean outward normal and two tangents, right-handed, in B.
        area: (p,) m^2.
        phi: (p, 3, n) mean displacement along these axes per unit modal coordinate.
        G: (3 p, 3 p) m/N.
        facet: (f, 3 or 4) node numbers of the facets' corners, as in `NodalModes`, counter-clockwise from outside.
        patch: (f,) the patch of each facet.
    """

    names: tuple[str, ...]
    surface: IntArray
    x: FloatArray
    axes: FloatArray
    area: FloatArray
    phi: FloatArray
    G: FloatArray
    facet: IntArray
    patch: IntArray

    __repr__ = brief


def contact_array_shapes(group: ContactPatches, n: int) -> Mapping[str, tuple[int, ...]]:
    """The shape that each array should have of a body of n modes."""
    p, f = group.area.size, group.patch.size
    corners = group.facet.shape[1] if group.facet.ndim == 2 else 3
    return {
        "surface": (p,), "x": (p, 3), "axes": (p, 3, 3), "area": (p,), "phi": (p, 3, n), "G": (3 * p, 3 * p),
        "facet": (f, corners), "patch": (f,),
    }  # fmt: skip


def contact_faults(group: ContactPatches) -> Iterator[str]:
    """Faults of a group whose arrays have their shapes."""
    p = group.area.size
    if not np.isin(group.surface, np.arange(len(group.names))).all():
        yield f"patches are of surfaces {np.unique(group.surface)}, and there are {len(group.names)} names"
    if not np.isin(group.patch, np.arange(p)).all():
        yield f"facets are of patches {group.patch.min()} to {group.patch.max()}, and there are {p}"
    if not (group.area > 0.0).all():
        yield f"a patch has the area {group.area.min()} m^2"
    turned = abs(group.axes.swapaxes(1, 2) @ group.axes - np.eye(3)).max(initial=0.0)
    if not (turned <= SEVEN_DIGITS and (np.linalg.det(group.axes) > 0.0).all()):
        yield "a patch has axes that are no rotation"
    # entries have one unit
    size = abs(group.G).max(initial=0.0)
    if not abs(group.G - group.G.T).max(initial=0.0) <= SEVEN_DIGITS * size:
        yield "G is not symmetric"
    elif not _is_positive(group.G + SEVEN_DIGITS * size * np.eye(3 * p)):
        yield "G is negative: some forces would move the patches against themselves"


def _is_positive(matrix: FloatArray) -> bool:
    """Whether a symmetric matrix has positive eigenvalues alone, or is zero."""
    try:
        np.linalg.cholesky(matrix)
    except np.linalg.LinAlgError:
        return not matrix.any()
    return True
