"""What a bristle bears: T = k_t z + c_t v, at most what Coulomb's law allows; and its variation."""

from __future__ import annotations

import math

from flexmbd.multibody.kernels.algebra.so3 import add3, dot3, load3, scale3, sub3
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.contact.bristle import STRETCH, WAY, stretch
from flexmbd.multibody.kernels.contact.normal_force import BRISTLE, BRISTLE_DAMPING

FREE, _STICKS = 0.0, 1.0  # pieces of the law; one more where the bristle slides, two where it bears mu N
_ZERO = (0.0, 0.0, 0.0)


@kernel
def bristle_force(data, o, kept, n, way, depth, mu, D, N):
    """The force (N) at the end of a way; the bristle's stretch (m); the piece of the law.

    And whether the law bends between there and where the step began.

    ``kept``: see ``stretch``, and where in the memory the piece of the law stands at the step's begin.  ``way``: how
    far the surfaces have slid (m), and the sliding velocity.  ``depth``: how deep they are pressed into each other (m),
    and its rate (m/s); D, N: of the normal force.
    """
    memory, m, t, first, across, piece_at = kept
    k = data[o + BRISTLE]
    law = data, o, D, mu / k, 0.0, N, 0.0
    z, _, slides, slid = stretch((memory, m, t, first, across), n, way, (_ZERO, _ZERO), law, depth, (0.0, 0.0))
    pull = add3(scale3(k, z), scale3(data[o + BRISTLE_DAMPING], way[1]))
    size, most = math.sqrt(dot3(pull, pull)), mu * N
    full = size > most
    piece = _STICKS + (1.0 if slides else 0.0) + (2.0 if full else 0.0)
    before = memory[piece_at]
    bends = (slid and not slides) or (before != FREE and before != piece)
    return scale3(-most / size if full else -1.0, pull), z, piece, bends


@kernel
def bristle_force_variation(data, o, kept, normal, way, depth, law):
    """The force and its variation; ``normal``, ``way``, ``depth`` and ``law``, which is mu, D and N, with theirs."""
    (n, dn), (y, v, dy, dv), (depth, ddepth), (mu, dmu, D, N, dN) = normal, way, depth, law
    memory, m, t, first, across, _ = kept
    k = data[o + BRISTLE]
    law = data, o, D, mu / k, dmu / k, N, dN
    z, dz, slides, _ = stretch((memory, m, t, first, across), n, (y, v), (dy, dv), law, depth, ddepth)
    whole = z
    if not slides:  # what a turn of the normal moves from one part of the whole to the other
        b = m + at.N_MEMORY_HEAD + first
        whole = add3(load3(memory, b + STRETCH), sub3(y, load3(memory, b + WAY)))
    if across:
        dz = sub3(dz, add3(scale3(dot3(dn, z), n), scale3(dot3(n, whole), dn)))  # it stays in the tangent plane
    else:
        dz = add3(dz, add3(scale3(dot3(n, z), dn), scale3(dot3(dn, whole), n)))
    most, dmost = mu * N, dmu * N + mu * dN
    pull = add3(scale3(k, z), scale3(data[o + BRISTLE_DAMPING], v))
    dpull = add3(scale3(k, dz), scale3(data[o + BRISTLE_DAMPING], dv))
    size = math.sqrt(dot3(pull, pull))
    if size <= most:
        return scale3(-1.0, pull), scale3(-1.0, dpull)
    share = most / size
    dshare = dmost / size - share * dot3(pull, dpull) / (size * size)
    return scale3(-share, pull), scale3(-1.0, add3(scale3(dshare, pull), scale3(share, dpull)))
