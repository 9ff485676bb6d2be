"""The loads of one body as nodal forces, with the derivative of those that follow its surface."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from petsc4py import PETSc

import numpy as np
from dolfinx import fem, la
from numpy.typing import NDArray

from flexmbd.continuum import parallel
from flexmbd.continuum.finite_elements.condensed_stiffness import CondensedStiffness
from flexmbd.continuum.finite_elements.held_expansion import HeldExpansion
from flexmbd.continuum.finite_elements.nodes import node_numbers
from flexmbd.continuum.finite_elements.surface_patch import SurfacePatch, surface_facets
from flexmbd.continuum.finite_elements.temperature import rise_function
from flexmbd.continuum.history.loads import (
    BodyAcceleration,
    BodyLoad,
    CentrifugalLoad,
    ForceAtNodes,
    Heating,
    PressureOnFacets,
    TractionOnFacets,
    Voltage,
    factors_of,
    listed,
    told,
)
from flexmbd.continuum.history.nonlinear_model import NonlinearModel
from flexmbd.errors import FormulationError, MeshError, SceneError
from flexmbd.multibody.interiors.time_factor import TimeFactor

FloatArray = NDArray[np.float64]


class AppliedLoads:
    """Nodal forces of loads. Constructing one is collective.

    Vectors are in the axes in which dead loads keep their direction: x = p + R X of body axes.

    Attributes:
        names: of the loads.
        factors: their functions of time.
        any: whether there are forces.
        any_follow: whether some of them go by the present places of the nodes.
        any_given_fields: whether there are temperatures or voltages, which are no forces.
    """

    def __init__(self, body: NonlinearModel, loads: Sequence[BodyLoad], *, mass: FloatArray | None = None) -> None:
        """Find facets and nodes.

        Args:
            body: the body.
            loads: each of another name.
            mass: (owned nodes,) kg, what an acceleration acts on; by default the consistent mass of each node.

        Raises:
            SceneError: on all ranks: something that is no load, two of one name, or the ranks were given others.
            FormulationError: on all ranks: the body has unknowns that turn with it.
            MeshError: on all ranks: facets or nodes that the mesh has not.
        """
        self._body, self._comm = body, body.comm
        self.loads = listed(loads)
        self.names = tuple(load.name for load in self.loads)
        self.factors: tuple[TimeFactor, ...] = factors_of(self.loads)
        forces = [load for load in self.loads if not isinstance(load, (Heating, Voltage))]
        self.any, self.any_given_fields = bool(forces), len(forces) < len(self.loads)
        if self.any and body.turns:
            raise FormulationError(
                f"loads act on nodes that move without turning, and {body.groups[0].form_name} has unknowns that turn; "
                "give follow its forces as load=, a vector over the load parameter"
            )
        parallel.check_same(body.comm, SceneError, loads=[told(load) for load in self.loads])
        self._n = body.layout.n_owned_nodes
        facets = {load.facets for load in self.loads if isinstance(load, (PressureOnFacets, TractionOnFacets))}
        self._patches = {name: SurfacePatch(body, surface_facets(body, name)) for name in sorted(facets)}
        if mass is None and any(isinstance(load, BodyAcceleration) for load in self.loads):
            mass = _row_sums(body)
        self._mass: FloatArray = np.zeros(self._n) if mass is None else mass
        turning = {k: load for k, load in enumerate(self.loads) if isinstance(load, CentrifugalLoad)}
        self._centrifugal = {k: _mass_times(body, _squared(load)) for k, load in turning.items()}
        rises = {k: self._rise(load) for k, load in enumerate(self.loads) if isinstance(load, Heating)}
        self._rises = {k: np.asarray(rise.x.array) for k, rise in rises.items()}
        self._held = {k: self._held_expansion(rise) for k, rise in rises.items()}
        self._volts = {k: self._port(load) for k, load in enumerate(self.loads) if isinstance(load, Voltage)}
        self._held |= {k: self._pull_of(port) for k, port in self._volts.items()}
        dead = {k: load for k, load in enumerate(self.loads) if not is_following(load) and k not in self._held}
        self._units = {k: self._unit(load) for k, load in dead.items()}
        self.any_follow = any(is_following(load) for load in self.loads)

    def values(self, t: float) -> FloatArray:
        """(loads,) the factors at t (s), rank 0's on all ranks. Collective.

        Raises:
            SceneError: on all ranks: one failed or is not finite.
        """
        found, error = np.zeros(len(self.factors)), None
        try:
            found[:] = [factor.at(t) for factor in self.factors]
        except SceneError as reason:
            error = reason
        if self._comm.size > 1:
            parallel.raise_collectively(self._comm, error)
            found = self._comm.bcast(found, root=0)
        elif error is not None:
            raise error
        return found

    def set_given_fields(self, values: FloatArray) -> None:
        """Bring the body to its temperature and its voltages at values of the factors; not collective."""
        if self._volts:
            efforts = np.zeros(len(self._body.ports))
            for k, port in self._volts.items():
                efforts[port] += values[k]
            self._body.set_voltages(efforts)
        if self._rises:
            self._body.set_temperature(np.asarray(sum(values[k] * rise for k, rise in self._rises.items())))

    def factors_of_given_fields(self, values: FloatArray) -> FloatArray:
        """(temperatures + voltages,) their factors, taken out of those of all loads (loads,); not collective."""
        return values[list(self._held)]

    def size_of_given_fields(self, values: FloatArray) -> float:
        """N, 2-norm of the forces that would hold in shape what expands or has voltages; else zero. Collective."""
        if not self.any_given_fields:
            return 0.0
        return self._body.norm(np.asarray(sum(values[k] * held for k, held in self._held.items())))

    def dead(self, values: FloatArray, R: FloatArray) -> FloatArray:
        """(owned nodes, 3) N, of loads that keep their direction; R (3, 3) turned the body as it began."""
        force = np.zeros((self._n, 3))
        for k, unit in self._units.items():
            turned = isinstance(self.loads[k], PressureOnFacets)
            force += values[k] * (unit @ R.T if turned else unit)
        return force

    def following(self, values: FloatArray, x: FloatArray) -> FloatArray:
        """(owned nodes, 3) N, of loads that go by the nodes' places x (owned nodes, 3) m. Collective.

        Tractions turn with the surface from body axes into the axes of x.
        """
        force = np.zeros((self._n, 3))
        if not self.any_follow:
            return force
        places = self._with_ghosts(x)
        for k, load in enumerate(self.loads):
            if isinstance(load, CentrifugalLoad):
                force -= values[k] * _times(self._centrifugal[k], x[: self._n] - np.asarray(load.point))
            elif is_following(load):
                force += values[k] * self._summed(load, places)
        return self._body.condense_nodes(force)

    def forces(self, values: FloatArray, x: FloatArray, R: FloatArray) -> FloatArray:
        """(owned nodes, 3) N, of all loads; arguments as of `dead` and `following`. Collective."""
        return self.dead(values, R) + self.following(values, x)

    def resultants(self, values: FloatArray, x: FloatArray, R: FloatArray) -> dict[str, FloatArray]:
        """(3,) N by name: the sum of each load over the body; arguments as above. Collective."""
        found = {}
        for k, load in enumerate(self.loads):
            if k in self._held:
                continue
            alone = np.where(np.arange(len(values)) == k, values, 0.0)
            force = self.dead(alone, R) if k in self._units else self.following(alone, x)
            found[load.name] = np.asarray(sum(self._comm.allgather(force.sum(axis=0))))
        return found

    def add_slopes(self, matrix: PETSc.Mat, values: FloatArray, x: FloatArray) -> None:
        """Subtract the derivative of ``following`` by the nodes' places from a matrix. Collective.

        Args:
            matrix: of the body's tangent, which is changed.
            values: of the factors.
            x: (owned nodes, 3) m, in the axes of the matrix' unknowns.
        """
        places, layout = self._with_ghosts(x), self._body.layout
        blocks, width = layout.space.dofmap.index_map, layout.space.dofmap.index_map_bs
        for k, load in enumerate(self.loads):
            if not is_following(load) or values[k] == 0.0:
                continue
            if isinstance(load, CentrifugalLoad):
                matrix.assemble()
                matrix.axpy(values[k], self._centrifugal[k], PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN)
                continue
            patch = self._patches[load.facets]  # type: ignore[union-attr]
            if isinstance(load, PressureOnFacets):
                slopes = patch.pressure_slopes(places)
            else:
                slopes = patch.traction_slopes(np.asarray(load.traction), places)  # type: ignore[union-attr]
            size = 3 * patch.nodes.shape[1]
            local = layout.displacement_dofs[patch.nodes].reshape(-1)
            numbers = width * blocks.local_to_global((local // width).astype(np.int32)) + local % width
            dofs = numbers.reshape(-1, size).astype(PETSc.IntType)
            for rows, block in zip(dofs, slopes.reshape(-1, size, size), strict=True):
                matrix.setValues(rows, rows, -values[k] * block, addv=PETSc.InsertMode.ADD_VALUES)
        matrix.assemble()

    def _unit(self, load: BodyLoad) -> FloatArray:
        """(owned nodes, 3) N, a dead load with the factor 1. Collective."""
        if isinstance(load, BodyAcceleration):
            return self._mass[:, None] * np.asarray(load.acceleration)
        if isinstance(load, ForceAtNodes):
            return self._body.condense_nodes(self._at_nodes(load))
        return self._summed(load, self._body.layout.node_x)

    def _rise(self, load: Heating) -> fem.Function:
        """K, with the factor 1. Collective."""
        if self._body.temperature is None:
            raise SceneError(
                f"load {load.name!r}: the body was compiled without a temperature; make it with "
                "NonlinearModel(..., heated=True)"
            )
        return rise_function(self._body, load.rise, f"load {load.name!r}", kind=SceneError)

    def _held_expansion(self, rise: fem.Function) -> FloatArray:
        """(owned dofs,) N, that hold the body at rest in shape. Collective, may compile."""
        body = self._body
        cold = replace(body.forms, groups=body.cold_groups)
        condensed = None if body.fields is None else CondensedStiffness(cold, body.fields)
        return HeldExpansion(cold, condensed=condensed).forces(rise)

    def _port(self, load: Voltage) -> int:
        """Its place among the body's ports."""
        ports = self._body.ports
        if load.electrode not in ports:
            there = ", ".join(map(repr, ports)) or "none"
            raise SceneError(
                f"load {load.name!r}: the body has no electrode {load.electrode!r} whose voltage is given; it has: "
                f'{there}. Make it with NonlinearModel(..., conditions=[Electrode("{load.electrode}")])'
            )
        return ports.index(load.electrode)

    def _pull_of(self, port: int) -> FloatArray:
        """(owned dofs,) N, by which 1 V pulls at the body as it is. Collective."""
        body, still = self._body, np.zeros(self._body.layout.n_local)
        now = np.array(body.efforts)
        forces = []
        for more in (1.0, 0.0):
            body.set_voltages(now + more * (np.arange(len(now)) == port))
            forces.append(body.force(still, dt=0.0))
        body.revert()
        return np.asarray(forces[0] - forces[1])

    def _at_nodes(self, load: ForceAtNodes) -> FloatArray:
        numbers = node_numbers(self._body)[: self._n]
        wanted = np.asarray(load.nodes, dtype=np.int64)
        mine = np.isin(numbers, wanted)
        known = np.concatenate(self._comm.allgather(numbers[mine]))
        missing = np.setdiff1d(wanted, known)
        if missing.size:
            raise MeshError(f"load {load.name!r}: the mesh has no node of the numbers {missing[:5].tolist()}")
        count = np.array([(wanted == number).sum() for number in numbers[mine]], dtype=float)
        force = np.zeros((self._n, 3))
        force[mine] = count[:, None] * np.asarray(load.force)
        return force

    def _summed(self, load: BodyLoad, places: FloatArray) -> FloatArray:
        """(owned nodes, 3) N, a load on facets with the factor 1 at places (local nodes, 3). Collective."""
        patch = self._patches[load.facets]  # type: ignore[union-attr]
        if isinstance(load, PressureOnFacets):
            part = patch.pressure(places)
        else:
            traction = np.asarray(load.traction)  # type: ignore[union-attr]
            part = patch.traction(traction, places if load.follows else None)  # type: ignore[union-attr]
        total = self._vector()
        total.array[:] = 0.0
        np.add.at(total.array.reshape(-1, 3), patch.nodes, part)
        total.scatter_reverse(la.InsertMode.add)
        return self._body.condense_nodes(total.array.reshape(-1, 3)[: self._n].copy())

    def _vector(self) -> la.Vector:
        """A vector of nodal values, (local nodes including ghosts * 3,)."""
        return fem.Function(self._body.layout.node_space).x

    def _with_ghosts(self, x: FloatArray) -> FloatArray:
        vector = self._vector()
        vector.array[: 3 * self._n] = x[: self._n].reshape(-1)
        vector.scatter_forward()
        return np.asarray(vector.array.reshape(-1, 3).copy())


@dataclass(frozen=True, eq=False)
class TrialLoads:
    """The loads of a body at trial displacements since its last accepted step, in body axes.

    Attributes:
        body: the body.
        loads: on it.
        values: of their factors.
        dead: (owned dofs,) N, in body axes.
    """

    body: NonlinearModel
    loads: AppliedLoads
    values: FloatArray
    dead: FloatArray

    def set_given_fields(self) -> None:
        """Bring the body to the temperature and the voltages that go with them; not collective."""
        self.loads.set_given_fields(self.values)

    @property
    def given_fields(self) -> FloatArray:
        """(temperatures + voltages,) their factors."""
        return self.loads.factors_of_given_fields(self.values)

    def force(self, increment: FloatArray) -> FloatArray:
        """(owned dofs,) N, at a displacement (local dofs,) m. Collective."""
        if not self.loads.any_follow:
            return self.dead
        following = self.loads.following(self.values, self._places(increment))
        return self.dead + self.body.layout.at_dofs(following, owned=True)

    def subtract_slopes(self, matrix: PETSc.Mat, increment: FloatArray) -> PETSc.Mat:
        """The matrix less the derivative of ``force`` by the displacement; it is changed. Collective."""
        if not self.loads.any_follow:
            return matrix
        places = self._places(increment)
        return self.body.with_slopes(matrix, lambda alone: self.loads.add_slopes(alone, self.values, places))

    def _places(self, increment: FloatArray) -> FloatArray:
        return self.body.complete_nodes(self.body.node_x + self.body.layout.displacements(increment))


def beside(t: float, side: int) -> float:
    """An instant (s) just before (-1) or after (1) t, by a few units of round-off: a load may jump at t."""
    return t + side * 8.0 * float(np.spacing(abs(t)))


def is_following(load: BodyLoad) -> bool:
    """Whether a load goes by the places of the nodes."""
    if isinstance(load, (PressureOnFacets, TractionOnFacets)):
        return load.follows
    return isinstance(load, CentrifugalLoad)


def _squared(load: CentrifugalLoad) -> FloatArray:
    """(3, 3) the square of the product w x, symmetric: the force per mass is minus it times the arm."""
    w = np.asarray(load.angular_velocity)
    return np.asarray(np.outer(w, w) - (w @ w) * np.eye(3))


def _times(matrix: PETSc.Mat, nodal: FloatArray) -> FloatArray:
    """A matrix times a nodal field (owned nodes, 3). Collective."""
    right, left = matrix.createVecs()
    right.array[:] = nodal.reshape(-1)
    matrix.mult(right, left)
    return np.asarray(left.array.reshape(-1, 3).copy())


def _mass_times(body: NonlinearModel, S: FloatArray) -> PETSc.Mat:
    """The consistent mass matrix times a matrix (3, 3) at each node. Collective."""
    if body.layout.has_further:
        raise FormulationError(
            f"{body.form_name} has unknowns besides the displacement, with which no CentrifugalLoad is taken; let the "
            "body turn in a machine"
        )
    mass = body.own_mass()
    blocks = PETSc.Mat().createAIJ(mass.getSizes(), nnz=3, comm=body.comm)
    first, end = blocks.getOwnershipRange()
    for row in range(first, end, 3):
        rows = np.arange(row, row + 3, dtype=PETSc.IntType)
        blocks.setValues(rows, rows, S)
    blocks.assemble()
    product = mass.matMult(blocks)
    mass.destroy()
    blocks.destroy()
    return product


def _row_sums(body: NonlinearModel) -> FloatArray:
    """(owned nodes,) kg, what of the mass a unit acceleration makes act on each node. Collective."""
    matrix, dofs = body.mass(), body.displacement_dofs[: body.layout.n_owned_nodes]
    right, left = matrix.createVecs()
    right.array[dofs[:, 0]] = 1.0
    matrix.mult(right, left)
    matrix.destroy()
    return np.asarray(left.array[dofs[:, 0]])
