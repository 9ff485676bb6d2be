"""Stress on the mesh of a reduced body, from its modal coordinates."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property

from mpi4py import MPI

import numpy as np
import ufl
from dolfinx import fem
from numpy.typing import ArrayLike, NDArray

from flexmbd.continuum import compat
from flexmbd.continuum.finite_elements.cell_group import CellGroup
from flexmbd.continuum.finite_elements.gathered_nodes import GatheredNodes, von_mises
from flexmbd.continuum.finite_elements.held_expansion import held_expansion, thermal_stress
from flexmbd.continuum.finite_elements.nodes import node_numbers
from flexmbd.continuum.finite_elements.recovery import ReductionModel, nodal_modes, node_rows
from flexmbd.continuum.finite_elements.temperature import refuse_without_expansion, scalar_function, set_at_nodes
from flexmbd.errors import FormulationError, RecordError
from flexmbd.record.reduced_body import Heat, ReducedBody
from flexmbd.record.stress_field import StressField

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


class StressRecovery:
    """Stress of the bodies reduced from one model. Constructing one is collective.

    The formulation's stress of u = sum phi_i q_i is evaluated in every cell at the displacement's
    nodes; of linear bodies, whose rotations are small, the part of it that is linear in u. On straight
    tetrahedra a displacement of degree 1 or 2 has a constant or linear stress in each cell, whose
    von Mises value is largest in a vertex: so the largest value is found exactly.
    """

    def __init__(self, model: ReductionModel, *, rest: FloatArray | None = None) -> None:
        """Compile the stress.

        Args:
            model: the body.
            rest: (local dofs including ghosts,) a displacement that is there at q = 0; its stress is added,
                but the picture's displacement and places start from it.
        """
        self._model = model
        self._rest = np.zeros(model.layout.n_local) if rest is None else rest
        self._u = fem.Function(model.unknown_space)
        points = compat.interpolation_points(model.layout.node_space)
        self._groups = model.warm_groups
        self._sigma = [(group.cells, fem.Expression(_tensor(group, self._u), points)) for group in self._groups]
        self._heat: _HeldExpansion | None = None  # compiled once it is asked for
        self._nodes = GatheredNodes(model, model.node_x)
        self._last: tuple[ReducedBody, FloatArray] | None = None

    def field(self, body: ReducedBody, q: ArrayLike, *, heat: Mapping[str, float] | None = None) -> StressField:
        """Displacement and stress at modal coordinates. Collective.

        Args:
            body: reduced from this mesh and formulation, with `Keep(modes=True)`.
            q: (n,) modal coordinates, the same on every rank.
            heat: factors of the record's temperatures by their names.

        Returns:
            The field, in body axes, the same on every rank.

        Raises:
            RecordError: on all ranks: q does not fit, or the modes are not there (see
                `flexmbd.continuum.finite_elements.recovery.nodal_modes`); a body of large displacements, and a
                formulation whose stress is linear in the displacement; temperatures that the record has not.
        """
        modal: FloatArray = np.asarray(q, dtype=np.float64)
        if modal.shape != (body.n_modes,):
            raise RecordError(f"q must have shape ({body.n_modes},), got {modal.shape}")
        if body.nonlinear is not None and self._is_linear:
            raise RecordError(
                f"the stress of {self._model.form_name} is that of small displacements, and this body has large ones: "
                "take a model of the same mesh whose form has the stress of large displacements, as st_venant_kirchhoff"
            )
        nodes, model = self._nodes, self._model
        displacement = self._modes_of(body) @ modal
        if body.nonlinear is None:
            sigma = self._linear_stresses(displacement)
        else:
            self._set(displacement + self._rest)
            sigma = self._stresses()
        sigma = sigma + self._held_expansion(body, heat)
        largest, at_largest = nodes.largest(von_mises(sigma))
        u = displacement[model.displacement_dofs[nodes.places]]
        averaged = nodes.average(np.hstack([u, sigma]))
        p, R = body.p_MB_M, body.R_MB
        stress = R.T @ averaged[:, 3:].reshape(-1, 3, 3) @ R
        return StressField(
            node=nodes.number,
            x=(nodes.x - p) @ R,
            triangle=nodes.triangle,
            displacement=averaged[:, :3] @ R,
            stress=stress,
            von_mises=von_mises(stress.reshape(-1, 9)),
            max=largest,
            max_x=(nodes.x[at_largest] - p) @ R,
        )

    @property
    def node(self) -> IntArray:
        """(k,) node numbers, ascending, the same on every rank."""
        return self._nodes.number

    @property
    def x(self) -> FloatArray:
        """(k, 3) m, their positions in the mesh's axes, the same on every rank."""
        return self._nodes.x

    def nodal(self, u: FloatArray) -> FloatArray:
        """Stress at the nodes, averaged over the cells, in the mesh's axes: the part linear in u. Collective.

        Args:
            u: (local dofs including ghosts,).

        Returns:
            (k, 3, 3) Pa, in the order of `node`, the same on every rank.
        """
        self._set(u)
        return self._nodes.average(self._stresses(self._slopes)).reshape(-1, 3, 3)

    def _linear_stresses(self, displacement: FloatArray) -> FloatArray:
        """Stress of a small displacement beside that of ``rest``, as `_stresses`."""
        if self._is_linear:
            self._set(displacement + self._rest)
            return self._stresses()
        self._set(self._rest)
        at_rest = self._stresses()
        self._set(displacement)
        return at_rest + self._stresses(self._slopes)

    @cached_property
    def _slopes(self) -> list[tuple[NDArray[np.int32], fem.Expression]]:
        """Derivatives of the stresses at ``rest`` along the displacement; compiles."""
        if self._is_linear:
            return self._sigma
        base = fem.Function(self._model.unknown_space)
        is_still = not self._model.comm.allreduce(bool(self._rest.any()), op=MPI.LOR)
        base.x.array[:] = self._model.unknown_columns(self._rest[:, None])[:, 0]
        points = compat.interpolation_points(self._model.layout.node_space)
        found = []
        for group in self._groups:
            slope = ufl.algorithms.expand_derivatives(ufl.derivative(_tensor(group, base), base, self._u))
            if is_still:  # much of it is nothing
                slope = ufl.algorithms.expand_derivatives(ufl.replace(slope, {base: ufl.zero(*base.ufl_shape)}))
            if self._u not in ufl.algorithms.extract_coefficients(slope):
                raise FormulationError(
                    f"{group.form_name}: its stress is not linear in the displacement, and a small one makes none"
                )
            found.append((group.cells, fem.Expression(slope, points)))
        return found

    @cached_property
    def _is_linear(self) -> bool:
        """Whether all stresses are linear in the displacement; not collective."""
        along = fem.Function(self._model.unknown_space)
        slopes = (ufl.derivative(_tensor(group, self._u), self._u, along) for group in self._groups)
        expanded = map(ufl.algorithms.expand_derivatives, slopes)
        return not any(self._u in ufl.algorithms.extract_coefficients(slope) for slope in expanded)

    def _set(self, u: FloatArray) -> None:
        self._u.x.array[:] = self._model.unknown_columns(u[:, None])[:, 0]

    def _modes_of(self, body: ReducedBody) -> FloatArray:
        """`nodal_modes`, kept for the body that was asked for last: a film asks for its instants one by one."""
        if self._last is None or self._last[0] is not body:
            self._last = body, nodal_modes(body, self._model)
        return self._last[1]

    def _held_expansion(self, body: ReducedBody, heat: Mapping[str, float] | None) -> FloatArray | float:
        """Stress at the nodes of each cell of what expands and is held, (len(places), 9) Pa. Collective."""
        known = () if body.heat is None else body.heat.names
        for name, factor in (heat or {}).items():
            if name not in known or not np.isfinite(factor):
                there = ", ".join(map(repr, known)) or "none"
                raise RecordError(
                    f"heat gives finite factors of the record's temperatures by their names, got {name!r}: {factor!r}; "
                    f"it has: {there}"
                )
        factors = np.array([(heat or {}).get(name, 0.0) for name in known])
        if body.heat is None or not factors.any():
            return 0.0
        if self._heat is None:
            self._heat = _HeldExpansion(self._model)
        return self._heat.stress(body.heat, factors, self._nodes)

    def _stresses(self, expressions: list[tuple[NDArray[np.int32], fem.Expression]] | None = None) -> FloatArray:
        """Stress of the present displacement at the nodes of each cell, (len(places), 9)."""
        sigma = np.empty((self._nodes.n_cells, self._nodes.per_cell, 9))
        for cells, expression in self._sigma if expressions is None else expressions:
            values = expression.eval(self._model.mesh.mesh, cells)
            sigma[cells] = values.reshape(-1, self._nodes.per_cell, 9)
        return sigma.reshape(-1, 9)


class _HeldExpansion:
    """The stress of rises of temperature without displacement. Constructing one is collective, and compiles."""

    def __init__(self, model: ReductionModel) -> None:
        self._model, self._rise = model, scalar_function(model.mesh, model.layout)
        self._fields = fem.Function(model.unknown_space)
        points = compat.interpolation_points(model.layout.node_space)
        refuse_without_expansion(model.groups)
        self._sigma = [
            (group.cells, fem.Expression(thermal_stress(group, self._fields, self._rise), points))
            for group in model.groups
        ]

    def stress(self, heat: Heat, factors: FloatArray, nodes: GatheredNodes) -> FloatArray:
        """(len(places), 9) Pa, of a record's temperatures times factors (h,). Collective."""
        values = node_rows(self._model, node_numbers(self._model), known=heat.node, values=(factors @ heat.rise))
        set_at_nodes(self._model, self._rise, values)
        fields = held_expansion(self._model).fields(self._rise)
        if fields is not None:
            self._fields.x.array[:] = fields
        sigma = np.empty((nodes.n_cells, nodes.per_cell, 9))
        for cells, expression in self._sigma:
            sigma[cells] = expression.eval(self._model.mesh.mesh, cells).reshape(-1, nodes.per_cell, 9)
        return sigma.reshape(-1, 9)


def _tensor(group: CellGroup, u: fem.Function) -> ufl.core.expr.Expr:
    sigma = group.formulation.stress(u, None, group.symbols)
    if sigma.ufl_shape != (3, 3):
        raise FormulationError(
            f"{group.form_name}: its stress has the shape {sigma.ufl_shape}, and a picture needs a tensor (3, 3)"
        )
    return sigma
