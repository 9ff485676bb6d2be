"""A body with history at a trial displacement: its cells evaluated, the forces summed, a step accepted.

Positions and displacements are in the axes of the body frame, which carries the gross rotation: the mesh,
as it stands after the last accepted step, is the corotated ghost of the last known configuration (Ambrosio
& Nikravesh 1992, section 2).  A formulation with `REFERENCE = "UPDATED"` refers to that configuration, and
its unknown is the displacement since; one with `"INITIAL"` to the undeformed mesh, and its unknown is the
whole displacement.  Both are driven by the increment since the last accepted step.

The mesh itself is moved only while something is assembled.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from functools import cached_property

from mpi4py import MPI

import numpy as np
import ufl
from dolfinx import fem, la
from numpy.typing import NDArray

from flexmbd.continuum import parallel
from flexmbd.continuum.contract.entries import is_rate_dependent
from flexmbd.continuum.finite_elements.cell_group import refuse_gyroscopic
from flexmbd.continuum.finite_elements.discrete_forms import DiscreteForms, DiscretisedBody
from flexmbd.continuum.finite_elements.electrode import Condition
from flexmbd.continuum.finite_elements.temperature import heated_groups, scalar_function
from flexmbd.continuum.history.held_fields import PortStates, held_fields
from flexmbd.continuum.history.history_snapshot import HistorySnapshot
from flexmbd.continuum.history.moved_mesh import MovedMesh
from flexmbd.continuum.history.plane_bodies import plane_axis
from flexmbd.continuum.history.point_history import History
from flexmbd.continuum.history.surface_springs import SurfaceSprings
from flexmbd.continuum.history.trial_errors import (
    check_references,
    find_inverted_cell,
    refuse_inverted_cell,
)
from flexmbd.continuum.history.viscous_forces import ViscousForces
from flexmbd.errors import FlexmbdError, FormulationError
from flexmbd.given import numbers

FloatArray = NDArray[np.float64]


class TrialBody(DiscretisedBody):
    """Formulations on a mesh with the state of the last accepted step, evaluated at increments since.

    Constructing one is collective.

    Attributes:
        forms: the formulations on the mesh, and the interfaces.
        displacement: (local dofs including ghosts,) m, of the last accepted step, from the undeformed mesh.
        viscous_forces: of the formulations' dissipation; None where there is none.
        springs: on facets, from the surface to the body's axes; None where there are none.
        temperature: K, its rise, which the formulations read; None where the body is not heated.
        cold_groups: the groups with the formulations as they were given.
        plane_axis: of the mesh, along the normal of a plane body; None of others.
        conditions: on fields with a gauge, as electrodes; None where there is no such field.
    """

    def __init__(
        self,
        forms: DiscreteForms,
        *,
        means: bool,
        heated: bool = False,
        threads: int = 1,
        conditions: Sequence[Condition] = (),
    ) -> None:
        """Compile the formulations. Collective.

        Args:
            forms: the formulations on the mesh, with history.
            means: whether formulations with `cell_mean` use it against volumetric locking.
            heated: whether they are at a temperature, which begins at zero.
            threads: among which each rank shares the cells of large bodies.
            conditions: on fields with a gauge, as electrodes.

        Raises:
            FormulationError: formulations of both references, or with gyroscopic forces; of a heated body those
                without an expansion; conditions on a field without a gauge.
            MeshError: conditions that are none, or on groups that the mesh has not.
        """
        self.temperature: fem.Function | None = None
        self.cold_groups = forms.groups
        if heated:
            self.temperature = scalar_function(forms.mesh, forms.layout)
            forms = replace(forms, groups=heated_groups(forms.groups, self.temperature))
        super().__init__(forms, layout=forms.layout, interfaces=forms.interfaces)
        refuse_gyroscopic(forms.groups, by="a body with history")
        check_references(forms)
        self._u = fem.Function(self.space)
        unknown, shared = self._u, None
        if self.fields is not None:
            unknown, shared = fem.Function(forms.whole), self._u
        v = ufl.TestFunction(unknown.function_space)
        self._histories = [
            History(group, unknown, v, means=means, shared=shared, temperature=self.temperature)
            for group in self.groups
        ]
        for history in self._histories:
            history.share(threads)
        self.viscous_forces = None
        if any(group.optional.dissipation is not None for group in self.groups):
            self.viscous_forces = ViscousForces(self.groups, self.space)
        self.springs = SurfaceSprings(self.surfaces, self.groups, self.space) if self.has_surface_energy else None
        self.conditions = held_fields(conditions, forms, self.springs)
        self._charged = PortStates.at_rest(0 if self.conditions is None else len(self.conditions.ports))
        self._charges: FloatArray = self._charged.flows  # of the trial
        self._viscous_work = 0.0
        self._dt = 0.0
        self._evaluated: FloatArray | None = None  # the displacement at which the cells were evaluated last
        self._moved = MovedMesh(self.space) if self.is_updated else None
        self.displacement: FloatArray = np.zeros(self.layout.n_local)
        self.plane_axis = plane_axis(self)
        self._sum = fem.Function(self.space).x
        self.check_cells()
        if self.fields is not None:
            faults = [history.singular_fields() for history in self._histories]
            parallel.raise_collectively(self.comm, next((fault for fault in faults if fault is not None), None))

    @property
    def is_updated(self) -> bool:
        """Whether the formulations refer to the updated configuration."""
        return self.groups[0].formulation.REFERENCE == "UPDATED"

    @property
    def is_rate_dependent(self) -> bool:
        """Whether the stress of a formulation depends on the length of the step."""
        return any(is_rate_dependent(group.formulation) for group in self.groups)

    @property
    def has_cell_means(self) -> bool:
        """Whether the volume of every cell changes by its mean alone."""
        return all(history.mean is not None for history in self._histories)

    @property
    def has_dissipation(self) -> bool:
        """Whether a formulation has a dissipation."""
        return self.viscous_forces is not None

    @property
    def needs_step(self) -> bool:
        """Whether forces depend on the length of the step."""
        return self.is_rate_dependent or self.has_dissipation

    @cached_property
    def held_dofs(self) -> NDArray[np.int32]:
        """Owned dofs that are not solved for: those of a plane body out of its plane, and what follows by ties."""
        if self.ties is not None:
            return self.ties.dofs
        if self.plane_axis is None:
            return np.zeros(0, dtype=np.int32)
        return np.sort(self.displacement_dofs[: self.layout.n_owned_nodes, self.plane_axis])

    @property
    def node_x(self) -> FloatArray:
        """(local nodes including ghosts, 3) m, of the last accepted step, in body axes."""
        x: FloatArray = self.layout.node_x + self.displacement[self.displacement_dofs]
        return x

    @cached_property
    def turns(self) -> bool:
        """Whether there are unknowns besides the displacement that rigid motions move, as rotations. Collective."""
        if not self.layout.has_further:
            return False
        return any(self.comm.allgather(bool(self.layout.kinematic[self.layout.further_dofs].any())))

    def fresh_snapshot(self) -> HistorySnapshot:
        """The state in which the body was made: undeformed, cold, with the first history."""
        cold = 0 if self.temperature is None else len(self.layout.node_x)
        histories = tuple(history.fresh() for history in self._histories)
        ports = PortStates.at_rest(len(self.ports))
        return HistorySnapshot(np.zeros(self.layout.n_local), histories, 0.0, np.zeros(cold), ports)

    def set_temperature(self, values: FloatArray) -> None:
        """Bring the body to a rise of temperature, K; not collective.

        Args:
            values: (local dofs of `temperature`,), or one for all.

        Raises:
            FormulationError: the body is not heated, or the values are none.
        """
        if self.temperature is None:
            raise FormulationError("the body was compiled without a temperature: NonlinearModel(..., heated=True)")
        now, given = self.temperature.x.array, numbers(values)
        if given.shape not in ((), now.shape) or not np.isfinite(given).all():
            raise FormulationError(
                f"a temperature is one finite number (K), or {len(now)} of them on this rank, got {values!r:.80}"
            )
        if not np.array_equal(now, np.broadcast_to(given, now.shape)):
            now[:] = given
            self._evaluated = None

    @cached_property
    def holds_places(self) -> bool:
        """Whether springs on facets pull at displacements, and not at further unknowns alone. Collective."""
        return self.springs is not None and (
            not self.layout.has_further
            or self.springs.push(self.displacement_dofs[: self.layout.n_owned_nodes].reshape(-1))
        )

    def refuse_surface_energy(self, *, by: str) -> None:
        """Refuse springs on facets, which reach to the body's axes. Collective.

        Args:
            by: what has axes that turn.

        Raises:
            FormulationError: on all ranks: there are some.
        """
        if self.holds_places:
            raise FormulationError(
                f"springs on facets (surface_energy) reach to the axes of the body, which {by} does not hold still: "
                "load the body slowly (follow), run it by itself (ExplicitRun), reduce it (craig_bampton), or connect "
                "springs of the scene to its frames"
            )

    def check_cells(self) -> None:
        """Refuse a trial displacement that turns a cell inside out. Collective.

        Raises:
            InvertedCellError: on all ranks; names the cell by its place in the mesh file and its centre.
        """
        if self.layout.has_further and self.mesh.dim < 3:  # a beam's sections, not its cells, have an outside
            return
        with self.present_mesh():
            inverted = find_inverted_cell(self._histories, self._u)
        refuse_inverted_cell(self.mesh, inverted)

    def set_voltages(self, values: FloatArray) -> None:
        """Bring ports, as electrodes, to voltages (k,), V, in the order of ``conditions.ports``; not collective.

        Raises:
            FormulationError: the body has other ports, or the values are no finite numbers.
        """
        now = np.zeros(0) if self.conditions is None else self.conditions.efforts
        given = numbers(values)
        if given.shape != now.shape or not np.isfinite(given).all():
            raise FormulationError(
                f"voltages are {len(now)} finite numbers (V), one of each port of the body, got {values!r:.80}"
            )
        if not np.array_equal(given, now):
            now[:] = given
            self._evaluated = None

    @property
    def ports(self) -> tuple[str, ...]:
        """Names of its ports: electrodes whose voltage is given."""
        return () if self.conditions is None else tuple(one.name for one in self.conditions.ports)

    @property
    def efforts(self) -> FloatArray:
        """(k,) V, of its ports, in their order, from now on."""
        return np.zeros(0) if self.conditions is None else self.conditions.efforts.copy()

    def port_states(self) -> dict[str, FloatArray]:
        """(2,) voltage (V) and charge (C) of its ports in the last accepted step, by name."""
        states = np.stack([self._charged.efforts, self._charged.flows], axis=1)
        return dict(zip(self.ports, states, strict=True))

    @property
    def charges(self) -> FloatArray:
        """(k,) C, of its ports in the last accepted step, in their order."""
        return self._charged.flows.copy()

    def _refuse(self, dt: float | None = None, **vectors: FloatArray) -> None:
        """Refuse what is no displacement (local dofs including ghosts,) or step. Collective."""
        parallel.refuse_vectors(self.comm, self.layout.n_local, kind=FormulationError, dt=dt, **vectors)

    def _length(self, dt: float | None) -> float:
        """The length of a step, s, where it is of some matter."""
        if dt is None and self.needs_step:
            raise FormulationError(
                f"the forces of {self.form_name} depend on rates, and the length of the step is not given; say dt (s)"
            )
        return 0.0 if dt is None else dt

    def _completed(self, increment: FloatArray) -> FloatArray:
        """(local dofs including ghosts,) m, with what follows by ties; a copy where there are some. Collective."""
        return increment if self.ties is None else self.complete(increment.copy())

    def _renew_constants(self) -> None:
        self._evaluated = None
        for history in self._histories:
            history.renew_constants()

    def _evaluate(self, increment: FloatArray, dt: float | None, *, explicit: bool = False) -> None:
        """Evaluate all cells at a trial displacement. Collective."""
        self._set_trial(increment, self._length(dt))
        if self.conditions is not None:
            self.conditions.complete(self._u.x.array)
        with self.present_mesh():
            self._run(increment, explicit=explicit)
        self._evaluated = None if explicit else increment.copy()

    def _require(self, increment: FloatArray, dt: float | None) -> None:
        """Evaluate all cells unless they were just evaluated there. Collective."""
        length, known = self._length(dt), self._evaluated
        same = known is not None and length == self._dt and np.array_equal(known, increment)
        if not self.comm.allreduce(same, op=MPI.LAND):
            self._evaluate(increment, dt)

    def _run(self, increment: FloatArray, *, explicit: bool = False) -> None:
        """All that the trial displacement makes of the cells, this rank's part of the forces in the sum. Collective.

        Raises:
            ConvergenceError: on all ranks: the equations at a point have no solution.
        """
        self._sum.array[:] = 0.0
        error: FlexmbdError | None = None
        try:
            for history in self._histories:
                history.run(self._sum.array, explicit=explicit)
        except FlexmbdError as caught:
            error = caught
        if self.fields is not None or any(group.has_local_unknowns for group in self.groups):
            parallel.raise_collectively(self.comm, error)
        if self.viscous_forces is not None:
            self.viscous_forces.add(self._sum.array, increment, dt=self._dt)
        if self.conditions is not None:
            self._charges = self.conditions.flows(self._sum.array)

    def _summed(self) -> FloatArray:
        """(owned dofs,) N, the forces of all ranks. Collective."""
        self._sum.scatter_reverse(la.InsertMode.add)
        force: FloatArray = self._sum.array[: self.n_owned].copy()
        if self.conditions is not None:
            self.conditions.condense(force)
        return self.condense(force)

    def _accept(self, increment: FloatArray) -> None:
        """Make history and configuration those at the step's end."""
        for history in self._histories:
            history.commit()
        if self.viscous_forces is not None:
            self._viscous_work += float(self.comm.allreduce(self.viscous_forces.work(increment)))
        self.displacement += increment
        self._evaluated = None  # was by where the body stood before
        if self.conditions is not None:
            self.conditions.complete(self.displacement)
            self._charged = self._charged.moved(self.conditions.efforts, self._charges)
        self._set_trial(np.zeros_like(increment), 0.0)

    def _set_trial(self, increment: FloatArray, dt: float) -> None:
        self._dt, self._evaluated = dt, None
        for history in self._histories:
            history.set_step(dt)
        self._u.x.array[:] = increment if self.is_updated else self.displacement + increment

    def present_mesh(self) -> AbstractContextManager[None]:
        """The mesh in the configuration that the formulations refer to, within a `with` block."""
        return nullcontext() if self._moved is None else self._moved.at(self.displacement)
