"""Fields of one cell: further unknowns of a form that are condensed in each cell before anything is assembled.

Enhanced strains, discontinuous stresses and pressures, a thickness strain: sub-elements of the unknown whose dofs all
lie inside one cell, that no rigid motion moves, on which neither kinetic energy nor dissipation nor a term on facets
depends, and that their own equations determine.  They are found from the element and the form's functions; a form says
nothing of them.  What is left is the *shared* part of the unknown, which begins with the displacement.

A field whose second derivatives with all fields of the cell vanish at rest, as those of a pressure at nu = 1/2, is a
multiplier: its cell does not determine it, and it stays an unknown of the body.  So does one that would make a body
so much stiffer than the rest of it is that half of the digits were lost, as that pressure just below.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import basix.ufl
import numpy as np
import ufl
from numpy.typing import NDArray

from flexmbd.continuum.contract.dof_layout import RigidDisplacement
from flexmbd.continuum.contract.entries import optional_entries
from flexmbd.continuum.contract.formulation import Formulation, IntegralTerm, internal_work
from flexmbd.continuum.contract.trial_symbols import GDIM, FloatArray, TrialSymbols, affine
from flexmbd.round_off import SQUARED

IntArray = NDArray[np.int64]


@dataclass(frozen=True)
class CellFields:
    """The parts of a form's unknown: fields of one cell, and what cells share.

    Attributes:
        element: of the whole unknown, mixed.
        of_cell: which of its sub-elements are fields of one cell, ascending.
    """

    element: Any
    of_cell: tuple[int, ...]

    @cached_property
    def shared_element(self) -> Any:
        """Of what cells share: that of the displacement, or a mixed one where more than it is left."""
        parts = [part for i, part in enumerate(self.element.sub_elements) if i not in self.of_cell]
        return parts[0] if len(parts) == 1 else basix.ufl.mixed_element(parts)

    @cached_property
    def cell_element(self) -> Any:
        """Of the fields of one cell: that of the one that there is, or a mixed one."""
        parts = [self.element.sub_elements[i] for i in self.of_cell]
        return parts[0] if len(parts) == 1 else basix.ufl.mixed_element(parts)

    @cached_property
    def shared_components(self) -> IntArray:
        """(n,) components of the flattened unknown that cells share."""
        return self._joined(_components(self.element), shared=True)

    @cached_property
    def shared_places(self) -> IntArray:
        """(n,) places of the shared dofs in the vector of a cell."""
        return self._joined(_dofs(self.element), shared=True)

    @cached_property
    def cell_places(self) -> IntArray:
        """(m,) places of the dofs of the fields of one cell in the vector of a cell."""
        return self._joined(_dofs(self.element), shared=False)

    def names(self, dofs: Sequence[int] | IntArray) -> str:
        """What a message calls the fields that have some of the ``cell_places``, by their numbers there."""
        places, found = {int(self.cell_places[k]) for k in dofs}, []
        for i, part in enumerate(_dofs(self.element)):
            if i in self.of_cell and not places.isdisjoint(map(int, part)):
                own = _components(self.element)[i]
                found.append(f"{own[0]} to {own[-1]}" if len(own) > 1 else f"{own[0]}")
        return f"unknown{'' if len(found) == 1 and ' ' not in found[0] else 's'} {' and '.join(found)}"

    def padded(self, shared: ufl.core.expr.Expr) -> ufl.core.expr.Expr:
        """The whole unknown whose shared part is an expression, and whose fields of one cell are zero."""
        return self._with_zeros(shared, self.shared_components)

    def in_cells(self, own: ufl.core.expr.Expr) -> ufl.core.expr.Expr:
        """The whole unknown whose fields of one cell are an expression, and whose shared part is zero."""
        return self._with_zeros(own, self._joined(_components(self.element), shared=False))

    def shared_rigid_motion(self, rigid_motion: RigidDisplacement) -> RigidDisplacement:
        """The shared part of a form's `rigid_motion`."""

        def motion(x: Any, translation: Any, rotation: Any) -> ufl.core.expr.Expr:
            whole = rigid_motion(x, translation, rotation)
            return ufl.as_vector([whole[int(i)] for i in self.shared_components])

        return motion

    def shared_terms(
        self, terms: Callable[..., Sequence[IntegralTerm]], *shared: ufl.core.expr.Expr
    ) -> list[IntegralTerm]:
        """Terms of which no field of one cell is a part, of the shared unknowns or rates.

        Args:
            terms: of whole ones.
            shared: the shared ones, each of the shape of the shared element's values.
        """
        domain = ufl.domain.extract_unique_domain(shared[0])
        whole = [ufl.Coefficient(ufl.FunctionSpace(domain, self.element)) for _ in shared]
        parts = {symbol: self.padded(part) for symbol, part in zip(whole, shared, strict=True)}
        return [
            (ufl.replace(ufl.algorithms.expand_derivatives(density), parts), rule) for density, rule in terms(*whole)
        ]

    def _with_zeros(self, given: ufl.core.expr.Expr, components: IntArray) -> ufl.core.expr.Expr:
        values = [ufl.as_ufl(0.0)] * (1 + int(_components(self.element)[-1][-1]))
        parts = [given[index] for index in np.ndindex(given.ufl_shape)]
        for place, value in zip(components, parts, strict=True):
            values[place] = value
        return ufl.as_vector(values)

    def _joined(self, parts: Sequence[IntArray], *, shared: bool) -> IntArray:
        return np.concatenate([part for i, part in enumerate(parts) if (i in self.of_cell) != shared])


def find_cell_fields(
    form: Formulation, parameters: Any, *, cell: str, degree: int
) -> CellFields | None:
    """The fields of one cell of a form; not collective, nothing is compiled.

    Args:
        form: a checked form file.
        parameters: of it.
        cell: one of its cells.
        degree: one of its degrees.

    Returns:
        None where there are none, as of a form of displacements alone, which costs nothing.
    """
    element = form.element(cell, 3, degree)
    candidates = _inside_cells(element)
    if not candidates:
        return None
    unknown = TrialSymbols(form, cell, degree, parameters=parameters)  # type: ignore[arg-type]
    own = _components(element)
    kept = [i for i in candidates if not unknown.moved[own[i]].any() and not _outer_terms(form, unknown, own[i])]
    if not kept:
        return None
    second = _SecondDerivatives(form, unknown)
    while kept:
        free = [i for i in kept if not _is_determined(second, own[i], np.concatenate([own[k] for k in kept]))]
        if not free:
            return CellFields(element, tuple(kept))
        kept = [i for i in kept if i not in free]
    return None


def common_cell_fields(found: Sequence[CellFields | None]) -> CellFields | None:
    """Those that are fields of one cell in each of several forms of one element."""
    first = found[0]
    if first is None or any(one is None for one in found):
        return None
    both = set(first.of_cell).intersection(*(one.of_cell for one in found if one is not None))
    return CellFields(first.element, tuple(sorted(both))) if both else None


def _inside_cells(element: Any) -> list[int]:
    """The sub-elements beside the displacement whose dofs all lie inside the cell."""
    if not isinstance(element, basix.ufl._MixedElement):
        return []
    return [
        i
        for i, part in enumerate(element.sub_elements)
        if i > 0 and not any(dofs for entities in part.entity_dofs[:-1] for dofs in entities)
    ]


def _components(element: Any) -> list[IntArray]:
    """Components of the flattened unknown, by sub-element."""
    cell = element.cell_type.name
    domain = ufl.Mesh(basix.ufl.element("Lagrange", cell, 1, shape=(GDIM,)))
    # a symmetric tensor has more components than dofs
    shapes = [ufl.FunctionSpace(domain, part).value_shape for part in element.sub_elements]
    return _counted([int(np.prod(shape, dtype=int)) for shape in shapes])


def _dofs(element: Any) -> list[IntArray]:
    """IntArray in the vector of a cell, by sub-element."""
    return _counted([int(part.dim) for part in element.sub_elements])


def _counted(sizes: Sequence[int]) -> list[IntArray]:
    ends = np.cumsum([0, *sizes])
    return [np.arange(begin, end) for begin, end in pairwise(ends)]


def _outer_terms(form: Any, unknown: TrialSymbols, components: IntArray) -> bool:
    """Whether kinetic energy, dissipation or terms on facets depend on some components of the unknown."""
    optional, p = optional_entries(form), unknown.parameters
    functions = (form.kinetic_energy, optional.dissipation, optional.surface_energy, optional.surface_kinetic_energy)
    rates = ufl.Coefficient(unknown.space)
    terms = [term for function in functions if function is not None for term in function(unknown.u, p)]
    if optional.gyroscopic is not None:
        terms += optional.gyroscopic(unknown.u, rates, p)
    return any(_depends(density, unknown, (unknown.u, rates), components) for density, _ in terms)


def _depends(density: Any, unknown: TrialSymbols, fields: Sequence[Any], components: IntArray) -> bool:
    """Whether a density is another where some components of its fields are not zero."""
    expanded = ufl.algorithms.expand_derivatives(density)
    values = []
    nothing: IntArray = np.zeros(0, dtype=np.int64)
    for cut in (nothing, components):
        some = {field: _cut(affine(field.ufl_shape, seed=7 + k), cut) for k, field in enumerate(fields)}
        values.append(unknown.evaluate_expanded(expanded, some))
    if values[0] is None or values[1] is None:  # only a mesh has a value: the density must not name them
        return any(_names_component(expanded, field, components) for field in fields)
    return values[0] != values[1]


def _names_component(expanded: Any, field: Any, components: IntArray) -> bool:
    """Whether some components of a field stand in an expression, or the field as a whole."""
    whole = False
    for part in ufl.corealg.traversal.unique_pre_traversal(expanded):
        operands = part.ufl_operands
        if not any(operand == field for operand in operands):
            continue
        at = operands[1][0] if isinstance(part, ufl.classes.Indexed) else None
        whole |= not isinstance(at, ufl.classes.FixedIndex) or int(at) in components
    return whole


def _is_determined(second: _SecondDerivatives, components: IntArray, of_cell: IntArray) -> bool:
    """Whether second derivatives at rest of some components with those of fields of one cell are there, and count."""
    displacement = np.arange(GDIM)
    own, cell, displaced = (second(*pair) for pair in (
        (components, components), (of_cell, components), (displacement, displacement),
    ))  # fmt: skip
    mixed = second(displacement, components)
    if own is None or cell is None or displaced is None or mixed is None:  # only a mesh has values
        return True
    if cell == 0.0:
        return False
    # what condensing adds to the stiffness of the displacement, over that
    return own == 0.0 or displaced == 0.0 or mixed**2 * SQUARED <= abs(own * displaced)


class _SecondDerivatives:
    """Those of a form's internal work at rest, along two fields of which some components alone are not zero."""

    def __init__(self, form: Any, unknown: TrialSymbols) -> None:
        self._unknown = unknown
        self._along, self._across = ufl.Argument(unknown.space, 1), ufl.Argument(unknown.space, 2)
        self._expanded = [
            ufl.algorithms.expand_derivatives(ufl.derivative(density, unknown.u, self._along))
            for density, _ in internal_work(form, unknown.u, self._across, p=unknown.parameters)
        ]

    def __call__(self, along: IntArray, across: IntArray) -> float | None:
        """Of two sets of components; None where only a mesh has it."""
        shape = self._unknown.u.ufl_shape
        size = np.arange(int(np.prod(shape, dtype=int)))
        fields = {self._unknown.u: affine(shape, seed=None)}
        for seed, (argument, some) in enumerate(((self._along, along), (self._across, across))):
            fields[argument] = _cut(affine(shape, seed=1 + seed), np.setdiff1d(size, some))
        values = [self._unknown.evaluate_expanded(expression, fields) for expression in self._expanded]
        return None if any(value is None for value in values) else sum(value for value in values if value is not None)


def _cut(field: Callable[[int], FloatArray], components: IntArray) -> Callable[[int], FloatArray]:
    """A vector field some of whose components are zero."""

    def cut(depth: int) -> FloatArray:
        values = field(depth).copy()
        values[components] = 0.0
        return values

    return cut
