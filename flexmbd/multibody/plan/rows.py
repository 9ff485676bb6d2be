"""Constraint rows of the plan: joints held by constraints, their penalties, and couplings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import SceneError
from flexmbd.multibody.functions.time_function import as_row
from flexmbd.multibody.joint.connection import Connection, motion_name
from flexmbd.multibody.joint.coordinate_coupling import CoordinateCoupling, coordinate_place
from flexmbd.multibody.joint.enforcement import AugmentedLagrangian, Penalty
from flexmbd.multibody.joint.protocol import Row
from flexmbd.multibody.kernels.base import kinds
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.elements.penalty import PENALTY
from flexmbd.multibody.plan.forces import ForceTable
from flexmbd.multibody.plan.numbering import Numbering
from flexmbd.multibody.topology import Topology

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class ScaledRow:
    """Numbers of a row in ``Plan.data`` that the machine's extent scales.

    Attributes:
        place: offset in ``Plan.data``.
        row: the row.
        choice: what enforces it.
        name: of the row.
    """

    place: int
    row: Row
    choice: Penalty | AugmentedLagrangian
    name: str

    def numbers(self, extent: float) -> FloatArray:
        """The parameters in ``Plan.data`` for a machine of this extent (m)."""
        if isinstance(self.choice, AugmentedLagrangian):
            return _augmented_parameters(extent, self.row, self.choice, self.name)
        return _penalty_parameters(extent, self.row, self.choice, self.name)


@dataclass
class RowTable:
    """Growing rows of constraints, their names and whose they are; and those that penalties enforce."""

    table: list[list[int]]
    names: list[str]
    owners: list[Connection | CoordinateCoupling]
    penalties: list[list[int]]
    penalised: list[tuple[Row, Penalty, str]]
    scaled: list[ScaledRow]


#: The row that holds a joint's only coordinate, by how its step turns.
_COORDINATE = {
    kinds.TURN_ABOUT_Z: Row(kinds.ROW_ANGLE, 0, "prescribed angle"),
    kinds.TURN_NONE: Row(kinds.ROW_TRANSLATION, 2, "prescribed displacement"),
}


def assemble_rows(b: Numbering, topology: Topology, couplings: Sequence[CoordinateCoupling]) -> RowTable:
    """Lay out the rows of all joints held by constraints, and of the couplings.

    Raises:
        SceneError: a coupling of a joint that has no coordinate, or a penalty that enforces nothing.
    """
    rows = RowTable([], [], [], [], [], [])
    for closure in topology.closures:
        _add_closure(b, rows, closure)
    for coupling in couplings:
        values = [float(len(coupling.terms)), 0.0]  # the sum is set at the start
        for term in coupling.terms:
            found = b.index.links.get(term.connection)
            if found is None:
                raise SceneError(
                    f"{coupling.name}: joint {term.connection.name!r} is held by constraints and has no "
                    "coordinate to couple; ask for Way.COORDINATES"
                )
            step, which = coordinate_place(term.connection.joint, term.index)
            values += [float(found[step]), float(which), term.share]
        data = b.add_data(np.array(values))
        rows.table.append([-1, -1, kinds.ROW_COUPLING, 0, data, kinds.LEVEL_POSITION, -1, 0])
        rows.names.append(coupling.name)
        rows.owners.append(coupling)
    return rows


def _add_closure(b: Numbering, rows: RowTable, closure: Connection) -> None:
    """Append the rows of a joint held by constraints, and that of its prescribed motion."""
    joint = closure.joint
    f = b.add_frame(closure.parent, b.index.bodies[closure.parent.body], joint.turn)
    g = b.add_frame(closure.child, b.index.bodies[closure.child.body], joint.turn)
    b.index.closures[closure] = (f, g)
    held: list[tuple[Row, int]] = [(row, -1) for row in closure.rows]
    if closure.motion is not None:
        what = motion_name(closure)
        time = b.add_time(as_row(closure.motion, what, motion=True), what, motion=True)
        held.append((_COORDINATE[joint.steps[0].pair.turning], time))
    for row, time in held:
        data = b.add_data(np.array(row.data)) if row.data else 0
        line = [f, g, row.kind, row.index, data, row.level, time, 0]
        name = f"{closure.name}: {row.name}"
        if isinstance(closure.enforce, AugmentedLagrangian):
            line[at.ROW_ENFORCEMENT] = b.add_data(_augmented_parameters(b.extent, row, closure.enforce, name))
            rows.scaled.append(ScaledRow(line[at.ROW_ENFORCEMENT], row, closure.enforce, name))
        if isinstance(closure.enforce, Penalty):
            rows.penalties.append(line)
            rows.penalised.append((row, closure.enforce, name))
        else:
            rows.table.append(line)
            rows.names.append(name)
            rows.owners.append(closure)


def _penalty_parameters(extent: float, row: Row, choice: Penalty | AugmentedLagrangian, name: str) -> FloatArray:
    """(2,) stiffness and damping of a row, in its own unit."""
    scale = extent * extent if row.kind in kinds.ROWS_IN_RAD else 1.0
    both = [float(choice.stiffness) * scale, float(choice.damping) * scale]
    if not np.isfinite(both).all():
        raise SceneError(
            f"{name}: its stiffness and damping, {choice.stiffness:g} and {choice.damping:g} for a m, come to "
            f"{both[0]:g} and {both[1]:g} for a rad in a machine of {extent:g} m; give less, or shorten the machine"
        )
    if row.level == kinds.LEVEL_POSITION:
        return np.array(both)
    if choice.damping == 0.0:
        raise SceneError(f"{name}: holds velocities alone, so that only damping enforces it; give a damping above 0")
    return np.array([0.0, both[1]])


def _augmented_parameters(extent: float, row: Row, choice: AugmentedLagrangian, name: str) -> FloatArray:
    """(N_ENFORCEMENT,) parameters of the augmented Lagrangian that enforces a row."""
    size = 1.0 if row.kind in kinds.ROWS_IN_RAD else extent
    return np.array([*_penalty_parameters(extent, row, choice, name), choice.tol * size, choice.tol])


def assemble_penalties(b: Numbering, rows: RowTable, table: ForceTable) -> None:
    """Append the elements that stand for penalised rows."""
    for k, (line, (row, choice, name)) in enumerate(zip(rows.penalties, rows.penalised, strict=True)):
        data = b.add_data(_penalty_parameters(b.extent, row, choice, name))
        rows.scaled.append(ScaledRow(data, row, choice, name))
        f, g = line[at.ROW_F], line[at.ROW_G]
        table.element(PENALTY, f"penalty on {name}", f=f, g=g, data=data, count=k)
