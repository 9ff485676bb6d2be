"""Lie-group generalized-alpha for trees and, in stabilised index-2 or in index-3 form, for closed loops.

Order 2; dissipation at high frequency set by the spectral radius rho.  Variable steps keep the
order because the auxiliary acceleration is carried over at its own instant.  Sources: Chung &
Hulbert 1993; Hilber, Hughes & Taylor 1977; Wood, Bossak & Zienkiewicz 1980; Bruels, Cardona &
Arnold 2012 (Lie group); Arnold & Hante 2017 (stabilised index-2 form).
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from flexmbd.errors import SceneError
from flexmbd.given import checked
from flexmbd.integrate import state as st
from flexmbd.integrate.alpha.implicit_steps import implicit_stepper
from flexmbd.integrate.alpha.relation import RelationChoice
from flexmbd.integrate.controller import Stepper
from flexmbd.integrate.interior_support import refuse_explicit_only, refuse_passes
from flexmbd.multibody.bodies.continuum_body import Scheme
from flexmbd.multibody.kernels.base.arrays import Work
from flexmbd.multibody.plan.compiled_scene import CompiledScene

ORDER = 2

_LEAST_DAMPED = 0.5  # spectral radius of Hilber's, Hughes' and Taylor's most damped method, alpha = 1/3


class AlphaFamily(Enum):
    """Whose alpha_m and alpha_f of the spectral radius.

    ``CHUNG_HULBERT`` damps least of low frequencies; ``HILBER_HUGHES_TAYLOR`` is HHT-alpha, with alpha_m = 0 and
    alpha = alpha_f = (1 - rho) / (1 + rho), at most 1/3; ``WOOD_BOSSAK_ZIENKIEWICZ`` has alpha_f = 0.
    """

    CHUNG_HULBERT = "Chung and Hulbert"
    HILBER_HUGHES_TAYLOR = "Hilber, Hughes and Taylor"
    WOOD_BOSSAK_ZIENKIEWICZ = "Wood, Bossak and Zienkiewicz"


@checked()
@dataclass(frozen=True)
class GeneralizedAlpha:
    """Choice of the method.

    Attributes:
        rho: the spectral radius at infinite frequency, in [0, 1]: 1 does not dissipate, smaller values damp what the
            step does not resolve.  Of HHT-alpha it lies in [1/2, 1].
        index: 2 closes loops at the level of positions and of velocities, 3 at that of positions alone, with fixed
            steps only.
        family: ``fm.AlphaFamily``, that of Chung and Hulbert by default.

    Raises:
        SceneError: rho lies outside, or there is no such index.
    """

    rho: float = 0.8
    index: int = 2
    family: AlphaFamily = AlphaFamily.CHUNG_HULBERT

    def __post_init__(self) -> None:
        if not 0.0 <= self.rho <= 1.0:
            raise SceneError(f"rho must lie between 0 and 1, got {self.rho}")
        if self.index not in (2, 3):
            raise SceneError(f"generalized-alpha has an index of 2 or 3, got {self.index}")
        if self.family is AlphaFamily.HILBER_HUGHES_TAYLOR and self.rho < _LEAST_DAMPED:
            raise SceneError(
                f"HHT-alpha has a rho between {_LEAST_DAMPED} (alpha = 1/3) and 1, got {self.rho}: rho = (1 - alpha) / "
                "(1 + alpha); to damp more take fm.AlphaFamily.CHUNG_HULBERT"
            )

    @property
    def name(self) -> str:
        """How ``explain`` calls the method."""
        form = ", index 3" if self.index == 3 else ""
        whose = "" if self.family is AlphaFamily.CHUNG_HULBERT else f" of {self.family.value}"
        return f"generalized-alpha{whose}, rho = {self.rho:g}, order {ORDER}{form}"

    @property
    def order(self) -> int:
        """Order of positions, velocities and multipliers."""
        return ORDER

    def check(self, scene: CompiledScene) -> None:
        """Runs every scene, but that bodies with history must solve for a step's end, with no augmented Lagrangian."""
        refuse_explicit_only(scene, self.name)
        refuse_passes(scene, self.name)

    def stepper(self, scene: CompiledScene, state: st.State, groups: st.Groups, work: Work) -> Stepper:
        """See ``integrate.protocol.Integrator``.

        Raises:
            SceneError: error control is asked of index 3, whose velocities jump with the step.
        """
        if self.index == 3 and state.counts[st.FIXED_STEP] == 0 and len(scene.plan.rows) > 0:
            raise SceneError("generalized-alpha of index 3 has no error control: give a step h, or take index=2")
        scheme = Scheme(*self.coefficients())
        return implicit_stepper(scene, state, groups, work, relation_of(self), index=self.index, scheme=scheme)

    def coefficients(self) -> tuple[float, float, float, float]:
        """alpha_m, alpha_f, beta, gamma (Chung & Hulbert 1993, eq. 17, 18, 20, 25)."""
        rho = self.rho
        alpha_m, alpha_f = {
            AlphaFamily.CHUNG_HULBERT: ((2.0 * rho - 1.0) / (rho + 1.0), rho / (rho + 1.0)),
            AlphaFamily.HILBER_HUGHES_TAYLOR: (0.0, (1.0 - rho) / (1.0 + rho)),
            AlphaFamily.WOOD_BOSSAK_ZIENKIEWICZ: ((rho - 1.0) / (rho + 1.0), 0.0),
        }[self.family]
        gamma = 0.5 + alpha_f - alpha_m
        return alpha_m, alpha_f, 0.25 * (gamma + 0.5) ** 2, gamma


def relation_of(method: GeneralizedAlpha) -> RelationChoice:
    """What its steps are: one stage, which remembers the auxiliary acceleration."""
    return RelationChoice(0, method.coefficients(), 1, 1)
