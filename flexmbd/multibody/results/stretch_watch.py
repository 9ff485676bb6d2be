"""Watches that no pseudo-rigid body is pressed flat: det F > 0 at the end of every step."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.bodies.body import Body
from flexmbd.multibody.bodies.pseudo_rigid_body import PseudoRigidBody
from flexmbd.multibody.plan.compiled_scene import CompiledScene

FloatArray = NDArray[np.float64]


class StoredRows(Protocol):
    """The interface of a run's rows so far."""

    def since(self, row: int) -> tuple[FloatArray, ...]:
        """The rows from ``row`` on: times (k,), configurations (k, nx), ..."""


class StretchWatch:
    """Looks through the rows of a simulation as they come.

    Attributes:
        fault: the first row, of all, in which a body has det F <= 0, and what to say of it; None so far.
    """

    def __init__(self, scene: CompiledScene, bodies: Iterable[Body]) -> None:
        found = [body for body in bodies if isinstance(body, PseudoRigidBody) and not body.rigid]
        self.fault: tuple[int, str] | None = None
        self._watched = [(body, scene.index.modes[body].x) for body in found]
        self._rows = 0

    def sees_nothing(self, stored: StoredRows) -> bool:
        """Look at the rows that came since; each begins with its time (s) and its configuration."""
        if not self._watched:
            return True
        t, x, *_ = stored.since(self._rows)
        found = [self._first(body, place, t, x) for body, place in self._watched]
        faults = [fault for fault in found if fault is not None]
        if faults and self.fault is None:
            self.fault = min(faults)
        self._rows += len(t)
        return self.fault is None

    def _first(
        self, body: PseudoRigidBody, place: slice, t: FloatArray, x: FloatArray
    ) -> tuple[int, str] | None:
        size = np.linalg.det(body.stretch_of(x[:, place]))
        bad = np.flatnonzero(~(size > 0.0))
        if not len(bad):
            return None
        row = int(bad[0])
        return self._rows + row, (
            f"pseudo-rigid body {body.name!r} has det F = {size[row]:.3g} at t = {t[row]:.6g} s: it is pressed flat or "
            "turned inside out; lower the load or the step, or take a CompiledEnergy that grows without bound as det F "
            "goes to 0, as St Venant-Kirchhoff's does not; what was computed before is in the error's trajectory"
        )
