"""Values of parameters in many variants at once, as columns that a table of numbers and starts are made of."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmbd.given import numbers
from flexmbd.multibody.bodies.body import FlexibleBody, Frame, RigidBody
from flexmbd.multibody.joint.connection import Connection
from flexmbd.multibody.parameter.body_parameters import CentreOfMass, FrameOrigin, Mass
from flexmbd.multibody.parameter.joint_parameters import InitialPosition, InitialVelocity, ModalPosition, ModalVelocity
from flexmbd.multibody.parameter.protocol import Parameter
from flexmbd.multibody.plan.compiled_scene import CompiledScene
from flexmbd.multibody.plan.number_table import BodyNumbers, NumberTable
from flexmbd.multibody.scene_index import IdentityMap

FloatArray = NDArray[np.float64]
Parameters = Mapping[str, Sequence[Parameter]]


def tabled_names(parameters: Parameters, scene: CompiledScene) -> tuple[str, ...]:
    """The parameters whose values go by columns: none of a body, frame or joint of which another's does not."""
    if scene.sources.scaled or scene.sources.is_awaited:
        return ()
    names = [name for name, meant in parameters.items() if all(_is_tabled(one) for one in meant)]
    while True:
        others = [one.of for name, meant in parameters.items() if name not in names for one in meant]
        kept = [name for name in names if not any(one.of is other for one in parameters[name] for other in others)]
        if len(kept) == len(names):
            moves = any(isinstance(other, Frame | FlexibleBody) for other in others)  # axes may lie in other ways
            return () if moves else tuple(kept)
        names = kept


def _is_tabled(parameter: Parameter) -> bool:
    if isinstance(parameter, InitialPosition):
        return len(parameter.joint.joint.start) == len(parameter.joint.joint.velocity_names)  # no quaternion
    return isinstance(parameter, Mass | CentreOfMass | FrameOrigin | InitialVelocity | ModalPosition | ModalVelocity)


@dataclass(frozen=True, eq=False)
class ValueColumns:
    """What the parameters of a batch of variants are.

    Attributes:
        table: numbers of bodies and frames.
        possible: (n,) whether they are finite and bodies can have them.
        starts: places in x or v (False) and values (n, k) there.
    """

    table: NumberTable
    possible: NDArray[np.bool_]
    starts: tuple[tuple[bool, slice, FloatArray], ...]

    def write_start(self, k: int, x: FloatArray, v: FloatArray) -> None:
        """Write the initial coordinates of variant k."""
        for of_x, place, values in self.starts:
            (x if of_x else v)[place] = values[k]


def value_columns(
    scene: CompiledScene, parameters: Parameters, rows: Sequence[Mapping[str, Any]]
) -> ValueColumns | None:
    """The columns of ``tabled_names``' parameters for variants; None where values are no arrays of numbers."""
    bodies: IdentityMap[RigidBody, BodyNumbers] = IdentityMap()
    places: IdentityMap[Frame, FloatArray] = IdentityMap()
    starts: list[tuple[bool, slice, FloatArray]] = []
    n = len(rows)
    for name, meant in parameters.items():
        column = numbers([row[name] for row in rows])
        for one in meant:
            values = _shaped(column, n, _size(one))
            if values is None:
                return None
            if isinstance(one, Mass):
                bodies[one.body] = replace(bodies.get(one.body, BodyNumbers()), mass=values[:, 0])
            elif isinstance(one, CentreOfMass):
                bodies[one.body] = replace(bodies.get(one.body, BodyNumbers()), com=values)
            elif isinstance(one, FrameOrigin):
                places[one.frame] = values
            elif isinstance(one, InitialPosition | InitialVelocity):
                slots = scene.index.joints[one.joint]
                of_x = isinstance(one, InitialPosition)
                starts.append((of_x, slots.x if of_x else slots.v, values))
            elif isinstance(one, ModalPosition | ModalVelocity):
                slots = scene.index.modes[one.body]
                of_x = isinstance(one, ModalPosition)
                starts.append((of_x, slots.x if of_x else slots.v, values))
    table = NumberTable(scene, n, bodies, places)
    possible = table.possible.copy()
    for _, _, values in starts:
        possible &= np.isfinite(values).all(axis=1)
    return ValueColumns(table, possible, tuple(starts))


def _size(parameter: Parameter) -> int:
    """How many numbers a value has; 0: one that is no array."""
    if isinstance(parameter, Mass):
        return 0
    if isinstance(parameter, CentreOfMass | FrameOrigin):
        return 3
    of: Connection | FlexibleBody = parameter.of
    if isinstance(of, FlexibleBody):
        return of.record.n_modes
    return len(of.joint.velocity_names)


def _shaped(column: FloatArray, n: int, size: int) -> FloatArray | None:
    """(n, size) values, or (n, 1) of single numbers; None where their shape is another."""
    if column.shape == (n,) and size <= 1:
        return column[:, None]
    return column if size > 0 and column.shape == (n, size) else None
