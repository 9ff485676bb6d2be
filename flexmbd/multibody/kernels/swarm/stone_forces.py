"""Where pseudo-rigid bodies touch and what that does to them.

A force f at the place x acts on r as f and on F as f (x) X, with X = F^-1 (x - r): so a pair of forces at one place
leaves linear and angular momentum as they are.  A bristle (``contact_law``) turns with the mean spin of the two bodies;
the walls do not spin.
"""

from __future__ import annotations

import math

from flexmbd.multibody.kernels.algebra.so3 import (
    add3,
    cross3,
    dot3,
    load3,
    load9,
    rotate,
    rotate_back,
    scale3,
    store3,
    store9,
    sub3,
)
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.contact.contact_law import friction_after
from flexmbd.multibody.kernels.contact.finding.near_pairs import find_pairs, place_shapes
from flexmbd.multibody.kernels.contact.finding.pair_points import add_pair
from flexmbd.multibody.kernels.contact.finding.shape_table import (
    FACES,
    FIRST_FACE,
    FIRST_VERTEX,
    ID_BITS,
    VERTICES,
)
from flexmbd.multibody.kernels.contact.normal_force import (
    BRISTLE,
    BRISTLE_DAMPING,
    DISSIPATION,
    EXPONENT,
    STIFFNESS,
    normal_force,
)
from flexmbd.multibody.kernels.swarm.stones import BEFORE, BODY, MARGIN, PAIRS, POINTS, VALUE

#: How the steps, or the search for points, ended: all is well; too little room; det F <= 0; a step that is too long for
#: a stiffness, or in which two bodies may pass each other.
DONE, TOO_SMALL, PRESSED, TOO_LONG, TOO_FAST = range(5)

_ZERO = (0.0, 0.0, 0.0)
_STEPS = 10.0  # for which near pairs are to serve, at the speed that the fastest body has
_LEAST, _MOST = 1e-3, 0.5  # of the smallest body's size: within how much near pairs are found


@kernel
def _inverse(f):
    """The inverse of a matrix, and its determinant."""
    c0, c1, c2 = f[4] * f[8] - f[5] * f[7], f[5] * f[6] - f[3] * f[8], f[3] * f[7] - f[4] * f[6]
    det = f[0] * c0 + f[1] * c1 + f[2] * c2
    if not det > 0.0:
        return f, det
    s = 1.0 / det
    back = (
        s * c0, s * (f[2] * f[7] - f[1] * f[8]), s * (f[1] * f[5] - f[2] * f[4]),
        s * c1, s * (f[0] * f[8] - f[2] * f[6]), s * (f[2] * f[3] - f[0] * f[5]),
        s * c2, s * (f[1] * f[6] - f[0] * f[7]), s * (f[0] * f[4] - f[1] * f[3]),
    )  # fmt: skip
    return back, det


@kernel
def _lay(stones, work, finding, r, F, G):
    """Lay all bodies' cores as F carries them, in the world's axes; False where a body has no volume."""
    table = stones.table
    cores = table.cores
    for b in range(r.shape[0]):
        f = load9(F[b], 0)
        back, det = _inverse(f)
        if not (det > 0.0 and det < math.inf):
            work.whole[BODY], work.told[VALUE] = b, det
            return False
        store9(work.back[b], 0, back)
        head = cores.head[table.core[b]]
        farthest = 0.0
        for k in range(head[FIRST_VERTEX], head[FIRST_VERTEX] + head[VERTICES]):
            p = rotate(f, load3(stones.corners[k], 0))
            store3(cores.vertices[k], 0, p)
            farthest = max(farthest, dot3(p, p))
        table.bound[b] = math.sqrt(farthest)
        for k in range(head[FIRST_FACE], head[FIRST_FACE] + head[FACES]):
            n = rotate_back(back, load3(stones.faces[k], 0))
            store3(cores.normals[k], 0, scale3(1.0 / math.sqrt(dot3(n, n)), n))
        g = load9(G[b], 0)
        x, y, z = (back[0], back[3], back[6]), (back[1], back[4], back[7]), (back[2], back[5], back[8])
        one, two, three = (g[0], g[1], g[2]), (g[3], g[4], g[5]), (g[6], g[7], g[8])
        store3(work.spin[b], 0, (
            0.5 * (dot3(three, y) - dot3(two, z)), 0.5 * (dot3(one, z) - dot3(three, x)),
            0.5 * (dot3(two, x) - dot3(one, y)),
        ))  # fmt: skip
        store3(finding.centre[b], 0, load3(r[b], 0))
    return True


@kernel
def _size(a, b, o, count):
    """The Frobenius norm of the difference of two rows."""
    total = 0.0
    for k in range(count):
        total += (a[k] - o * b[k]) ** 2
    return math.sqrt(total)


@kernel
def _near_pairs_serve(stones, work, r, F):
    """Whether no vertex has moved so far that there may be other pairs."""
    if work.whole[PAIRS] < 0:
        return False
    for b in range(r.shape[0]):
        moved = _size(r[b], work.at_r[b], 1.0, 3) + _size(F[b], work.at_F[b], 1.0, 9) * stones.reach[b]
        if not 2.0 * moved < work.told[MARGIN]:
            return False
    return True


@kernel
def _find_near_pairs(stones, work, finding, r, v, F, G, h):
    """Find the pairs that may touch before a vertex has moved by half of a margin; how it ended."""
    fastest, smallest = 0.0, math.inf
    for b in range(r.shape[0]):
        speed = _size(v[b], v[b], 0.0, 3) + _size(G[b], G[b], 0.0, 9) * stones.reach[b]
        if speed > fastest:
            fastest, work.whole[BODY] = speed, b
        smallest = min(smallest, stones.reach[b])
        for k in range(3):
            work.at_r[b, k] = r[b, k]
        for k in range(9):
            work.at_F[b, k] = F[b, k]
    if 2.0 * h * fastest > smallest:
        work.told[VALUE] = 0.5 * smallest / fastest
        return TOO_FAST
    margin = min(max(2.0 * _STEPS * h * fastest, _LEAST * smallest), _MOST * smallest)
    place_shapes(stones.table, finding, r, work.upright, work.still, work.still)
    pairs = find_pairs(stones.table, finding, 0.0, margin)
    finding.needed[0], finding.needed[1] = pairs, 0
    work.told[MARGIN] = margin
    work.whole[PAIRS] = pairs if pairs <= finding.pairs.shape[0] else -1
    return DONE if pairs <= finding.pairs.shape[0] else TOO_SMALL


@kernel
def find_points(stones, work, finding, points, r, v, F, G, h):
    """Find the points where bodies touch; what came of it."""
    if not _lay(stones, work, finding, r, F, G):
        return PRESSED
    if not _near_pairs_serve(stones, work, r, F):
        code = _find_near_pairs(stones, work, finding, r, v, F, G, h)
        if code != DONE:
            return code
    table = stones.table
    count = 0
    for k in range(work.whole[PAIRS]):
        a, b = finding.pairs[k, 0], finding.pairs[k, 1]
        off = sub3(load3(finding.centre[a], 0), load3(finding.centre[b], 0))
        if dot3(off, off) <= (table.bound[a] + table.bound[b]) ** 2:
            count = add_pair(table, finding, points, a, b, 0.0, count)
    finding.needed[1] = count
    work.whole[POINTS] = count
    return DONE if count <= points.gap.shape[0] else TOO_SMALL


@kernel
def _recall(work, points, k, at):
    """The bristle of point k in the step before, and where its pair begins there; ``at``: of the pair before it."""
    pair, found = points.id[k] >> ID_BITS, _ZERO
    while at < work.whole[BEFORE] and work.id_before[at] >> ID_BITS < pair:
        at += 1
    j = at
    while j < work.whole[BEFORE] and work.id_before[j] >> ID_BITS == pair:
        if work.id_before[j] == points.id[k]:
            found = load3(work.z_before[j], 0)
        j += 1
    return found, at


@kernel
def _motion(work, r, v, G, b, x):
    """Of the material point of body b at x: its place in the undeformed body, from the centre, and its velocity."""
    place = rotate(load9(work.back[b], 0), sub3(x, load3(r[b], 0)))
    return place, add3(load3(v[b], 0), rotate(load9(G[b], 0), place))


@kernel
def _push(stones, work, b, place, f, stiffness, damping):
    """Add a force at a material point to a body's accelerations, and what it may stiffen and damp."""
    arm = rotate(load9(stones.per_second[b], 0), place)
    for i in range(3):
        work.push[b, i] += stones.per_mass[b] * f[i]
        for j in range(3):
            work.pull[b, 3 * i + j] += f[i] * arm[j]
    give = stones.per_mass[b] + dot3(place, arm)
    work.stiff[b] += stiffness * give
    work.damp[b] += damping * give


@kernel
def push_apart(stones, work, points, r, v, G, h):
    """Add the forces at all points to the accelerations, and move their bristles on by h (s)."""
    data = stones.data
    rough = data[BRISTLE] > 0.0
    at = 0
    for k in range(work.whole[POINTS]):
        a, b = points.bodies[k, 0], points.bodies[k, 1]
        n, depth = load3(points.normal[k], 0), -points.gap[k]
        x = scale3(0.5, add3(load3(points.position_a[k], 0), load3(points.position_b[k], 0)))
        on_a, rate = _motion(work, r, v, G, a, x)
        on_b, spin = _ZERO, _ZERO
        if b >= 0:
            on_b, other = _motion(work, r, v, G, b, x)
            rate = sub3(rate, other)
            spin = scale3(0.5, add3(load3(work.spin[a], 0), load3(work.spin[b], 0)))
        N, stiffness, damping = normal_force(data, 0, data[DISSIPATION], depth, -dot3(n, rate))
        force = scale3(N, n)
        p = data[EXPONENT]
        work.energy[k] = data[STIFFNESS] * max(depth, 0.0) ** (p + 1.0) / (p + 1.0)
        if rough:
            z, at = _recall(work, points, k, at)
            work.energy[k] += 0.5 * data[BRISTLE] * dot3(z, z)
            z = add3(z, scale3(h, cross3(spin, z)))
            friction, z = friction_after(data, 0, n, N, sub3(rate, scale3(dot3(n, rate), n)), z, h)
            force = add3(force, friction)
            store3(work.z[k], 0, z)
            stiffness, damping = max(stiffness, data[BRISTLE]), max(damping, data[BRISTLE_DAMPING])
        store3(work.force[k], 0, force)
        if b >= 0:  # each of the two gives way: twice the stiffness bounds what they do together
            stiffness, damping = 2.0 * stiffness, 2.0 * damping
            _push(stones, work, b, on_b, scale3(-1.0, force), stiffness, damping)
        _push(stones, work, a, on_a, force, stiffness, damping)
