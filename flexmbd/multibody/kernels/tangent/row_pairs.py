"""The tangent of constraint rows: their Jacobians, and the geometric stiffness of their reactions (``frame_pairs``)."""

from __future__ import annotations

from flexmbd.multibody.kernels.algebra.so3 import add3, cross3, dot3, rotate, rotate_back, scale3
from flexmbd.multibody.kernels.base import kinds
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.base.deferred import deferred_kernel
from flexmbd.multibody.kernels.inverse_dynamics.closure import coupling_term, relative_motion
from flexmbd.multibody.kernels.physics.constraint_laws import row_wrench, row_wrench_variation
from flexmbd.multibody.kernels.tangent.diagonal_blocks import clear_rows
from flexmbd.multibody.kernels.tangent.frame_pairs import (
    add_changes,
    clear_path,
    collect_paths,
    load_edges,
    pair_frames,
    put_change,
    put_first,
    variation_by_unknown,
)


@kernel
def _same_frames(row, other):
    return row[at.ROW_F] == other[at.ROW_F] and row[at.ROW_G] == other[at.ROW_G]


@kernel
def last_of_group(plan, first):
    """One past the last row that joins the same frames as row ``first``."""
    last = first + 1
    while (
        last < plan.rows.shape[0]
        and plan.rows[last, at.ROW_KIND] != kinds.ROW_COUPLING
        and _same_frames(plan.rows[first], plan.rows[last])
    ):
        last += 1
    return last


@kernel
def _coupling_row(plan, tw, i, per_v):
    """Jacobian of a coupling of coordinates."""
    o = plan.rows[i, at.ROW_DATA]
    for k in range(int(plan.data[o])):
        v, share = coupling_term(plan, o, k)
        tw.jacobian[i, v] += share
        tw.rate_jacobian[i, v] += per_v * share


@kernel
def _total_wrench(plan, first, last, multipliers, d, R):
    """Wrench of rows first .. last - 1 together, at G, in F's axes."""
    force = torque = (0.0, 0.0, 0.0)
    for i in range(first, last):
        one, turn = row_wrench(plan.data, plan.rows[i], d, R)
        force = add3(force, scale3(multipliers[i], one))
        torque = add3(torque, scale3(multipliers[i], turn))
    return force, torque


@kernel
def _row_column(plan, tw, i, k, d, R, rate, spin, change, multiplier):
    """Jacobians of row i, into column k, by an unknown; returns what that changes of the row's wrench.

    The wrench is that of the multiplier.
    """
    dd, dtheta, drate, dspin, unit, turn = change
    row = plan.rows[i]
    force, torque = row_wrench(plan.data, row, d, R)
    dforce, dtorque = row_wrench_variation(plan.data, row, d, R, dd, dtheta)
    tw.jacobian[i, k] = dot3(force, unit) + dot3(torque, turn)
    tw.rate_jacobian[i, k] = (
        dot3(dforce, rate) + dot3(dtorque, spin) + dot3(force, drate) + dot3(torque, dspin)
    )
    return scale3(multiplier, dforce), scale3(multiplier, dtorque)


@kernel
def _begin_rows(tw, first, last, count):
    """Note which unknowns the columns of these rows belong to, and clear them."""
    tw.row_count[first] = count
    for j in range(count):
        tw.row_unknown[first, j] = tw.path[j]
        for i in range(first, last):
            tw.jacobian[i, j] = 0.0
            tw.rate_jacobian[i, j] = 0.0


@kernel
def put_group(plan, work, tw, first, last, x, v, a, multipliers, per_x, per_v, per_a, at_f, at_g, compact):
    """Store what the unknowns change of the wrench of rows first .. last - 1, which join the same two frames.

    Also write these rows of ``tw.jacobian`` and ``tw.rate_jacobian``: column by column of the path where they are
    ``compact``.  ``at_f``, ``at_g`` and what is returned: as of ``put_element``.
    """
    f, g = plan.rows[first, at.ROW_F], plan.rows[first, at.ROW_G]
    d, R, rate, spin, _, _ = relative_motion(plan, work, f, g)
    c_F, c_G, v_G, w_F, w_G, R_F = pair_frames(plan, work, tw, f, g)
    force, torque = _total_wrench(plan, first, last, multipliers, d, R)
    pull = rotate(R_F, force)
    moment = add3(rotate(R_F, torque), cross3(c_G, pull))
    load_edges(plan, work, tw, f, g, pull, moment, x, v, a, per_x, per_v, per_a, at_f, at_g)
    count = collect_paths(plan, tw, f, g)
    if compact:
        _begin_rows(tw, first, last, count)
    moved = 0
    for j in range(count):
        k = tw.path[j]
        moves, dd, dtheta, drate, dspin, phi, r = variation_by_unknown(tw, k, per_x, c_G, v_G, w_F, w_G, R_F)
        if not moves:
            continue
        moved = put_first(tw, moved, j)
        dforce = dtorque = (0.0, 0.0, 0.0)
        unit = rotate_back(R_F, add3(r, cross3(phi, c_G)))
        change = (dd, dtheta, drate, dspin, unit, rotate_back(R_F, phi))
        for i in range(first, last):
            one, turn = _row_column(plan, tw, i, j if compact else k, d, R, rate, spin, change, multipliers[i])
            dforce = add3(dforce, one)
            dtorque = add3(dtorque, turn)
        dmoment = add3(dtorque, add3(cross3(dd, force), cross3(d, dforce)))
        put_change(tw, k, per_x, phi, r, dforce, dmoment, pull, moment, c_F, R_F)
    return count, moved


@deferred_kernel()
def add_closures(plan, work, tw, x, v, a, multipliers, per_x, per_v, per_a, matrix):
    """Add the geometric stiffness of the rows' reactions; write ``tw.jacobian`` and ``tw.rate_jacobian``."""
    clear_rows(tw.blocks, tw.jacobian)
    clear_rows(tw.blocks, tw.rate_jacobian)
    first = 0
    while first < plan.rows.shape[0]:
        if plan.rows[first, at.ROW_KIND] == kinds.ROW_COUPLING:
            _coupling_row(plan, tw, first, per_v)
            first += 1
            continue
        last = last_of_group(plan, first)
        count, moved = put_group(
            plan, work, tw, first, last, x, v, a, multipliers, per_x, per_v, per_a, matrix, matrix, False
        )
        add_changes(tw, count, moved, matrix)
        clear_path(tw, count)
        first = last
