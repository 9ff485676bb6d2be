"""A step of generalized-alpha of a machine with loops whose matrix is sparse.

With B the tree's iteration matrix, K its part by positions and C the rows, unknowns are corrections of accelerations a,
of reactions nu and of shifts s = B^-1 C^T kappa of positions:

    B a + C^T nu + K s = r1,   C (a + s) = r2,   C a + R (a + s) = r3,

R the rates' derivatives by positions.  With y = a + s all follow from solutions with the saddle matrix of B and C: y by
its positions, s by C s = r2 - r3 + R y, then what K s changes of y; R of that is small of higher order and left out.
Rows that shift no positions stand in the saddle matrix by their own equation in place of C.

Columns of balls are by the turns of a step where they say what displacements do: K and the C that moves positions, not
that of velocities.  So there s follows from the rates' equation as a whole, C s = C y + R y - r3.
"""

from __future__ import annotations

from flexmbd.integrate import state as st
from flexmbd.integrate.alpha.workspace import holds_position_alone, is_unshifted
from flexmbd.integrate.sparse_rows import least_row_pivot, tell_worthless
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.base.deferred import FLAG, TUPLE2, deferred_kernel
from flexmbd.multibody.kernels.base.separate import call_separate
from flexmbd.multibody.kernels.reading.plan_entries import augmented_stiffness, is_augmented
from flexmbd.multibody.kernels.sparse.block_lu import factor_sparse, solve_sparse
from flexmbd.multibody.kernels.tangent.sparse_assembly import put_rows
from flexmbd.multibody.kernels.tangent.sparse_products import add_motions, multiply, multiply_rows, put_reactions
from flexmbd.multibody.kernels.tangent.sparse_turns import turn_block_columns, turn_path_columns


@kernel
def is_sparse(scratch):
    """Whether the machine's matrix is sparse."""
    return scratch.kernels[2] != 0


@kernel
def assemble(plan, work, scratch, per_x, per_v, per_a):
    """The tangent at the last trial into the sparse matrix."""
    sparse = scratch.sparse
    x, v, a, multipliers = scratch.x, scratch.v, scratch.a, scratch.multipliers
    call_separate(
        scratch.kernels[2],
        (
            plan,
            work,
            scratch.tangent,
            sparse.to,
            x,
            v,
            a,
            multipliers,
            per_x,
            per_v,
            per_a,
            sparse.matrix.values,
        ),
    )


@kernel
def _copy(values, out):
    for k in range(out.shape[0]):
        out[k] = values[k]


@kernel
def _put_slopes(plan, scratch, per_x, per_v):
    """What stands in the rows of the saddle matrix."""
    slopes = scratch.loops.slopes
    for i in range(plan.rows.shape[0]):
        slopes[i, 0], slopes[i, 1], slopes[i, 2] = 1.0, 0.0, 0.0
        if is_unshifted(plan, scratch, i) and not holds_position_alone(plan, scratch, i):
            augmented = is_augmented(plan.rows[i])
            k_x, k_v = augmented_stiffness(plan.data, plan.rows[i]) if augmented else (0.0, 1.0)
            total = k_x * per_x + k_v * per_v
            slopes[i, 0] = k_x * per_x / total
            slopes[i, 1] = k_v / total
            slopes[i, 2] = -1.0 / total if augmented else 0.0


@kernel
def _turn_stiffness(plan, scratch):
    """Let the stiffness count turns of balls within the step; whether there are any.

    What that changes of the matrix is left in ``loops.tree``, and of the rows' rates in ``loops.rate_jacobian``.
    """
    loops, values = scratch.loops, scratch.sparse.matrix.values
    balls, rates = loops.spins.shape[0] > 0, loops.rate_jacobian
    if balls:
        to, pattern, move = scratch.sparse.to, scratch.sparse.pattern, scratch.displacement
        turn_block_columns(plan, pattern, to, move, loops.stiffness)
        turn_path_columns(scratch.tangent, to, loops.spins, move, rates)
        for i in range(rates.shape[0]):
            for j in range(rates.shape[1]):
                rates[i, j] -= scratch.tangent.rate_jacobian[i, j]
        for k in range(values.shape[0]):
            loops.tree.values[k] = loops.stiffness[k] - values[k]
    return balls


@deferred_kernel(FLAG)
def _factor_across(plan, state, scratch):
    """Factor the saddle matrix in which all rows hold, those that an augmented Lagrangian lets yield included."""
    sparse, loops = scratch.sparse, scratch.loops
    _copy(sparse.matrix.values, loops.across.values)
    for i in range(plan.rows.shape[0]):
        loops.slopes[i, 0], loops.slopes[i, 1], loops.slopes[i, 2] = 1.0, 0.0, 0.0
    put_rows(plan, scratch.tangent, sparse.to, loops.jacobian, loops.slopes, 1.0, loops.across.values)
    if factor_sparse(sparse.pattern, loops.across):
        return True
    tell_worthless(plan, state, scratch.tangent, sparse.to, loops.across)
    return False


@deferred_kernel(FLAG)
def linearise_loops(plan, work, state, scratch, per_x, per_v):
    """Build and factor the saddle matrix and the tree's; False if one is singular."""
    sparse, loops, to = scratch.sparse, scratch.loops, scratch.sparse.to
    loops.per_v[0] = per_v
    assemble(plan, work, scratch, per_x, 0.0, 0.0)
    _copy(sparse.matrix.values, loops.stiffness)
    for i in range(loops.rate_jacobian.shape[0]):
        _copy(scratch.tangent.rate_jacobian[i], loops.rate_jacobian[i])
    turns = _turn_stiffness(plan, scratch)
    assemble(plan, work, scratch, per_x, per_v, 1.0)
    for i in range(loops.jacobian.shape[0]):
        _copy(scratch.tangent.jacobian[i], loops.jacobian[i])
    if turns:
        for k in range(loops.tree.values.shape[0]):
            sparse.matrix.values[k] += loops.tree.values[k]
        turn_path_columns(scratch.tangent, to, loops.spins, scratch.displacement, loops.jacobian)
        _copy(sparse.matrix.values, loops.whole)
        for i in range(loops.rate_jacobian.shape[0]):
            for j in range(loops.rate_jacobian.shape[1]):
                loops.rate_jacobian[i, j] += scratch.tangent.rate_jacobian[i, j]
    _copy(sparse.matrix.values, loops.tree.values)
    for i in range(plan.rows.shape[0]):
        k = to.starts[0] + i
        block = to.block[k]
        loops.tree.values[to.diagonal[block, 0] + to.diagonal[block, 1] * k + k] = 1.0
    if not factor_sparse(sparse.pattern, loops.tree):
        tell_worthless(plan, state, scratch.tangent, to, loops.tree)
        return False
    across = loops.across.values.shape[0] > 0
    if across and not _factor_across(plan, state, scratch):
        return False
    _put_slopes(plan, scratch, per_x, per_v)
    put_rows(plan, scratch.tangent, to, loops.jacobian, loops.slopes, 1.0, sparse.matrix.values)
    if not factor_sparse(sparse.pattern, sparse.matrix):
        tell_worthless(plan, state, scratch.tangent, to, sparse.matrix)
        return False
    of_rows = loops.across if across else sparse.matrix
    least = least_row_pivot(plan, sparse.pattern, of_rows, scratch.memory.row_length)
    st.watch_pivot(state, least)
    scratch.least_pivot[0] = least
    return True


@kernel
def _solve(scratch, matrix, vector):
    """Solve for one vector (unknowns,), in place."""
    right = scratch.sparse.rhs
    _copy(vector, right[0])
    solve_sparse(scratch.sparse.pattern, matrix, right)
    _copy(right[0], vector)


@deferred_kernel()
def solve_tree_sparse(plan, scratch, rhs):
    """Solve with the tree's matrix; each row of the (k, free) ``rhs`` is one right-hand side, in place."""
    nu, vector = plan.free.shape[0], scratch.loops.vectors[0]
    for q in range(rhs.shape[0]):
        vector[:] = 0.0
        for j in range(nu):
            vector[j] = rhs[q, j]
        _solve(scratch, scratch.loops.tree, vector)
        for j in range(nu):
            rhs[q, j] = vector[j]


@kernel
def _push(scratch, reactions, vector):
    """Write B^-1 C^T times reactions (m,) into a vector."""
    put_reactions(scratch.tangent, scratch.sparse.to, reactions, vector)
    _solve(scratch, scratch.loops.tree, vector)


@deferred_kernel()
def shift_positions(plan, scratch, shifts, per_x, displacement):
    """Add ``per_x`` times B^-1 C^T times the shifts (m,) to ``displacement`` (nv,).

    It is known where they are the sum of Newton's corrections.
    """
    loops = scratch.loops
    known = True
    for i in range(shifts.shape[0]):
        known = known and shifts[i] == loops.shifts[i]
    if not known:
        moved = False
        for i in range(shifts.shape[0]):
            loops.shifts[i] = shifts[i]
            moved = moved or shifts[i] != 0.0
        loops.vectors[0, :] = 0.0
        if moved:
            _push(scratch, shifts, loops.vectors[0])
        for j in range(plan.free.shape[0]):
            loops.shifted[j] = loops.vectors[0, j]
    for j in range(plan.free.shape[0]):
        displacement[plan.free[j]] += per_x * loops.shifted[j]


@deferred_kernel()
def solve_loops(plan, scratch, rhs):
    """Solve for corrections of accelerations, reactions and shifts, as of the dense matrix, in place.

    ``loops.vectors[1]`` begins with the last right-hand side's s.
    """
    sparse, loops, tw = scratch.sparse, scratch.loops, scratch.tangent
    pattern, to = sparse.pattern, sparse.to
    nu, m = plan.free.shape[0], plan.rows.shape[0]
    y, s, change = loops.vectors[0], loops.vectors[1], loops.vectors[2]
    per_v = loops.per_v[0]
    for q in range(rhs.shape[0]):
        y[:] = 0.0
        for j in range(nu):
            y[j] = rhs[q, j]
        shifted = False
        for i in range(m):
            unshifted = is_unshifted(plan, scratch, i)
            shifted = shifted or not unshifted
            y[nu + i] = rhs[q, nu + m + i] if unshifted else rhs[q, nu + i]
        _solve(scratch, sparse.matrix, y)
        if not shifted:
            for j in range(nu + m):
                rhs[q, j] = y[j]
            rhs[q, nu + m :] = 0.0
            s[:] = 0.0
            continue
        balls = loops.spins.shape[0] > 0
        add_motions(pattern, loops.whole if balls else loops.stiffness, to, y)
        multiply_rows(tw, to, loops.rate_jacobian, y, loops.row)
        s[:] = 0.0
        for i in range(m):
            if not is_unshifted(plan, scratch, i):
                s[nu + i] = loops.row[i] / per_v - rhs[q, nu + m + i]
                if not balls:
                    s[nu + i] += rhs[q, nu + i]
        _solve(scratch, sparse.matrix, s)
        for i in range(m):
            rhs[q, nu + m + i] = -s[nu + i]
            rhs[q, nu + i] = y[nu + i] - s[nu + i]
            s[nu + i] = 0.0
        change[:] = 0.0
        multiply(pattern, loops.stiffness, to, s, change[:nu])
        multiply_rows(tw, to, loops.jacobian, s, loops.row)
        for j in range(nu):
            change[j] = -change[j]
        for i in range(m):
            if is_unshifted(plan, scratch, i):
                change[nu + i] = loops.slopes[i, 1] * per_v * loops.row[i]
        _solve(scratch, sparse.matrix, change)
        for j in range(nu):
            rhs[q, j] = y[j] + change[j] - s[j]
        for i in range(m):
            rhs[q, nu + i] += change[nu + i]


@deferred_kernel(TUPLE2)
def sizes_of_correction(plan, state, scratch, per_x, per_v):
    """The largest parts of ``s.correction``, of the motion and of the forces out of balance, over the scales.

    ``s.correction`` is what ``solve_loops`` left last, and subtracted from ``s.unknown`` already.
    """
    nu, m = plan.free.shape[0], plan.rows.shape[0]
    loops = scratch.loops
    correction, pushed, shift = scratch.correction[0], loops.vectors[0], loops.vectors[1]
    _push(scratch, correction[nu : nu + m], pushed)
    for i in range(m):
        loops.shifts[i] = scratch.unknown[nu + m + i]
    size = 0.0
    imbalance = 0.0
    for j in range(nu):
        k = plan.free[j]
        move = correction[j]
        imbalance = max(imbalance, abs(move + pushed[j]) * per_v / scratch.scale_v[k])
        part = max(abs(move) * per_x / scratch.scale_x[k], abs(move) * per_v / scratch.scale_v[k])
        loops.shifted[j] -= shift[j]
        part = max(part, abs(shift[j]) * per_x / scratch.scale_x[k])
        if not part <= size:
            size = part
            state.counts[st.WORST] = k
    return size, imbalance


@deferred_kernel()
def remove_across_sparse(plan, scratch, vector):
    """Remove from a vector (free,) what reactions of the rows would make."""
    nu, m = plan.free.shape[0], plan.rows.shape[0]
    loops, own = scratch.loops, scratch.loops.vectors[0]
    own[:] = 0.0
    for j in range(nu):
        own[j] = vector[j]
    add_motions(scratch.sparse.pattern, loops.stiffness, scratch.sparse.to, own)
    multiply_rows(scratch.tangent, scratch.sparse.to, loops.jacobian, own, loops.row)
    own[:] = 0.0
    for i in range(m):
        own[nu + i] = loops.row[i]
    _solve(scratch, loops.across if loops.across.values.shape[0] > 0 else scratch.sparse.matrix, own)
    for j in range(nu):
        vector[j] -= own[j]
