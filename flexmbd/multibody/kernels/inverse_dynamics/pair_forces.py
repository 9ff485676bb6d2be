"""What the pairs of a group of frames exert on each other and store."""

from __future__ import annotations

from flexmbd.multibody.kernels.algebra.so3 import add3, load3, load9, rotate, rotate_back, scale3, sub3
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.base.deferred import NUMBER, deferred_kernel
from flexmbd.multibody.kernels.elements.pairs import follows_rates, frame_of_pair, line
from flexmbd.multibody.kernels.elements.table import pair_push
from flexmbd.multibody.kernels.inverse_dynamics.recursion import frame_motion, load_frame

_ZERO = (0.0, 0.0, 0.0)


@kernel
def frame_place(plan, work, f):
    """Where frame f is (m), in inertial axes."""
    b = plan.frame_of[f, at.FRAME_BODY]
    p = load3(work.frame[f], at.F_P)
    if b >= 0:
        body = work.body[b]
        p = add3(load3(body, at.B_P), rotate(load9(body, at.B_R), p))
    return p


@kernel
def _place(plan, work, f, moves):
    """Where frame f is (m) and, where it matters how it ``moves``, its velocity (m/s); both in inertial axes."""
    if moves:
        p, R, v, _, _, _ = frame_motion(plan, work, f)
        return p, rotate(R, v)
    return frame_place(plan, work, f), _ZERO


@kernel
def _load(plan, work, f, force, out):
    """Subtract a force (N, inertial axes) on frame f from the wrench required of its body."""
    b = plan.frame_of[f, at.FRAME_BODY]
    if b >= 0:
        in_body = rotate_back(load9(work.body[b], at.B_R), scale3(-1.0, force))
        load_frame(plan, work, f, rotate_back(load9(work.frame[f], at.F_R), in_body), _ZERO, out)


@deferred_kernel()
def load_pairs(plan, work, row, out):
    """Subtract the forces of a group's pairs from the wrenches required of its bodies.

    Both of a pair get one force, so that momentum is kept to round-off whatever the law is.
    """
    moves = follows_rates(plan, row)
    for i in range(row[at.EL_COUNT]):
        f = frame_of_pair(plan, row, i)
        p, v = _place(plan, work, f, moves)
        total = _ZERO
        for j in range(i + 1, row[at.EL_COUNT]):
            g = frame_of_pair(plan, row, j)
            place, velocity = _place(plan, work, g, moves)
            r, n, rate = line(sub3(place, p), sub3(velocity, v))
            force = scale3(pair_push(plan, work, row, i, j, r, rate)[0], n)
            total = sub3(total, force)
            _load(plan, work, g, force, out)
        _load(plan, work, f, total, out)


@deferred_kernel(NUMBER)
def pairs_energy(plan, work, row):
    """What a group's pairs store (J)."""
    moves = follows_rates(plan, row)
    energy = 0.0
    for i in range(row[at.EL_COUNT]):
        p, v = _place(plan, work, frame_of_pair(plan, row, i), moves)
        for j in range(i + 1, row[at.EL_COUNT]):
            place, velocity = _place(plan, work, frame_of_pair(plan, row, j), moves)
            r, _, rate = line(sub3(place, p), sub3(velocity, v))
            energy += pair_push(plan, work, row, i, j, r, rate)[1]
    return energy
