"""Strains of slender bodies as unknowns of their own, for Newton's method on large deflections.

A slender body that bends is stretched by the square of a Newton step, and with its membrane stiffness, larger than that
of bending by the square of its slenderness, this is a force in which the body seems to buckle: Newton's method creeps.
With the stresses as unknowns of their own, and eliminated from the linear equations again, the tangent has those of the
strains e + (de/dx) step, predicted by the step before, in the place of the stresses at hand; nothing else changes, and
steps are as long as bending allows (Magisano, Leonetti & Garcea 2017, How to improve efficiency and robustness of the
Newton method in geometrically non-linear structural problem discretized via displacement-based finite elements,
Computer Methods in Applied Mechanics and Engineering 313).

The strains are those of reduced bodies' membranes (`ModalStretch` of the record) and of elements of exact beams.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.kernels.base.arrays import Plan, Work
from flexmbd.multibody.kernels.inverse_dynamics.residual import residual
from flexmbd.multibody.kernels.reading.beam_strains import beam_elements_alone, beam_strains, slack_elsewhere
from flexmbd.multibody.kernels.reading.tree import MembraneStretch, membrane_stretches
from flexmbd.multibody.kernels.tangent.residual_tangent import tangent
from flexmbd.multibody.kernels.tangent.tangent_layout import TangentWork, new_tangent_work

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class StrainPredictor:
    """The strains of a machine, m in number: of membranes in the order of the tree, then six of each beam element.

    Attributes:
        bodies: those that have membranes.
        beams: the plan with elements of exact beams as its only forces.
        work: scratch.
        tangents: scratch of the beams' stiffness.
        nv: number of the machine's velocities.
    """

    bodies: tuple[MembraneStretch, ...]
    beams: Plan
    work: Work
    tangents: TangentWork
    nv: int

    def at(self, x: FloatArray) -> FloatArray:
        """(m,) at a configuration x (nx,): of membranes e + s, J^(1/2), their forces as well; of beams m and rad."""
        parts = [one.slope @ x[one.x] + 0.5 * (one.second @ x[one.x]) @ x[one.x] for one in self.bodies]
        return np.concatenate([np.zeros(0), *parts, self._of_beams(x, np.zeros(self.nv))[0]])

    def change(self, x: FloatArray, step: FloatArray) -> FloatArray:
        """(m,) of the strains at x by a small step (nv,)."""
        parts = [(one.slope + one.second @ x[one.x]) @ step[one.v] for one in self.bodies]
        return np.concatenate([np.zeros(0), *parts, self._of_beams(x, step)[1]])

    def force(self, x: FloatArray, excess: FloatArray) -> FloatArray:
        """(nv,) on the machine's coordinates, as ``kernels.residual`` counts, by strains (m,) beside those at x."""
        total, first = np.zeros(self.nv), 0
        for one in self.bodies:
            part = excess[first : first + len(one.slope)]
            total[one.v] += part @ (one.slope + one.second @ x[one.x])
            first += len(one.slope)
        if not len(self.beams.elements):
            return total
        rest, none, out = np.zeros(self.nv), np.zeros(len(self.beams.rows)), np.zeros((2, self.nv))
        for plan, part in zip((self.beams, self._with(excess[first:])), out, strict=True):
            residual(plan, self.work, x, rest, rest, none, part)
        return total + out[1] - out[0]

    def stiffness(self, x: FloatArray, excess: FloatArray) -> FloatArray:
        """(nv, nv) that stresses of strains (m,) beside those at x make."""
        total, first = np.zeros((self.nv, self.nv)), 0
        for one in self.bodies:
            total[one.v, one.v] += np.tensordot(excess[first : first + len(one.slope)], one.second, 1)
            first += len(one.slope)
        if not len(self.beams.elements):
            return total
        rest, none, found = np.zeros(self.nv), np.zeros(len(self.beams.rows)), np.zeros((2, self.nv, self.nv))
        for plan, part in zip((self.beams, self._with(excess[first:])), found, strict=True):
            tangent(plan, self.work, self.tangents, x, rest, rest, none, 1.0, 0.0, 0.0, part)
        return total + found[1] - found[0]

    def _of_beams(self, x: FloatArray, v: FloatArray) -> FloatArray:
        """(2, 6 k) strains of k elements, and their rates by velocities v (nv,)."""
        found = np.zeros((2, len(self.beams.elements), 6))
        if found.size:
            beam_strains(self.beams, self.work, x, v, np.zeros(self.nv), found)
        return found.reshape(2, -1)

    def _with(self, excess: FloatArray) -> Plan:
        return slack_elsewhere(self.beams, -excess.reshape(-1, 6))


def stretches(plan: Plan) -> bool:
    """Whether a machine has such strains."""
    return any(True for _ in membrane_stretches(plan)) or len(beam_elements_alone(plan).elements) > 0


def strain_predictor(plan: Plan, work: Work, nv: int) -> StrainPredictor:
    """Of a machine's plan with nv velocities."""
    beams = beam_elements_alone(plan)
    tangents = new_tangent_work(beams, nv, sizes=np.ones((2, nv)))
    return StrainPredictor(tuple(membrane_stretches(plan)), beams, work, tangents, nv)
