"""The arrays of a machine's kernels, set up as its integrator would."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import ExportError
from flexmbd.integrate import state as st
from flexmbd.integrate.alpha import implicit_steps
from flexmbd.integrate.alpha import workspace as alpha_layout
from flexmbd.integrate.alpha.generalized_alpha import GeneralizedAlpha, relation_of
from flexmbd.integrate.controller import NO_KNOTS, arrays_of
from flexmbd.integrate.explicit import explicit_runge_kutta
from flexmbd.integrate.explicit.explicit_runge_kutta import ExplicitRungeKutta, RungeKuttaMemory, new_method
from flexmbd.integrate.explicit.force_noise import no_force_noise
from flexmbd.integrate.explicit.loop_dynamics import new_loop_memory, set_row_scales
from flexmbd.integrate.explicit.tableau import TableauArrays
from flexmbd.multibody.bodies.body import Frame
from flexmbd.multibody.functions.breaks import find_breaks, jumps_of_rate
from flexmbd.multibody.kernels.base import kinds
from flexmbd.multibody.kernels.base.arrays import Plan, new_work
from flexmbd.multibody.kernels.reading.force_tables import force_elements, time_kinds
from flexmbd.multibody.kernels.tangent.residual_tangent import tangent, tangent_after_residual
from flexmbd.multibody.kernels.tangent.tangent_layout import new_tangent_work
from flexmbd.multibody.plan.compiled_scene import CompiledScene
from flexmbd.multibody.start.consistent_start import Start
from flexmbd.run.input_values import evaluate_inputs
from flexmbd.run.snapshot import new_snapshot

FloatArray = NDArray[np.float64]

#: The integrators that machines leave with.
Method = ExplicitRungeKutta | GeneralizedAlpha

#: The relative tolerance that rules Newton's iteration.
NEWTON = 1e-9

_SOME_STEPS = 1e4  # of a run whose length the host alone knows

#: One stage at the step's beginning, which moves nothing.
_STANDSTILL = TableauArrays(np.zeros((2, 1)), np.zeros(2), np.zeros((2, 2)), 0)


@dataclass(frozen=True)
class Call:
    """A kernel and its arguments."""

    kernel: Any
    arguments: tuple[Any, ...]


@dataclass(frozen=True)
class FrameCall:
    """A call of `frame_series` for one frame; its last argument takes what comes out."""

    frame: Frame
    call: Call


@dataclass(frozen=True, eq=False)
class Parts:
    """The arrays of a machine's kernels.

    Attributes:
        run: takes a step, for the record has room for one.
        refresh: a step of no motion that finds accelerations and reactions.
        state, plan: among their arguments.
        memory: arrays of the method's memory, which begin anew as they are.
        histories: those among them that begin as the accelerations.
        behind: kernels behind addresses: the array that holds one, and the call.
        frames: calls for outputs, which are added to.
        flows: the same, of ports.
        tangents: of model exchange: derivatives of the residual by accelerations, velocities, positions, each into
            the matrix that is its call's last argument.
        breaks: instants (s) at which steps end and begin anew.
        impulses: those at which the rate of a prescribed motion jumps.
    """

    run: Call
    refresh: Call
    state: st.State
    plan: Plan
    memory: tuple[np.ndarray, ...] = ()
    histories: tuple[FloatArray, ...] = ()
    behind: tuple[tuple[np.ndarray, Call], ...] = ()
    frames: list[FrameCall] = field(default_factory=list)
    flows: list[Call] = field(default_factory=list)
    tangents: tuple[Call, ...] = ()
    breaks: FloatArray = field(default_factory=lambda: np.zeros(0))
    impulses: FloatArray = field(default_factory=lambda: np.zeros(0))


def refuse_functions(scene: CompiledScene) -> None:
    """Refuse what no kernel computes: bodies with history, users' functions; and what fixed steps leave out: contacts.

    Raises:
        ExportError: naming them.
    """
    plan = scene.plan
    if scene.interiors is not None:
        names = ", ".join(body.name for body in scene.interiors.bodies)
        raise ExportError(
            f"bodies with history cannot be exported in an FMU ({names}): where they stay elastic, reduce them"
        )
    signals = {row.signal.name: None for row in scene.time_rows if row.signal is not None}
    if signals:
        raise ExportError(
            "controllers and states cannot be exported in an FMU, nor can signals that they set "
            f"({', '.join(signals)}): give the loads numbers, make them inputs, and compute these outside"
        )
    elements = force_elements(plan)
    touching = zip(elements.number, elements.behaviour, strict=True)
    contacts = [scene.element_names[k] for k, one in touching if one.lets_go]
    if contacts:
        raise ExportError(
            f"bodies that touch cannot be exported in an FMU ({contacts[0]}{', ...' if len(contacts) > 1 else ''}), "
            "whose fixed steps would pass impacts over: give a joint's end as a JointStop, or compute what touches "
            "outside, with a FrameForce as input"
        )
    given = time_kinds(plan)
    users = [scene.time_names[k] for k in np.flatnonzero((given == kinds.TIME_PYTHON) | (given == kinds.TIME_COMPILED))]
    users += [scene.element_names[k] for k in elements.number[elements.address != 0]]
    if users:
        raise ExportError(
            f"users' functions cannot be exported in an FMU ({', '.join(users)}): give numbers, fm.Table or fm.Sine, "
            "or make the force an input and compute it outside"
        )


def parts_of(start: Start, method: Method, h: float) -> Parts:
    """What the method's ``stepper`` sets up at a start, for fixed steps of at most h (s)."""
    scene = start.scene
    snapshot = new_snapshot(start, method, t_start=0.0, t_end=1.0, rtol=NEWTON, h=h)
    state, groups, work = snapshot.state, snapshot.groups, new_work(scene.plan)
    evaluate_inputs(scene, work, 0.0)
    plan = scene.plan.replace(lapack=np.zeros_like(scene.plan.lapack))  # addresses in this process
    breaks = find_breaks(scene.time_rows, scene.declared_breaks(), rtol=NEWTON, h=h)
    impulses = np.unique(np.concatenate([np.zeros(0), *(jumps_of_rate(row) for row in scene.time_rows)]))
    x, v, a, nu = (np.zeros((1, size)) for size in (scene.nx, scene.nv, scene.nv, len(plan.rows)))
    record = st.Record(np.zeros(1), x, v, a, nu, work)
    explicit = method if isinstance(method, ExplicitRungeKutta) else ExplicitRungeKutta()
    shared = plan, work, state, groups, record
    resting = _explicit(scene, explicit, _STANDSTILL, NO_KNOTS, shared)
    if isinstance(method, ExplicitRungeKutta):
        run = _explicit(scene, method, method.pair.tableau, breaks.knots, shared)
        return Parts(run, resting, state, plan, breaks=breaks.jumps, impulses=impulses)
    scratch = alpha_layout.new_workspace(plan, work, scene.nx, scene.nv, relation_of(method), dense=True)
    memory = scratch.memory
    memory.index[0] = method.index
    memory.filters[0] = len(plan.flex) > 0
    stepped = Call(tangent_after_residual, (
        plan, work, scratch.tangent, state.x, state.v, state.a, state.multipliers, 0.0, 0.0, 0.0, scratch.full_tangent
    ))  # fmt: skip
    scratch.kernels[:] = 0
    one = implicit_steps.ImplicitSteps(plan, work, scratch)
    run = Call(implicit_steps.advance, (one, implicit_steps.RULE, breaks.knots, state, groups, record))
    own = tuple(arrays_of(memory).values())
    histories = memory.before, memory.earlier, memory.earliest
    behind = ((scratch.kernels, stepped),)
    return Parts(run, resting, state, plan, own, histories, behind, breaks=breaks.jumps, impulses=impulses)


def refuse_unstable_step(start: Start, method: Method, h: float) -> None:
    """Raise SceneError where steps h (s) are beyond the method's stability in a run of some length."""
    snapshot = new_snapshot(start, method, t_start=0.0, t_end=_SOME_STEPS * h, rtol=NEWTON, h=h)
    work = new_work(start.scene.plan)
    evaluate_inputs(start.scene, work, 0.0)
    stepper = method.stepper(start.scene, snapshot.state, snapshot.groups, work)
    stepper.begin()
    stepper.refuse_step()


def with_tangents(parts: Parts, scene: CompiledScene) -> Parts:
    """The parts with the tangents for model exchange.

    Raises:
        ExportError: the machine is more than a system of first order in joint coordinates and velocities.
    """
    nv, more = scene.nv, []
    if len(parts.plan.rows) > 0:
        more.append("closed loops, whose constraints a solver of ordinary differential equations does not keep")
    if len(parts.plan.free) < nv:
        more.append("prescribed motions")
    if len(parts.state.x) != nv:
        more.append("joints whose position is a quaternion (Free, Spherical), or elements with memory")
    if len(parts.breaks) > 0:
        more.append("functions of time that jump or bend, which are events")
    if more:
        raise ExportError(f"this machine cannot be exported for model exchange, for it has {'; and '.join(more)}")
    work = parts.refresh.arguments[0].work
    state, sizes = parts.state, np.ones((2, nv))
    tangent_work = new_tangent_work(parts.plan, nv, sizes=sizes)
    calls = []
    for weights in ((0.0, 0.0, 1.0), (0.0, 1.0, 0.0), (1.0, 0.0, 0.0)):
        at = state.x, state.v, state.a, state.multipliers
        calls.append(Call(tangent, (parts.plan, work, tangent_work, *at, *weights, np.zeros((nv, nv)))))
    return replace(parts, tangents=tuple(calls))


def _explicit(
    scene: CompiledScene, choice: ExplicitRungeKutta, tableau: TableauArrays, knots: FloatArray, shared: tuple[Any, ...]
) -> Call:
    """A call of the loop over steps with an explicit method."""
    plan, work, state, groups, record = shared
    memory = RungeKuttaMemory(new_loop_memory(plan), no_force_noise())
    method = new_method(replace(scene, plan=plan), choice, tableau, memory, work)
    set_row_scales(scene, method.loops, state, work)
    return Call(explicit_runge_kutta.advance, (method, choice.rule, knots, state, groups, record))
