"""A step's relation: how positions and velocities hang on the accelerations that are solved for, stage by stage.

At the end of each stage of a step forces balance, M a + C^T nu = f, and displacement u from the step's start, velocity
v and acceleration a there follow each other linearly:

    v_i = known + c_v a_i,    u_i = known + c_x a_i

What is known is a sum over v and a at the start, u, v and a of the stages before, and vectors that the method remembers
from step to step.  The weights are all that tells one method of this kind from another: generalized-alpha, composite
methods, backward differences, implicit Runge-Kutta methods with a stage at a time.  Newton's iteration, its matrix, the
closing of loops and the local error are the same.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexmbd.integrate import state as st
from flexmbd.multibody.kernels.base.array_struct import ArrayStruct
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.base.deferred import deferred_kernel
from flexmbd.multibody.kernels.base.native import call_relation
from flexmbd.multibody.kernels.physics.time_functions import evaluate_times

FloatArray = NDArray[np.float64]

#: Columns of a stage's displacement, velocity and acceleration among those of its point; that of the start comes first.
U, V, A = range(3)
POINT = 3

_SAME = 1e-12  # relative difference of weights that round-off makes: factors serve both


class RelationChoice(NamedTuple):
    """What a method says of its relation.

    address: of its compiled function, 0: generalized-alpha.  data: numbers that the function gets.
    stages: a step.  remembered: how many vectors are carried from step to step.
    """

    address: int
    data: tuple[float, ...]
    stages: int
    remembered: int


@dataclass(frozen=True, eq=False)
class Relation(ArrayStruct):
    """Weights of a step at hand, and what its stages have found.

    address, data: see ``RelationChoice``.  lengths: (2,) s, the step that the weights belong to and the one before, 0
    where none is remembered.  stage: (1,) the stage at hand.  nodes: (s,) ends of the stages in steps.
    position, velocity: (s, n) weights of u and v at the end of each stage, with n = 3 (s + 1) + r: u, v, a of the start
    and of the stages, then what is remembered.  remember: (r, n) weights of what is remembered next.
    points: (s - 1, 3, nv) u, v, a of the stages before the last.  reactions: (s - 1, m) their multipliers.
    known: (2, nv) u and v at the end of the stage at hand, but for what its acceleration adds.
    next: (r, nv) what is remembered next.
    """

    address: NDArray[np.int64]
    data: FloatArray
    lengths: FloatArray
    stage: NDArray[np.int64]
    nodes: FloatArray
    position: FloatArray
    velocity: FloatArray
    remember: FloatArray
    points: FloatArray
    reactions: FloatArray
    known: FloatArray
    next: FloatArray


def new_relation(choice: RelationChoice, nv: int, m: int) -> Relation:
    """Zeros for nv velocities and m constraint rows."""
    s, r, zeros = choice.stages, choice.remembered, np.zeros
    n = POINT * (s + 1) + r
    return Relation(
        address=np.array([choice.address]),
        data=np.array(choice.data, dtype=np.float64),
        lengths=zeros(2),
        stage=zeros(1, np.int64),
        nodes=zeros(s),
        position=zeros((s, n)),
        velocity=zeros((s, n)),
        remember=zeros((r, n)),
        points=zeros((s - 1, POINT, nv)),
        reactions=zeros((s - 1, m)),
        known=zeros((2, nv)),
        next=zeros((r, nv)),
    )


@kernel
def _generalized_alpha(data, h, before, nodes, u, v, memory):
    """Weights of generalized-alpha (Arnold & Bruels 2007), which remembers its auxiliary acceleration A.

    It belongs delay = alpha_m - alpha_f steps later than the true one.  After a step of another length what it differs
    by goes in proportion: where steps at most double, nothing grows by that in constraint rows or stiff modes, at any
    rho.  In a step that begins anew it is A = a + delay (a' - a) by the acceleration a' at that step's own end, which
    makes the step one of Newmark's, with gamma = 1/2 (``Scheme.newmark``).
    """
    alpha_m, alpha_f, beta, gamma = data[0], data[1], data[2], data[3]
    v0, a0, a1, auxiliary = 1, 2, 5, 6
    delay = alpha_m - alpha_f
    nodes[0] = 1.0
    u[0, v0] = h
    v[0, v0] = 1.0
    if before == 0.0:
        share = 0.25 * (1.0 + delay * delay)
        u[0, a0] = (0.5 - share) * h * h
        u[0, a1] = share * h * h
        v[0, a0] = 0.5 * h
        v[0, a1] = 0.5 * h
        memory[0, a0] = -delay
        memory[0, a1] = 1.0 + delay
        return
    carried = h / before
    memory[0, a1] = (1.0 - alpha_f) / (1.0 - alpha_m)
    memory[0, auxiliary] = -alpha_m / (1.0 - alpha_m) * carried
    memory[0, a0] = (alpha_f - alpha_m * (1.0 - carried)) / (1.0 - alpha_m)
    for k in (a0, a1, auxiliary):
        own = carried if k == auxiliary else 1.0 - carried if k == a0 else 0.0
        u[0, k] = h * h * ((0.5 - beta) * own + beta * memory[0, k])
        v[0, k] = h * ((1.0 - gamma) * own + gamma * memory[0, k])


@kernel
def _write_weights(relation, h, before):
    """Write the weights of a step h after one of ``before`` (s; 0: none is remembered)."""
    relation.lengths[0] = h
    relation.lengths[1] = before
    relation.position[:] = 0.0
    relation.velocity[:] = 0.0
    relation.remember[:] = 0.0
    if relation.address[0] == 0:
        _generalized_alpha(
            relation.data, h, before, relation.nodes, relation.position, relation.velocity, relation.remember
        )
    else:
        call_relation(
            relation.address[0],
            relation.data,
            (h, before),
            relation.nodes,
            relation.position,
            relation.velocity,
            relation.remember,
        )


@kernel
def take_weights(relation, h, before):
    """Have the weights of a step h after one of ``before`` (s; 0: none is remembered)."""
    if h != relation.lengths[0] or before != relation.lengths[1]:
        _write_weights(relation, h, before)


@kernel
def _add_vector(total, weight, vector):
    if weight != 0.0:
        for k in range(total.shape[0]):
            total[k] += weight * vector[k]


@kernel
def _add_parts(relation, remembered, weights, count, total):
    """Add the sums over the ends of ``count`` stages and what is remembered, by weights (n,), to ``total`` (nv,)."""
    for j in range(count):
        for part in range(POINT):
            _add_vector(total, weights[POINT * (j + 1) + part], relation.points[j, part])
    first = weights.shape[0] - remembered.shape[0]
    for j in range(remembered.shape[0]):
        _add_vector(total, weights[first + j], remembered[j])


@deferred_kernel()
def _add_known(relation, remembered, i, through):
    """Add what stages before stage i and several memories make of u and v at its end."""
    _add_parts(relation, remembered, relation.velocity[i], i, relation.known[1])
    _add_parts(relation, remembered, relation.position[i], i, relation.known[0])
    _add_vector(relation.known[0], through, relation.known[1])


@kernel
def begin_stage(plan, work, state, scratch, h, i):
    """Write what is known of stage i's end, and what u and v there get per unit of the new acceleration.

    Factors of a matrix with other shares are let go.  Functions of time are evaluated at its end.
    """
    relation, scheme = scratch.relation, scratch.memory.scheme
    relation.stage[0] = i
    own = POINT * (i + 1)
    through = relation.position[i, own + V]
    per_v = relation.velocity[i, own + A]
    per_x = relation.position[i, own + A] + through * per_v
    if not (abs(per_x - scheme[0]) <= _SAME * abs(per_x) and abs(per_v - scheme[1]) <= _SAME * abs(per_v)):
        scratch.memory.step_factored[0] = 0.0
    scheme[0] = per_x
    scheme[1] = per_v
    # one loop where a method has one stage and one memory, for small machines' sake
    remembered = scratch.memory.remembered
    alone = i == 0 and remembered.shape[0] == 1 and through == 0.0
    carried = remembered[0] if alone else state.v
    m = relation.position.shape[1] - 1
    x_v, x_a, x_m = relation.position[i, V], relation.position[i, A], relation.position[i, m]
    v_v, v_a, v_m = relation.velocity[i, V], relation.velocity[i, A], relation.velocity[i, m]
    if not alone:
        x_m = v_m = 0.0
    known_x, known_v = relation.known[0], relation.known[1]
    v, a = state.v, state.a
    for k in range(v.shape[0]):
        known_x[k] = x_v * v[k] + x_a * a[k] + x_m * carried[k]
        known_v[k] = v_v * v[k] + v_a * a[k] + v_m * carried[k]
    if not alone:
        _add_known(relation, remembered, i, through)
    end = state.numbers[st.STEP_END]
    if i + 1 < relation.nodes.shape[0]:
        end = state.numbers[st.TIME] + relation.nodes[i] * h
    evaluate_times(plan, st.function_time(state.numbers, end), work.time)


@kernel
def keep_stage(scratch, i):
    """Keep what was found at the end of stage i, which is not the step's."""
    relation = scratch.relation
    for k in range(scratch.v.shape[0]):
        relation.points[i, U, k] = scratch.displacement[k]
        relation.points[i, V, k] = scratch.v[k]
        relation.points[i, A, k] = scratch.a[k]
    for row in range(scratch.multipliers.shape[0]):
        relation.reactions[i, row] = scratch.multipliers[row]


@deferred_kernel()
def remember_step(state, scratch):
    """Replace what is remembered by what the accepted step in ``scratch`` makes of it; ``state`` is at its start."""
    relation, remembered = scratch.relation, scratch.memory.remembered
    last = relation.nodes.shape[0] - 1
    own = POINT * (last + 1)
    for j in range(remembered.shape[0]):
        weights, total = relation.remember[j], relation.next[j]
        for k in range(total.shape[0]):
            total[k] = weights[V] * state.v[k] + weights[A] * state.a[k] + weights[own + U] * scratch.displacement[k]
            total[k] += weights[own + V] * scratch.v[k] + weights[own + A] * scratch.a[k]
        _add_parts(relation, remembered, weights, last, total)
    for j in range(remembered.shape[0]):
        for k in range(remembered.shape[1]):
            remembered[j, k] = relation.next[j, k]


@kernel
def remembers_acceleration(relation):
    """Whether a step of one stage remembers a sum of accelerations alone, as generalized-alpha does."""
    if relation.remember.shape[0] != 1 or relation.nodes.shape[0] != 1:
        return False
    weights = relation.remember[0]
    return weights[V] == 0.0 and weights[POINT + U] == 0.0 and weights[POINT + V] == 0.0
