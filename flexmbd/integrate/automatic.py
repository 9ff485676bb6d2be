"""Choice of an integrator for a scene when the user names none."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

from flexmbd.errors import SceneError
from flexmbd.integrate.alpha.generalized_alpha import GeneralizedAlpha
from flexmbd.integrate.explicit.central_difference import CentralDifference
from flexmbd.integrate.explicit.explicit_runge_kutta import ExplicitRungeKutta
from flexmbd.integrate.explicit.tableau import Pair
from flexmbd.integrate.machine_rates import MachineRates, machine_rates, rates_of_many
from flexmbd.integrate.moreau.moreau_jean import MoreauJean
from flexmbd.integrate.predicted_cost import CENTRAL, ORDER_5, ORDER_8, RADAU, RADAU_GRIPPED, StepModel, counts
from flexmbd.integrate.protocol import Integrator
from flexmbd.integrate.radau.radau_iia import RadauIIA
from flexmbd.multibody.bodies.continuum_body import ImplicitInterior
from flexmbd.multibody.interiors.scene_interiors import Interiors
from flexmbd.multibody.kernels.elements.element import Behaviour, Stiffness
from flexmbd.multibody.kernels.reading.force_tables import force_elements, has_hard_contacts, has_hard_groups
from flexmbd.multibody.plan.compiled_scene import CompiledScene
from flexmbd.multibody.start.consistent_start import Start

_TIGHT = 1e-4  # rtol from which the pair of order 8 costs less than that of order 5
_PAIRS = {Pair.DORMAND_PRINCE_5: ORDER_5, Pair.DORMAND_PRINCE_8: ORDER_8}
_LARGE = 300  # velocities above which the machine's vibrations are not all computed


@dataclass(frozen=True)
class IntegratorChoice:
    """An integrator, and the reason for its choice.

    Attributes:
        method: the integrator.
        why: the reason in words, for ``explain``.
        explicit_steps: (1/s), what the stability of 8(5,3) asks for where Radau IIA was chosen against it; infinite
            elsewhere.
    """

    method: Integrator
    why: str
    explicit_steps: float = math.inf


def choose(start: Start, *, t: float, rtol: float, h: float | None) -> IntegratorChoice:
    """Choose an integrator for a scene at its consistent start at time ``t`` (s).

    Fixed steps: generalized-alpha, which stays stable whatever they do not resolve.  Error control: an explicit pair
    where nothing in the scene can be stiff; with modes, springs, exact beams, stops or friction the method that is
    predicted to take least time (``predicted_cost``); Radau IIA where users' laws may be stiff.
    Hard contacts leave Moreau's and Jean's method.  Bodies with history leave generalized-alpha, or central differences
    where an interior can step explicitly alone.
    """
    if start.scene.interiors is not None:
        return _with_history(start.scene.interiors)
    if has_hard_contacts(start.scene.plan):
        told = "hard contacts, which it alone solves for" if h is not None else "hard contacts: give its step, h=1e-3"
        return IntegratorChoice(MoreauJean(), told)
    if h is not None:
        return IntegratorChoice(GeneralizedAlpha(), "fixed steps, which may leave vibrations unresolved")
    elements = dict.fromkeys(force_elements(start.scene.plan).behaviour)
    unseen = ", ".join(dict.fromkeys(one.name for one in elements if one.stiffness is Stiffness.UNSEEN))
    if unseen:
        return IntegratorChoice(RadauIIA(), f"stiff: {unseen}")
    elastic = len(start.scene.plan.flex) > 0
    gripped = any(one.grip is not None for one in elements)
    long = Pair.DORMAND_PRINCE_8
    pairs = [long] if elastic or gripped or rtol <= _TIGHT else [Pair.DORMAND_PRINCE_5, long]
    if not elastic and not gripped and not any(one.stiffness is Stiffness.SEEN for one in elements):
        return IntegratorChoice(ExplicitRungeKutta(pairs[0]), f"nothing stiff, rtol = {rtol:g}")
    rates = rates_of_many(start, t) if start.scene.nv > _LARGE else machine_rates(start, t)
    if rates is None:
        return IntegratorChoice(RadauIIA(), f"stiff: {_in_a_large_machine(start, elements)}")
    return _cheapest(start, rates, pairs, rtol=rtol)


def locates_impacts(method: Integrator, scene: CompiledScene) -> bool:
    """Whether a scene has hard contacts that a method does not solve for, so that a run locates their impacts."""
    return has_hard_contacts(scene.plan) and not isinstance(method, MoreauJean)


def check_method(method: Integrator, scene: CompiledScene, *, locates: bool = False) -> None:
    """Raise SceneError where a method cannot run a scene, with one that can.

    ``locates``: whether who steps locates impacts, which only contacts of pairs have.
    """
    method.check(scene)
    if locates_impacts(method, scene) and not (locates and not has_hard_groups(scene.plan)):
        raise SceneError(
            f"{method.name} does not know the hard contacts of this scene (fm.contact.Hard), which act by impulses; "
            "take integrator=fm.MoreauJean() with a step h=..., or a smooth law as fm.contact.PowerLaw; by error "
            "control, simulate(..., rtol=) without h, it finds the impacts of single spheres and corners that do not "
            "come to rest"
        )


def _cheapest(start: Start, rates: MachineRates, pairs: Sequence[Pair], *, rtol: float) -> IntegratorChoice:
    """The method that is predicted to take least time, of explicit pairs, Radau IIA and central differences.

    These are weighed with elastic bodies alone: of rigid machines their order is too low.
    """
    plan = start.scene.plan
    machine = counts(plan)
    gripping = list(dict.fromkeys(one.name for one in force_elements(plan).behaviour if one.grip is not None))
    radau = RADAU_GRIPPED if gripping and not len(plan.flex) else RADAU
    weighed: list[tuple[Integrator, StepModel]] = [(ExplicitRungeKutta(pair), _PAIRS[pair]) for pair in pairs]
    weighed.append((RadauIIA(), radau))
    if len(plan.flex):
        weighed.append((CentralDifference(), CENTRAL))
    costs = [1e-6 * model.steps(rates, rtol) * machine.step(model) for _, model in weighed]
    told = ", ".join(f"{method.name} {cost:.2g}" for (method, _), cost in zip(weighed, costs, strict=True))
    method, model = weighed[int(np.argmin(costs))]
    steps = model.steps(rates, rtol)
    limited = "stability" if steps * model.reach <= rates.fastest * (1.0 + 1e-12) else "accuracy"
    fastest = f"{'rates' if gripping else 'vibrations'} up to {rates.fastest:.3g} 1/s"
    held = f", under the motion's load on {', '.join(gripping)}," if gripping else ""
    why = f"{fastest}{held} in a motion of {rates.motion:.3g} 1/s, rtol = {rtol:g}"
    said = f"{why}; predicted s a simulated second at equal errors: {told}; its steps are limited by {limited}"
    stepped_over = isinstance(method, RadauIIA) and rates.fastest > 0.0
    return IntegratorChoice(method, said, rates.fastest / ORDER_8.reach if stepped_over else math.inf)


def _with_history(interiors: Interiors) -> IntegratorChoice:
    """Implicit where all interiors can be; else explicit."""
    if all(isinstance(body.interior, ImplicitInterior) for body in interiors.bodies):
        return IntegratorChoice(GeneralizedAlpha(), "bodies with history, whose interiors are solved for")
    return IntegratorChoice(CentralDifference(), "bodies with history, whose interiors step explicitly")


def _in_a_large_machine(start: Start, elements: Collection[Behaviour]) -> str:
    """What may be stiff, in words, where the machine's rates are not known."""
    if len(start.scene.plan.flex):
        return "modes of flexible bodies in a large machine"
    stiff = [one.name for one in elements if one.stiffness is Stiffness.SEEN or one.grip is not None]
    return f"{', '.join(dict.fromkeys(stiff))} in a large machine"
