"""How the nodes of a body that steps explicitly answer forces: lumped masses, what is held, what damps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum.finite_elements.lumping import lumped_mass
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
        masses: (owned nodes,) kg.
        weights: (owned nodes,) kg, the same but for zero at nodes that somebody else moves.
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
        self.masses: FloatArray = body.layout.displacements(lumped)[:, 0].copy()
        n = len(self.masses)
        self.bonded: NDArray[np.int32] = np.zeros(0, dtype=np.int32) if bonded is None else bonded
        self._moves: FloatArray = np.ones((n, 3))
        for support in supports:
            nodes = body.layout.nodes_on(body.mesh.dim - 1, body.mesh.facets(support.group))
            held = np.array([support.x, support.y, support.z])
            self._moves[np.ix_(nodes[nodes < n], np.flatnonzero(held))] = 0.0
        self._moves[self.bonded] = 0.0
        self.plane, self.thickness = PlaneMotion(body), thickness
        if thickness is not None:
            thickness.hold(self._moves)
        self.weights: FloatArray = self.masses.copy()
        self.weights[self.bonded] = 0.0

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
            return pull
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
