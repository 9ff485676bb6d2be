"""What an interior shows of itself: its mesh, and fields on the nodes at the state it stands in."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from flexmbd.brief import brief
from flexmbd.multibody.bodies.continuum_body import FrameMotion, Interior

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class InteriorMesh:
    """The k nodes of an interior and its surface, undeformed, in body axes.

    Attributes:
        node: (k,) node numbers of the mesh's input, ascending.
        x: (k, 3) m.
        triangle: (t, 3) the surface as rows of ``x``, oriented outwards.
    """

    node: IntArray
    x: FloatArray
    triangle: IntArray

    __repr__ = brief


@dataclass(frozen=True, eq=False)
class InteriorFields:
    """Fields on the k nodes of an interior at an instant.

    Attributes:
        p, R: (3,) m, (3, 3): the body axes in inertial ones.
        position, velocity, acceleration: (k, 3) m, m/s, m/s^2, in inertial axes.
        values: further fields by name, (k,) or (k, m): ``stress`` (k, 6), Cauchy stress in Pa, xx, yy, zz, yz, xz, xy
            in inertial axes; ``von_mises`` in Pa; parts of the history by the names that the form gives them.
        largest: Pa, the largest von Mises stress at any point of a cell.
        largest_row: the node nearest to that point.
    """

    p: FloatArray
    R: FloatArray
    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    values: Mapping[str, FloatArray]
    largest: float
    largest_row: int

    __repr__ = brief


@runtime_checkable
class ObservedInterior(Interior, Protocol):
    """An interior that shows its fields; asking for them does not change its state."""

    def outline(self) -> InteriorMesh:
        """Its mesh, the same on every rank.  Collective."""

    def observe(self, motion: FrameMotion) -> InteriorFields:
        """Fields at the last accepted state, at which its frames move so; the same on every rank.  Collective."""

    def locate(self, point: FloatArray) -> tuple[IntArray, FloatArray]:
        """The cell that holds a point (3,) m of the undeformed body, in body axes.  Collective.

        Returns:
            (m,) rows of the nodes of that cell, and (m,) the values of their shape functions there.

        Raises:
            MeshError: no cell holds it.
        """

    def outer_forces(self) -> Mapping[str, FloatArray]:
        """(3,) N by name, in inertial axes: the resultant of each contact plane and load on the body.  Collective.

        At the last accepted state; always the same names.  Asked after each step.
        """
