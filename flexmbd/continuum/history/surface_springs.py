"""Springs between the surface of a body with history and its body axes: forces, tangent and energy.

They are those of the formulations' `surface_energy` at the whole displacement from the undeformed body, over the facets
as they lay there, whatever configuration the formulations of the cells refer to.
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
from flexmbd.continuum.finite_elements.surface_group import SurfaceGroup, surface_work

FloatArray = NDArray[np.float64]


class SurfaceSprings:
    """The springs of all facet groups that have some. Constructing one is collective, and may compile."""

    def __init__(self, surfaces: Sequence[SurfaceGroup], groups: Sequence[CellGroup], space: fem.FunctionSpace) -> None:
        """Compile the forces.

        Args:
            surfaces: of the body.
            groups: of its cells, for the matrix' pattern.
            space: of the unknown.
        """
        self._groups, self._space = groups, space
        self._u = fem.Function(space)
        self._work = surface_work(surfaces, self._u, ufl.TestFunction(space))
        self._forces = [fem.form(work) for work in self._work]
        self._energies = [fem.form(energy) for group in surfaces for energy in group.energy(self._u)]
        self._slopes: list[fem.Form] | None = None

    def add(self, forces: FloatArray, displacement: FloatArray) -> None:
        """Add this rank's part of the forces, N, that hold the springs; both (local dofs including ghosts,)."""
        self._u.x.array[:] = displacement
        for form in self._forces:
            fem.assemble_vector(forces, form)

    def tangent(self, displacement: FloatArray) -> PETSc.Mat:
        """Derivative of the forces by the displacement, N/m, a new matrix. Collective; compiles at the first call."""
        if self._slopes is None:
            self._slopes = assembly.derivatives(self._work, self._u)
        self._u.x.array[:] = displacement
        return assembly.assemble({"stiffness of springs on facets": self._slopes}, self._groups, self._space)[0]

    def energy(self, displacement: FloatArray) -> float:
        """This rank's part of their energy, J."""
        self._u.x.array[:] = displacement
        return sum(float(fem.assemble_scalar(form)) for form in self._energies)
