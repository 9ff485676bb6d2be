"""An elastic joint: stiffness and damping between two frames in all six directions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmbd.given import refuse_no_truth
from flexmbd.multibody.bodies.body import Frame
from flexmbd.multibody.bodies.point_mass import refuse_turn
from flexmbd.multibody.force.protocol import BetweenFrames, ElementTable
from flexmbd.multibody.force.six_matrix import semidefinite_matrix
from flexmbd.multibody.kernels.elements.bushing_wrench import BUSHING
from flexmbd.multibody.kernels.elements.halfway_bushing import HALFWAY_BUSHING


@dataclass(frozen=True, eq=False)
class Bushing(BetweenFrames):
    """The wrench of the energy u^T K u / 2 and of the dissipation u'^T C u' / 2, u = (d, theta).

    d = p_FG_F (m) and theta the rotation vector of R_FG (rad), both in F's axes; slack where G lies on F.  Where it is
    ``symmetric``, d is seen from axes half-way between F and G, and both frames count alike: exchanged, they get the
    opposite wrenches.  The wrench
    is the exact derivative at any size of u, so no energy is lost or made; turns stay below half a revolution, where
    theta changes its direction, which a run tells (`fm.RangeWarning`).

    Attributes:
        frame_F, frame_G: its ends.
        stiffness: (6,) diagonal or (6, 6) symmetric, positive semidefinite: N/m and N m/rad, in F's axes.
        damping: alike: N s/m and N m s/rad.
        symmetric: whether stiffness and damping are in axes half-way between F's and G's, turned from F by theta / 2.
    """

    frame_F: Frame
    frame_G: Frame
    stiffness: ArrayLike
    damping: ArrayLike = (0.0,) * 6
    symmetric: bool = False

    @property
    def resists_turns(self) -> bool:
        """Whether a turn meets forces or moments."""
        first = 0 if self.symmetric else 3  # half-way axes turn with theta
        return any(self._matrix(name)[first:].any() for name in ("stiffness", "damping"))

    def check(self) -> None:
        """Raise SceneError for matrices that store or dissipate a negative energy, and turns of a point mass."""
        refuse_no_truth(symmetric=self.symmetric)
        self._matrix("stiffness")
        self._matrix("damping")
        refuse_turn(self.frame_F, f"{self.what}: acts in the axes of F")
        if self.resists_turns:
            refuse_turn(self.frame_G, f"{self.what}: resists turns")

    def assemble(self, table: ElementTable) -> None:
        """One row."""
        numbers = np.concatenate([self._matrix(name).ravel() for name in ("stiffness", "damping")])
        data = table.numbers(numbers)
        f, g = table.frame(self.frame_F), table.frame(self.frame_G)
        kind = HALFWAY_BUSHING if self.symmetric else BUSHING
        table.element(kind, self.what, f=f, g=g, data=data, acts=bool(numbers.any()))

    def _matrix(self, name: str) -> NDArray[np.float64]:
        return semidefinite_matrix(getattr(self, name), f"{self.what}: {name}")
