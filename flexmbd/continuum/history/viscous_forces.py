"""Viscous forces of a body with history: those of its formulations' dissipation, by the rates of a step.

The rates are the step's displacement over its length.  So the work that the forces take in a step is not negative
whatever its length, the implicit Euler method's; on a slow motion they lag by half a step.
"""

from __future__ import annotations

from collections.abc import Sequence

from petsc4py import PETSc

import numpy as np
import ufl
from dolfinx import fem
from numpy.typing import NDArray

from flexmbd.continuum.finite_elements import assembly
from flexmbd.continuum.finite_elements.cell_group import CellGroup

FloatArray = NDArray[np.float64]


class ViscousForces:
    """The forces dR/dv of the groups that have a dissipation R. Constructing one is collective, and may compile.

    Attributes:
        are_linear: whether they are linear in the rates.
    """

    def __init__(self, groups: Sequence[CellGroup], space: fem.FunctionSpace) -> None:
        """Compile the forces.

        Args:
            groups: of the body.
            space: of the unknown.
        """
        self._groups, self._space = groups, space
        self._rates = fem.Function(space)
        self._per_second = fem.Constant(space.mesh, 0.0)
        v, along = ufl.TestFunction(space), ufl.TrialFunction(space)
        works = [ufl.derivative(term, self._rates, v) for term in assembly.dissipation(groups, self._rates)]
        self._forms = [fem.form(work) for work in works]
        slopes = [ufl.algorithms.expand_derivatives(ufl.derivative(work, self._rates, along)) for work in works]
        self._slopes = slopes
        self.are_linear = all(self._rates not in slope.coefficients() for slope in slopes)
        self._local: FloatArray = np.zeros_like(self._rates.x.array)

    def tangent_forms(self) -> list[fem.Form]:
        """Their derivatives by the step's displacement, for the step last set. Collective; compiles."""
        return [fem.form(self._per_second * slope) for slope in self._slopes]

    def matrix(self) -> PETSc.Mat:
        """Their derivative by the rates at rest, N s/m, a new matrix. Collective; compiles."""
        zero = {self._rates: ufl.zero(self._rates.ufl_shape)}
        forms = [fem.form(ufl.replace(slope, zero)) for slope in self._slopes]
        return assembly.assemble({"damping matrix": forms}, self._groups, self._space)[0]

    def add(self, forces: FloatArray, increment: FloatArray, *, dt: float) -> None:
        """Add this rank's part of the forces of a step. Not collective.

        Args:
            forces: (local dofs including ghosts,) N, to which they are added.
            increment: (local dofs including ghosts,) m.
            dt: s; at 0 no time passes, and there are none.
        """
        self._per_second.value = 1.0 / dt if dt > 0.0 else 0.0
        self._rates.x.array[:] = self._per_second.value * increment
        self._local[:] = 0.0
        if dt > 0.0:
            for form in self._forms:
                fem.assemble_vector(self._local, form)
        forces += self._local

    def work(self, increment: FloatArray) -> float:
        """This rank's part of the work, J, that the forces last added take on the step."""
        return float(self._local @ increment)
