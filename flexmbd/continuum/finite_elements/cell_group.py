"""Groups of cells, each with one formulation and one set of parameters."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from types import ModuleType
from typing import Any, TypeAlias, cast

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum import compat, parallel
from flexmbd.continuum.contract.cell_fields import CellFields
from flexmbd.continuum.contract.dissipation import check_values
from flexmbd.continuum.contract.dof_layout import check_element
from flexmbd.continuum.contract.entries import OptionalEntries, optional_entries
from flexmbd.continuum.contract.formulation import Formulation, IntegralTerm, load_form, orders, symbols
from flexmbd.continuum.grid.tagged_mesh import TaggedMesh
from flexmbd.errors import FlexmbdError, FormulationError, MeshError

Source: TypeAlias = "str | Path | ModuleType"
"""A formulation as `formulation.load_form` takes it."""

Pairs: TypeAlias = "Mapping[str, tuple[Source, Any]]"
"""A formulation and its parameters, by the name of a cell group."""


@dataclass(frozen=True, eq=False)
class CellGroup:
    """Cells of one formulation and one material.

    Attributes:
        name: of the mesh's cell group; None where the body is all one.
        formulation: the checked form file.
        parameters: an instance of its `Parameters`.
        symbols: the parameters as constants on the mesh (`formulation.symbols`).
        cells: (k,) the cells of the group that this rank owns, ascending.
        fields: of one cell, which are condensed there; None: the unknown is that of the formulation.
    """

    name: str | None
    formulation: Formulation
    parameters: Any
    symbols: Any
    cells: NDArray[np.int32]
    fields: CellFields | None = None

    @property
    def form_name(self) -> str:
        """Name of the formulation's module."""
        return form_name(self.formulation)

    @property
    def optional(self) -> OptionalEntries:
        """The formulation's optional functions of the contract."""
        return optional_entries(self.formulation)

    def kinetic_energy(self, v: Any) -> list[IntegralTerm]:
        """Terms of the kinetic energy of rates v, of the shared unknown where there are fields of one cell."""
        return self._shared(self.formulation.kinetic_energy, v)

    def dissipation(self, v: Any) -> list[IntegralTerm]:
        """The same of Rayleigh's function; none where there is none."""
        return [] if self.optional.dissipation is None else self._shared(self.optional.dissipation, v)

    def gyroscopic(self, u: Any, v: Any) -> list[IntegralTerm]:
        """The same of the kinetic energy linear in the rates v."""
        return [] if self.optional.gyroscopic is None else self._shared(self.optional.gyroscopic, u, v)

    def _shared(self, function: Callable[..., Sequence[IntegralTerm]], *unknowns: Any) -> list[IntegralTerm]:
        if self.fields is None:
            return list(function(*unknowns, self.symbols))
        return self.fields.shared_terms(lambda *whole: function(*whole, self.symbols), *unknowns)

    @property
    def has_local_unknowns(self) -> bool:
        """Whether there are equations to be solved at the points, or a compiled law to be called."""
        begin = self.optional.local_unknowns
        return self.optional.point_law is not None or (begin is not None and begin(self.parameters) is not None)

    @property
    def has_sections(self) -> bool:
        """Whether the formulation has cross-sections (`motion`), as beams and shells do."""
        return self.optional.motion is not None


def form_name(form: Formulation) -> str:
    """Name of a formulation's module."""
    # a formulation is a module, which the Protocol cannot say
    return cast(ModuleType, form).__name__


def refuse_dissipation(groups: Sequence[CellGroup], *, by: str) -> None:
    """Refuse bodies whose viscous forces would be left out; the same on every rank, not collective.

    Args:
        groups: of the body.
        by: what takes the body and has no viscous forces.

    Raises:
        FormulationError: a formulation has a dissipation.
    """
    for group in groups:
        if group.optional.dissipation is not None:
            raise FormulationError(
                f"{group.form_name} has a dissipation, whose forces {by} would leave out; reduce the body "
                "(craig_bampton), or give it a form without dissipation"
            )


def refuse_gyroscopic(groups: Sequence[CellGroup], *, by: str) -> None:
    """Refuse bodies whose gyroscopic forces would be left out; the same on every rank, not collective.

    Args:
        groups: of the body.
        by: what takes the body and has no such forces.

    Raises:
        FormulationError: a formulation has kinetic energy linear in the rates.
    """
    for group in groups:
        if group.optional.gyroscopic is not None:
            raise FormulationError(
                f"{group.form_name} has gyroscopic(u, v, p), whose forces {by} would leave out; reduce the body "
                "(craig_bampton), or give it a form without"
            )


def pair_cells(
    mesh: TaggedMesh,
    formulation: Source | Pairs,
    parameters: Any,
    *,
    degree: int,
    with_history: bool = False,
) -> tuple[CellGroup, ...]:
    """Check formulations and parameters and give each its cells. Collective.

    Args:
        mesh: with a named group for every cell, if there are several pairs.
        formulation: one for the whole body; or pairs (formulation, parameters) by cell group.
        parameters: of the one formulation; None with several.
        degree: of the elements.
        with_history: whether formulations with a residual and no energy will do.

    Returns:
        The groups, in the order they were given.

    Raises:
        FormulationError: on all ranks: a form file breaks its contract, or does not fit its
            parameters, the cell or the degree; the pairs do not name the mesh's groups; two
            formulations have different elements; or the ranks were given different things.
        MeshError: on all ranks: cells are in no group, or in two.
    """
    error: FlexmbdError | None = None
    pairs: dict[str | None, tuple[Formulation, Any]] = {}
    try:
        pairs = _loaded(mesh, formulation, parameters)
        for form, values in pairs.values():
            check_formulation(form, values, mesh, degree, with_history=with_history)
        _check_together(mesh, pairs, degree)
    except FlexmbdError as caught:
        error = caught
    parallel.raise_collectively(mesh.comm, error)
    _check_agreement(mesh, pairs, degree)
    cells = _cells(mesh, pairs)
    constants = {id(values): symbols(values, mesh=mesh.mesh) for _, values in pairs.values()}
    return tuple(
        CellGroup(name, form, values, constants[id(values)], cells[name])
        for name, (form, values) in pairs.items()
    )


def _loaded(
    mesh: TaggedMesh, formulation: Source | Pairs, parameters: Any
) -> dict[str | None, tuple[Formulation, Any]]:
    if not isinstance(formulation, Mapping):
        return {None: (load_form(formulation), parameters)}
    if parameters is not None:
        raise FormulationError(
            "several formulations bring their own parameters: leave out the third argument, and "
            'write {"group": (formulation, parameters), ...}'
        )
    there = ", ".join(repr(name) for name in sorted(mesh.cell_groups)) or "none"
    faults = [
        f"no cell group {name!r} is in the mesh" for name in formulation if name not in mesh.cell_groups
    ]
    faults += [
        f"cell group {name!r} has no formulation and parameters"
        for name in sorted(mesh.cell_groups)
        if name not in formulation
    ]
    faults += [
        f"cell group {name!r} must have a pair (formulation, parameters), got {pair!r}"
        for name, pair in formulation.items()
        if not isinstance(pair, tuple) or len(pair) != 2
    ]
    if not formulation:
        faults.append("no pair is given")
    if faults:
        raise FormulationError(f"{'; '.join(faults)}. The mesh's cell groups are: {there}")
    loaded = {source: load_form(source) for source in dict.fromkeys(source for source, _ in formulation.values())}
    return {name: (loaded[source], values) for name, (source, values) in formulation.items()}


def check_formulation(
    form: Formulation, parameters: Any, mesh: TaggedMesh, degree: int, *, with_history: bool
) -> None:
    """Refuse what does not fit a formulation; not collective.

    Args:
        form: the formulation.
        parameters: that are to be its own.
        mesh: of the body.
        degree: of the elements.
        with_history: whether formulations with a residual and no energy will do.

    Raises:
        FormulationError: parameters, cells, degree or element do not fit.
    """
    name = form_name(form)
    if not isinstance(parameters, form.Parameters):
        raise FormulationError(
            f"{name} takes its own Parameters, got {parameters!r}; write {name}.Parameters(...)"
        )
    if not with_history and optional_entries(form).strain_energy is None:
        raise FormulationError(
            f"{name} has a residual and no strain_energy, of which the stiffness is the second derivative; "
            "it is for bodies with history, flexmbd.continuum.NonlinearModel"
        )
    if mesh.mesh.geometry.dim != 3:
        raise FormulationError(
            f"the mesh lies in {mesh.mesh.geometry.dim} dimensions; give its nodes three coordinates"
        )
    cell = mesh.mesh.topology.cell_name()
    if cell not in form.CELLS:
        raise FormulationError(
            f"{name} has no {cell}; mesh the part with {' or '.join(form.CELLS)}"
        )
    degrees = sorted(orders(form, cell))
    if isinstance(degree, bool) or degree not in degrees:
        raise FormulationError(f"{name} has displacements of degree {degrees}, got degree={degree!r}")
    geometry = compat.geometry_degree(mesh.mesh)
    if degree < geometry:
        raise FormulationError(
            f"degree={degree} is below the degree {geometry} of the mesh's geometry, and could not "
            f"carry its rigid motions; use degree={geometry} or a mesh of degree {degree}"
        )
    check_element(form.element(cell, 3, degree), name=name)
    if optional_entries(form).dissipation is not None:
        faults = check_values(form, cell, degree, parameters=parameters)
        if faults:
            raise FormulationError(f"{name} with {parameters!r}: dissipation {'; '.join(faults)}")


def _check_together(
    mesh: TaggedMesh, pairs: Mapping[str | None, tuple[Formulation, Any]], degree: int
) -> None:
    """Refuse formulations that cannot be in one body; not collective."""
    cell = mesh.mesh.topology.cell_name()
    (first, (form, _)), *others = pairs.items()
    element = form.element(cell, 3, degree)
    for name, (other, _) in others:
        found = other.element(cell, 3, degree)
        if found != element:
            raise FormulationError(
                f"cell groups {first!r} and {name!r} have different elements, which cannot share their "
                f"nodes: {form_name(form)} has {element}, {form_name(other)} has {found}"
            )
        if len({optional_entries(one).motion is None for one in (form, other)}) > 1:
            raise FormulationError(
                f"of {form_name(form)} and {form_name(other)} one has cross-sections (motion, section_inertia) "
                "and the other has none: they cannot be in one body"
            )


def _check_agreement(
    mesh: TaggedMesh, pairs: Mapping[str | None, tuple[Formulation, Any]], degree: int
) -> None:
    """Refuse what differs between the ranks, which would not fit together. Collective."""
    mine = [degree, *((name, form_name(form), _numbers(values)) for name, (form, values) in pairs.items())]
    if any(other != mine for other in mesh.comm.allgather(mine)):
        raise FormulationError(
            "the ranks were given different formulations, parameters or degrees; give all the same"
        )


def _numbers(parameters: Any) -> list[float]:
    numbers: list[float] = []
    for value in (getattr(parameters, field.name) for field in fields(parameters)):
        if is_dataclass(value):
            numbers += _numbers(value)
        else:
            numbers += [number for number in np.atleast_1d(value) if isinstance(number, float)]
    return numbers


def _cells(
    mesh: TaggedMesh, pairs: Mapping[str | None, tuple[Formulation, Any]]
) -> dict[str | None, NDArray[np.int32]]:
    """The owned cells of each group, once every cell is known to be in exactly one. Collective."""
    topology = mesh.mesh.topology
    count = topology.index_map(topology.dim).size_local
    if None in pairs:
        return {None: np.arange(count, dtype=np.int32)}
    found = {name: mesh.cell_tags.find(mesh.cell_groups[cast(str, name)]) for name in pairs}
    found = {name: np.unique(cells[cells < count]).astype(np.int32) for name, cells in found.items()}
    times = np.bincount(np.concatenate([np.empty(0, int), *found.values()]), minlength=count)
    # a cell with two tags is in both groups, or listed twice in one
    parts = [(times == 0).sum(), (times > 1).sum(), *map(len, found.values())]
    missing, twice, *sizes = mesh.comm.allreduce(np.array(parts))
    faults = []
    if missing > 0:
        faults.append(f"{missing} cells are in no cell group: tag every volume of the part")
    if twice > 0:
        faults.append(f"{twice} cells are in two cell groups: tag each volume once")
    faults += [
        f"cell group {name!r} has no cells" for name, size in zip(found, sizes, strict=True) if size == 0
    ]
    if faults:
        raise MeshError("; ".join(faults))
    return found
