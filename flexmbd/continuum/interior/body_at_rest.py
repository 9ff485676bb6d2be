"""A body between frames at rest: in balance with the frames where they are, and its linear equations about that."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum.finite_elements.interface import AveragedInterface
from flexmbd.continuum.history.nonlinear_model import NonlinearModel
from flexmbd.continuum.interior.frame_columns import BalancedNodes
from flexmbd.continuum.interior.linear_interior import linear_equations
from flexmbd.continuum.interior.loads_in_motion import LoadsInMotion
from flexmbd.continuum.interior.nodal_solution import NodalSolution
from flexmbd.continuum.interior.step_equations import NodalState, RestEquations, StepEnd
from flexmbd.errors import SceneError
from flexmbd.multibody.bodies.continuum_body import FrameMotion
from flexmbd.multibody.interiors.steady import InteriorModes, LinearInterior

FloatArray = NDArray[np.float64]

#: `Scheme.slopes` at rest: displacements cause no accelerations.
_AT_REST = (np.inf, 1.0)


def balance_at_rest(
    nodes: NodalSolution, loads: LoadsInMotion, now: NodalState, t: float, motion: FrameMotion, *, guess: FloatArray,
    gravity: FloatArray,
) -> tuple[StepEnd, FloatArray, FloatArray]:
    """Find it under the loads at t (s), from a guess (local dofs,) m of the increment since ``now``. Collective.

    Returns:
        The state at rest; wrenches and slopes as of `SteadyInterior.equilibrate`.
    """
    body, axes = nodes.body, nodes.axes(motion)
    still = np.zeros_like(body.layout.node_x)
    trial = loads.at(loads.applied.values(t), axes)
    at_rest = RestEquations(body, axes.to_body(nodes.inertia(still - gravity)), trial, nodes.round_off)
    solution = nodes.solve(guess, motion, axes, at_rest)
    x: FloatArray = axes.positions(solution.increment)
    response = nodes.response(solution, at_rest, motion, x=x, apparent=still - gravity, slopes=_AT_REST)
    turns = None
    if nodes.turning is not None and now.turns is not None:
        turns = nodes.turning.rested(now.turns, solution.increment, axes.R)
    state = NodalState(t, x, still + motion.v[0], still, still, 0.0, turns)
    end = StepEnd(state, solution.increment, axes.to_inertial(trial.force(solution.increment)), (), 0.0, motion.R)
    return end, response.wrenches, response.slopes


def linear_at_rest(
    nodes: NodalSolution, loads: LoadsInMotion, now: NodalState, motion: FrameMotion, *, modes: InteriorModes,
    gravity: FloatArray,
) -> LinearInterior:
    """See `SteadyInterior.linear`, about the last accepted state. Collective.

    Raises:
        SceneError: a load follows its surface.
    """
    if loads.applied.any_follow:
        raise SceneError(
            "a load that follows its surface is left out of the linear equations of a body with history; linearise "
            "without it, or with follows=False"
        )
    body, axes = nodes.body, nodes.axes(motion)
    dead_load = loads.after(now.t, now.x)
    internal = body.force(np.zeros(body.layout.n_local), dt=0.0)
    apparent = np.zeros_like(now.x) - gravity
    at = BalancedNodes(
        motion, axes.to_inertial(internal) - dead_load + nodes.inertia(apparent), now.x, apparent, dead_load=dead_load,
        slopes=_AT_REST, couples=nodes.bonds.turns.wrenches(internal, motion.R, axes.R),
    )  # fmt: skip
    return linear_equations(nodes.frames, at, modes=modes, prescribed=nodes.fixed, turns=now.turns)


def refuse_restless(body: NonlinearModel, contacts: Sequence[str]) -> None:
    """Refuse bodies whose state at rest is not found; contacts: names of theirs. Not collective.

    Raises:
        SceneError: it has averaged interfaces alone, touches something, or its stress depends on rates.
    """
    if all(isinstance(found, AveragedInterface) for found in body.interfaces):
        raise SceneError(
            "it has averaged interfaces alone, which hold no node, and at rest no inertia holds it: its "
            "equilibrium is found only with a rigid interface (Coupling.RIGID)"
        )
    if contacts:
        raise SceneError(
            f"its surface touches something (contact {contacts[0]!r}): its state at rest is not "
            "searched for with contacts yet, nor is it linearised with them. Let it come to rest in a simulation"
        )
    if body.is_rate_dependent:
        raise SceneError(
            f"{body.form_name} has a stress that depends on rates: its state at rest and its linear response "
            "depend on the loading's duration. Let it come to rest in a simulation"
        )
