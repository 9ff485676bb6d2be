"""A body between frames at rest: in balance with the frames where they are, and its linear equations about that."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum.finite_elements.interface import AveragedInterface
from flexmbd.continuum.history.nonlinear_model import NonlinearModel
from flexmbd.continuum.interior.implicit_contacts import ImplicitContacts
from flexmbd.continuum.interior.linear_interior import linear_equations
from flexmbd.continuum.interior.loads_in_motion import LoadsInMotion
from flexmbd.continuum.interior.nodal_solution import NodalSolution
from flexmbd.continuum.interior.step_equations import NodalState, RestEquations
from flexmbd.errors import SceneError
from flexmbd.multibody.bodies.continuum_body import FrameMotion
from flexmbd.multibody.interiors.steady import InteriorModes, LinearInterior

FloatArray = NDArray[np.float64]

#: `Scheme.slopes` at rest: displacements cause no accelerations.
_AT_REST = (np.inf, 1.0)


@dataclass(frozen=True, eq=False)
class RestingBody:
    """The balance that was found.

    Attributes:
        x: (local nodes, 3) m, inertial.
        increment: (local dofs,) m, displacement since the last accepted step.
        load: (owned nodes, 3) N, in inertial axes, that acts there.
        wrenches, slopes: as of `SteadyInterior.equilibrate`.
    """

    x: FloatArray
    increment: FloatArray
    load: FloatArray
    wrenches: FloatArray
    slopes: FloatArray


def balance_at_rest(
    nodes: NodalSolution, loads: LoadsInMotion, t: float, motion: FrameMotion, *, guess: FloatArray, gravity: FloatArray
) -> RestingBody:
    """Find it under the loads at t (s), from a guess (local dofs,) m of the increment. Collective."""
    body, axes = nodes.body, nodes.axes(motion)
    apparent = np.zeros_like(body.layout.node_x) - gravity
    trial = loads.at(loads.applied.values(t), axes)
    at_rest = RestEquations(body, axes.to_body(nodes.inertia(apparent)), trial, nodes.round_off)
    solution = nodes.solve(guess, motion, axes, at_rest)
    x: FloatArray = axes.positions(solution.increment)
    response = nodes.response(solution, at_rest, motion, x=x, apparent=apparent, slopes=_AT_REST)
    force = axes.to_inertial(trial.force(solution.increment))
    return RestingBody(x, solution.increment, force, response.wrenches, response.slopes)


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
    return linear_equations(
        nodes.frames,
        motion,
        internal=axes.to_inertial(internal) - dead_load,
        dead_load=dead_load,
        couples=nodes.bonds.turns.wrenches(internal, motion.R, axes.R),
        x=now.x,
        apparent_acceleration=np.zeros_like(now.x) - gravity,
        modes=modes,
        prescribed=nodes.fixed,
    )


def refuse_restless(body: NonlinearModel, contacts: ImplicitContacts) -> None:
    """Refuse bodies whose state at rest is not found. Not collective.

    Raises:
        SceneError: it has averaged interfaces alone, touches something, or its stress depends on rates.
    """
    if all(isinstance(found, AveragedInterface) for found in body.interfaces):
        raise SceneError(
            "it has averaged interfaces alone, which hold no node, and at rest no inertia holds it: its "
            "equilibrium is found only with a rigid interface (Coupling.RIGID)"
        )
    if contacts.touches:
        raise SceneError(
            f"its surface touches something (contact {contacts.touches[0].name!r}): its state at rest is not "
            "searched for with contacts yet, nor is it linearised with them. Let it come to rest in a simulation"
        )
    if body.is_rate_dependent:
        raise SceneError(
            f"{body.form_name} has a stress that depends on rates: its state at rest and its linear response "
            "depend on the loading's duration. Let it come to rest in a simulation"
        )
