"""Watches that no pseudo-rigid body is pressed flat: det F > 0 at the end of every step."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.bodies.body import Body
from flexmbd.multibody.bodies.pseudo_rigid_body import PseudoRigidBody
from flexmbd.multibody.plan.compiled_scene import CompiledScene

FloatArray = NDArray[np.float64]


class StretchWatch:
    """Looks through the rows of a simulation as they come.

    Attributes:
        fault: the first row, of all, in which a body has det F <= 0, and what to say of it; None so far.
    """

    def __init__(self, scene: CompiledScene, bodies: Iterable[Body]) -> None:
        found = [body for body in bodies if isinstance(body, PseudoRigidBody) and not body.rigid]
        self.fault: tuple[int, str] | None = None
        self._watched = [(body, scene.index.modes[body].x) for body in found]
        self._blocks = 0
        self._rows = 0

    def sees_nothing(self, blocks: Sequence[tuple[FloatArray, ...]]) -> bool:
        """Look at the blocks of rows that came since; each begins with times (k,) and configurations (k, nx)."""
        if not self._watched:
            return True
        for t, x, *_ in blocks[self._blocks :]:
            found = [self._first(body, place, t, x) for body, place in self._watched]
            faults = [fault for fault in found if fault is not None]
            if faults and self.fault is None:
                self.fault = min(faults)
            self._rows += len(t)
        self._blocks = len(blocks)
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
