"""Rolling and spinning resistance: moments about the sphere's centre, at most an arm (m) times the normal force.

Two bristles as friction's, of the same stiffness and damping, one in the tangent plane and one along the normal.  They
act at the sphere's radius R, or at that of a disc: their way is R times the angle by which it has turned against the
shape (m, in the axes of the shape's frame), and they bear at most arm / R times N.  Both ways are parts of one state,
both stretches of one vector.
"""

from __future__ import annotations

from flexmbd.multibody.kernels.algebra.so3 import add3, dot3, load3, scale3, store3, sub3
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.contact.bristle import RATE, ROLLS, SPINS, STRETCH, TURN, WAY, flat
from flexmbd.multibody.kernels.contact.bristle_force import FREE, bristle_force, bristle_force_variation
from flexmbd.multibody.kernels.contact.normal_force import BRISTLE, LEVER, RADIUS, ROLLING, SPINNING, normal_force
from flexmbd.multibody.kernels.contact.restitution import dissipation
from flexmbd.multibody.kernels.contact.signed_distance import distance, gradient_variation

_ZERO = (0.0, 0.0, 0.0)


@kernel
def _kept(memory, m, t, across):
    """As ``bristle_force`` takes it, of the bristle that rolls, across the normal, or of the one that spins."""
    return memory, m, t, TURN, across, m + at.N_MEMORY_HEAD + (ROLLS if across else SPINS)


@kernel
def _bear(data, o, way, d, rate, spin):
    """The forces at the radius of both bristles, their stretches, pieces, and whether one bends."""
    memory, m, t, y = way
    gap, n = distance(data, o, d)
    R = data[o + LEVER]
    depth = data[o + RADIUS] - gap, -dot3(n, rate)
    if not depth[0] > 0.0:
        return _ZERO, _ZERO, FREE, FREE, False
    D = dissipation(data, o, (memory, m, t), depth)
    N = normal_force(data, o, D, depth[0], depth[1])[0]
    v = scale3(R, spin)
    rolls, spins = flat(n, v), scale3(dot3(n, v), n)
    one, z, piece, bends = bristle_force(
        data, o, _kept(memory, m, t, True), n, (y, rolls), depth, data[o + ROLLING] / R, D, N
    )  # fmt: skip
    other, z_n, piece_n, bends_n = bristle_force(
        data, o, _kept(memory, m, t, False), n, (y, spins), depth, data[o + SPINNING] / R, D, N
    )  # fmt: skip
    return add3(one, other), add3(z, z_n), piece, piece_n, bends or bends_n


@kernel
def resist(data, o, way, d, rate, spin, out):
    """The moment on the sphere (N m), and whether the law bends in this step; rates of the state into ``out`` (3,).

    ``way``: the memory, where the contact's begins, the time (s), and the radius times the turn (m).
    """
    force, _, _, _, bends = _bear(data, o, way, d, rate, spin)
    store3(out, 0, scale3(data[o + LEVER], spin))
    return scale3(data[o + LEVER], force), bends


@kernel
def resist_variation(data, o, way, motion, change, out):
    """The variation of the moment, as in ``contact_variation``; that of the state's rates into ``out`` (3,)."""
    d, rate, spin = motion
    dd, drate, dspin, dy = change
    memory, m, t, y = way
    R = data[o + LEVER]
    v, dv = scale3(R, spin), scale3(R, dspin)
    store3(out, 0, dv)
    gap, n = distance(data, o, d)
    depth = data[o + RADIUS] - gap, -dot3(n, rate)
    if not depth[0] > 0.0:
        return _ZERO
    dn = gradient_variation(data, o, d, dd)
    ddepth = -dot3(n, dd), -dot3(dn, rate) - dot3(n, drate)
    D = dissipation(data, o, (memory, m, t), depth)
    N, by_depth, by_rate = normal_force(data, o, D, depth[0], depth[1])
    dN = by_depth * ddepth[0] + by_rate * ddepth[1]
    spins = scale3(dot3(n, v), n)
    dspins = add3(scale3(dot3(dn, v) + dot3(n, dv), n), scale3(dot3(n, v), dn))
    _, one = bristle_force_variation(
        data, o, _kept(memory, m, t, True), (n, dn), (y, sub3(v, spins), dy, sub3(dv, dspins)), (depth, ddepth),
        (data[o + ROLLING] / R, 0.0, D, N, dN),
    )  # fmt: skip
    _, other = bristle_force_variation(
        data, o, _kept(memory, m, t, False), (n, dn), (y, spins, dy, dspins), (depth, ddepth),
        (data[o + SPINNING] / R, 0.0, D, N, dN),
    )  # fmt: skip
    return scale3(R, add3(one, other))


@kernel
def remember_turn(data, o, way, d, rate, spin, x):
    """Write into the configuration x what the two bristles remember; ``remember_contact`` has the time."""
    _, m, _, y = way
    _, z, piece, piece_n, _ = _bear(data, o, way, d, rate, spin)
    k = m + at.N_MEMORY_HEAD
    store3(x, k + TURN + STRETCH, z)
    store3(x, k + TURN + WAY, y)
    store3(x, k + TURN + RATE, scale3(data[o + LEVER], spin))
    x[k + ROLLS], x[k + SPINS] = piece, piece_n


@kernel
def turn_energy(data, o, way, d):
    """What both bristles store (J), as they are remembered."""
    if not distance(data, o, d)[0] < data[o + RADIUS]:
        return 0.0
    z = load3(way[0], way[1] + at.N_MEMORY_HEAD + TURN + STRETCH)
    return 0.5 * data[o + BRISTLE] * dot3(z, z)
