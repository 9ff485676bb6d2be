"""Steps of all methods that are a ``relation``: the attempt, the loop over steps, what a simulation gets of them."""

from __future__ import annotations

from dataclasses import dataclass

from flexmbd.integrate import state as st
from flexmbd.integrate.alpha.interiors import ImplicitInteriors
from flexmbd.integrate.alpha.local_error import local_error
from flexmbd.integrate.alpha.relation import RelationChoice
from flexmbd.integrate.alpha.step_history import accept, prepare_step, solve_stages
from flexmbd.integrate.alpha.workspace import AlphaWorkspace, new_workspace
from flexmbd.integrate.controller import Rule, Stepper, make_advance, next_step, settle
from flexmbd.integrate.jumps import take_jump
from flexmbd.multibody.bodies.continuum_body import Scheme
from flexmbd.multibody.kernels.base.array_struct import ArrayStruct
from flexmbd.multibody.kernels.base.arrays import Plan, Work
from flexmbd.multibody.kernels.base.compiling import entry_kernel, kernel
from flexmbd.multibody.kernels.base.deferred import FLAG, deferred_kernel
from flexmbd.multibody.plan.compiled_scene import CompiledScene

#: How steps of order 2 follow from their errors: they change seldom, for each change costs a factorisation.
RULE = Rule(exponent=0.5, shortest=1.0 / 64.0)


@dataclass(frozen=True, eq=False)
class ImplicitSteps(ArrayStruct):
    """Arguments of an attempt."""

    plan: Plan
    work: Work
    scratch: AlphaWorkspace


def implicit_stepper(
    scene: CompiledScene, state: st.State, groups: st.Groups, work: Work, choice: RelationChoice, *,
    index: int = 2, order: int = 2, scheme: Scheme | None = None,
) -> Stepper:
    """See ``integrate.protocol.Integrator``.

    Args:
        scene: what moves.
        state: where it stands.
        groups: scales of its error.
        work: of its kernels.
        choice: the relation.
        index: 2 closes loops at the level of positions and of velocities, 3 at that of positions alone.
        order: of the method, by which steps follow from their errors.
        scheme: how bodies with history step along, where the scene has any.
    """
    interiors = scene.interiors
    scratch = new_workspace(scene.plan, work, scene.nx, scene.nv, choice, interiors=interiors is not None)
    memory = scratch.memory

    def drop_factors() -> None:
        memory.step_factored[0] = 0.0

    def begin() -> None:
        drop_factors()
        memory.index[0] = index
        memory.filters[0] = len(scene.plan.flex) > 0 or interiors is not None

    drop_factors()
    rule = RULE.replace(exponent=1.0 / order)
    if interiors is not None and scheme is not None:
        machine = ImplicitInteriors(interiors, scheme, rule, scene.plan, work, state, groups, scratch)
        return Stepper(machine.advance, begin, drop_factors, memory)
    loop = make_advance(advance, ImplicitSteps(scene.plan, work, scratch), rule, state, groups)
    return Stepper(loop, begin, drop_factors, memory)


@deferred_kernel(FLAG)
def _passes_jump(method, state, groups, h):
    """Whether an attempt whose error is too large is taken all the same, for it passes a jump (see ``jumps``)."""
    return take_jump(method.plan.free, state, groups, state.a, method.scratch.a, 1.0, h)


@kernel
def _attempt(method, state, groups, h):
    """An attempt at a step, see ``controller``."""
    plan = method.plan
    work = method.work
    scratch = method.scratch
    tolerance = prepare_step(state, groups, scratch, h)
    if settle(plan, state, solve_stages(plan, work, state, scratch, h, tolerance)):
        ratio = 0.0
        if state.counts[st.FIXED_STEP] == 0:
            ratio = local_error(plan, work, state, groups, scratch, h, state.numbers[st.RATE])
        if not ratio <= 1.0 and _passes_jump(method, state, groups, h):
            ratio = 1.0
        state.numbers[st.ERROR_RATIO] = ratio
        if ratio <= 1.0:
            accept(state, scratch, h)


@entry_kernel
def advance(method, rule, knots, state, groups, record):
    """Step until the end, a full record, or a failure; see ``controller``."""
    h = 0.0
    while True:
        h = next_step(method.plan, rule, knots, state, groups, record, h)
        if h == 0.0:
            return state.counts[st.OUTCOME]
        _attempt(method, state, groups, h)
