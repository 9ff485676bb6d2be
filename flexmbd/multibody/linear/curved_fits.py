"""Fits of curved surfaces that are known by the centroids of their patches alone, which lie behind the surface."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import RangeWarning, warn
from flexmbd.multibody.bodies.body import FlexibleBody
from flexmbd.multibody.contact.elastic_surface import ElasticSurface
from flexmbd.multibody.kernels.base.arrays import Work
from flexmbd.multibody.kernels.sampling.passing_shares import GAP
from flexmbd.multibody.linear.passing import surfaces_that_touch, touching_points
from flexmbd.multibody.plan.compiled_scene import CompiledScene

FloatArray = NDArray[np.float64]

_SMALL = 0.1  # of an overlap: what patches may lie behind their surface


def tell_curved_fits(scene: CompiledScene, work: Work, x: FloatArray) -> None:
    """Tell surfaces that are pressed from opposite sides, by little more than their patches' centroids lie behind them.

    Args:
        scene: the machine.
        work: scratch.
        x: (nx,) an equilibrium.

    Warns:
        RangeWarning: there is one, with how far they lie behind, the overlap, and the remedy.
    """
    for contact in surfaces_that_touch(scene):
        own = contact.surface
        if not isinstance(own, ElasticSurface) or own.shape is not None:
            continue
        undeformed = x.copy()
        for end in contact.frames:
            if isinstance(end.body, FlexibleBody):
                undeformed[scene.index.modes[end.body].x] = 0.0
        gap = touching_points(scene, work, contact, undeformed, np.zeros(scene.nv))[:, GAP]
        presses = gap < 0.0
        if not presses.any() or own.normals[presses].dot(own.normals[presses].T).min() >= 0.0:
            continue
        behind, overlap = float(own.behind[presses].max()), float(-gap.min())
        if behind > _SMALL * overlap:
            warn(
                f"{contact.what}: it is a fit, of patches whose centroids lie up to {behind:.2g} m behind the curved "
                f"surface, beside an overlap of {overlap:.2g} m, which is counted from there: say what the surface is, "
                "undeformed, ElasticSurface(..., shape=), as contact.HollowCylinder(body.frame(), radius) of a bore, "
                "so that they are brought onto it",
                RangeWarning,
                subject=f"fit of {contact.what}",
            )
