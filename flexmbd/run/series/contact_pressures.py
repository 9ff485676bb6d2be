"""Pressures on the contact patches of reduced bodies over a machine's rows."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmbd.errors import SceneError
from flexmbd.given import checked, refuse_other
from flexmbd.multibody.bodies.body import FlexibleBody
from flexmbd.multibody.contact.elastic_surface import ElasticSurface
from flexmbd.multibody.contact.surface_contact import SurfaceContact
from flexmbd.multibody.results.surface_series import SurfaceSeries
from flexmbd.run.series.force_series import ForceSeries

FloatArray = NDArray[np.float64]

_WANTED = "a contact of elastic surfaces, as scene.touch(contact.ElasticSurface(...), ...) gave"


class ContactPressures(ForceSeries):
    """The question of a `Trajectory` for pressures."""

    @checked("t")
    def contact_pressures(
        self, touching: SurfaceContact | Sequence[SurfaceContact], *, t: ArrayLike | None = None
    ) -> dict[FlexibleBody, FloatArray]:
        """Pressures of contacts on each reduced body that they touch, (nt, patches) Pa; or at times ``t`` (k,).

        In the order of ``body.record.contact``; both bodies of a pair, and where several contacts press a patch their
        sum.  A pressure is the normal force on a patch over its undeformed area.

        Raises:
            SceneError: what is no contact of elastic surfaces, or of another scene.
        """
        found: dict[FlexibleBody, FloatArray] = {}
        for one in touching if isinstance(touching, Sequence) else [touching]:
            refuse_other(one, SurfaceContact, "what is asked for pressures", wanted=_WANTED)
            (series,) = self.contacts(one, t=t)
            if not isinstance(series, SurfaceSeries):
                raise SceneError(f"{one.what} has no patches")
            if isinstance(one.surface, ElasticSurface):
                _add(found, one.surface, series.pressure)
            if isinstance(one.other, ElasticSurface):
                _add(found, one.other, series.other_pressure)
        return found

    def _pressures_of(
        self, touching: Sequence[SurfaceContact]
    ) -> Callable[[FloatArray], Mapping[FlexibleBody, FloatArray]] | None:
        """``contact_pressures`` of these by times (k,) s, for pictures; None of none."""
        return (lambda t: self.contact_pressures(touching, t=t)) if len(touching) else None


def _add(found: dict[FlexibleBody, FloatArray], surface: ElasticSurface, pressure: FloatArray) -> None:
    """Add pressures (nt, p) on the patches of a surface to those on its body."""
    group = surface.body.record.contact
    assert group is not None  # noqa: S101  (refused when the surface was made)
    whole = found.setdefault(surface.body, np.zeros((len(pressure), len(group.area))))
    whole[:, surface.patches] += pressure
