"""Choice of an integrator for a scene when the user names none."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from flexmbd.integrate.alpha.generalized_alpha import GeneralizedAlpha
from flexmbd.integrate.explicit.central_difference import CentralDifference
from flexmbd.integrate.explicit.explicit_runge_kutta import ExplicitRungeKutta
from flexmbd.integrate.explicit.tableau import Pair
from flexmbd.integrate.protocol import Integrator
from flexmbd.integrate.radau.radau_iia import RadauIIA
from flexmbd.multibody.bodies.continuum_body import ImplicitInterior
from flexmbd.multibody.interiors.scene_interiors import Interiors
from flexmbd.multibody.kernels.base.arrays import new_work
from flexmbd.multibody.kernels.elements.element import Behaviour, Stiffness
from flexmbd.multibody.kernels.physics.time_functions import evaluate_times
from flexmbd.multibody.kernels.reading.force_tables import force_elements
from flexmbd.multibody.kernels.tangent.residual_tangent import tangent
from flexmbd.multibody.kernels.tangent.tangent_layout import new_tangent_work
from flexmbd.multibody.plan.scene_matrices import coordinate_sizes, fastest_rate
from flexmbd.multibody.start.consistent_start import Start

_TIGHT = 1e-4  # rtol from which the pair of order 8 costs less than that of order 5
_STIFF = 20.0  # rates of the machine's motion that an explicit step of its accuracy still takes in
_LARGE = 300  # velocities above which the eigenvalues of springs are not computed


@dataclass(frozen=True)
class IntegratorChoice:
    """An integrator, and the reason for its choice.

    Attributes:
        method: the integrator.
        why: the reason in words, for ``explain``.
    """

    method: Integrator
    why: str


def choose(start: Start, *, t: float, rtol: float, h: float | None) -> IntegratorChoice:
    """Choose an integrator for a scene at its consistent start at time ``t`` (s).

    Fixed steps: generalized-alpha, which stays stable whatever they do not resolve.  Error control:
    an explicit pair where nothing in the scene is stiff, Radau IIA where modes or springs are, and
    generalized-alpha where forces set in abruptly.  Bodies with history leave generalized-alpha, or central differences
    where an interior can step explicitly alone.
    """
    if start.scene.interiors is not None:
        return _with_history(start.scene.interiors)
    if h is not None:
        return IntegratorChoice(GeneralizedAlpha(), "fixed steps, which may leave vibrations unresolved")
    elements = dict.fromkeys(force_elements(start.scene.plan).behaviour)
    abrupt = [one.name for one in elements if one.abrupt]
    if abrupt:
        return IntegratorChoice(GeneralizedAlpha(), f"abrupt forces: {', '.join(abrupt)}")
    stiff = _stiffness(start, elements, t)
    if stiff:
        return IntegratorChoice(RadauIIA(), f"stiff: {stiff}")
    pair = Pair.DORMAND_PRINCE_8 if rtol <= _TIGHT else Pair.DORMAND_PRINCE_5
    return IntegratorChoice(ExplicitRungeKutta(pair), f"nothing stiff, rtol = {rtol:g}")


def _with_history(interiors: Interiors) -> IntegratorChoice:
    """Implicit where all interiors can be; else explicit."""
    if all(isinstance(body.interior, ImplicitInterior) for body in interiors.bodies):
        return IntegratorChoice(GeneralizedAlpha(), "bodies with history, whose interiors are solved for")
    return IntegratorChoice(CentralDifference(), "bodies with history, whose interiors step explicitly")


def _stiffness(start: Start, elements: Collection[Behaviour], t: float) -> str:
    """The stiff parts of the scene in words; empty if there are none."""
    plan = start.scene.plan
    if len(plan.flex):
        return "modes of flexible bodies"
    unseen = [one.name for one in elements if one.stiffness is Stiffness.UNSEEN]
    if unseen:
        return ", ".join(dict.fromkeys(unseen))
    if not any(one.stiffness is Stiffness.SEEN for one in elements):
        return ""
    if start.scene.nv > _LARGE:
        return "springs in a large machine"
    fastest, motion = _fastest_rate(start, t), _motion_rate(start)
    return f"springs and dampers of {fastest:.3g} 1/s" if fastest > _STIFF * motion else ""


def _fastest_rate(start: Start, t: float) -> float:
    """Largest eigenvalue (1/s) of the tree linearised about the start."""
    scene = start.scene
    plan, n = scene.plan, scene.nv
    sizes = np.stack([coordinate_sizes(scene), np.zeros(n)])
    work, tangent_work = new_work(plan), new_tangent_work(plan, n, sizes=sizes)
    evaluate_times(plan, t, work.time)
    parts = np.zeros((3, n, n))
    at_start = (start.x, start.v, start.a, start.multipliers)
    tangent(plan, work, tangent_work, *at_start, 1.0, 0.0, 0.0, parts[0])
    tangent(plan, work, tangent_work, *at_start, 0.0, 0.0, 1.0, parts[2])
    sizes[1] = sizes[0] * fastest_rate(parts[2], parts[0])
    tangent(plan, work, tangent_work, *at_start, 0.0, 1.0, 0.0, parts[1])
    free = np.ix_(plan.free, plan.free)
    stiffness, damping, mass = (part[free] for part in parts)
    k = len(plan.free)
    companion = np.zeros((2 * k, 2 * k))
    companion[:k, k:] = np.eye(k)
    companion[k:, :k] = -np.linalg.solve(mass, stiffness)
    companion[k:, k:] = -np.linalg.solve(mass, damping)
    return float(np.abs(np.linalg.eigvals(companion)).max(initial=0.0))


def _motion_rate(start: Start) -> float:
    """The machine's own rate (1/s) at the start."""
    scene = start.scene
    free = scene.plan.free
    size = scene.group_full[scene.group_of[free]]
    rates = np.maximum(np.abs(start.v[free]) / size, np.sqrt(np.abs(start.a[free]) / size))
    return float(rates.max(initial=0.0))
