"""Newton's iteration of a Radau IIA step, with old factors while they serve."""

from __future__ import annotations

from flexmbd.integrate import state as st
from flexmbd.integrate.newton_control import (
    CONVERGED,
    NOT_FINITE,
    TOO_SLOW,
    contraction_to_remember,
    count_solved_step,
    expected_contraction,
    give_up_old_factors,
    judge,
)
from flexmbd.integrate.radau.coefficients import STAGES
from flexmbd.integrate.radau.end import close_end, place_end
from flexmbd.integrate.radau.matrix import correct_stages, factor_step, take_tangent
from flexmbd.integrate.radau.row_transforms import choose_stage, transform_stage_rows
from flexmbd.integrate.radau.sparse_stages import is_sparse
from flexmbd.integrate.radau.stages import (
    evaluate_stage,
    place_stages,
    predict_stages,
    put_stage,
)
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.elements.changing_stiffness import stiffness_change
from flexmbd.multibody.kernels.inverse_dynamics.letting_go import count_touching
from flexmbd.round_off import ROUND_OFF

MAX_ITERATIONS = 10  # with error control, which can take a smaller step instead
_MAX_FIXED = 20
_RENEW = 0.05  # a slower contraction than this renews the tangent for the next step
_ROUND_OFF = 10.0 * ROUND_OFF  # of the scales: transformed stages sum more
_RENEWALS = 8  # steps at least that take a new tangent with new factors after an old one failed
_MIDDLE = STAGES // 2
_TRANSFORMED = 3  # attempts before the two that transform the rows of the stages, from both predictors
_SWEEPS = 3  # of rotations at the first guess


@kernel
def _stiffness_change(plan, work, scratch):
    """The largest change of an element's stiffness since the tangent was taken, as a share, at any stage.

    Factors that hold a contact which the machine has left correct next to nothing, however much is wrong.
    """
    largest = 0.0
    for i in range(STAGES):
        change = stiffness_change(
            plan, work, scratch.scale_x, scratch.x[i], scratch.v[i], scratch.tangent_stiffness
        )
        largest = max(largest, change)
    return largest


@kernel
def _noise_of_velocities(plan, scratch, h):
    """The corrections over their scales that round-off of positions leaves in velocities.

    Where stiff forces answer round-off of a position, a step moves it back, within h.
    """
    most = 0.0
    for j in range(plan.free.shape[0]):
        k = plan.free[j]
        most = max(most, scratch.scale_x[k] / scratch.scale_v[k])
    return ROUND_OFF * most / h


@kernel
def _holds_what_is_gone(plan, work, state, scratch, most):
    """Write ``s.touched`` and ``s.gaps``; whether the tangent holds a contact that touches at ``most`` stages or less.

    Its corrections are small there, however much is wrong.
    """
    gone = False
    scratch.touched[:] = 0.0
    for i in range(STAGES if scratch.touched.shape[0] > 0 else 0):
        put_stage(plan, work, state, scratch, i)  # it was evaluated before it was corrected last
        count_touching(plan, work, scratch.x[i], scratch.v[i], scratch.touched, scratch.gaps[i])
    for i in range(scratch.touched.shape[0]):
        gone = gone or (scratch.tangent_touched[i] > 0.0 and scratch.touched[i] <= most)
    return gone


@kernel
def _is_believed(plan, work, state, scratch, attempt, known):
    """Whether stages that converged are believed: the tangent holds no contact that is gone.

    An old tangent must hold at all stages; a new one, of a guess that was wrong, at any, while there is another guess.
    """
    if not _holds_what_is_gone(plan, work, state, scratch, STAGES - 1 if attempt == 0 else 0):
        return True
    scratch.memory.tangent_serves[0] = 0
    return not (attempt == 0 or (attempt == 1 and known))


@kernel
def _iterate(plan, work, state, scratch, h, tolerance, last):
    """Iterate with the factors at hand; whether the stages converged.

    ``last``: no other attempt follows, and what stalls at round-off of velocities has converged.
    """
    before = 0.0
    contraction = expected_contraction(scratch.memory.contraction[0])
    if scratch.tangent_stiffness.shape[0] > 0:
        contraction = max(contraction, _stiffness_change(plan, work, scratch))
    # transformed rows depend on where the stages were: only later corrections show the contraction
    shows = 3 if scratch.uses_transform[0] == 1 else 1
    most = _MAX_FIXED if state.counts[st.FIXED_STEP] == 1 else MAX_ITERATIONS
    noise = max(_ROUND_OFF, _noise_of_velocities(plan, scratch, h)) if last else _ROUND_OFF
    for iteration in range(most):
        for i in range(STAGES):
            evaluate_stage(plan, work, state, scratch, i)
            if scratch.uses_transform[0] == 1 and not transform_stage_rows(plan, work, scratch, i):
                return False
        state.counts[st.ITERATIONS] += 1
        scratch.memory.newton_iterations[0] = iteration + 1
        correct_stages(plan, scratch, h)
        size = place_stages(plan, state, scratch, h)
        verdict, contraction = judge(size, before, contraction, 0.0, tolerance, noise, most - 1 - iteration)
        if verdict == CONVERGED:
            scratch.memory.contraction[0] = contraction_to_remember(contraction, iteration + 1)
            return True
        if verdict == NOT_FINITE or (verdict == TOO_SLOW and iteration >= shows):
            return False
        before = size
    return False


@kernel
def solve_step(plan, work, state, scratch, h, tolerance):
    """Solve the stages with the old factors where they still serve, with new ones otherwise.

    Returns whether it converged; if so ``scratch`` holds the stages, the last being the step's end.
    """
    known = scratch.memory.polynomial_known[0] == 1
    renew = scratch.memory.renewals[0] > 0
    transforms = plan.rows.shape[0] > 0 and not is_sparse(scratch)
    attempts = _TRANSFORMED + 2 if transforms else _TRANSFORMED
    for attempt in range(attempts):
        new_factors = scratch.memory.step_factored[0] != h
        if attempt == 0 and (scratch.memory.tangent_serves[0] == 0 or (new_factors and renew)):
            continue
        # these differ from the attempts that follow by the predictor alone
        if not known and (attempt == 2 or attempt == _TRANSFORMED):
            continue
        predict_stages(plan, state, scratch, h, known and attempt != 2 and attempt != _TRANSFORMED + 1)
        scratch.local[:, :] = 0.0
        for _ in range(_SWEEPS if scratch.quaternions.shape[0] > 0 else 1):
            place_stages(plan, state, scratch, h)
        stage = _MIDDLE
        if attempt >= _TRANSFORMED:
            stage = choose_stage(plan, work, state, scratch)
            if stage < 0:
                continue
        if attempt > 0:
            scratch.memory.contraction[0] = 1.0
            if not take_tangent(plan, work, state, scratch, stage):
                continue
        if scratch.memory.step_factored[0] != h and not factor_step(plan, state, scratch, h):
            state.counts[st.OUTCOME] = st.RANK_LOST
            continue
        scratch.uses_transform[0] = 1 if attempt >= _TRANSFORMED else 0
        last = attempt == (attempts - 1 if known else attempts - 2)
        solved = _iterate(plan, work, state, scratch, h, tolerance, last)
        if not (solved and _is_believed(plan, work, state, scratch, attempt, known)):
            if attempt == 0:
                give_up_old_factors(scratch.memory, _RENEWALS)
            continue
        if plan.rows.shape[0] > 0:
            if not close_end(plan, work, state, scratch, h, tolerance, attempt == 0):
                continue
        else:  # the stages were evaluated before they were corrected last
            place_end(plan, work, state, scratch)
        slow = scratch.memory.newton_iterations[0] > 1 and scratch.memory.contraction[0] > _RENEW  # as measured
        if slow or attempt >= _TRANSFORMED:
            scratch.memory.tangent_serves[0] = 0
        count_solved_step(scratch.memory, renew, attempt == 0)
        return True
    scratch.memory.tangent_serves[0] = 0
    return False
