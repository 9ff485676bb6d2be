"""Where the unknown's degrees of freedom lie: displacements, rotations, and those that are neither.

The space of a formulation is a blocked Lagrange space of the displacement alone (three dofs a node),
a blocked one whose first three components are the displacement (six, with rotations, say), or a mixed
one whose first sub-element is the displacement.  What else it holds is known by its rigid motion: a
dof that no rigid motion of the body moves, a pressure for one, is not kinematic.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeAlias

import basix
import basix.ufl
import numpy as np
import ufl
from dolfinx import fem
from numpy.typing import ArrayLike, NDArray

from flexmbd.continuum import compat
from flexmbd.errors import FormulationError

FloatArray = NDArray[np.float64]
Indices = NDArray[np.int32]

RigidDisplacement: TypeAlias = Callable[
    [ufl.core.expr.Expr, ufl.core.expr.Expr, ufl.core.expr.Expr], ufl.core.expr.Expr
]
"""The `rigid_motion(x, translation, rotation)` of a form file."""


@dataclass(frozen=True, eq=False)
class Field:
    """One sub-element of the unknown, as a space of its own.

    Attributes:
        space: blocked or scalar.
        dofs: the dof of the whole space, local to this rank, of each dof of `space`, ghosts included.
        components: which components of the flattened unknown it holds.
    """

    space: fem.FunctionSpace
    dofs: Indices
    components: slice


@dataclass(frozen=True, eq=False)
class DofLayout:
    """The dofs of one space. Local ones stand in PETSc's order: a rank's own first, then its ghosts.

    Attributes:
        space: of the unknown.
        node_space: of the displacement alone, whose blocks of three are the displacement's nodes; the
            same as `space` where there are no other unknowns.
        displacement_dofs: (local nodes including ghosts, 3) dof of `space` of each of its components.
        fields: the sub-elements of `space` in their order; a blocked space is one field.
        rigid_motion: of the formulation.
    """

    space: fem.FunctionSpace
    node_space: fem.FunctionSpace
    displacement_dofs: Indices
    fields: tuple[Field, ...]
    rigid_motion: RigidDisplacement

    @property
    def displacement_degree(self) -> int:
        """Degree of the displacement's Lagrange element."""
        return int(self.node_space.element.basix_element.degree)

    @property
    def n_local(self) -> int:
        """Number of dofs this rank knows, ghosts included."""
        return self.space.dofmap.index_map_bs * _n_blocks(self.space)

    @property
    def n_owned(self) -> int:
        """Number of dofs this rank owns."""
        return int(self.space.dofmap.index_map_bs * self.space.dofmap.index_map.size_local)

    @property
    def n_owned_nodes(self) -> int:
        """Number of displacement nodes this rank owns."""
        return int(self.node_space.dofmap.index_map.size_local)

    @cached_property
    def node_x(self) -> FloatArray:
        """(local nodes including ghosts, 3) m, positions of the displacement's nodes."""
        x: FloatArray = self.node_space.tabulate_dof_coordinates()
        return x

    @cached_property
    def kinematic(self) -> NDArray[np.bool_]:
        """(local dofs including ghosts,) whether some rigid motion of the body moves a dof.

        These are displacements and rotations, which an interface binds; the others, such as
        pressures, it leaves alone. Collective at the first call of a process, which may compile.
        """
        if self.displacement_dofs.size == self.n_local:
            return np.ones(self.n_local, dtype=bool)
        moved: NDArray[np.bool_] = np.any(self.rigid_columns(np.zeros(3), np.eye(3)), axis=1)
        return moved

    @property
    def has_further(self) -> bool:
        """Whether there are unknowns beside the displacement."""
        return self.displacement_dofs.size != self.n_local

    @cached_property
    def further_dofs(self) -> NDArray[np.int64]:
        """(m,) dofs of this rank, ghosts included, that are not displacements; ascending."""
        others = np.ones(self.n_local, dtype=bool)
        others[self.displacement_dofs] = False
        return np.flatnonzero(others)

    def displacements(self, values: FloatArray) -> FloatArray:
        """The displacements among values at dofs; a view of them where there is nothing else.

        Args:
            values: (owned dofs, ...) or (local dofs including ghosts, ...).

        Returns:
            (owned nodes, 3, ...), or (local nodes including ghosts, 3, ...).
        """
        if not self.has_further:
            return values.reshape(-1, 3, *values.shape[1:])
        n = len(self.displacement_dofs) if len(values) == self.n_local else self.n_owned_nodes
        return np.asarray(values[self.displacement_dofs[:n]])

    def at_dofs(self, nodal: FloatArray, *, owned: bool) -> FloatArray:
        """Values of nodes as those of dofs, zero at all others; a view of them where there are no others.

        Args:
            nodal: (owned nodes, 3, ...), or (local nodes including ghosts, 3, ...).
            owned: whether they are of owned nodes alone.

        Returns:
            (owned dofs, ...), or (local dofs including ghosts, ...).
        """
        if not self.has_further:
            return nodal.reshape(-1, *nodal.shape[2:])
        values = np.zeros((self.n_owned if owned else self.n_local, *nodal.shape[2:]))
        values[self.displacement_dofs[: len(nodal)]] = nodal
        return values

    def nodes_on(self, dim: int, entities: Indices) -> Indices:
        """The displacement's nodes on entities of the mesh with their borders. Collective.

        Args:
            dim: dimension of the entities.
            entities: (k,) indices local to this rank; k may be zero.

        Returns:
            (n,) local nodes, ghosts included, also those whose entities only another rank named.
        """
        nodes: Indices = fem.locate_dofs_topological(self.node_space, dim, entities)
        return nodes

    def kinematic_dofs_on(self, dim: int, entities: Indices) -> Indices:
        """The kinematic dofs of all fields there; as `nodes_on`, and ascending. Collective."""
        found = []
        for field in self.fields:
            blocks = fem.locate_dofs_topological(field.space, dim, entities)
            size = field.space.dofmap.index_map_bs
            found.append(field.dofs[(size * blocks[:, None] + np.arange(size)).reshape(-1)])
        dofs = np.sort(np.concatenate(found))
        return dofs[self.kinematic[dofs]]

    def rigid_columns(self, origin: ArrayLike, axes: ArrayLike) -> FloatArray:
        """The six unit rigid motions, field by field. Collective at the first call, which may compile.

        Args:
            origin: (3,) m, the point that rotations leave at rest.
            axes: (3, 3) rotation; motions are along and about its columns.

        Returns:
            (local dofs including ghosts, 6): three translations by 1 m, three rotations by 1 rad.
        """
        motion = self._rigid_field
        motion.origin.value[:] = np.asarray(origin, dtype=float)
        columns = np.zeros((self.n_local, 6), order="F")
        for i in range(6):
            unit = np.zeros((2, 3))
            unit[i // 3] = np.asarray(axes, dtype=float)[:, i % 3]
            motion.translation.value[:], motion.rotation.value[:] = unit
            for field, expression in zip(self.fields, motion.expressions, strict=True):
                if expression is not None:
                    function = fem.Function(field.space)
                    function.interpolate(expression)
                    columns[field.dofs, i] = function.x.array
        return columns

    @cached_property
    def _rigid_field(self) -> _RigidMotionField:
        return _RigidMotionField(self)


class _RigidMotionField:
    """A rigid motion as expressions, one a field, whose constants can be set."""

    def __init__(self, layout: DofLayout) -> None:
        mesh = layout.space.mesh
        self.origin, self.translation, self.rotation = (
            fem.Constant(mesh, np.zeros(3)) for _ in range(3)
        )
        arm = ufl.SpatialCoordinate(mesh) - self.origin
        whole = layout.rigid_motion(arm, self.translation, self.rotation)
        flat = _flattened(whole)
        # None where it is zero: DOLFINx refuses an expression without a mesh
        self.expressions: list[fem.Expression | None] = []
        for field in layout.fields:
            part = shaped(flat[field.components], field.space.value_shape)
            points = compat.interpolation_points(field.space)
            zero = isinstance(part, ufl.classes.Zero)
            self.expressions.append(None if zero else fem.Expression(part, points))


def check_element(element: basix.ufl._ElementBase, *, name: str) -> None:
    """Refuse an element whose displacement is not found; the same on every rank, not collective.

    Args:
        element: of a formulation.
        name: of the formulation, for the message.

    Raises:
        FormulationError: it is not continuous Lagrange with a displacement of three components first.
    """
    first = _displacement(element)
    lagrange = getattr(first, "element_family", None) is basix.ElementFamily.P
    mixed = first is not element
    if not lagrange or first.discontinuous or first.block_size < 3 or (mixed and first.block_size > 3):
        raise FormulationError(
            f"the element of {name} must have three displacement components a node: a continuous Lagrange element of "
            "shape (3,), or (6,) with rotations after them, or a mixed element whose first sub-element is a continuous "
            f"Lagrange element of shape (3,); got {element}"
        )


def dof_layout(space: fem.FunctionSpace, rigid_motion: RigidDisplacement) -> DofLayout:
    """Find where the dofs of a space lie. Collective.

    Args:
        space: of an element that `check_element` let pass.
        rigid_motion: of the formulation, by which the kinematic dofs are found.
    """
    element = space.ufl_element()
    if _displacement(element) is element:
        size = space.dofmap.index_map_bs
        dofs = np.arange(size * _n_blocks(space), dtype=np.int32)
        whole = Field(space, dofs, slice(0, size))
        nodes, places = _nodes_of_blocks(space)
        return DofLayout(space, nodes, dofs.reshape(-1, size)[places, :3], (whole,), rigid_motion)
    fields, first = [], 0
    for i in range(len(element.sub_elements)):
        own, of_part = compat.collapse(space.sub(i))
        size = int(np.prod(own.value_shape, dtype=int))  # a symmetric tensor has more components than dofs
        fields.append(Field(own, of_part, slice(first, first + size)))
        first += size
    return DofLayout(space, fields[0].space, fields[0].dofs.reshape(-1, 3), tuple(fields), rigid_motion)


def _nodes_of_blocks(space: fem.FunctionSpace) -> tuple[fem.FunctionSpace, Indices]:
    """A space of blocks of three for one of larger blocks, and its blocks' places in that one."""
    count = _n_blocks(space)
    if space.dofmap.index_map_bs == 3:
        return space, np.arange(count, dtype=np.int32)
    whole = space.ufl_element()
    degree, variant = whole.basix_element.degree, whole.lagrange_variant
    element = basix.ufl.element(whole.element_family, whole.cell_type, degree, variant, shape=(3,))
    nodes = fem.functionspace(space.mesh, element)
    places = np.empty(count, dtype=np.int32)
    places[nodes.dofmap.list] = space.dofmap.list
    return nodes, places


def _n_blocks(space: fem.FunctionSpace) -> int:
    blocks = space.dofmap.index_map
    return int(blocks.size_local + blocks.num_ghosts)


def _displacement(element: Any) -> Any:
    return element.sub_elements[0] if isinstance(element, basix.ufl._MixedElement) else element


def _flattened(values: ufl.core.expr.Expr) -> list[ufl.core.expr.Expr]:
    """The components of an expression, row by row."""
    return [values[index] if index else values for index in np.ndindex(values.ufl_shape)]


def shaped(values: Sequence[Any], shape: tuple[int, ...]) -> ufl.core.expr.Expr:
    """An expression of that shape from its components, row by row."""
    array = np.empty(shape, dtype=object)
    for index, value in zip(np.ndindex(shape), values, strict=True):
        array[index] = value
    return ufl.as_tensor(array.tolist()) if shape else ufl.as_ufl(values[0])
