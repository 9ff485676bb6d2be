"""A body with history or large displacements, step by step: forces, tangent, accepted state.

Its axes and configurations are those of `trial_body`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import ufl
from dolfinx import fem, la
from numpy.typing import NDArray

from flexmbd.continuum import parallel
from flexmbd.continuum.contract.formulation import set_symbols
from flexmbd.continuum.finite_elements import assembly
from flexmbd.continuum.finite_elements.cell_group import Pairs, Source
from flexmbd.continuum.finite_elements.discrete_forms import discretise
from flexmbd.continuum.finite_elements.electrode import Condition
from flexmbd.continuum.finite_elements.interface import Interface
from flexmbd.continuum.finite_elements.surface_group import Surfaces, surface_kinetic_energy
from flexmbd.continuum.finite_elements.temperature import at_nodes, set_at_nodes
from flexmbd.continuum.finite_elements.weld import Weld, with_welds
from flexmbd.continuum.grid.tagged_mesh import TaggedMesh
from flexmbd.continuum.history.damage_bands import DamageBands
from flexmbd.continuum.history.history_snapshot import HistorySnapshot as HistorySnapshot
from flexmbd.continuum.history.lane_pass import check_threads
from flexmbd.continuum.history.mean_tangent import MeanTangent
from flexmbd.continuum.history.stress_predictor import StressPredictor, can_be_predicted
from flexmbd.continuum.history.trial_body import TrialBody
from flexmbd.continuum.history.trial_errors import (
    find_large_increment,
    refuse_infinite_force,
    refuse_large_increment,
    refuse_without_limit,
)
from flexmbd.errors import ConvergenceError, FormulationError
from flexmbd.given import checked

FloatArray = NDArray[np.float64]


@checked("cell_means", "condense", "heated", "threads", error=FormulationError, agree=parallel.told_to_all)
class NonlinearModel(TrialBody):
    """A body of one or several formulations, total or updated Lagrangian, with or without history.

    Constructing one is collective.

    Attributes:
        forms: the formulations on the mesh, and the interfaces.
        displacement: (local dofs including ghosts,) m, of the last accepted step, from the undeformed
            mesh. Not to be changed by hand.
        viscous_forces: of the formulations' dissipation; None where there is none.
        springs: on facets, from the surface to the body's axes; None where there are none.
    """

    def __init__(
        self,
        mesh: TaggedMesh,
        formulation: Source | Pairs,
        parameters: Any = None,
        *,
        degree: int,
        interfaces: Sequence[Interface] = (),
        cell_means: bool | None = None,
        surfaces: Surfaces | None = None,
        condense: bool = True,
        heated: bool = False,
        threads: int = 1,
        conditions: Sequence[Condition] = (),
        welds: Sequence[Weld] = (),
    ) -> None:
        """Check everything, then compile. Collective over the mesh's communicator.

        Args:
            mesh: lengths in m.
            formulation: a module, the name of one in `flexmbd.forms`, or a form file's path; or
                several as {cell group: (formulation, parameters)}, whose elements are the same.
            parameters: an instance of the formulation's `Parameters`, SI units; left out with several.
            degree: of the elements, at least that of the mesh's geometry, and the same with a
                formulation whose reference is the updated configuration.
            interfaces: groups of the mesh that carry frames.
            cell_means: whether formulations with `cell_mean` use it against volumetric locking; by default
                with elements of degree 1. One mean a cell is too few for those of degree 2.
            surfaces: springs and mass on the surface: {facet group: (formulation, parameters)}, of which
                `surface_energy` and `surface_kinetic_energy` are taken. Springs reach to the body's axes.
            condense: whether fields of one cell, as enhanced strains, are solved for in their cell; else they are
                unknowns of the body, as which it is loaded slowly alone.
            heated: whether its loads give it a temperature (`Heating`).
            threads: among which each rank shares the cells of large bodies; results are the same for any number.
            conditions: electrodes, of a formulation whose `gauge` names a potential; loads give their voltages
                (`Voltage`). Where none of them fixes it, the potential is zero at one node.
            welds: nodes that follow facets, of solids of displacements alone.

        Raises:
            FormulationError: `threads` is no number of threads; a form file breaks its contract, or does not fit its
                parameters, the cell or the degree; formulations of both references; of the updated one a degree unlike
                the geometry's, or unknowns besides the displacement; of a heated body one that names no expansion, or
                expansions that are all zero.
            InterfaceError: an interface cannot carry a frame, or the ranks were given different ones.
            MeshError: `mesh` is not a `TaggedMesh`; with several pairs, cells in no group or in two; `surfaces` on
                facets that the surface has not; as `with_welds`.
        """
        check_threads(threads)
        forms = discretise(
            mesh,
            formulation,
            parameters,
            degree=degree,
            interfaces=interfaces,
            surfaces=surfaces,
            with_history=True,
            condense=condense,
        )
        forms = with_welds(forms, welds)
        means = degree == 1 if cell_means is None else cell_means
        super().__init__(forms, means=means, heated=heated, threads=threads, conditions=conditions)
        self._alone, self._tied = PETSc.Mat(), PETSc.Mat()  # the last tangent, without ties and with; no handles yet
        self._bands: DamageBands | None = None
        if self.layout.has_further and mesh.dim == 3:
            self._bands = DamageBands(self.layout, lambda unknown: self.force(unknown, dt=0.0))
            self.revert()

    def vector(self) -> la.Vector:
        """A vector of the space with its ghosts, for scattering; not collective."""
        return fem.Function(self.space).x

    def norm(self, values: FloatArray) -> float:
        """2-norm of values at owned dofs, or at some of them, over all ranks. Collective."""
        parallel.refuse_vectors(self.comm, None, kind=FormulationError, values=values)
        return float(np.sqrt(self.comm.allreduce(values @ values)))

    @checked("explicit", error=FormulationError, agree=parallel.told_to_all)
    def force(self, increment: FloatArray, *, dt: float | None = None, explicit: bool = False) -> FloatArray:
        """Internal forces at a trial displacement. Collective.

        Formulations whose reference is the initial configuration get the whole displacement, `displacement` plus the
        increment; those of the updated one the increment.

        Args:
            increment: (local dofs including ghosts,) m, since the last accepted step, whatever the formulations refer
                to; the ghosts' are their owners'.
            dt: s, length of the step; at 0 no time passes: nothing flows or relaxes, and there are no viscous
                forces. None: of no matter, as where `needs_step` is false.
            explicit: whether fields of one cell need be no more exact than explicit steps have them, as `step` does.

        Returns:
            (owned dofs,) N: the forces that hold the body in that shape.

        Raises:
            FormulationError: on all ranks: `needs_step`, and dt is None; no displacement of this body, or no dt.
            ConvergenceError: on all ranks: a cell is turned inside out (`InvertedCellError`, which
                names one), or the equations at a point have no solution.
        """
        self._refuse(dt, increment=increment)
        increment = self._completed(increment)
        self._evaluate(increment, dt, explicit=explicit)
        if self.springs is not None:
            self.springs.add(self._sum.array, self.displacement + increment)
        force = self._summed()
        if not self.comm.allreduce(bool(np.isfinite(force).all()), op=MPI.LAND):
            self.check_cells()
            refuse_infinite_force(self.forms, force)
        return force

    @property
    def predicts_stress(self) -> bool:
        """Whether stresses follow from where the body is alone, in a group at least, so that a step predicts them."""
        return not self.layout.has_further and any(can_be_predicted(history) for history in self._histories)

    def predict_stress(self, before: FloatArray, after: FloatArray) -> FloatArray:
        """Predict stresses from one of Newton's iterates to the next, for `tangent`. Collective, may compile.

        Args:
            before: (local dofs including ghosts,) m, since the last accepted step.
            after: the same, of the next iterate.

        Returns:
            (owned dofs,) N, forces of the difference between predicted and present stresses.
        """
        self._refuse(before=before, after=after)
        return self.condense(self._predictor.predict(self._completed(before), self._completed(after)))

    @cached_property
    def _predictor(self) -> StressPredictor:
        def evaluate(increment: FloatArray) -> None:
            if self.fields is None:
                self._set_trial(increment, self._dt)
            else:
                self._evaluate(increment, self._dt)

        return StressPredictor(self._histories, self._u, evaluate)

    @checked("predicted", error=FormulationError, agree=parallel.told_to_all)
    def tangent(self, increment: FloatArray, *, dt: float | None = None, predicted: bool = False) -> PETSc.Mat:
        """Derivative of the internal forces by the displacement, at a trial displacement. Collective.

        Compiles at the first call. The matrix is the body's own and is filled anew at each call.

        Args:
            increment: as for `force`.
            dt: as for `force`.
            predicted: with the stresses that `predict_stress` predicted last in the place of those at hand.

        Raises:
            ConvergenceError: as `force`.
            FormulationError: as `force`.
        """
        self._refuse(dt, increment=increment)
        increment = self._completed(increment)
        self._require(increment, dt)
        with self.present_mesh():
            matrix = self._tangent.assemble(self._predictor.tangent_forms if predicted else ())
        if self.springs is not None:
            springs = self.springs.tangent(self.displacement + increment)
            matrix.axpy(1.0, springs, PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN)
            springs.destroy()
        if self.ties is not None:
            self._alone, into = matrix, self._tied if self._tied.handle else None
            self._tied = matrix = self.ties.condensed(matrix, keeps_diagonal=True, into=into)
        return matrix if self.conditions is None else self.conditions.constrain(matrix)

    def with_slopes(self, matrix: PETSc.Mat, add: Callable[[PETSc.Mat], object]) -> PETSc.Mat:
        """The last tangent with further derivatives of forces by displacements, as of loads that follow. Collective.

        Args:
            matrix: what `tangent` returned last, which is changed.
            add: adds them to a matrix of the tangent's pattern, over all dofs, as if there were no ties.
        """
        if self.ties is None:
            add(matrix)
            return matrix
        alone = self._alone.duplicate()
        alone.zeroEntries()
        add(alone)
        alone.assemble()
        tied = self.ties.condensed(alone, keeps_diagonal=False)
        matrix.axpy(1.0, tied, PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN)
        for item in (alone, tied):
            item.destroy()
        return matrix

    def unloading_tangent(self) -> PETSc.Mat:
        """The elastic tangent at the last accepted step, at which all points unload. Collective.

        There the stress lies on the yield surface, and round-off would choose the side: with the yield limits of
        ``scaled_yield`` it lies inside, and nothing else changes.  As of `tangent`.

        Raises:
            FormulationError: on all ranks: a formulation keeps a history and does not say what its yield limit is.
        """
        limited = [group for group in self.groups if group.optional.state is not None]
        refuse_without_limit(limited)
        try:
            for group in limited:
                form: Any = group.formulation
                set_symbols(group.symbols, form.scaled_yield(group.parameters, 2.0))
            self._renew_constants()
            return self.tangent(np.zeros(self.layout.n_local), dt=0.0)
        finally:
            for group in limited:
                set_symbols(group.symbols, group.parameters)
            self._renew_constants()

    def mass(self) -> PETSc.Mat:
        """The consistent mass matrix of the undeformed body, kg, a new one; none at what follows by ties. Collective.

        May compile.
        """
        alone = self.own_mass()
        if self.ties is None:
            return alone
        tied = self.ties.condensed(alone, keeps_diagonal=False)
        alone.destroy()
        return tied

    def own_mass(self) -> PETSc.Mat:
        """As `mass`, as if there were no ties. Collective, may compile."""
        zero = fem.Function(self.space)
        kinetic = [*assembly.kinetic_energy(self.groups, zero), *surface_kinetic_energy(self.surfaces, zero)]
        momentum = [ufl.derivative(term, zero, ufl.TestFunction(self.space)) for term in kinetic]
        forms = {"mass": assembly.derivatives_at_rest(momentum, zero)}
        return assembly.assemble(forms, self.groups, self.space)[0]

    def commit(self, increment: FloatArray, *, dt: float | None = None) -> None:
        """Accept a displacement: history and configuration become those at its end. Collective.

        Args:
            increment: as for `force`, which was called with it before.
            dt: as for `force`.

        Raises:
            FormulationError: as `force`.
            ConvergenceError: on all ranks: a history is not finite; nothing is accepted.
        """
        self._refuse(dt, increment=increment)
        increment = self._completed(increment)
        self._require(increment, dt)
        finite = all(history.trial_is_finite for history in self._histories)
        if not self.comm.allreduce(finite, op=MPI.LAND):
            self.revert()
            raise ConvergenceError("the history at the step's end is not finite; take a smaller step")
        self._accept(increment)

    def step(self, increment: FloatArray, *, dt: float | None = None) -> FloatArray:
        """Internal forces at a displacement that is accepted at once, as explicit steps do. Collective.

        The same as `force` and `commit`, in one pass, but for springs on facets, which are left out: whoever steps
        explicitly knows where the ground is.

        Args:
            increment: as for `force`.
            dt: as for `force`.

        Returns:
            (owned dofs,) N.

        Raises:
            FormulationError: as `force`.
            ConvergenceError: as `force` and `commit`; nothing is accepted.
        """
        self._refuse(dt, increment=increment)
        increment = self._completed(increment)
        self._evaluate(increment, dt, explicit=True)
        force = self._summed()
        finite = bool(np.isfinite(force).all()) and all(history.trial_is_finite for history in self._histories)
        if not self.comm.allreduce(finite, op=MPI.LAND):
            self.revert()
            self.check_cells()
            raise ConvergenceError("the internal forces are not finite; take a smaller step")
        self._accept(increment)
        return force

    def _accept(self, increment: FloatArray) -> None:
        """As `TrialBody`; tells of bands of damage that the cells do not resolve."""
        super()._accept(increment)
        if self._bands is not None and self._bands.is_to_be_looked_at:
            self._bands.look(self.displacement)

    def revert(self) -> None:
        """Forget every trial since the last accepted step."""
        self._evaluated = None
        for history in self._histories:
            history.revert()

    def snapshot(self) -> HistorySnapshot:
        """Copy the body's state."""
        return HistorySnapshot(
            self.displacement.copy(),
            tuple(history.snapshot() for history in self._histories),
            self._viscous_work,
            np.zeros(0) if self.temperature is None else at_nodes(self, self.temperature),
            self._charged,
        )

    @checked(error=FormulationError)
    def restore(self, snapshot: HistorySnapshot) -> None:
        """Go back to a snapshot of this body; not collective.

        Raises:
            FormulationError: it is no snapshot.
        """
        self._evaluated = None
        self.displacement[:] = snapshot.displacement
        self._viscous_work, self._charged = snapshot.viscous_work, snapshot.ports
        self.set_voltages(snapshot.ports.efforts)
        self._set_trial(np.zeros(self.layout.n_local), 0.0)
        if self.temperature is not None:
            set_at_nodes(self, self.temperature, snapshot.temperature)
        for history, kept in zip(self._histories, snapshot.history, strict=True):
            history.restore(kept)

    def energies(self) -> dict[str, float]:
        """Energies, J, of the last accepted step by name: "elastic", "plastic", "viscous", "springs". Collective.

        The sums of the formulations' energies, of the work that their dissipation took, and of springs on facets;
        the same on every rank. Where electrodes are given voltages "elastic" is with the electric energy, and
        "voltages" minus the work that came in by them.
        """
        self._set_trial(np.zeros(self.layout.n_local), 0.0)
        totals: dict[str, float] = {}
        with self.present_mesh():
            for history in self._histories:
                for name, value in history.energies().items():
                    totals[name.split()[0]] = totals.get(name.split()[0], 0.0) + value
        energies = {name: float(self.comm.allreduce(value)) for name, value in totals.items()}
        if self.springs is not None:
            energies["springs"] = float(self.comm.allreduce(self.springs.energy(self.displacement)))
        if self.ports:
            energies["elastic"] = energies.get("elastic", 0.0) + float(self._charged.efforts @ self._charged.flows)
            energies["voltages"] = -float(self._charged.works.sum())
        return {**energies, "viscous": self._viscous_work} if self.has_dissipation else energies

    def stress(self) -> list[FloatArray]:
        """Cauchy stress, Pa, of the last accepted step in body axes: for each group (cells, points, 3, 3)."""
        self._set_trial(np.zeros(self.layout.n_local), 0.0)
        with self.present_mesh():
            self._run(np.zeros(self.layout.n_local))
            return [history.stress() for history in self._histories]

    def history(self) -> list[FloatArray]:
        """For each group the accepted history, (points of all cells of this rank, components)."""
        return [history.accepted for history in self._histories]

    def points(self) -> list[FloatArray]:
        """For each group the quadrature points of its cells, (points, 3) in reference coordinates."""
        return [history.points for history in self._histories]

    def volumes(self) -> FloatArray:
        """(cells of this rank, points) measure of the cells' map at the points, of the last accepted step.

        In the order of the groups; negative where a cell is inside out.
        """
        with self.present_mesh():
            measure = ufl.JacobianDeterminant(self.mesh.mesh)
            return np.concatenate([history.evaluate(measure) for history in self._histories])

    def check_increment(self, increment: FloatArray) -> None:
        """Refuse a step that is larger than a formulation with `increment_size` integrates well. Collective.

        Args:
            increment: as for `force`.

        Raises:
            LargeIncrementError: on all ranks: names the cell by its place in the mesh file and its centre.
        """
        self._refuse(increment=increment)
        self._set_trial(self._completed(increment), 0.0)
        with self.present_mesh():
            ratio, where = find_large_increment(self._histories)
        refuse_large_increment(self.mesh, where, ratio=ratio)

    @cached_property
    def _tangent(self) -> MeanTangent:
        further = [] if self.viscous_forces is None else self.viscous_forces.tangent_forms()
        return MeanTangent(self._histories, self._u, self.groups, further=further)
