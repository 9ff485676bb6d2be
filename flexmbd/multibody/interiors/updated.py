"""Interiors that tell how far the updates of their history in time are off, which no error of the machine's shows."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from flexmbd.multibody.bodies.continuum_body import Interior


@runtime_checkable
class UpdatedInterior(Interior, Protocol):
    """An interior with a history that it can update twice, by steps of two lengths."""

    def watch_updates(self) -> None:
        """Estimate the error of the updates from the present state on, until it begins anew."""

    def update_error(self) -> float:
        """The largest error of its forces by the updates of its history so far, over their largest; 0 unwatched."""
