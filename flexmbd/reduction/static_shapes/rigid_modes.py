"""The six rigid-body modes of a free body, and how loads and displacements are freed of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexmbd.continuum.finite_elements.linear_model import LinearModel
from flexmbd.continuum.matrices.blocks import FloatArray, inner, multiply, symmetric


@dataclass(frozen=True, eq=False)
class RigidModes:
    """Rigid motions about the centre of mass, along the mesh's axes.

    Attributes:
        model: the body.
        com: (3,) m, centre of mass in the mesh's axes.
        motions: (owned dofs, 6) R, three translations by 1 m, three small rotations by 1 rad.
        images: (owned dofs, 6) M R.
        mass: (6, 6) R^T M R: mass (kg), and inertia about the centre of mass (kg m^2).
    """

    model: LinearModel
    com: FloatArray
    motions: FloatArray
    images: FloatArray
    mass: FloatArray

    def coordinates(self, displacement: FloatArray) -> FloatArray:
        """(6, k) the rigid modes' coordinates of displacements (owned dofs, k). Collective.

        The rest, u - R c, fulfils the mean-axis conditions: integral rho u = 0 and
        integral rho x cross u = 0 (Tisserand; Canavin & Likins 1977, doi:10.2514/3.57261).
        """
        momenta = inner(self.model.comm, self.images, displacement)
        return np.asarray(np.linalg.solve(self.mass, momenta))

    def deformation(self, displacement: FloatArray) -> FloatArray:
        """Displacements (owned dofs, k) less their rigid part. Collective."""
        rest: FloatArray = displacement - self.motions @ self.coordinates(displacement)
        return rest

    def balanced(self, loads: FloatArray) -> FloatArray:
        """Loads (owned dofs, k) less the inertia forces of the rigid motion they cause. Collective.

        The rest is self-equilibrated: no resultant force, no resultant moment (inertia relief).
        """
        resultant = inner(self.model.comm, self.motions, loads)
        rest: FloatArray = loads - self.images @ np.linalg.solve(self.mass, resultant)
        return rest


def rigid_modes(model: LinearModel) -> RigidModes:
    """The rigid-body modes of a model. Collective; the same small arrays on every rank."""
    about_zero = model.rigid_motions(np.zeros(3), np.eye(3))
    mass = inner(model.comm, about_zero, multiply(model.M, about_zero))
    # a translation's momentum about the origin, m c x e_j
    moments = mass[3:, :3] / mass[0, 0]
    com = 0.5 * np.array(
        [
            moments[2, 1] - moments[1, 2],
            moments[0, 2] - moments[2, 0],
            moments[1, 0] - moments[0, 1],
        ]
    )
    motions = model.rigid_motions(com, np.eye(3))
    images = multiply(model.M, motions)
    return RigidModes(model, np.asarray(com), motions, images, symmetric(inner(model.comm, motions, images)))
