"""Where conditions on a field lie on a mesh: the dofs of each, which lie apart, and those by which a field is held."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from mpi4py import MPI

import numpy as np
import ufl
from dolfinx import fem, la
from numpy.typing import NDArray

from flexmbd.continuum import parallel
from flexmbd.continuum.contract.dof_layout import Field
from flexmbd.continuum.finite_elements.discrete_forms import DiscreteForms
from flexmbd.continuum.finite_elements.electrode import Condition, refuse_no_conditions
from flexmbd.continuum.finite_elements.interface import mesh_group
from flexmbd.continuum.finite_elements.nodes import dof_numbers
from flexmbd.errors import FormulationError, MeshError

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class FloatingGroup:
    """Dofs of one value: those of an electrode that floats.

    Attributes:
        dofs: (m,) owned by this rank; m may be zero.
        leader: global number of the dof that stands for all.
    """

    dofs: IntArray
    leader: int


@dataclass(frozen=True, eq=False)
class ConditionPlaces:
    """Where conditions lie on a mesh.

    Attributes:
        ports: those whose value is given, k of them.
        units: (owned dofs, k) one unit of each port's effort.
        held: (owned dofs,) what is given, or follows another dof.
        floating: dofs of one value each.
        fixed: names of the fields of which some value is given.
    """

    ports: tuple[Condition, ...]
    units: FloatArray
    held: BoolArray
    floating: tuple[FloatingGroup, ...]
    fixed: frozenset[str]


def find_places(
    conditions: Sequence[Condition], forms: DiscreteForms, shifts: Mapping[str, FloatArray]
) -> ConditionPlaces:
    """Find the dofs of conditions. Collective.

    Args:
        conditions: as `checked_conditions` gave them.
        forms: the formulations on the mesh.
        shifts: (owned dofs,) one unit of each field, by its name.

    Raises:
        MeshError, FormulationError: on all ranks: as `dofs_on` and `check_apart`.
    """
    places = [dofs_on(one, forms, shifts[one.field]) for one in conditions]
    check_apart(forms.comm, conditions, places)
    n, first = forms.layout.n_owned, first_dof(forms)
    ports = tuple(one for one in conditions if one.is_port)
    units, held = np.zeros((n, len(ports)), order="F"), np.zeros(n, dtype=bool)
    floating = []
    for one, dofs in zip(conditions, places, strict=True):
        held[dofs] = True
        if one.floating:
            group = FloatingGroup(dofs, lowest(forms.comm, dofs, first=first))
            floating.append(group)
            held[dofs[dofs + first == group.leader]] = False
        elif one.is_port:
            units[dofs, ports.index(one)] = shifts[one.field][dofs]
    fixed = frozenset(one.field for one in conditions if not one.floating)
    return ConditionPlaces(ports, units, held, tuple(floating), fixed)


def first_dof(forms: DiscreteForms) -> int:
    """Global number of this rank's first dof; not collective."""
    return int(forms.space.dofmap.index_map.local_range[0] * forms.space.dofmap.index_map_bs)


def condense(
    comm: MPI.Comm, forces: FloatArray, *, held: BoolArray, floating: Sequence[FloatingGroup], first: int
) -> None:
    """Take what is held out of forces, and add up those on each floating electrode at its leader. Collective.

    Args:
        comm: of the body.
        forces: (owned dofs,), which are changed.
        held: (owned dofs,) as in `ConditionPlaces`, and what else is held.
        floating: dofs of one value each.
        first: global number of this rank's first dof.
    """
    for group in floating:
        whole = comm.allreduce(float(forces[group.dofs].sum()))
        if 0 <= group.leader - first < len(forces):
            forces[group.leader - first] = whole
    forces[held] = 0.0


def checked_conditions(
    conditions: Sequence[Condition], forms: DiscreteForms, shifts: Mapping[str, Any]
) -> Sequence[Condition]:
    """The conditions, which are the same on all ranks, each on a field that a gauge names. Collective.

    Args:
        conditions: as they were given.
        forms: the formulations on the mesh.
        shifts: by the names of the fields that the formulation's gauge has.

    Raises:
        MeshError: on all ranks: they differ between ranks; one is no condition; two have one name.
        FormulationError: on all ranks: no gauge of the formulation names the field of one.
    """
    parallel.check_same(forms.comm, MeshError, conditions=repr(conditions))
    given = refuse_no_conditions(conditions)
    for one in given:
        if one.field not in shifts:
            there = ", ".join(map(repr, shifts)) or "none"
            raise FormulationError(
                f"{one}: {forms.form_name} has no gauge {one.field!r}, which would say what one {one.EFFORT[1]} of the "
                f"field is: write gauge(p) into the form; it has: {there}"
            )
    return given


def dofs_on(one: Condition, forms: DiscreteForms, shift: FloatArray) -> IntArray:
    """(m,) dofs of this rank that a condition holds. Collective.

    Args:
        one: the condition.
        forms: the formulations on the mesh.
        shift: (owned dofs,) one unit of its field.

    Raises:
        MeshError: on all ranks: the mesh has no such group, or no dofs there.
        FormulationError: on all ranks: the field is discontinuous.
    """
    mesh, comm = forms.mesh, forms.comm
    known = {**mesh.facet_groups, **mesh.edge_groups, **mesh.vertex_groups, **mesh.cell_groups}
    if one.name not in known:
        there = ", ".join(map(repr, sorted(known))) or "none"
        raise MeshError(f"{one}: the mesh has no such group of facets, edges, vertices or cells; it has: {there}")
    group, found = mesh_group(one.name, mesh), []
    for field in forms.layout.fields:
        if comm.allreduce(bool(shift[owned(field.dofs, len(shift))].any()), op=MPI.LOR):
            if is_broken(field):
                raise FormulationError(f"{one}: the field {one.field!r} is discontinuous and has no values on facets")
            blocks = fem.locate_dofs_topological(field.space, group.dim, group.entities)
            size = field.space.dofmap.index_map_bs
            found.append(field.dofs[(size * blocks[:, None] + np.arange(size)).reshape(-1)])
    dofs = owned(np.unique(np.concatenate(found)), len(shift)).astype(np.int64)
    dofs = dofs[shift[dofs] != 0.0]
    if not comm.allreduce(len(dofs)):
        raise MeshError(f"{one}: the group has no nodes of the field {one.field!r}")
    return dofs


def check_apart(comm: MPI.Comm, conditions: Sequence[Condition], places: Sequence[IntArray]) -> None:
    """Refuse conditions that share dofs. Collective.

    Raises:
        MeshError: on all ranks: names two.
    """
    for k, one in enumerate(conditions):
        for other, dofs in zip(conditions[:k], places[:k], strict=True):
            if comm.allreduce(len(np.intersect1d(dofs, places[k]))):
                raise MeshError(
                    f"{other} and {one} touch: they share nodes, which cannot have two potentials; leave a gap "
                    "between the groups, or make one group of both"
                )


def lowest(comm: MPI.Comm, dofs: IntArray, *, first: int) -> int:
    """The least global number of some dofs, local to their ranks; first: of this rank's first dof. Collective."""
    mine = first + int(dofs.min()) if len(dofs) else np.iinfo(np.int64).max
    return int(comm.allreduce(mine, op=MPI.MIN))


def free_dof(forms: DiscreteForms, shift: FloatArray, held: BoolArray) -> IntArray:
    """The dof that is held of a field that nothing else holds: (1,) on its rank, (0,) on others. Collective.

    It is the same one for any number of ranks.
    """
    there = np.flatnonzero((shift != 0.0) & ~held)
    numbers_of = dof_numbers(forms, there)
    least = forms.comm.allreduce(int(numbers_of.min(initial=np.iinfo(np.int64).max)), op=MPI.MIN)
    return there[numbers_of == least]


def mean_of(forms: DiscreteForms, shift: FloatArray) -> FloatArray:
    """(owned dofs,) whose product with an unknown is the mean of a field in units of its shift. Collective."""
    space = forms.layout.space
    unit, v = fem.Function(space), ufl.TestFunction(space)
    unit.x.array[: forms.layout.n_owned] = shift
    unit.x.scatter_forward()
    degree = 2 * space.ufl_element().embedded_superdegree
    vector = fem.assemble_vector(fem.form(ufl.inner(unit, v) * ufl.dx(metadata={"quadrature_degree": degree})))
    vector.scatter_reverse(la.InsertMode.add)
    weights: FloatArray = vector.array[: forms.layout.n_owned].copy()
    weights /= forms.comm.allreduce(float(weights @ shift))
    return weights


def owned(dofs: NDArray[Any], count: int) -> NDArray[Any]:
    """Those of local dofs that this rank owns, of so many."""
    return dofs[dofs < count]


def is_broken(field: Field) -> bool:
    """Whether a field is one of each cell."""
    return bool(field.space.ufl_element().discontinuous)
