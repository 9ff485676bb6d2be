"""Watches when a body spins so fast that it matters what its shapes lack of being stiffened by the spin.

The record has the stiffness that a spin adds twice. Load by load it is that of the full model's stress
(`GeometricStiffness`). A machine has that of the membrane forces of the body's own shapes (`ModalStretch`), which is
the same where shapes complete the response to the centrifugal force. Static shapes alone do not (`guyan`): a blade's
tension is uniform then, and it is stiffened a third too much.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import RangeWarning, warn
from flexmbd.multibody.bodies.body import Body
from flexmbd.multibody.kernels.base.arrays import new_work
from flexmbd.multibody.kernels.sampling.series import body_series
from flexmbd.multibody.plan.compiled_scene import CompiledScene
from flexmbd.multibody.results.stretch_watch import StoredRows
from flexmbd.record.groups import load_stiffness
from flexmbd.record.inertia_loads import CENTRIFUGAL, centrifugal_forces, spin_products
from flexmbd.record.reduced_body import ReducedBody

FloatArray = NDArray[np.float64]

# Of the square of the lowest frequency: what is told of an error of it.
_TOLD = 0.01
# Of what a spin adds to it: what records lack that complete the response to the centrifugal force, by far.
_COMPLETE = 0.05
_AT_ONCE = 1024  # rows, of all bodies


@dataclass(frozen=True, eq=False)
class SpinLack:
    """What a record has of the stiffness by a spin, and what that of a machine has too much.

    Attributes:
        stiffness: (n,) 1/s^2, at rest.
        added: (6, n, n) by the full model's stress, by the products xx, yy, zz, xy, xz, yz of angular velocities in the
            body's axes.
        excess: (6, n, n) of the machine's over that.
    """

    stiffness: FloatArray
    added: FloatArray
    excess: FloatArray

    def share(self, spin: FloatArray) -> float:
        """Of the square of the lowest frequency at an angular velocity (3,), rad/s in the body's axes."""
        products = spin_products(spin)
        values, modes = np.linalg.eigh(np.diag(self.stiffness) + np.tensordot(products, self.added, 1))
        change = modes[:, 0] @ np.tensordot(products, self.excess, 1) @ modes[:, 0]
        return float(change / values[0]) if values[0] > 0.0 else 0.0


def spin_lack(record: ReducedBody) -> SpinLack | None:
    """Of a record; None where nothing is lacking that could matter, or is not known."""
    if record not in _known:
        _known[record] = _spin_lack(record)
    return _known[record]


_known: WeakKeyDictionary[ReducedBody, SpinLack | None] = WeakKeyDictionary()


def _spin_lack(record: ReducedBody) -> SpinLack | None:
    geometric, stretch = record.geometric, record.stretch
    if geometric is None or stretch is None:
        return None
    added, machine = np.zeros((2, 6, record.n_modes, record.n_modes))
    forces = centrifugal_forces(record.gram[1:4, 4:].reshape(3, record.n_modes, 3))
    for k, name in enumerate(CENTRIFUGAL):
        known = load_stiffness(geometric, name)
        if known is not None:
            added[k] = known
            machine[k] = np.tensordot(stretch.strain @ (forces[k] / record.stiffness), stretch.P, 1)
    first, excess = int(np.argmin(record.stiffness)), machine - added
    lacks = abs(excess[:3, first, first]).max() > _COMPLETE * abs(added[:3, first, first]).max()
    return SpinLack(record.stiffness, added, excess) if lacks else None


class SpinWatch:
    """Looks through the rows of a simulation as they come, and warns once of each body."""

    def __init__(self, scene: CompiledScene, bodies: Iterable[Body]) -> None:
        self._scene = scene
        records = ((body, scene.index.now(body).reduced()) for body in bodies)
        found = {body: spin_lack(record) for body, record in records if record is not None}
        self._watched = {body: lack for body, lack in found.items() if lack is not None}
        self._rows = 0

    def look(self, stored: StoredRows) -> None:
        """Look at the rows that came since; each begins with time (s), configuration, velocities and accelerations.

        Warns:
            RangeWarning: as `judge`.
        """
        if not self._watched:
            return
        t, x, v, *_ = stored.since(self._rows)
        self._rows += len(t)
        for body in self._told(t, x, v):
            del self._watched[body]

    def judge(self, t: FloatArray, x: FloatArray, v: FloatArray) -> None:
        """The same of other states, as steady motions or whole runs: times (k,), configurations and velocities.

        Warns:
            RangeWarning: what a body's shapes lack changes the square of its lowest frequency by a hundredth; once a
                body.
        """
        self._told(t, x, v)

    def _told(self, t: FloatArray, x: FloatArray, v: FloatArray) -> list[Body]:
        """The bodies of which it is told at one of these rows, once each."""
        quick: list[Body] = []
        plan, watched = self._scene.plan, dict(self._watched)
        for begin in range(0, len(t) if watched else 0, _AT_ONCE):
            block = slice(begin, begin + _AT_ONCE)
            rows = np.ascontiguousarray(x[block]), np.ascontiguousarray(v[block])
            motions = np.zeros((len(rows[0]), len(plan.tree), 21))
            # velocities need no accelerations
            body_series(plan, new_work(plan), *rows, np.zeros(rows[1].shape), motions)
            for body, lack in tuple(watched.items()):
                own = motions[:, self._scene.index.bodies[body]]
                spin = np.einsum("kab,ka->kb", own[:, 3:12].reshape(-1, 3, 3), own[:, 15:18])
                row = int(np.argmax(np.einsum("kb,kb->k", spin, spin)))
                share = lack.share(spin[row])
                if abs(share) > _TOLD:
                    del watched[body]
                    quick.append(body)
                    _tell(body, float(t[begin + row]), spin[row], share)
        return quick


def _tell(body: Body, t: float, spin: FloatArray, share: float) -> None:
    warn(
        f"flexible body {body.name!r} turns with {np.linalg.norm(spin):.4g} rad/s at t = {t:.6g} s: no shape of it "
        "completes the tension of the centrifugal force, so that the square of its lowest frequency is off by "
        f"{100.0 * share:+.2g} % there, and by more where it turns faster; reduce it with a mode or more "
        "(craig_bampton, modes=1), with which shapes that complete it come",
        RangeWarning,
        subject=f"spin of {body.name}",
    )
