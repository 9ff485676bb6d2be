"""The limit of bodies of small displacements: interfaces that turn against each other by more than a quarter radian."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import RangeWarning, warn
from flexmbd.multibody.bodies.body import Body, FlexibleBody
from flexmbd.multibody.plan.compiled_scene import CompiledScene
from flexmbd.multibody.results.state_rows import StateRows
from flexmbd.record.reduced_body import ReducedBody

FloatArray = NDArray[np.float64]

#: rad, at which a displacement across is off by theta^2 / 2, three hundredths.
MOST = 0.25


@dataclass(frozen=True, eq=False)
class _Bending:
    """A body of small displacements.

    Attributes:
        body: it.
        turns: (p, 3, n) rad per mode, how the interfaces of each pair turn against each other, but for the twist
            about the line through both, which shortens nothing.
        names: of the interfaces, pair by pair.
    """

    body: Body
    turns: FloatArray
    names: tuple[tuple[str, str], ...]

    def tells(self, rows: StateRows) -> bool:
        """As `Limit`."""
        q = rows.x[rows.most, rows.scene.index.modes[self.body].x]
        turned = np.einsum("kn,pan->kpa", q, self.turns)  # too small for threads of BLAS
        angles = np.sqrt(np.einsum("kpa,kpa->kp", turned, turned))
        beyond = np.flatnonzero(angles.max(axis=1) > MOST)
        if not len(beyond):
            return False
        row = int(beyond[0])
        pair = int(np.argmax(angles[row]))
        angle, (one, other) = angles[row, pair], self.names[pair]
        warn(
            f"flexible body {self.body.name!r} bends: its interfaces {one!r} and {other!r} turn by {angle:.2g} rad "
            f"against each other at t = {rows.t[rows.most][row]:.6g} s, and its record is of small displacements, so "
            f"that what moves across is off by about {50.0 * angle**2:.1g} %, and by more where it bends more; reduce "
            "it with nonlinear=ModalDerivatives(...), or cut it in several pieces",
            RangeWarning,
            subject=f"bending of {self.body.name}",
        )
        return True


def bend_limits(scene: CompiledScene, bodies: Iterable[Body]) -> Iterator[_Bending]:
    """Of flexible bodies without nonlinear stiffness, with two interfaces or more."""
    for body in bodies:
        record = scene.index.now(body).reduced()
        if isinstance(body, FlexibleBody) and record is not None and record.nonlinear is None and record.n_modes:
            limit = _bending(body, record)
            if limit is not None:
                yield limit


def _bending(body: Body, record: ReducedBody) -> _Bending | None:
    turns, names = [], []
    for one, other in combinations(record.interfaces, 2):
        turn, line = other.modes[3:] - one.modes[3:], other.p_BI_B - one.p_BI_B
        length = float(np.linalg.norm(line))
        if length > 0.0:
            axis = line / length
            turn = turn - np.outer(axis, axis @ turn)
        if turn.any():
            turns.append(turn)
            names.append((one.name, other.name))
    return _Bending(body, np.array(turns), tuple(names)) if turns else None
