"""One point of a path of equilibria: tangent, and Newton's iterations in a plane across a step (Riks 1979).

Unknowns are changes of the machine's coordinates that its constraints allow, and the load factor.  A direction of the
path is a change xi (nv,) and one of the factor; their product <a, b> = sum(xi_a xi_b / size^2) / typical^2 + f_a f_b /
width^2 has each coordinate in rad or in the machine's extent, by what is typical of them, and the factor in its range.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from flexmbd.continuation.newton import corrected
from flexmbd.continuation.space import ALIKE, APART, PathDirection, unit
from flexmbd.errors import ConvergenceError
from flexmbd.multibody.kernels.algebra.rotation_update import coordinate_slots
from flexmbd.multibody.kernels.base.arrays import Work, memories_end
from flexmbd.multibody.kernels.inverse_dynamics.memories import remember
from flexmbd.multibody.linear.balance import ForceBalance, balance, moved, step_size
from flexmbd.multibody.linear.forces_at_play import BALANCED
from flexmbd.multibody.linear.passing import passing_on_the_way
from flexmbd.multibody.linear.path.loading import Loading, LoadSlopes
from flexmbd.multibody.linear.stability import SOFT, MotionSpectrum, own_stiffness, spectrum
from flexmbd.multibody.linear.steady_motion import SteadyMotion
from flexmbd.multibody.linear.strain_predictor import StrainPredictor
from flexmbd.multibody.plan.compiled_scene import CompiledScene

FloatArray = NDArray[np.float64]

_ITERATIONS = 12
_SINGULAR = 1e-14  # pivots over the largest one, of equations with each coordinate in the unit of its own stiffness


@dataclass(frozen=True, eq=False)
class MachinePoint:
    """An equilibrium on a path.

    Attributes:
        x: (nx,) configuration.
        factor: of the load.
        at: balance and derivatives there.
        slopes: of the loads.
        iterations: of Newton's method that led there.
    """

    x: FloatArray
    factor: float
    at: ForceBalance
    slopes: LoadSlopes
    iterations: int


@dataclass(frozen=True, eq=False)
class StillMotions:
    """Motions that nothing resists, which stay where they are while Newton's method finds the others' balance.

    On its way the stiffness along them is that of forces out of balance, and no measure of where they are to go.

    Attributes:
        changes: (nz, k) of them, each coordinate in the unit of its own stiffness.
        forces: (nz, k) that no other motion balances.
    """

    changes: FloatArray
    forces: FloatArray

    def beside(self, matrix: FloatArray, right: FloatArray, scale: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Linear equations (m,), m >= nz, in which these do not move; what forces they leave is unknown in turn."""
        (n, k), m = self.changes.shape, len(right)
        wide = np.pad(matrix, ((0, k), (0, k)))
        wide[m:, :n] = self.changes.T
        forces = scale[:, None] * self.forces
        wide[:n, m:] = forces / np.linalg.norm(forces, axis=0)
        return wide, np.append(right, np.zeros(k))


@dataclass(frozen=True, eq=False)
class MachineSpace:
    """A machine under loads that follow one factor.

    Attributes:
        scene: compiled, without redundant rows.
        work: scratch.
        strains: membrane strains of its bodies.
        loading: its loads.
        width: range of factors.
        v: (nv,) velocities at which it is in balance; zeros of an equilibrium.
        size: (nv,) of ``motion_sizes``, rad or m.
        typical: of these sizes, what counts as much as the range of factors in the product (``typical_motion``).
        at_play: (nv,) J, of ``forces_at_play``; zeros where no motion is so soft that their round-off would move it.
        remembers: whether force elements with memory note each point; else the path is no way that they went.
        motion: the steady motion in which it is in balance; None at rest.
    """

    scene: CompiledScene
    work: Work
    strains: StrainPredictor
    loading: Loading
    width: float
    v: FloatArray
    size: FloatArray
    typical: float = 1.0
    at_play: FloatArray | float = 0.0
    remembers: bool = True
    motion: SteadyMotion | None = None

    def product(self, a: PathDirection, b: PathDirection) -> float:
        """<a, b>."""
        along = float((a.xi / self.size) @ (b.xi / self.size)) / self.typical**2
        return along + a.factor * b.factor / self.width**2

    def largest(self, a: PathDirection) -> float:
        """Largest part: rad, of the extent, or of the range of factors."""
        return max(step_size(self.size, a.xi), abs(a.factor) / self.width)

    def at(self, x: FloatArray, factor: float, iterations: int = 0) -> MachinePoint:
        """A configuration under a factor, in balance or not.

        Raises:
            SceneError: as ``balance``.
        """
        slopes = self.loading.slopes(self.work, x, self.v, factor=factor, width=self.width)
        further = self.loading.apply(self.work, factor)
        found = balance(
            self.scene, self.work, x, self.v, given=slopes.given, further=further, motion=self.motion
        )
        return MachinePoint(x, factor, found, slopes, iterations)

    def spectrum(self, here: MachinePoint) -> MotionSpectrum:
        """Of its stiffness."""
        return spectrum(self.scene, here.at, at_play=self.at_play)

    def along_factor(self, sign: float) -> PathDirection:
        """The factor's own direction."""
        return PathDirection(np.zeros(self.scene.nv), sign * self.width)

    def difference(self, before: MachinePoint, after: MachinePoint) -> PathDirection:
        """The change from one point to another; angles of joints count their turns."""
        plain, quaternions = coordinate_slots(self.scene.plan)
        xi = np.zeros(self.scene.nv)
        xi[plain[:, 1]] = after.x[plain[:, 0]] - before.x[plain[:, 0]]
        for in_x, in_v in quaternions:
            turned = scipy.spatial.transform.Rotation.from_quat
            first, second = (turned(np.roll(one.x[in_x : in_x + 4], -1)) for one in (before, after))
            xi[in_v : in_v + 3] = (first.inv() * second).as_rotvec()
        return PathDirection(xi, after.factor - before.factor)

    def remember_alike(self, one: MachinePoint, other: MachinePoint) -> bool:
        """Whether force elements remember the same."""
        plain, quaternions = coordinate_slots(self.scene.plan)
        first = len(plain) + 4 * len(quaternions)
        return bool(np.allclose(one.x[first:], other.x[first:], rtol=ALIKE, atol=0.0))

    def tangent(self, here: MachinePoint, onwards: PathDirection) -> PathDirection:
        """Unit tangent of the path at a point, on the side of a direction."""
        lacking = 0.0 * here.at.lacking
        return unit(self, self._solution(here, onwards, lacking, 1.0, 0.0, still=self.still(here)))

    def other_path(self, here: MachinePoint, mode: PathDirection, tangent: PathDirection) -> PathDirection:
        """Unit direction of the path that crosses another one at a bifurcation.

        It is m + s t of the mode m and the other path's tangent t.  With the derivatives of the stiffness K along both,
        and its left null vector l, 2 s l.K'(t)m + l.K'(m)m = 0 (Seydel 2010, Practical Bifurcation and Stability
        Analysis, section 5.6.2): s = 0 where bending to either side is alike.
        """
        z, stiffness = here.at.by.z, here.at.stiffness()
        scale = 1.0 / self._own(z, stiffness)
        left = scale * np.linalg.svd(scale[:, None] * stiffness * scale)[0][:, -1]

        def slope(along: PathDirection) -> float:
            length = APART / self.largest(along)
            beside = [self.at(*self.moved(here.x, here.factor, along.times(side))).at for side in (-length, length)]
            if not all(np.array_equal(one.by.z, z) for one in beside):  # of a loop whose dependent coordinates change
                return 0.0
            change = beside[1].stiffness() - beside[0].stiffness()
            return float(left @ change @ mode.xi[z]) / (2.0 * length)

        by_path = slope(tangent)
        share = -0.5 * slope(mode) / by_path if by_path != 0.0 else 0.0
        return unit(self, mode.plus(tangent.times(share)))

    def against(self, here: MachinePoint, unresolved: FloatArray) -> PathDirection:
        """The direction in which forces (nz,) push, each coordinate by as much as its own stiffness would let it."""
        z = here.at.by.z
        return PathDirection(here.at.by.Vz @ (-unresolved / self._own(z, here.at.stiffness()) ** 2), 0.0)

    def newton_step(self, here: MachinePoint, across: PathDirection) -> PathDirection:
        """Newton's step towards the equilibrium in the plane that is normal to ``across``."""
        return self._solution(here, across, here.at.lacking, 0.0, 0.0, still=self.still(here))

    def correct(
        self, start: MachinePoint, step: PathDirection, across: PathDirection, *, undetermined: int = 0
    ) -> MachinePoint:
        """The equilibrium in the plane through the end of a step that is normal to ``across``.

        Strains of slender bodies are unknowns of their own, as in ``find_equilibrium``.  So near to a bifurcation that
        round-off moves it along the modes, corrections leave out as many directions as are ``undetermined``.

        What comes to touch is stopped, and a plane across its motion may be met far away or nowhere: then it is the
        equilibrium under the factor at the step's end.

        Raises:
            ConvergenceError: Newton's method does not converge, or the step passes through a contact.
            SceneError: as ``balance``, or the loops do not close.
        """
        through = passing_on_the_way(self.scene, self.work, start.x, step.xi, self.size)
        if through.share < 1.0:
            raise ConvergenceError(f"the step passes through what touches: {through.told}")
        try:
            return self._corrected(start, step, across, undetermined)
        except ConvergenceError:
            if not (through.meets and across.xi.any() and step.factor != 0.0):
                raise
        return self._corrected(start, step, self.along_factor(np.sign(step.factor)), undetermined)

    def _corrected(
        self, start: MachinePoint, step: PathDirection, across: PathDirection, undetermined: int
    ) -> MachinePoint:
        x, factor, strained = start.x, start.factor, self.strains.at(start.x)
        still = self.still(start)

        def iterate(change: PathDirection, iteration: int, close: bool) -> MachinePoint | PathDirection:
            nonlocal x, factor, strained
            predicted = strained + self.strains.change(x, change.xi)
            x, factor = self.moved(x, factor, change)
            here, strained = self.at(x, factor, iteration), self.strains.at(x)
            if close:
                return here
            more = self.strains.stiffness(x, predicted - strained)
            return self._solution(here, across, here.at.lacking, 0.0, more, undetermined, still)

        return corrected(self, step, iterate, most=_ITERATIONS)

    def sized(self, mode: FloatArray) -> FloatArray:
        """(nv,) a mode whose largest part is 1 rad or the machine's extent."""
        parts = mode / self.size
        return np.asarray(mode / parts[np.argmax(np.abs(parts))])

    def remembered(self, here: MachinePoint, factor: float) -> MachinePoint:
        """The point, its factor rounded to the given one, with what elements with memory note of it."""
        here = replace(here, factor=factor)
        if not self.remembers or not memories_end(self.scene.plan):
            return here
        x = here.x.copy()
        self.loading.apply(self.work, here.factor)
        remember(self.scene.plan, self.work, x, here.at.v, here.factor)
        return replace(here, x=x)

    def moved(self, x: FloatArray, factor: float, change: PathDirection) -> tuple[FloatArray, float]:
        """After a change."""
        factor = factor + change.factor
        self.loading.apply(self.work, factor)
        after = moved(self.scene, self.work, x, change.xi, driven=True)
        return after, factor

    def _own(self, z: NDArray[np.int64], stiffness: FloatArray) -> FloatArray:
        """(nz,) unit of the independent coordinates' own stiffness."""
        return own_stiffness(stiffness, self.size[z], np.broadcast_to(self.at_play, self.scene.nv)[z])

    def softest(self, here: MachinePoint) -> float:
        """The smallest stiffness over the largest one, of motions in units of the coordinates' own; 1 of none."""
        stiffness = here.at.stiffness()
        if not len(stiffness):
            return 1.0
        scale = 1.0 / self._own(here.at.by.z, stiffness)
        values = np.linalg.svd(scale[:, None] * stiffness * scale, compute_uv=False)
        return float(values[-1] / values[0]) if values[0] > 0.0 else 0.0

    def still(self, here: MachinePoint) -> StillMotions | None:
        """The motions that nothing resists at a point and nothing drives, if there are any."""
        if not np.any(self.at_play):
            return None
        z, stiffness = here.at.by.z, here.at.stiffness()
        scale = 1.0 / self._own(z, stiffness)
        left, values, across = np.linalg.svd(scale[:, None] * stiffness * scale)
        forces = np.broadcast_to(self.at_play, self.scene.nv)[z] / self.size[z] * scale
        nothing = BALANCED * float(np.linalg.norm(forces))
        driven = np.abs(left.T @ (scale[:, None] * np.stack([here.at.lacking, here.at.by.Vz.T @ here.slopes.force], 1)))
        kept = (values <= SOFT * values[0]) & (driven <= nothing).all(axis=1)
        return StillMotions(across[kept].T, left[:, kept] / scale[:, None]) if kept.any() else None

    def _solution(
        self,
        here: MachinePoint,
        across: PathDirection,
        lacking: FloatArray,
        along: float,
        more: FloatArray | float,
        undetermined: int = 0,
        still: StillMotions | None = None,
    ) -> PathDirection:
        """The change that the linear equations give: nothing lacks any longer, and <across, change> = along.

        K dz + r df = - lacking,  xi = Vz dz + xi_f df, in which K is taken with each coordinate in the unit of its own
        stiffness.
        """
        by, at = here.at.by, here.at
        follows = by.Xu.sum(axis=1)  # of its one input, or none
        load = by.Vz.T @ (here.slopes.force + (at.of.stiffness + more) @ follows)
        stiffness, n = at.stiffness(more), len(by.z)
        scale = np.asarray(1.0 / self._own(by.z, stiffness), dtype=np.float64)
        matrix = np.zeros((n + 1, n + 1))
        matrix[:n, :n] = scale[:, None] * stiffness * scale
        if not across.xi.any() and along == 0.0:  # the factor stays, whatever forces nothing balances
            found = _least_squares(matrix[:n, :n], -scale * lacking, undetermined, still, scale)
            return PathDirection(by.Vz @ (found * scale), 0.0)
        matrix[:n, n] = scale * load * self.width
        weights = across.xi / (self.typical * self.size) ** 2
        matrix[n, :n] = (weights @ by.Vz) * scale
        matrix[n, n] = (weights @ follows) * self.width + across.factor / self.width
        # the factor's column, then the plane's row in units of their own
        column = float(np.abs(matrix[:n, n]).max(initial=0.0)) or 1.0
        matrix[:, n] /= column
        row = float(np.abs(matrix[n]).max()) or 1.0
        matrix[n] /= row
        found = _least_squares(matrix, np.append(-scale * lacking, along / row), undetermined, still, scale)
        found[n] /= column
        factor = float(found[n]) * self.width
        return PathDirection(by.Vz @ (found[:n] * scale) + follows * factor, factor)


def _least_squares(
    matrix: FloatArray, right: FloatArray, undetermined: int, still: StillMotions | None, scale: FloatArray
) -> FloatArray:
    """The shortest solution, without the directions of the smallest singular values, or what is to stay ``still``."""
    n = len(right)
    if still is not None:
        matrix, right = still.beside(matrix, right, scale)
    if not undetermined:
        solution = scipy.linalg.lstsq(matrix, right, cond=_SINGULAR, lapack_driver="gelsy", check_finite=False)[0]
        return np.asarray(solution, dtype=np.float64)[:n]
    left, values, across = np.linalg.svd(matrix)
    kept = len(values) - undetermined
    return np.asarray(across[:kept].T @ ((left[:, :kept].T @ right) / values[:kept]), dtype=np.float64)[:n]
