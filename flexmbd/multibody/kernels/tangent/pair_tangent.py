"""The tangent of forces between all pairs of a group of frames."""

from __future__ import annotations

from flexmbd.multibody.kernels.algebra.so3 import add3, cross3, rotate, scale3, sub3
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.base.deferred import deferred_kernel
from flexmbd.multibody.kernels.elements.differences import difference_step
from flexmbd.multibody.kernels.elements.pairs import force_variation, frame_of_pair, line, step_along
from flexmbd.multibody.kernels.elements.table import is_of_pairs, pair_push, pair_slope
from flexmbd.multibody.kernels.inverse_dynamics.closure import relative_motion
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
def _force(plan, work, row, i, j, d, rate):
    """Force on frame j (N), in the axes of d (m), which changes by ``rate`` (m/s)."""
    r, n, along = line(d, rate)
    return scale3(pair_push(plan, work, row, i, j, r, along)[0], n)


@kernel
def _variation(plan, work, row, i, j, d, rate, dd, drate, step):
    """Its change for d + dd, rate + drate."""
    r, n, along = line(d, rate)
    known, slope = pair_slope(plan, work, row, i, j, r)
    if known:
        return force_variation(pair_push(plan, work, row, i, j, r, along)[0], slope, r, n, dd)
    short = step_along(step, r, dd)
    if short == 0.0:
        return (0.0, 0.0, 0.0)
    move, quicker = scale3(short, dd), scale3(short, drate)
    up = _force(plan, work, row, i, j, add3(d, move), add3(rate, quicker))
    down = _force(plan, work, row, i, j, sub3(d, move), sub3(rate, quicker))
    return scale3(0.5 / short, sub3(up, down))


@kernel
def _add_pair(plan, work, tw, row, i, j, x, v, a, per_x, per_v, per_a, matrix):
    """Frames i and j of a group."""
    f, g = frame_of_pair(plan, row, i), frame_of_pair(plan, row, j)
    d, _, rate, _, _, _ = relative_motion(plan, work, f, g)
    c_F, c_G, v_G, w_F, w_G, R_F = pair_frames(plan, work, tw, f, g)
    force = scale3(-1.0, _force(plan, work, row, i, j, d, rate))
    pull = rotate(R_F, force)
    moment = cross3(c_G, pull)
    load_edges(plan, work, tw, f, g, pull, moment, x, v, a, per_x, per_v, per_a, matrix, matrix)
    count = collect_paths(plan, tw, f, g)
    moved = 0
    for q in range(count):
        k = tw.path[q]
        moves, dd, _, drate, _, phi, shift = variation_by_unknown(tw, k, per_x, c_G, v_G, w_F, w_G, R_F)
        if not moves:
            continue
        moved = put_first(tw, moved, q)
        step = difference_step(per_x, per_v, tw.size_x[k], tw.size_v[k])
        dforce = scale3(-1.0, _variation(plan, work, row, i, j, d, rate, dd, drate, step))
        dmoment = add3(cross3(dd, force), cross3(d, dforce))
        put_change(tw, k, per_x, phi, shift, dforce, dmoment, pull, moment, c_F, R_F)
    add_changes(tw, count, moved, matrix)
    clear_path(tw, count)


@deferred_kernel()
def _add_group(plan, work, tw, row, x, v, a, per_x, per_v, per_a, matrix):
    """All pairs of a group."""
    for i in range(row[at.EL_COUNT]):
        for j in range(i + 1, row[at.EL_COUNT]):
            _add_pair(plan, work, tw, row, i, j, x, v, a, per_x, per_v, per_a, matrix)


@kernel
def add_pairs(plan, work, tw, x, v, a, per_x, per_v, per_a, matrix):
    """Add stiffness and damping of the forces between all pairs of groups."""
    for i in range(plan.elements.shape[0]):
        row = plan.elements[i]
        if is_of_pairs(row[at.EL_KIND]):
            _add_group(plan, work, tw, row, x, v, a, per_x, per_v, per_a, matrix)
