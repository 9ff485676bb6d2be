"""Nodal fields of a body with history (`ObservedInterior`)."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum.history.body_memory import BodyMemory
from flexmbd.continuum.history.nodal_fields import NodalFields
from flexmbd.continuum.history.nonlinear_model import NonlinearModel
from flexmbd.continuum.interior.contact_field import CONTACT_PRESSURE, PushedNodes, contact_pressure
from flexmbd.multibody.interiors.observed import InteriorFields, InteriorMesh

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


class BodyObserver:
    """Gathers a body's nodes and fields. Constructing one costs nothing; all calls are collective."""

    def __init__(self, body: NonlinearModel, memory: BodyMemory) -> None:
        """`memory` gathers nodal values of the body."""
        self._body, self._memory = body, memory

    def outline(self) -> InteriorMesh:
        """The undeformed mesh. Collective.

        Raises:
            FormulationError: on all ranks: the body is not made of solid cells.
        """
        nodes = self._fields.nodes
        return InteriorMesh(nodes.number, nodes.x, nodes.triangle)

    def fields(
        self,
        pose: tuple[FloatArray, FloatArray],
        R: FloatArray,
        *,
        nodal: tuple[FloatArray, FloatArray, FloatArray],
        pushed: PushedNodes | None = None,
    ) -> InteriorFields:
        """Fields at the last accepted step. Collective.

        Args:
            pose: (3,) m and (3, 3), the body axes as the frames carry them.
            R: (3, 3), from the axes that the mesh is stepped in to inertial ones.
            nodal: position, velocity and acceleration (owned nodes at least, 3), in inertial axes.
            pushed: the owned nodes by contacts; None: nothing is touched.
        """
        x, v, a = (self._memory.gather_nodes(part) for part in nodal)
        values, largest, row = self._fields.evaluate(R)
        if pushed is not None:
            touches, force = self._memory.gather_nodes(pushed.columns).T
            nodes = self._fields.nodes
            values[CONTACT_PRESSURE] = contact_pressure(PushedNodes(touches, force), nodes.x, nodes.triangle)
        return InteriorFields(*pose, x, v, a, values, largest, row)

    def locate(self, point: FloatArray) -> tuple[IntArray, FloatArray]:
        """The nodes of the cell that holds a point of the undeformed body, and their weights. Collective.

        Raises:
            MeshError: on all ranks: no cell holds it.
        """
        return self._fields.locate(point)

    @cached_property
    def _fields(self) -> NodalFields:
        return NodalFields(self._body)
