"""A strain at which elements of a geometrically exact beam are slack, as a function of time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmbd.errors import SceneError
from flexmbd.multibody.bodies.body import Frame
from flexmbd.multibody.force.beam_element import BeamElement
from flexmbd.multibody.force.protocol import ElementTable, OffJoints, vector
from flexmbd.multibody.functions.breaks import jumps_of_value
from flexmbd.multibody.functions.time_function import TimeFunction, as_row
from flexmbd.multibody.kernels.elements.given_strain import GIVEN_STRAIN


@dataclass(frozen=True, eq=False)
class BeamStrain(OffJoints):
    """Elements are slack at rest + length times a strain of time along one of its components, which does work on them.

    Attributes:
        elements: of beams.
        lengths: m, of each.
        component: 0 to 5: stretch, shears along y and z (1), twist, curvatures about y and z (rad/m).
        strain: a function of time, whose rate is taken too (``TimeFunction``).
        what: its name in messages.
    """

    elements: Sequence[BeamElement]
    lengths: Sequence[float]
    component: int
    strain: TimeFunction
    what: str

    @property
    def frames(self) -> tuple[Frame, ...]:
        """The ends of the elements."""
        return tuple(frame for one in self.elements for frame in one.frames)

    def check(self) -> None:
        """Raise SceneError for no function of time, or one that jumps where elements are viscous."""
        row = as_row(self.strain, self.what, motion=True)
        jumps = jumps_of_value(row)
        if len(jumps) and any(np.any(one.damping) for one in self.elements):
            raise SceneError(
                f"{self.what} jumps at t = {jumps[0]:g} s, which the beam's viscosity would resist by an infinite "
                "force; let the strain rise in a finite time, or leave out the viscosity"
            )

    def assemble(self, table: ElementTable) -> None:
        """One function of time, and a row for each element."""
        time = table.time(self.strain, self.what, rate=True)
        unit = np.eye(6)[self.component]
        for element, length in zip(self.elements, self.lengths, strict=True):
            stiffness, damping = element.matrices()
            data = table.numbers(np.concatenate([stiffness @ unit, damping @ unit]) * length)
            f, g = table.frame(element.frame_F), table.frame(element.frame_G)
            table.element(GIVEN_STRAIN, self.what, f=f, g=g, data=data, time=time)


@dataclass(frozen=True, eq=False)
class MovingStrain:
    """One component of the strain of some elements, by their rows, as a function of time."""

    group: str
    rows: tuple[int, ...]
    component: int
    function: TimeFunction


@dataclass(frozen=True, eq=False)
class StrainTable:
    """The strains at which elements are slack beside their shape: numbers (elements, 6), and functions of time."""

    fixed: NDArray[np.float64]
    moving: tuple[MovingStrain, ...]


def strain_table(
    given: Mapping[str, ArrayLike | Sequence[TimeFunction] | Sequence[Sequence[TimeFunction]]], groups: Sequence[str]
) -> StrainTable:
    """Strains that are given by group, for elements whose groups these are; a function of several is called once.

    Raises:
        SceneError: another shape than (6,) or (elements of the group, 6), what is not finite, or no function of time.
    """
    fixed, moving = np.zeros((len(groups), 6)), []
    for name, strains in given.items():
        rows = [row for row, group in enumerate(groups) if group == name]
        what = f"strain of {name!r}, for each of {len(rows)} elements or for all,"
        entries = _entries(strains)
        size = (6,) if entries.ndim == 1 else (len(rows), 6)
        numbers = np.array([_is_number(one) for one in entries.flat], bool).reshape(entries.shape)
        mixed = entries.shape == size and not numbers.all()
        values: ArrayLike = np.where(numbers, entries, 0.0) if mixed else entries.tolist()
        fixed[rows] = vector(values, size, what)
        for component in range(6):
            alike: dict[int, list[int]] = {}
            column = np.broadcast_to(entries, (len(rows), 6))[:, component]
            for k in range(len(rows)):
                if not _is_number(column[k]):
                    alike.setdefault(id(column[k]), []).append(k)
            for places in alike.values():
                function = column[places[0]]
                as_row(function, what, motion=True)
                moving.append(MovingStrain(name, tuple(rows[k] for k in places), component, function))
    return StrainTable(fixed, tuple(moving))


def _entries(strains: object) -> NDArray[np.object_]:
    try:
        return np.array(strains, dtype=object)
    except ValueError:  # rows of different lengths
        return np.array(None, dtype=object)


def _is_number(entry: object) -> bool:
    return isinstance(entry, (int, float, np.integer, np.floating)) and not isinstance(entry, bool)
