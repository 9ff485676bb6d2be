"""Which nodes of a body's stress modes are watched."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import SceneError
from flexmbd.multibody.bodies.body import FlexibleBody
from flexmbd.record.groups import StressModes

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
PointFilter = Callable[[FloatArray], NDArray[np.bool_]]


def stress_modes(body: FlexibleBody, *, name: str) -> StressModes:
    """The stress modes of a body's record.

    Raises:
        SceneError: it has none.
    """
    stress = body.record.stress
    if stress is None:
        raise SceneError(
            f"{name}: its record holds no stress modes; reduce it with keep=Keep(stress=True), as in "
            "craig_bampton(model, ..., keep=Keep(stress=True))"
        )
    return stress


def places(body: FlexibleBody, modes: StressModes) -> FloatArray:
    """(k, 3) m, the nodes of the stress modes, undeformed in the mesh's axes."""
    found: FloatArray = modes.x @ body.record.R_MB.T + body.record.p_MB_M
    return found


def watched_nodes(
    body: FlexibleBody, modes: StressModes, *, clearance: float | None, where: PointFilter | None, name: str
) -> IntArray:
    """Rows of the stress modes that are farther than `clearance` (m) from interfaces and that `where` takes.

    Raises:
        SceneError: `where` fails.
    """
    chosen = np.ones(len(modes.node), dtype=bool)
    held = modes.interface >= 0
    if clearance is not None and held.any():
        from scipy.spatial import cKDTree  # on need: 0.1 s

        distance, _ = cKDTree(modes.x[held]).query(modes.x)
        chosen &= distance > clearance
    if where is not None:
        try:
            inside = np.asarray(where(places(body, modes).T))
        except Exception as reason:
            raise SceneError(f"{name}: `where` raised {type(reason).__name__}: {reason}") from reason
        if inside.shape != chosen.shape or inside.dtype != np.bool_:
            raise SceneError(
                f"{name}: `where` of points (3, n) must return n truth values, got {inside.dtype} "
                f"{inside.shape} for n = {len(chosen)}"
            )
        chosen &= inside
    return np.flatnonzero(chosen)
