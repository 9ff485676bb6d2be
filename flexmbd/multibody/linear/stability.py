"""Stability of an equilibrium, by the tangent stiffness on the motions that the constraints leave free.

Where all forces have a potential the stiffness is symmetric, and as many of its eigenvalues are negative as there are
independent unstable motions; they are counted with each coordinate in the unit of its own stiffness, which changes no
sign (Sylvester's law of inertia).  Forces that follow what they act on have no potential: a machine under them may
flutter, that is two of the eigenvalues mu of K phi = mu M phi have become complex, with motions exp(s t), s^2 = -mu
(Bolotin 1963, Nonconservative Problems of the Theory of Elastic Stability).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from flexmbd.continuation.flutter import count_growing, flutters, grows, parted
from flexmbd.multibody.kernels.reading.tree import tree_joints
from flexmbd.multibody.linear.balance import ForceBalance
from flexmbd.multibody.plan.compiled_scene import CompiledScene
from flexmbd.multibody.plan.scene_matrices import coordinate_sizes
from flexmbd.round_off import ROUND_OFF

FloatArray = NDArray[np.float64]

HAS_POTENTIAL = 1e-6  #: of the coordinates' own stiffness: what derivatives of users' functions by differences may lack
SOFT = 1e-8  #: of the stiffest motion: so soft, nothing resists it but what round-off may be


@dataclass(frozen=True, eq=False)
class MotionSpectrum:
    """Eigenvalues of the stiffness at an equilibrium, ascending by their real parts.

    Attributes:
        values: (nz,) without unit where there is a potential: of the stiffness over the coordinates' own; else 1/s^2.
        shapes: (nv, nz) right eigenvectors as changes of the machine's coordinates; real parts.
        has_potential: whether the stiffness is symmetric.
        round_off: what is left of an eigenvalue that is zero.
    """

    values: NDArray[np.complex128]
    shapes: FloatArray
    has_potential: bool
    round_off: float

    @property
    def unstable(self) -> int:
        """How many independent motions grow: of a flutter two."""
        return count_growing(self.values, self.round_off)

    @property
    def diverging(self) -> int:
        """How many of them grow without swinging: eigenvalues that are real and negative."""
        return int(np.count_nonzero(self._diverge))

    @property
    def idle(self) -> NDArray[np.bool_]:
        """(nz,) whether nothing resists a motion, or drives it, up to round-off."""
        return np.asarray(np.abs(self.values) <= self.round_off)

    @property
    def gives_way(self) -> bool:
        """Whether nothing resists some motion, up to round-off."""
        return bool(self.idle.any())

    @property
    def sign(self) -> float:
        """Of the product of all eigenvalues."""
        real = self.values.real[self.values.imag == 0.0]
        return -1.0 if int((real < 0.0).sum()) % 2 else 1.0

    def smallest(self) -> float:
        """The size of the eigenvalue next to zero."""
        return float(np.abs(self.values).min())

    def eigenvalue(self, k: int) -> float:
        """The real part of eigenvalue k."""
        return float(self.values[k].real)

    def nearest(self) -> int:
        """Which eigenvalue is the smallest in size."""
        return int(np.argmin(np.abs(self.values)))

    def mode(self, k: int) -> FloatArray:
        """(nv,) of eigenvalue k."""
        return self.shapes[:, k]

    def diverging_mode(self) -> FloatArray:
        """(nv,) of the first of those that grow without swinging."""
        return self.shapes[:, int(np.argmax(self._diverge))]

    @property
    def _diverge(self) -> NDArray[np.bool_]:
        return np.asarray(grows(self.values, self.round_off) & ~flutters(self.values))

    def flutter_mode(self) -> FloatArray | None:
        """(nv,) of the two eigenvalues that became complex last; None where none are complex."""
        pairs = np.flatnonzero(flutters(self.values))
        if not len(pairs):
            return None
        return self.shapes[:, pairs[np.argmin(parted(self.values[pairs]))]]


def spectrum(
    scene: CompiledScene, at: ForceBalance, more: FloatArray | float = 0.0, *, at_play: FloatArray | float = 0.0
) -> MotionSpectrum:
    """Of the tangent stiffness of a balance, with ``more`` (nv, nv) beside it; ``at_play``: of ``own_stiffness``."""
    Vz, stiffness = at.by.Vz, at.stiffness(more)
    if not len(stiffness):
        return MotionSpectrum(np.zeros(0, complex), np.zeros((len(Vz), 0)), True, 0.0)
    z = at.by.z
    own = own_stiffness(stiffness, coordinate_sizes(scene)[z], np.broadcast_to(at_play, scene.nv)[z])
    scaled = stiffness / np.outer(own, own)
    if has_potential(scene, at, at_play=at_play):
        values, shapes = scipy.linalg.eigh(0.5 * (scaled + scaled.T))
        round_off = len(values) * ROUND_OFF
        return MotionSpectrum(values.astype(complex), Vz @ (shapes / own[:, None]), True, round_off)
    factor = scipy.linalg.cholesky(at.mass, lower=True)
    half = scipy.linalg.solve_triangular(factor, stiffness, lower=True)
    whole = scipy.linalg.solve_triangular(factor, half.T, lower=True).T
    values, shapes = scipy.linalg.eig(whole)
    order = np.argsort(values.real, kind="stable")
    values, shapes = values[order], shapes[:, order]
    shapes = scipy.linalg.solve_triangular(factor.T, shapes.real, lower=False)
    round_off = len(values) * ROUND_OFF * float(np.abs(values).max())
    return MotionSpectrum(values, Vz @ shapes, False, round_off)


def has_potential(scene: CompiledScene, at: ForceBalance, *, at_play: FloatArray | float = 0.0) -> bool:
    """Whether the forces at a state have a potential, as far as their derivatives there tell.

    Along rotations, in axes that turn with them, second derivatives of a potential commute up to the moment that is
    out of balance: K_12 - K_21 = - f_3.  ``at_play``: of ``own_stiffness``.
    """
    skew = at.of.stiffness - at.of.stiffness.T
    force = at.open_force()
    for joint in tree_joints(scene.plan):
        if joint.spin is not None:
            x, y, z = force[joint.spin]
            skew[joint.spin, joint.spin] += [[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]]
    skew, stiffness = at.by.Vz.T @ skew @ at.by.Vz, at.stiffness()
    z = at.by.z
    own = own_stiffness(stiffness, coordinate_sizes(scene)[z], np.broadcast_to(at_play, scene.nv)[z])
    return bool((np.abs(skew / np.outer(own, own)) <= HAS_POTENTIAL).all())


def own_stiffness(stiffness: FloatArray, size: FloatArray, at_play: FloatArray | float = 0.0) -> FloatArray:
    """(n,) the root of each coordinate's own stiffness, of all that its row has in the machine's sizes.

    It is no less than forces ``at_play`` (n,), J, make of it where they turn: what is left of these is round-off.
    """
    energy = np.maximum(np.abs(stiffness) @ size * size, at_play)
    return np.where(energy > 0.0, np.sqrt(energy) / size, 1.0)
