"""A linearised machine: its matrices, eigenvalues and shapes, its state space and frequency response."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from flexmbd.errors import PictureError, SceneError
from flexmbd.given import checked, is_truth
from flexmbd.multibody.bodies.body import Body
from flexmbd.multibody.kernels.base.arrays import new_work
from flexmbd.multibody.kernels.physics.joints import retract
from flexmbd.multibody.linear.linearize import LinearEquations
from flexmbd.multibody.linear.working_point import WorkingPoint
from flexmbd.multibody.plan.compiled_scene import CompiledScene
from flexmbd.multibody.team import Team
from flexmbd.round_off import of_solver
from flexmbd.run.stats import NOTHING_SPENT
from flexmbd.run.trajectory import Trajectory

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]
_MOST_INSTANTS = 10**6  # of a film of hours


_LEAST_OF_MANY, _FEW_OF_MANY = 200, 4  # rows from which, and so many to each eigenvalue, not all are computed


class StateSpace(NamedTuple):
    """ds/dt = A s + B u, outputs = C s + D u; unpacks into scipy.signal.StateSpace(*...) and control.ss(*...)."""

    A: FloatArray
    B: FloatArray
    C: FloatArray
    D: FloatArray


@dataclass(frozen=True, eq=False)
class LinearizedMachine:
    """M dz/dt + C z + K y = V v + W w and dy/dt = Ty y + Tz z + Tv v + Tw w, about a working point.

    y (ny,) are changes of independent coordinates, z (nz,) of independent velocities: small turns in the axes of
    the body that they turn, else of the coordinate itself.  Where nothing rolls without slip z is dy/dt, and the first
    equation is M y'' + C y' + K y = V v + W w (Anthonis & Ramon 2003, eq. 8).  Controls v and disturbances w
    are forces (N, N m, or factors), and of each prescribed motion displacement, velocity and acceleration.

    Attributes:
        equations: of multibody.linearize.
        point: the working point.
        controls, disturbances: names of the columns of V and W.
        motions: first columns, in (v, w), of displacements that are followed by their rates and accelerations.
        bodies: name to body.
        team: who writes files.
    """

    equations: LinearEquations
    point: WorkingPoint
    controls: tuple[str, ...]
    disturbances: tuple[str, ...]
    motions: tuple[int, ...]
    bodies: Mapping[str, Body]
    team: Team

    def __repr__(self) -> str:
        """How many coordinates, velocities and inputs."""
        eq = self.equations
        return (
            f"<LinearizedMachine: {eq.K.shape[1]} coordinates, {eq.M.shape[1]} velocities, "
            f"{len(self.controls)} controls, {len(self.disturbances)} disturbances>"
        )

    @property
    def M(self) -> FloatArray:
        """(nz, nz) kg, kg m, kg m^2 by the coordinates; of modal coordinates 1."""
        return self.equations.M

    @property
    def C(self) -> FloatArray:
        """(nz, nz) damping and gyroscopic matrix."""
        return self.equations.C

    @property
    def K(self) -> FloatArray:
        """(nz, ny) stiffness matrix, with those of weight, of reactions and of centrifugal forces."""
        return self.equations.K

    @property
    def V(self) -> FloatArray:
        """(nz, controls)."""
        return self.equations.F[:, : len(self.controls)]

    @property
    def W(self) -> FloatArray:
        """(nz, disturbances)."""
        return self.equations.F[:, len(self.controls) :]

    @property
    def scene(self) -> CompiledScene:
        """The compiled scene."""
        return self.point.scene

    @property
    def coordinates(self) -> tuple[str, ...]:
        """(ny,) names of y."""
        return tuple(self.equations.coordinates.names[k] for k in self.equations.by.y)

    @property
    def velocities(self) -> tuple[str, ...]:
        """(nz,) names of z: those of the coordinates whose rates they are."""
        return tuple(self.equations.coordinates.names[k] for k in self.equations.by.z)

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of the outputs."""
        return tuple(name for one in self.equations.outputs for name in one.names)

    @cached_property
    def _system(self) -> tuple[FloatArray, FloatArray]:
        """Of s = (y, z): ds/dt = A s + B (v, w)."""
        e = self.equations
        right = np.hstack([-e.K, -e.C, e.F])
        rates = np.asarray(np.linalg.solve(e.M, right), dtype=np.float64)
        first = np.hstack([e.by.Ty, e.by.Tz, e.by.Tu])
        whole = np.vstack([first, rates])
        n = len(e.by.y) + len(e.by.z)
        return whole[:, :n], whole[:, n:]

    @cached_property
    def _observed(self) -> tuple[FloatArray, FloatArray]:
        """Outputs = C s + D (v, w)."""
        by, (A, B) = self.equations.by, self._system
        rate = self._rates()
        states: list[FloatArray] = [np.zeros((0, len(A)))]
        inputs: list[FloatArray] = [np.zeros((0, B.shape[1]))]
        for one in self.equations.outputs:
            if one.order == 0:
                C, D = np.hstack([one.L @ by.Xy, np.zeros((len(one.L), len(by.z)))]), one.L @ by.Xu
            else:
                C, D = np.hstack([one.L @ by.Vy + one.G @ by.Xy, one.L @ by.Vz]), one.L @ by.Vu + one.G @ by.Xu
            if one.order == 2:
                C, D = C @ A, C @ B + D @ rate
            states.append(C)
            inputs.append(D)
        return np.vstack(states), np.vstack(inputs)

    def _rates(self) -> FloatArray:
        """(nu, nu) rates of the inputs by the inputs, where one is another's."""
        nu = len(self.controls) + len(self.disturbances)
        rate = np.zeros((nu, nu))
        for k in self.motions:
            rate[[k, k + 1], [k + 1, k + 2]] = 1.0
        return rate

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the state space's inputs: controls, then disturbances, of each motion the acceleration alone."""
        names = self.controls + self.disturbances
        return tuple(name for k, name in enumerate(names) if k not in self._followed)

    @property
    def drivers(self) -> tuple[str, ...]:
        """Names of the inputs of ``frequency_response``: as ``inputs``, but of each motion the displacement alone."""
        names = self.controls + self.disturbances
        return tuple(names[k] for k in self._driving)

    @property
    def _driving(self) -> list[int]:
        """Columns of (v, w) without rates and accelerations of motions."""
        beside = {k + order for k in self.motions for order in (1, 2)}
        return [k for k in range(len(self.controls) + len(self.disturbances)) if k not in beside]

    @property
    def states(self) -> tuple[str, ...]:
        """Names of the state space's states: coordinates, velocities and states, then each motion and its rate."""
        names = self.controls + self.disturbances
        moved = [names[k + order] for k in self.motions for order in (0, 1)]
        of_equations = self.equations.coordinates.states
        named = zip(self.equations.by.z, self.velocities, strict=True)
        rates = (name if k in of_equations else f"rate of {name}" for k, name in named)
        return (*self.coordinates, *rates, *moved)

    @property
    def _followed(self) -> list[int]:
        """Columns of (v, w) that are states of the state space: motions and their rates."""
        return [k + order for k in self.motions for order in (0, 1)]

    def state_space(self) -> StateSpace:
        """First-order form: states as ``states`` names them, inputs as ``inputs``, outputs as ``outputs``.

        Prescribed motions enter by their accelerations (m/s^2 or rad/s^2), two states integrating each.
        """
        (A, B), (C, D) = self._system, self._observed
        units = self._units
        A, B, C = units[:, None] * A / units, units[:, None] * B, C / units
        nu, followed = B.shape[1], np.array(self._followed, np.int64)
        given = np.setdiff1d(np.arange(nu), followed)
        rate = self._rates()
        lower = np.hstack([np.zeros((len(followed), len(A))), rate[np.ix_(followed, followed)]])
        return StateSpace(
            np.vstack([np.hstack([A, B[:, followed]]), lower]),
            np.vstack([B[:, given], rate[np.ix_(followed, given)]]),
            np.hstack([C, D[:, followed]]),
            D[:, given],
        )

    @property
    def _units(self) -> FloatArray:
        """(ny + nz,) of states of users' equations the scales that they are divided by inside, of others 1."""
        scales = np.ones(len(self.equations.coordinates.names))
        for places in self.scene.index.states.values():
            scales[places.v] = places.scale
        return np.concatenate([np.ones(len(self.equations.by.y)), scales[self.equations.by.z]])

    @checked()
    def frequency_response(self, omega: ArrayLike) -> ComplexArray:
        """(k, outputs, drivers) amplitudes at angular frequencies ``omega`` (k,) rad/s.

        Of a prescribed motion per unit of displacement, not of acceleration.

        Raises:
            SceneError: the machine vibrates freely at one of them, undamped.
        """
        frequency = np.atleast_1d(np.asarray(omega, dtype=np.float64))
        if frequency.ndim != 1:
            raise SceneError(f"omega must be angular frequencies (k,), got an array of shape {frequency.shape}")
        (A, B), (C, D) = self._system, self._observed
        given = self._driving
        found = np.zeros((len(frequency), len(C), len(given)), complex)
        for k, s in enumerate(1j * frequency):
            share = np.eye(B.shape[1], dtype=complex)
            for m in self.motions:
                share[m + 1, m], share[m + 2, m] = s, s * s
            share = share[:, given]
            try:
                states = np.linalg.solve(s * np.eye(len(A)) - A, B @ share)
            except np.linalg.LinAlgError as reason:
                raise SceneError(
                    f"at {frequency[k]:g} rad/s the machine moves without any input, so that no amplitude answers it; "
                    "ask beside that frequency, or damp the machine"
                ) from reason
            found[k] = C @ states + D @ share
        return found

    @cached_property
    def _modes(self) -> tuple[ComplexArray, ComplexArray]:
        values, vectors = scipy.linalg.eig(self._system[0])
        order = np.lexsort((-values.imag, np.abs(values)))
        return values[order], vectors[:, order]

    @checked()
    def eigenvalues(self, *, modes: int | None = None) -> ComplexArray:
        """(ny + nz,) 1/s, in ascending size, of pairs the one with positive imaginary part first.

        With ``modes`` as many of the smallest alone, or one more that is the other of a pair: of a machine of hundreds
        of coordinates, none of which is free to move, they take a small part of the time of all.

        Raises:
            SceneError: ``modes`` is no number of modes.
        """
        if modes is None:
            return self._modes[0].copy()
        if is_truth(modes) or not isinstance(modes, int | np.integer) or modes < 1:
            raise SceneError(f"modes must be a whole number of eigenvalues from 1, not {modes!r}")
        A = self._system[0]
        wanted = int(modes) + 1  # the other of the last pair
        values = None
        if "_modes" not in vars(self) and len(A) >= max(_FEW_OF_MANY * wanted, _LEAST_OF_MANY):
            values = _smallest_eigenvalues(A, wanted)
        if values is None:
            values = self._modes[0]
        parts_pair = modes < len(values) and values[modes - 1].imag > 0.0
        return values[: modes + int(parts_pair)].copy()

    def frequencies(self) -> FloatArray:
        """Hz, |eigenvalue| / (2 pi) of the vibrations, in ascending order; of what does not swing there is none."""
        values = self.eigenvalues()
        return np.abs(values[self._swings]) / (2.0 * np.pi)

    def damping_ratios(self) -> FloatArray:
        """Of the vibrations, as ``frequencies``: minus the real part of the eigenvalue over its size."""
        values = self.eigenvalues()[self._swings]
        return -values.real / np.abs(values)

    @property
    def _swings(self) -> NDArray[np.int64]:
        values = self._modes[0]
        return np.flatnonzero(values.imag > 1e-9 * np.abs(values))

    def shapes(self) -> tuple[ComplexArray, ComplexArray]:
        """Changes of configuration and velocity (ny + nz, nv) of each eigenvalue, as tangent vectors of the machine.

        Further columns are of the coordinates of bodies with history.  The largest entry, over 1 rad or the machine's
        extent, is 1.
        """
        by, (_, vectors) = self.equations.by, self._modes
        y, z = vectors[: len(by.y)].T, vectors[len(by.y) :].T
        places, rates = y @ by.Xy.T, y @ by.Vy.T + z @ by.Vz.T
        if not places.size:  # nothing moves
            return places, rates
        sizes = np.abs(places) / self.equations.coordinates.size
        largest = places[np.arange(len(places)), np.argmax(sizes, axis=1)]
        phase = np.exp(1j * np.angle(largest))
        scale = (phase * np.maximum(sizes.max(axis=1, initial=0.0), 1e-300))[:, None]
        return places / scale, rates / scale

    @checked("amplitude", "periods", "instants")
    def mode_motion(self, k: int, *, amplitude: float = 0.1, periods: float = 1.0, instants: int = 120) -> Trajectory:
        """Eigenvalue k's motion added to the steady one, to be filmed, plotted or asked as any trajectory.

        A vibration is drawn at constant size; what does not swing from ``amplitude`` down, or up to it.

        Args:
            k: which of ``eigenvalues``.
            amplitude: the largest coordinate (rad, or of the machine's extent).
            periods: how many, or time constants.
            instants: how many are computed, evenly in time.

        Raises:
            SceneError: there is no such eigenvalue, or it is zero.
        """
        if not 2 <= instants <= _MOST_INSTANTS:
            raise SceneError(f"instants must lie between 2 and {_MOST_INSTANTS}, got {instants}")
        values = self._modes[0]
        if is_truth(k) or not isinstance(k, int | np.integer) or not 0 <= k < len(values):
            raise SceneError(f"there are eigenvalues 0 to {len(values) - 1}; k must be one of them, not {k}")
        if abs(values[k]) <= np.finfo(float).eps * np.abs(values).max():  # the solver tells it from none
            raise SceneError(f"eigenvalue {k} is zero: nothing vibrates or decays; choose another")
        swings = abs(values[k].imag) > 1e-9 * abs(values[k])
        span = periods * (2.0 * np.pi / abs(values[k].imag) if swings else 1.0 / abs(values[k].real))
        rate = 1j * values[k].imag if swings else values[k]
        t = np.linspace(0.0, span, instants)
        growth = amplitude * np.exp(rate * t - max(0.0, rate.real) * span)
        shape, speed = (part[k, : self.scene.nv] for part in self.shapes())
        moved = np.outer(growth, speed)
        x, v, a = np.empty((instants, self.scene.nx)), *np.empty((2, instants, self.scene.nv))
        point, motion, work = self.point, self.equations.motion, new_work(self.scene.plan)
        turning = motion.slopes(work, point.x).turning
        for i, (time, factor) in enumerate(zip(t, growth, strict=True)):
            T = motion.transport(work, point.x, time)
            carried = motion.later(work, point.x, point.v, time)
            retract(self.scene.plan, carried, T @ (factor * shape).real, x[i])
            v[i] = T @ (point.v + moved[i].real)
            a[i] = T @ (turning @ (point.v + moved[i].real) + (rate * moved[i]).real)
        return Trajectory(
            scene=self.scene,
            t=t,
            x=x,
            v=v,
            a=a,
            row_multipliers=np.tile(self.point.multipliers, (instants, 1)),
            stats=NOTHING_SPENT,
            bodies=self.bodies,
            team=self.team,
        )

    @checked("omega", "title", error=PictureError)
    def plot(self, omega: ArrayLike, *, path: str | Path | None = None, title: str = "") -> Figure:
        """Draw the frequency response, see ``flexmbd.visual.plot_response``."""
        import flexmbd.visual as visual  # matplotlib loads only here

        return visual.plot_response(self, omega, path=path, title=title)


def _smallest_eigenvalues(A: FloatArray, count: int) -> ComplexArray | None:
    """(count,) of A (n, n) by inverse iteration, sorted as all are; None where some may be zero.

    Arnoldi's method (Lehoucq, Sorensen & Yang 1998).
    """
    from scipy.sparse.linalg import LinearOperator, eigs

    n, lapack = len(A), scipy.linalg.lapack
    *factors, zero = lapack.dgetrf(A)
    if zero or lapack.dgecon(factors[0], np.abs(A).sum(axis=0).max())[0] <= of_solver(n):
        return None
    inverse = LinearOperator((n, n), lambda b: lapack.dgetrs(*factors, b)[0])
    first = np.random.default_rng(0).standard_normal(n)
    values = 1.0 / eigs(inverse, k=count, v0=first, return_eigenvectors=False)
    return np.asarray(values[np.lexsort((-values.imag, np.abs(values)))])
