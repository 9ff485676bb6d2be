"""An element of a geometrically exact beam between the frames of two sections."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmbd.multibody.bodies.body import Frame
from flexmbd.multibody.force.protocol import BetweenFrames, ElementTable, check_numbers, vector
from flexmbd.multibody.force.six_matrix import semidefinite_matrix
from flexmbd.multibody.kernels.elements.beam_wrench import BEAM_ELEMENT


@dataclass(frozen=True, eq=False)
class BeamElement(BetweenFrames):
    """The wrench of the energy s^T K s / 2 and of the dissipation s'^T C s' / 2, s = xi - rest.

    xi (6,) is the logarithm of G's pose in F's axes, (J(theta)^-1 d, theta) with d = p_FG_F (m), theta (rad) the
    rotation vector of R_FG and J(theta) the left Jacobian of the rotation: the screw motion that leads from one section
    to the other, stretch and shear before twist and bend, each times the length (Sonneville, Cardona & Bruels 2014).
    No rigid motion of both frames changes it.  Turns between the frames stay below half a revolution.

    Attributes:
        frame_F, frame_G: the sections' frames.
        stiffness: (6,) diagonal or (6, 6) symmetric, positive semidefinite: N/m, N and N m/rad.
        rest: (6,) xi where it is slack, m and rad; of a straight element (length, 0, 0, 0, 0, 0).
        damping: as stiffness: N s/m, N s and N m s/rad.
        extent: m, of the beam that it is a part of, which counts in the machine's extent; by default its own length.
    """

    frame_F: Frame
    frame_G: Frame
    stiffness: ArrayLike
    rest: ArrayLike
    damping: ArrayLike = (0.0,) * 6
    extent: float | None = None

    @property
    def reach(self) -> float:
        """How far (m) the beam reaches that it is a part of."""
        return float(np.linalg.norm(self._rest()[:3])) if self.extent is None else float(self.extent)

    def check(self) -> None:
        """Raise SceneError for matrices that store or dissipate a negative energy, and an extent that is none."""
        self._numbers()
        if self.extent is not None:
            check_numbers(self.what, least={"extent": self.extent})

    def assemble(self, table: ElementTable) -> None:
        """One row."""
        numbers = self._numbers()
        f, g = table.frame(self.frame_F), table.frame(self.frame_G)
        data = table.numbers(numbers)
        table.element(BEAM_ELEMENT, self.what, f=f, g=g, data=data, acts=bool(numbers[:72].any()))

    def matrices(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Stiffness and damping, (6, 6) each.

        Raises:
            SceneError: one is not symmetric or has a negative eigenvalue.
        """
        stiffness = semidefinite_matrix(self.stiffness, f"{self.what}: stiffness")
        return stiffness, semidefinite_matrix(self.damping, f"{self.what}: damping")

    def _numbers(self) -> NDArray[np.float64]:
        stiffness, damping = self.matrices()
        return np.concatenate([stiffness.ravel(), damping.ravel(), self._rest(), [float(damping.any())]])

    def _rest(self) -> NDArray[np.float64]:
        return vector(self.rest, (6,), f"{self.what}: rest")
