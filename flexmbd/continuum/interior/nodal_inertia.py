"""How the nodes of a body that steps explicitly answer forces: lumped masses, what is held, what damps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum.finite_elements.lumping import lumped_mass, own_lumped_mass
from flexmbd.continuum.history.nonlinear_model import NonlinearModel
from flexmbd.continuum.interior.further_unknowns import refuse_inertia_of_further_unknowns
from flexmbd.continuum.interior.plane_motion import PlaneMotion
from flexmbd.continuum.interior.thickness_mass import ThicknessMass
from flexmbd.errors import SceneError
from flexmbd.given import checked

FloatArray = NDArray[np.float64]


@checked()
@dataclass(frozen=True)
class Support:
    """Nodes of a facet group whose velocity components are held at zero, as on a plane of symmetry.

    Attributes:
        group: of facets.
        x, y, z: which components, in inertial axes, are held.

    Raises:
        SceneError: none is held.
    """

    group: str
    x: bool = False
    y: bool = False
    z: bool = False

    def __post_init__(self) -> None:
        if not (self.x or self.y or self.z):
            raise SceneError(f"support on {self.group!r} holds no component: say x=True, y=True or z=True")


class NodalInertia:
    """Masses of the owned nodes of a body, and the components along which they are held.

    Attributes:
        masses: (owned nodes,) kg; of nodes that follow others by ties what they hand on to these.
        lumped: (owned nodes,) kg, the same but for zero at these.
        touching: (owned nodes,) kg, the same but for zero at bonded nodes: with which they meet planes.
        weights: (owned nodes,) kg, zero at nodes that somebody else moves and at those that follow others.
        bonded: these.
        damping: 1/s, force per mass and velocity, against inertial axes.
        thickness: further mass of edges through a wall, or None.
        plane: of a plane body, in which its nodes are held.
    """

    def __init__(
        self, body: NonlinearModel, *, supports: Sequence[Support], damping: float,
        bonded: NDArray[np.int32] | None, thickness: ThicknessMass | None,
    ) -> None:
        """Find masses and what is held. Collective.

        Raises:
            MeshError: a support is on facets that the mesh has not.
            FormulationError: the mass cannot be lumped, or there are unknowns besides the displacement that have mass.
        """
        lumped = lumped_mass(body)
        refuse_inertia_of_further_unknowns(body, lumped)
        self.damping = damping
        self.lumped: FloatArray = body.layout.displacements(lumped)[:, 0].copy()
        self.masses: FloatArray = self.lumped.copy()
        n = len(self.masses)
        self.bonded: NDArray[np.int32] = np.zeros(0, dtype=np.int32) if bonded is None else bonded
        self._moves: FloatArray = np.ones((n, 3))
        for support in supports:
            nodes = body.layout.nodes_on(body.mesh.dim - 1, body.mesh.facets(support.group))
            held = np.array([support.x, support.y, support.z])
            self._moves[np.ix_(nodes[nodes < n], np.flatnonzero(held))] = 0.0
        if body.ties is not None:
            body.ties.refuse_held(self._moves == 0.0, by="supports", kind=SceneError)
        self._moves[self.bonded] = 0.0
        self.plane, self.thickness = PlaneMotion(body), thickness
        if thickness is not None:
            thickness.hold(self._moves)
        self._body = body
        if body.ties is not None:
            # what they touch planes and shapes with
            self.masses[body.ties.own] = body.layout.displacements(own_lumped_mass(body))[body.ties.own, 0]
        self.touching: FloatArray = self.masses.copy()
        self.touching[self.bonded] = 0.0
        self.weights: FloatArray = self.touching.copy()
        if body.ties is not None:
            self.weights[body.ties.own] = 0.0

    @property
    def is_held(self) -> NDArray[np.bool_]:
        """(owned nodes, 3) the components that supports hold, or somebody else moves."""
        return np.asarray(self._moves == 0.0)

    def passed_on(self, a: FloatArray, touched: FloatArray) -> FloatArray:
        """Accelerations (owned nodes, 3) m/s^2 with those by forces (owned nodes, 3) N of contacts. Collective."""
        return self._body.complete_nodes(a + self.held(self._body.condense_nodes(touched) / self.masses[:, None]))

    def held(self, vectors: FloatArray, nodes: Any = slice(None)) -> FloatArray:
        """Vectors (k, 3) at the given owned nodes, or at all, without the components along which these are held."""
        return self.plane.in_plane(vectors * self._moves[nodes])

    def answered(self, alone: FloatArray) -> FloatArray:
        """(owned nodes, 3) m/s^2, where they would be ``alone`` by the lumped masses. Collective."""
        return alone if self.thickness is None else self.thickness.accelerations(alone)

    def pulled(self, force: FloatArray, gravity: FloatArray, v: FloatArray) -> FloatArray:
        """(owned nodes, 3) m/s^2, by forces (owned nodes, 3) N, gravity (3,) m/s^2 and damping at v m/s. Collective."""
        pull = self.held(force / self.masses[:, None] + gravity - self.damping * v)
        if self.thickness is None:
            return self._body.complete_nodes(pull)
        damped = self.held(-self.damping * v)  # by all mass
        return self.thickness.accelerations(pull - damped) + damped

    def momenta(self, v: FloatArray) -> FloatArray:
        """(owned nodes, 3) N s, at velocities v (owned nodes, 3) m/s."""
        if self.thickness is None:
            return np.asarray(self.weights[:, None] * v)
        return np.asarray(self.weights[:, None] * v + self.thickness.times(v))

    def drag(self, v: FloatArray) -> FloatArray:
        """(owned nodes, 3) N, of damping."""
        return np.zeros_like(v) if self.damping == 0.0 else -self.damping * self.momenta(v)

    def square_difference(self, one: FloatArray, other: FloatArray) -> float:
        """This rank's part of M one . one - M other . other, for vectors (owned nodes, 3). Collective."""
        lumped = float(self.weights @ ((one**2).sum(axis=1) - (other**2).sum(axis=1)))
        return lumped if self.thickness is None else lumped + self.thickness.square(one) - self.thickness.square(other)
