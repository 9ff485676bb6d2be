"""Membrane strains of a machine's reduced bodies, for Newton's method on large deflections.

A slender body that bends is stretched by the square of a Newton step, and with its membrane stiffness, larger than that
of bending by the square of its slenderness, this is a force in which the body seems to buckle: Newton's method creeps.
With the membrane forces N as unknowns of their own, e + s = N (`ModalStretch` of the record), and eliminated from
the linear equations again, the tangent has N = (e + s) + (c + C q) dq from the step before in the place of the strains
at hand; nothing else changes, and steps are as long as bending allows (Magisano, Leonetti & Garcea 2017, How to improve
efficiency and robustness of the Newton method in geometrically non-linear structural problem discretized via
displacement-based finite elements, Computer Methods in Applied Mechanics and Engineering 313).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.kernels.base.arrays import Plan
from flexmbd.multibody.kernels.reading.tree import MembraneStretch, membrane_stretches

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class MembraneStrains:
    """The membrane strains of all bodies of a machine, m in number, in the order of the tree.

    Attributes:
        bodies: those that have any.
        nv: number of the machine's velocities.
    """

    bodies: tuple[MembraneStretch, ...]
    nv: int

    def at(self, x: FloatArray) -> FloatArray:
        """(m,) J^(1/2), e + s at a configuration x (nx,), which are the membrane forces as well."""
        parts = [one.slope @ x[one.x] + 0.5 * (one.second @ x[one.x]) @ x[one.x] for one in self.bodies]
        return np.concatenate([np.zeros(0), *parts])

    def change(self, x: FloatArray, step: FloatArray) -> FloatArray:
        """(m,) of the strains at x by a small step (nv,)."""
        parts = [(one.slope + one.second @ x[one.x]) @ step[one.v] for one in self.bodies]
        return np.concatenate([np.zeros(0), *parts])

    def force(self, x: FloatArray, forces: FloatArray) -> FloatArray:
        """(nv,) on the machine's coordinates, as ``kernels.residual`` counts them, by membrane forces (m,)."""
        total, first = np.zeros(self.nv), 0
        for one in self.bodies:
            part = forces[first : first + len(one.slope)]
            total[one.v] += part @ (one.slope + one.second @ x[one.x])
            first += len(one.slope)
        return total

    def stiffness(self, forces: FloatArray) -> FloatArray:
        """(nv, nv) that membrane forces (m,) make."""
        total, first = np.zeros((self.nv, self.nv)), 0
        for one in self.bodies:
            total[one.v, one.v] += np.tensordot(forces[first : first + len(one.slope)], one.second, 1)
            first += len(one.slope)
        return total


def membrane_strains(plan: Plan, nv: int) -> MembraneStrains:
    """Those of a machine's plan with nv velocities."""
    return MembraneStrains(tuple(membrane_stretches(plan)), nv)
