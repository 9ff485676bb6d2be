"""Springs between the surface of a body with history and its body axes: forces, tangent and energy.

They are those of the formulations' `surface_energy` at the whole displacement from the undeformed body, over the facets
as they lay there, whatever configuration the formulations of the cells refer to.
"""

from __future__ import annotations

from collections.abc import Sequence

from petsc4py import PETSc

import numpy as np
import ufl
from dolfinx import fem, la
from numpy.typing import NDArray

from flexmbd.continuum.finite_elements import assembly
from flexmbd.continuum.finite_elements.cell_group import CellGroup
from flexmbd.continuum.finite_elements.surface_group import SurfaceGroup, surface_work

FloatArray = NDArray[np.float64]


class SurfaceSprings:
    """The springs of all facet groups that have some. Constructing one is collective, and may compile.

    Attributes:
        are_linear: whether their forces are linear in the displacement.
    """

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
        along = ufl.TrialFunction(space)
        slopes = [ufl.algorithms.expand_derivatives(ufl.derivative(work, self._u, along)) for work in self._work]
        self.are_linear = all(self._u not in slope.coefficients() for slope in slopes)
        self._sum = fem.Function(space).x

    def add(self, forces: FloatArray, displacement: FloatArray) -> None:
        """Add this rank's part of the forces, N, that hold the springs; both (local dofs including ghosts,)."""
        self._u.x.array[:] = displacement
        for form in self._forces:
            fem.assemble_vector(forces, form)

    def push(self, displacements: NDArray[np.integer]) -> bool:
        """Whether they pull at the displacements, as a ground of a potential does not. Collective.

        Args:
            displacements: (owned nodes * 3,) their dofs.
        """
        some = np.random.default_rng(0).uniform(-1.0, 1.0, len(self._u.x.array))
        self._sum.array[:] = 0.0
        self.add(self._sum.array, some)
        self._sum.scatter_reverse(la.InsertMode.add)
        return any(self._space.mesh.comm.allgather(bool(self._sum.array[displacements].any())))

    def of_nodes(self, displacement: FloatArray) -> FloatArray:
        """(owned nodes, 3) N, that hold the springs of a body of displacements alone at that of its nodes. Collective.

        Args:
            displacement: (owned nodes, 3) m.
        """
        self._set_owned(displacement)
        self._sum.array[:] = 0.0
        self.add(self._sum.array, self._u.x.array.copy())
        self._sum.scatter_reverse(la.InsertMode.add)
        return np.asarray(self._sum.array[: displacement.size].reshape(-1, 3).copy())

    def energy_of_nodes(self, displacement: FloatArray) -> float:
        """Energy, J, of all ranks at that displacement; as `of_nodes`. Collective."""
        self._set_owned(displacement)
        return float(self._space.mesh.comm.allreduce(self.energy(self._u.x.array.copy())))

    def _set_owned(self, displacement: FloatArray) -> None:
        self._u.x.array[: displacement.size] = displacement.ravel()
        self._u.x.scatter_forward()

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
