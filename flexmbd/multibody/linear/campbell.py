"""Campbell diagrams: the vibrations of a machine over the speed at which it spins, and its critical speeds.

The eigenvalues of the linearised machine's damped, gyroscopic equations are followed from speed to speed by their
shapes, through crossings too: by the modal assurance criterion between right and left eigenvectors, which are
orthogonal to those of every other eigenvalue whatever the damping and whatever the units of the coordinates (Genta
2005, Dynamics of Rotating Systems, section 4.6; Allemang 2003).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmbd.errors import SceneError, told_once
from flexmbd.given import numbers
from flexmbd.multibody.team import Team

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

_OWN = 0.5  # of the criterion: more than half of a shape is in no more than one other


class FirstOrderMachine(Protocol):
    """What is followed: a linearised machine, as ``System.linearize`` gives it."""

    @property
    def states(self) -> tuple[str, ...]:
        """Names of the states."""

    @property
    def team(self) -> Team:
        """Who writes files."""

    def state_space(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """A, B, C, D of ds/dt = A s + B u, outputs = C s + D u."""


@dataclass(frozen=True)
class CriticalSpeed:
    """A speed at which an engine order meets a vibration.

    Attributes:
        speed: rad/s.
        frequency: Hz, of the vibration, order times speed over 2 pi.
        order: how many times in a turn the machine is pushed.
        branch: which vibration, a column of ``Campbell.frequencies``.
        damping_ratio: of the vibration there.
    """

    speed: float
    frequency: float
    order: float
    branch: int
    damping_ratio: float


@dataclass(frozen=True, eq=False)
class Campbell:
    """Vibrations over speed; made by ``flexmbd.campbell``, drawn by ``flexmbd.visual.plot_campbell``.

    Attributes:
        speeds: (k,) rad/s, ascending.
        eigenvalues: (k, n) 1/s, with positive imaginary part, a column for each vibration that was followed, by
            ascending mean frequency; NaN at speeds where it does not swing.
        critical: the critical speeds, ascending.
        orders: the engine orders that were looked for.
        team: who writes files.
    """

    speeds: FloatArray
    eigenvalues: ComplexArray
    critical: tuple[CriticalSpeed, ...]
    orders: tuple[float, ...]
    team: Team

    def __repr__(self) -> str:
        """How many vibrations over which speeds."""
        return (
            f"<Campbell: {self.eigenvalues.shape[1]} vibrations at {len(self.speeds)} speeds from {self.speeds[0]:g} "
            f"to {self.speeds[-1]:g} rad/s, {len(self.critical)} critical speeds>"
        )

    @property
    def frequencies(self) -> FloatArray:
        """(k, n) Hz, of the damped vibrations: imaginary parts over 2 pi."""
        return np.asarray(self.eigenvalues.imag / (2.0 * np.pi), dtype=np.float64)

    @property
    def damping_ratios(self) -> FloatArray:
        """(k, n) minus the real part of the eigenvalue over its size; negative where the vibration grows."""
        return _damping_ratio(self.eigenvalues)


@dataclass(frozen=True, eq=False)
class _Vibrations:
    """Eigenvalues (m,) with positive imaginary part, right (N, m) and left vectors (m, N) with left right = 1."""

    values: ComplexArray
    right: ComplexArray
    left: ComplexArray

    def likeness(self, others: _Vibrations) -> FloatArray:
        """(m, m') the criterion: 1 of the same shape, 0 of another one of the same machine."""
        return np.abs((self.left @ others.right) * (others.left @ self.right).T)


def campbell(
    linearize: Callable[[float], FirstOrderMachine],
    speeds: ArrayLike,
    *,
    orders: Sequence[float] = (1.0,),
) -> Campbell:
    """Follow a machine's vibrations over its speed, and find where engine orders meet them.

    Not collective; with a team each rank computes the same.

    Args:
        linearize: the machine linearised at a speed (rad/s), as ``lambda speed: scene_at(speed).linearize()``; with
            the same coordinates at each.  Called at ``speeds``, and some ten times for each critical speed.
        speeds: (k,) rad/s, ascending; so near to each other that between two no shape changes by more than half.
        orders: engine orders: how many times in a turn the machine is pushed, 1 by unbalance.

    Raises:
        SceneError: bad speeds or orders, other states at another speed, or as ``linearize``, with the speed.

    Warns:
        RangeWarning: as ``linearize`` of a body that spins too fast for its shapes; once a body, at the lowest speed.
    """
    given, wanted = numbers(speeds), numbers(orders)
    if given.ndim != 1 or len(given) < 2 or not np.isfinite(given).all() or not (np.diff(given) > 0.0).all():
        raise SceneError(f"speeds must be two or more finite numbers (rad/s), ascending, got {speeds!r:.80}")
    if wanted.ndim != 1 or not np.isfinite(wanted).all() or not (wanted > 0.0).all():
        raise SceneError(f"engine orders must be a list of positive numbers, got {orders!r:.80}")
    with told_once():
        return _diagram(_Machines(linearize), given, wanted)


def _diagram(machines: _Machines, given: FloatArray, wanted: FloatArray) -> Campbell:
    """Of the machines at the given speeds (k,) rad/s, and where the wanted engine orders meet their vibrations."""
    tracked = _Branches()
    for speed in given:
        tracked.add(machines.vibrations(float(speed)))
    tracked.sort()
    eigenvalues = tracked.eigenvalues()
    critical = [
        crossing
        for order in wanted
        for k in range(len(given) - 1)
        for branch in range(eigenvalues.shape[1])
        if (crossing := _crossing(machines, given, tracked, k, branch, float(order))) is not None
    ]
    found = tuple(sorted(critical, key=lambda one: one.speed))
    return Campbell(given.astype(np.float64), eigenvalues, found, tuple(map(float, wanted)), machines.team)


class _Machines:
    """Linearises at speeds, and sees to it that the states stay the same."""

    def __init__(self, linearize: Callable[[float], FirstOrderMachine]) -> None:
        self._linearize = linearize
        self._first: tuple[float, FirstOrderMachine] | None = None

    @property
    def team(self) -> Team:
        if self._first is None:
            raise LookupError("nothing was linearised yet")
        return self._first[1].team

    def vibrations(self, speed: float) -> _Vibrations:
        """Those at a speed (rad/s)."""
        try:
            machine = self._linearize(speed)
        except SceneError as reason:
            raise SceneError(f"at {speed:g} rad/s: {reason}") from reason
        if self._first is None:
            self._first = speed, machine
        elif machine.states != self._first[1].states:
            other = next((name for name in machine.states if name not in self._first[1].states), "fewer states")
            raise SceneError(
                f"at {speed:g} rad/s the machine has other states than at {self._first[0]:g} rad/s ({other!r}); "
                "linearise one scene, of which only the speed changes"
            )
        return _vibrations(machine.state_space()[0])


def _vibrations(A: FloatArray) -> _Vibrations:
    import scipy.linalg  # on need

    values, left, right = scipy.linalg.eig(A, left=True, right=True)
    swings = np.flatnonzero(values.imag > 1e-9 * np.abs(values))  # as `LinearizedMachine.frequencies`
    swings = swings[np.lexsort((values[swings].real, np.abs(values[swings])))]
    right, left = right[:, swings], left[:, swings].conj().T
    # within equal eigenvalues the left vectors are some basis: that which belongs to the right ones
    return _Vibrations(values[swings], right, np.linalg.pinv(left @ right) @ left)


class _Branches:
    """Columns of the diagram: which of the vibrations at each speed continues which."""

    def __init__(self) -> None:
        self.seen: list[_Vibrations] = []
        self.number: list[list[int]] = []  # of each branch, by speed: which vibration it is, -1 where it is none
        self._clear: list[int] = []  # of each branch: the last speed at which its shape was clearly its own

    def add(self, now: _Vibrations) -> None:
        """Continue the branches at one more speed.

        A branch is compared with its shape at the speed before, and with the last one that was clearly its own: where
        two frequencies are equal, as forward and backward whirl are at rest, shapes are any mixture.
        """
        here = len(self.seen)
        self.seen.append(now)
        likeness = np.zeros((len(self.number), len(now.values)))
        for j, numbers_of in enumerate(self.number):
            for then in {here - 1, self._clear[j]}:
                if numbers_of[then] >= 0:
                    one = self.seen[then].likeness(now)[numbers_of[then]]
                    likeness[j] = np.maximum(likeness[j], one) if one.size else likeness[j]
        rows, columns = _assigned(likeness)
        for j, part in enumerate(self.number):
            found = columns[rows == j]
            part.append(int(found[0]) if len(found) else -1)
            if len(found) and likeness[j, found[0]] > _OWN:
                self._clear[j] = here
        for column in np.setdiff1d(np.arange(len(now.values)), columns):
            self.number.append([-1] * here + [int(column)])
            self._clear.append(here)

    def sort(self) -> None:
        """By ascending mean frequency: at one speed equal ones, as whirls at rest, would be sorted by round-off."""
        means = np.nanmean(self.eigenvalues().imag, axis=0) if self.number else np.zeros(0)
        self.number = [self.number[j] for j in np.argsort(means)]

    def eigenvalues(self) -> ComplexArray:
        """(speeds, branches)."""
        nothing = complex(np.nan, np.nan)
        rows = [
            [self.seen[k].values[part[k]] if part[k] >= 0 else nothing for part in self.number]
            for k in range(len(self.seen))
        ]
        return np.array(rows, dtype=np.complex128).reshape(len(self.seen), len(self.number))


def _assigned(likeness: FloatArray) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Pairs of branches and vibrations whose likenesses have the largest sum; those that are not alike at all none."""
    from scipy.optimize import linear_sum_assignment  # on need

    rows, columns = linear_sum_assignment(likeness, maximize=True)
    alike = likeness[rows, columns] > np.finfo(float).eps
    return rows[alike], columns[alike]


def _crossing(
    machines: _Machines, speeds: FloatArray, tracked: _Branches, k: int, branch: int, order: float
) -> CriticalSpeed | None:
    """Where between speeds k and k + 1 a branch's frequency is ``order`` times the speed; None where it is not."""
    from scipy.optimize import brentq  # on need

    ends = tuple(tracked.number[branch][k : k + 2])
    if min(ends) < 0:
        return None
    known = tuple(tracked.seen[k + i] for i in (0, 1))
    found: dict[float, complex] = {float(speeds[k + i]): complex(known[i].values[ends[i]]) for i in (0, 1)}

    def above(speed: float) -> float:
        """rad/s, the vibration's frequency above the order's."""
        if speed not in found:
            now = machines.vibrations(speed)
            likeness = np.maximum(*(known[i].likeness(now)[ends[i]] for i in (0, 1)))
            found[speed] = complex(now.values[int(np.argmax(likeness))])
        return found[speed].imag - order * speed

    low, high = above(float(speeds[k])), above(float(speeds[k + 1]))
    if low == 0.0 or low * high > 0.0:
        return None
    speed = float(brentq(above, speeds[k], speeds[k + 1], rtol=1e-10))
    above(speed)
    return CriticalSpeed(
        speed, order * speed / (2.0 * np.pi), order, branch, float(_damping_ratio(np.array(found[speed])))
    )


def _damping_ratio(eigenvalues: ComplexArray) -> FloatArray:
    ratio: FloatArray = -eigenvalues.real / np.abs(eigenvalues)
    return ratio
