"""Watches that nothing is pressed flat: det F > 0 at the end of every step, of pseudo-rigid bodies and of faces."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.bodies.body import Body, FlexibleBody
from flexmbd.multibody.bodies.pseudo_rigid_body import PseudoRigidBody
from flexmbd.multibody.plan.compiled_scene import CompiledScene
from flexmbd.record.reduced_body import InterfaceFrame

FloatArray = NDArray[np.float64]


class StoredRows(Protocol):
    """The interface of a run's rows so far."""

    @property
    def count(self) -> int:
        """How many rows there are."""

    def since(self, row: int) -> tuple[FloatArray, ...]:
        """The rows from ``row`` on: times (k,), configurations (k, nx), ..."""


@dataclass(frozen=True, eq=False)
class _Watched:
    """What has a deformation gradient: its name, where its modal coordinates lie in x, F of these, and a remedy."""

    name: str
    place: slice
    gradient: Callable[[FloatArray], FloatArray]
    remedy: str


class StretchWatch:
    """Looks through the rows of a simulation as they come.

    Attributes:
        fault: the first row, of all, in which something has det F <= 0, and what to say of it; None so far.
    """

    def __init__(self, scene: CompiledScene, bodies: Iterable[Body]) -> None:
        self.fault: tuple[int, str] | None = None
        self._watched = [one for body in bodies for one in _watched(scene, body)]
        self._rows = 0

    @property
    def is_idle(self) -> bool:
        """Whether nothing of the scene can be pressed flat."""
        return not self._watched

    def sees_nothing(self, stored: StoredRows) -> bool:
        """Look at the rows that came since; each begins with its time (s) and its configuration."""
        if not self._watched:
            return True
        t, x, *_ = stored.since(self._rows)
        found = [self._first(one, t, x) for one in self._watched]
        faults = [fault for fault in found if fault is not None]
        if faults and self.fault is None:
            self.fault = min(faults)
        self._rows += len(t)
        return self.fault is None

    def _first(self, watched: _Watched, t: FloatArray, x: FloatArray) -> tuple[int, str] | None:
        size = np.linalg.det(watched.gradient(x[:, watched.place]))
        bad = np.flatnonzero(~(size > 0.0))
        if not len(bad):
            return None
        row = int(bad[0])
        return self._rows + row, (
            f"{watched.name} has det F = {size[row]:.3g} at t = {t[row]:.6g} s: it is pressed flat or turned inside "
            f"out; {watched.remedy}; what was computed before is in the error's trajectory"
        )


def _watched(scene: CompiledScene, body: Body) -> Iterable[_Watched]:
    """The deformation gradients of a body."""
    if isinstance(body, PseudoRigidBody) and not body.rigid:
        yield _Watched(
            f"pseudo-rigid body {body.name!r}",
            scene.index.modes[body].x,
            body.stretch_of,
            "lower the load or the step, or take a CompiledEnergy that grows without bound as det F goes to 0, as St "
            "Venant-Kirchhoff's does not",
        )
    record = scene.index.now(body).reduced() if isinstance(body, FlexibleBody) else None
    if record is not None and record.nonlinear is not None:
        for interface, strain in zip(record.interfaces, record.nonlinear.face_strain, strict=True):
            yield _Watched(
                f"the face of interface {interface.name!r} of flexible body {body.name!r}",
                scene.index.modes[body].x,
                _face_gradient(interface, strain),
                "its modes turn it towards pi, where it has no rotation; cut the body in several pieces, or reduce it "
                "for a larger range of loads",
            )


def _face_gradient(interface: InterfaceFrame, strain: FloatArray) -> Callable[[FloatArray], FloatArray]:
    """F (nt, 3, 3) = 1 + [theta] + S of an interface's face as a function of q (nt, n); ``strain`` (6, n)."""
    x, y, z = interface.modes[3:]
    xx, yy, zz, yz, xz, xy = strain
    rows = np.array([[xx, xy - z, xz + y], [xy + z, yy, yz - x], [xz - y, yz + x, zz]])
    return lambda q: np.asarray(np.eye(3) + np.einsum("abn,tn->tab", rows, q))
