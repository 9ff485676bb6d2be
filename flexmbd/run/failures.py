"""Why a run stopped early: the codes of steppers, failures of users' functions and Ctrl-C, in words with remedies."""

from __future__ import annotations

import numpy as np

from flexmbd.errors import FlexmbdError, SceneError
from flexmbd.integrate import state as st
from flexmbd.multibody.joint.enforcement import AugmentedLagrangian
from flexmbd.multibody.kernels.base.arrays import Work
from flexmbd.multibody.kernels.reading.force_tables import friction_of_hard_contact
from flexmbd.multibody.plan.compiled_scene import CompiledScene
from flexmbd.run.stepping import Integration
from flexmbd.run.stopped import SimulationError, SimulationInterrupted
from flexmbd.run.trajectory import Trajectory

_NAMED = 4  # joints that a message names

#: Causes of a step's failure, and the remedies.
_CAUSES = {
    st.NOT_CONVERGED: (
        "left equations that Newton's iteration does not solve",
        "look for a force that changes abruptly with position or velocity, or a position that the machine cannot leave",
    ),
    st.RANK_LOST: (
        "met constraints that are independent no longer, or a singular matrix",
        "look for a singular position: bodies in one line or one plane, a joint turned to its limit",
    ),
    st.LOOPS_OPEN: (
        "led to loops that do not close",
        "look for the end of the mechanism's reach: a dead point that its motion or its loads drive it beyond",
    ),
    st.NOT_FINITE: (
        "led to no finite state",
        "look for a force without bound, or a body without mass in a direction in which it is pushed",
    ),
    st.INACCURATE: (
        "left an error above rtol",
        "look for a jump: of a force with time (declare it: breaks=), or with position or velocity (declare it: "
        "fm.Switched, smooth it, or set the velocities by an event); or for a force that grows without bound",
    ),
    st.ENDLESS_JUMPS: (
        "met one jump of accelerations after the other",
        "look for a law that jumps and holds the machine where it does, as dry friction at rest: smooth it (as "
        "fm.force.JointFriction is), or end the run there by an event with stop=True",
    ),
}


def refuse_stopped(scene: CompiledScene, integration: Integration, code: int, trajectory: Trajectory) -> None:
    """Raise the error of a stepper's code, if it did not reach its end."""
    if code == st.CALLBACK_FAILED or scene.callbacks.error is not None:
        raise _callback_failure(scene, integration.work, trajectory)
    if code == st.INTERIOR_FAILED and scene.interiors is not None:
        failure = scene.interiors.failure[-1]
        raise SimulationError(
            f"{failure}; what was computed up to t = {integration.t:.6g} s is in the error's trajectory", trajectory
        ) from failure
    if code not in (st.OUTPUT, st.DONE):
        raise SimulationError(_failure(scene, integration.state, code), trajectory)


def _callback_failure(scene: CompiledScene, work: Work, trajectory: Trajectory) -> BaseException:
    """The error of a user's function, with the time and what was computed."""
    message, error = scene.failure(work) or ("a user's function failed", SceneError("on another rank"))
    if isinstance(error, KeyboardInterrupt):
        return interrupted(trajectory)
    if not isinstance(error, Exception):
        return error
    failure = SimulationError(message, trajectory)
    failure.__cause__ = error
    return failure


def refuse_broken_off(error: FlexmbdError | KeyboardInterrupt | None, trajectory: Trajectory) -> None:
    """Raise the error of an event's function or action, or of Ctrl-C, between steps."""
    if isinstance(error, KeyboardInterrupt):
        raise interrupted(trajectory) from error
    if error is not None:
        raise SimulationError(str(error), trajectory) from error


def interrupted(trajectory: Trajectory) -> SimulationInterrupted:
    """The exception of Ctrl-C."""
    return SimulationInterrupted(
        f"interrupted at t = {trajectory.t[-1]:.6g} s; what was computed up to then is in the exception's trajectory",
        trajectory,
    )


def _failure(scene: CompiledScene, state: st.State, code: int) -> str:
    """Where, when and on what a simulation stopped."""
    t, h = state.numbers[st.TIME], state.numbers[st.STEP]
    if code == st.NOT_ENFORCED:
        return _left_open(scene, t)
    if code == st.PAINLEVE:
        return _painleve(scene, state)
    if code == st.BLOCKED:
        return (
            f"the simulation stopped at t = {t:.6g} s: {scene.element_names[int(state.counts[st.WORST])]} is closed by "
            "prescribed motions, and nothing gives way to an impulse; let a force or a spring drive what meets there, "
            "or end its motion before; what was computed up to then is in the error's trajectory"
        )
    worst = scene.velocity_names[int(state.counts[st.WORST])] if scene.nv else "nothing"
    why, remedy = _CAUSES[code]
    if state.counts[st.FIXED_STEP] == 1:
        why = f"the fixed step {h:.2e} s {why}"
        remedy = f"take a smaller h, or give rtol instead of h; else {remedy}"
    else:
        why = f"a step as short as {h:.2e} s still {why}"
    return (
        f"the simulation stopped at t = {t:.6g} s: {why}; the worst coordinate was {worst!r}; "
        f"{remedy}; what was computed up to then is in the error's trajectory"
    )


def _painleve(scene: CompiledScene, state: st.State) -> str:
    """That a contact slides in Painlevé's case, with its coefficient of friction and the angle."""
    number = int(state.counts[st.WORST])
    mu, angle = friction_of_hard_contact(scene.plan, number), float(np.rad2deg(state.numbers[st.ERROR_RATIO]))
    return (
        f"the simulation stopped at t = {state.numbers[st.TIME]:.6g} s: {scene.element_names[number]} slides in "
        f"Painlevé's case: a push along the normal moves its point at {angle:.4g} degrees to the normal, along the "
        f"slip, and friction of mu = {mu:.6g} then presses it the more the more it is pushed apart (from "
        f"{np.rad2deg(np.arctan2(1.0, mu)):.4g} degrees on), so that no force is right; take a smaller mu, or a "
        "smooth contact, fm.contact.PowerLaw(...); what was computed up to then is in the error's trajectory"
    )


def _left_open(scene: CompiledScene, t: float) -> str:
    """That repeated solutions did not close the joints that augmented Lagrangians hold, the softest first."""
    held = [(c.enforce, c.name) for c in scene.topology.closures if isinstance(c.enforce, AugmentedLagrangian)]
    held.sort(key=lambda one: one[0].stiffness)
    named = ", ".join(f"{name!r} (stiffness {enforce.stiffness:.4g} N/m)" for enforce, name in held[:_NAMED])
    more = f" and {len(held) - _NAMED} more" if len(held) > _NAMED else ""
    return (
        f"the simulation stopped at t = {t:.6g} s: repeated solutions do not close what augmented Lagrangians hold, "
        f"{named}{more}; they converge where the stiffness is above about mass / step^2: give a larger one, or take "
        "enforce=fm.Multipliers() or integrator=fm.RadauIIA(), which need none; what was computed up to then is in the "
        "error's trajectory"
    )
