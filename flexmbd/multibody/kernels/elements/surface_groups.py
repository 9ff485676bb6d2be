"""Contacts of elastic surfaces that give way together: several press patches of one body.

A body's residual flexibility joins all that presses its patches.  Contact a of a group is pressed by f_a >= 0, a force
f_a r_a on the patches of a body: its own normal on its patch, and on the other surface the opposite normal by its
weights.  So the gaps are g_a + sum_b C_ab f_b with C_ab = sum over the bodies of r_a^T G r_b, and one complementarity
gives the forces of all (``surface_forces`` has that of one contact alone, to which this comes down).

A group in ``Plan.data``: how many members and bodies, how many slots and how wide a row of weights, how many unknowns
(six of each member, then the modes of each body), then where in ``work.generalized`` its parts begin; of each member
its own and the other body, -1 of none, and where in ``Plan.data`` the numbers stand that its patches have in these
bodies' tables; of each body where its table of patches begins (``surface_layout``), its first mode among the unknowns,
and its fields in ``work.generalized``.

The parts stand behind all that a member needs by itself: vectors of slots, (S,) each, what is known of each member,
C and its factor, weights (S, W), two fields (3, P) of each body, B (S, N), K (N, N) and a row, N = `padded` unknowns.
"""

from __future__ import annotations

import math

from flexmbd.multibody.kernels.algebra.so3 import add3, cross3, dot3, rotate, rotate_back, scale3, store3
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.block_view import matrix_view
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.base.lanes import padded, padded_size
from flexmbd.multibody.kernels.contact.complementarity import solve_complementary
from flexmbd.multibody.kernels.elements import surface_layout as sl
from flexmbd.multibody.kernels.elements.surface_points import mean_of
from flexmbd.multibody.kernels.elements.surface_residual import clear_others, move_by
from flexmbd.round_off import EQUAL

(
    N_MEMBERS, N_BODIES, N_SLOTS, WIDTH, N_UNKNOWNS, VECTORS, MEMBERS, MATRIX, WEIGHTS, ROWS, STIFFNESS, LINE, N_HEAD,
) = range(13)  # fmt: skip
OWN, OTHER, OWN_NUMBERS, OTHER_NUMBERS, N_MEMBER = range(5)
TABLE, FIRST_MODE, FIELDS, N_BODY = range(4)
#: Vectors of the slots, in the order in which members have theirs: as in ``surface_layout``; then the member, its slot,
#: the patch in its body's table; the normals in F's axes and in the body's own, (3,) each.
GAP, FORCE, LEFT, INSIDE, ORDER, OWNER, SLOT, PATCH, NORMAL, OWN_NORMAL, N_VECTOR = *range(9), 11, 14
#: Of a member R (9), force and torque on its body (3, 3), how many of its contacts bear; behind the last how many bear
#: at all, and how deep any may be pressed in (m).
ROTATION, FORCED, TWISTED, OWN_BEARING, N_KNOWN = 0, 9, 12, 15, 16
BEARING, DEEP = 0, 1
#: Of a body what all forces move its patches by, and what one does.
MOVED, TRIED, N_FIELD = 0, 3, 6


def group_parts(members: int, bodies: list[int], slots: int, unknowns: int, longest: int, first: int) -> list[int]:
    """The head of a group behind how many members and bodies it has, the fields of its bodies, and where all ends.

    Args:
        members: how many.
        bodies: of each how many patches its table has.
        slots: of all members, by `padded_size`.
        unknowns: of the group.
        longest: unknowns of the member that has most.
        first: how many numbers the members need by themselves.
    """
    P = [padded_size(p) for p in bodies]
    width, size = max(P), padded_size(unknowns)
    lengths = [N_VECTOR * slots, N_KNOWN * (members + 1), 2 * slots * slots, slots * width]
    lengths += [N_FIELD * one for one in P] + [slots * size, size * size, longest]
    places = [first + sum(lengths[:k]) for k in range(len(lengths) + 1)]
    fields = places[4 : 4 + len(P)]
    return [slots, width, unknowns, *places[:4], *places[4 + len(P) : -1], *fields, places[-1]]


@kernel
def group_of(plan, row):
    """Where the group of a surface begins in ``Plan.data``; -1: it is alone."""
    return int(plan.data[row[at.EL_DATA] + sl.GROUP])


@kernel
def number_in_group(plan, row):
    """Which member it is."""
    return int(plan.data[row[at.EL_DATA] + sl.MEMBER])


@kernel
def of_group(plan, g, what):
    """A number of the group's head."""
    return int(plan.data[g + what])


@kernel
def of_member(plan, g, i, what):
    """A number of member i."""
    return int(plan.data[g + N_HEAD + N_MEMBER * i + what])


@kernel
def of_body(plan, g, b, what):
    """A number of body b."""
    return int(plan.data[g + N_HEAD + N_MEMBER * of_group(plan, g, N_MEMBERS) + N_BODY * b + what])


@kernel
def padded_patches(plan, g, b):
    """How many numbers a row of the fields of body b has."""
    return padded(int(plan.data[of_body(plan, g, b, TABLE) + sl.N_PATCH]))


@kernel
def gather_contacts(plan, work, row, g, m, found):
    """Add a member's near patches, as ``find_gaps`` left them on m slots, to the ``found`` ones; how many there are."""
    i = number_in_group(plan, row)
    _, p, _ = sl.table_of(plan, row)
    _, size, _ = sl.other_of(plan, row)
    V = matrix_view(work.generalized, 0, sl.N_VECTOR, padded(p))
    points = matrix_view(work.generalized, sl.points_place(p), padded(p), sl.N_POINT)
    own_weights = matrix_view(work.generalized, sl.weights_place(p), padded(p), padded(size))
    vectors = matrix_view(work.generalized, of_group(plan, g, VECTORS), N_VECTOR, of_group(plan, g, N_SLOTS))
    slots, width = of_group(plan, g, N_SLOTS), of_group(plan, g, WIDTH)
    weights = matrix_view(work.generalized, of_group(plan, g, WEIGHTS), slots, width)
    numbers, others = of_member(plan, g, i, OWN_NUMBERS), of_member(plan, g, i, OTHER_NUMBERS)
    for k in range(m):
        if V[sl.GAP, k] == math.inf:
            continue
        vectors[GAP, found], vectors[OWNER, found], vectors[SLOT, found] = V[sl.GAP, k], i, k
        vectors[PATCH, found] = plan.data[numbers + int(V[sl.PATCH, k])]
        for c in range(3):
            vectors[NORMAL + c, found] = points[k, sl.NORMAL + c]
            vectors[OWN_NORMAL + c, found] = V[sl.OWN_NORMAL + c, k]
        if size > 0:
            for e in range(weights.shape[1]):
                weights[found, e] = 0.0
            for e in range(size):
                weights[found, int(plan.data[others + e])] = own_weights[k, e]
        found += 1
    return found


@kernel
def _presses(plan, g, b, i):
    """Whether member i presses body b."""
    return of_member(plan, g, i, OWN) == b or of_member(plan, g, i, OTHER) == b


@kernel
def _move(plan, work, g, b, a, along, own, size, first):
    """Add to a field of body b what a force of ``size`` on contact a moves its patches by.

    It pushes along a direction in F's axes, in the body's own axes ``own``.
    """
    vectors = matrix_view(work.generalized, of_group(plan, g, VECTORS), N_VECTOR, of_group(plan, g, N_SLOTS))
    slots, width = of_group(plan, g, N_SLOTS), of_group(plan, g, WIDTH)
    weights = matrix_view(work.generalized, of_group(plan, g, WEIGHTS), slots, width)
    i = int(vectors[OWNER, a])
    fields = matrix_view(work.generalized, of_body(plan, g, b, FIELDS), N_FIELD, padded_patches(plan, g, b))
    t = of_body(plan, g, b, TABLE)
    p, n = int(plan.data[t + sl.N_PATCH]), int(plan.data[t + sl.N_MODE])
    if of_member(plan, g, i, OWN) == b:
        move_by(plan.data, p, n, t, int(vectors[PATCH, a]), scale3(size, own), fields, first)
    else:
        for e in range(p):
            if weights[a, e] != 0.0:
                move_by(plan.data, p, n, t, e, scale3(-size * weights[a, e], along), fields, first)


@kernel
def _felt(plan, work, g, b, a, first):
    """What a field of body b opens the gap of contact a by."""
    vectors = matrix_view(work.generalized, of_group(plan, g, VECTORS), N_VECTOR, of_group(plan, g, N_SLOTS))
    slots, width = of_group(plan, g, N_SLOTS), of_group(plan, g, WIDTH)
    weights = matrix_view(work.generalized, of_group(plan, g, WEIGHTS), slots, width)
    fields = matrix_view(work.generalized, of_body(plan, g, b, FIELDS), N_FIELD, padded_patches(plan, g, b))
    if of_member(plan, g, int(vectors[OWNER, a]), OWN) == b:
        return dot3(sl.at3(vectors, OWN_NORMAL, a), sl.at3(fields, first, int(vectors[PATCH, a])))
    return -dot3(sl.at3(vectors, NORMAL, a), mean_of(fields, first, weights[a, : fields.shape[1]]))


@kernel
def _write_flexibility(plan, work, g, m):
    """Write the upper triangle of C (m, m)."""
    vectors = matrix_view(work.generalized, of_group(plan, g, VECTORS), N_VECTOR, of_group(plan, g, N_SLOTS))
    C = matrix_view(work.generalized, of_group(plan, g, MATRIX), m, m)
    C[:, :] = 0.0
    for b in range(of_group(plan, g, N_BODIES)):
        fields = matrix_view(work.generalized, of_body(plan, g, b, FIELDS), N_FIELD, padded_patches(plan, g, b))
        for a in range(m):
            if not _presses(plan, g, b, int(vectors[OWNER, a])):
                continue
            clear_others(fields, TRIED)
            _move(plan, work, g, b, a, sl.at3(vectors, NORMAL, a), sl.at3(vectors, OWN_NORMAL, a), 1.0, TRIED)
            for c in range(a, m):
                if _presses(plan, g, b, int(vectors[OWNER, c])):
                    C[a, c] += _felt(plan, work, g, b, c, TRIED)


@kernel
def factor_place(plan, g):
    """Where the factor of C begins in the scratch space."""
    S = of_group(plan, g, N_SLOTS)
    return of_group(plan, g, MATRIX) + S * S


@kernel
def press_contacts(plan, work, g, m):
    """Find the forces of the first m contacts, and how all patches of the bodies are moved; how many bear, or -1.

    A patch that two contacts press along one normal shares its force among them.
    """
    vectors = matrix_view(work.generalized, of_group(plan, g, VECTORS), N_VECTOR, of_group(plan, g, N_SLOTS))
    for a in range(m):
        if vectors[GAP, a] != vectors[GAP, a]:
            return -1
    _write_flexibility(plan, work, g, m)
    C = matrix_view(work.generalized, of_group(plan, g, MATRIX), m, m)
    count = -1
    for turn in range(2):
        if turn == 1:
            for a in range(m):
                C[a, a] += EQUAL * C[a, a]
        count = solve_complementary(
            C, vectors[GAP], m, vectors[FORCE], vectors[LEFT], vectors[INSIDE], vectors[ORDER],
            work.generalized, factor_place(plan, g),
        )  # fmt: skip
        if count >= 0:
            break
    for b in range(of_group(plan, g, N_BODIES)):
        fields = matrix_view(work.generalized, of_body(plan, g, b, FIELDS), N_FIELD, padded_patches(plan, g, b))
        clear_others(fields, MOVED)
        for k in range(count):
            a = int(vectors[ORDER, k])
            if _presses(plan, g, b, int(vectors[OWNER, a])):
                along, own = sl.at3(vectors, NORMAL, a), sl.at3(vectors, OWN_NORMAL, a)
                _move(plan, work, g, b, a, along, own, vectors[FORCE, a], MOVED)
    return count


@kernel
def count_bearing(plan, work, g, count):
    """Write how many contacts of each member are among the first ``count`` of ORDER, which bear."""
    vectors = matrix_view(work.generalized, of_group(plan, g, VECTORS), N_VECTOR, of_group(plan, g, N_SLOTS))
    known = matrix_view(work.generalized, of_group(plan, g, MEMBERS), of_group(plan, g, N_MEMBERS) + 1, N_KNOWN)
    for i in range(of_group(plan, g, N_MEMBERS)):
        known[i, OWN_BEARING] = 0.0
    for k in range(count):
        known[int(vectors[OWNER, int(vectors[ORDER, k])]), OWN_BEARING] += 1.0


@kernel
def bears(plan, work, row):
    """Whether a contact of a member bears whose group has been pressed."""
    g, i = group_of(plan, row), number_in_group(plan, row)
    return work.generalized[of_group(plan, g, MEMBERS) + N_KNOWN * i + OWN_BEARING] > 0.0


@kernel
def stored_by_contacts(plan, work, g, count):
    """What the residual flexibility of the bodies stores (J), of the first ``count`` of ORDER, which bear."""
    vectors = matrix_view(work.generalized, of_group(plan, g, VECTORS), N_VECTOR, of_group(plan, g, N_SLOTS))
    energy = 0.0
    for k in range(count):
        a = int(vectors[ORDER, k])
        energy -= 0.5 * vectors[FORCE, a] * vectors[GAP, a]
    return energy


@kernel
def forces_of_member(plan, work, row, g, count):
    """Write a member's forces at its slots; how many of its patches bear, the first of its own ORDER.

    LEFT has their places among all that bear.
    """
    i = number_in_group(plan, row)
    _, p, _ = sl.table_of(plan, row)
    V = matrix_view(work.generalized, 0, sl.N_VECTOR, padded(p))
    vectors = matrix_view(work.generalized, of_group(plan, g, VECTORS), N_VECTOR, of_group(plan, g, N_SLOTS))
    own = 0
    for k in range(count):
        a = int(vectors[ORDER, k])
        if int(vectors[OWNER, a]) == i:
            V[sl.ORDER, own], V[sl.LEFT, own] = vectors[SLOT, a], k
            V[sl.FORCE, int(vectors[SLOT, a])] = vectors[FORCE, a]
            own += 1
    return own


@kernel
def residual_in_group(plan, work, row, g, k):
    """What the residual flexibility moves a member's patch k by (m), in the body's axes."""
    i = number_in_group(plan, row)
    b = of_member(plan, g, i, OWN)
    fields = matrix_view(work.generalized, of_body(plan, g, b, FIELDS), N_FIELD, padded_patches(plan, g, b))
    return sl.at3(fields, MOVED, int(plan.data[of_member(plan, g, i, OWN_NUMBERS) + k]))


@kernel
def residuals_of_member(plan, work, row, g, count):
    """Write how the residual flexibility moves its patches that touch, and all of the other surface."""
    i = number_in_group(plan, row)
    _, p, _ = sl.table_of(plan, row)
    _, size, _ = sl.other_of(plan, row)
    V = matrix_view(work.generalized, 0, sl.N_VECTOR, padded(p))
    points = matrix_view(work.generalized, sl.points_place(p), padded(p), sl.N_POINT)
    others = matrix_view(work.generalized, sl.others_place(p, size), sl.N_OTHER, padded(size))
    for a in range(count):
        k = int(V[sl.ORDER, a])
        store3(points[k], sl.OWN_RESIDUAL, residual_in_group(plan, work, row, g, int(V[sl.PATCH, k])))
    if size > 0:
        b = of_member(plan, g, i, OTHER)
        fields = matrix_view(work.generalized, of_body(plan, g, b, FIELDS), N_FIELD, padded_patches(plan, g, b))
        clear_others(others, sl.DENT)
        for e in range(size):
            number = int(plan.data[of_member(plan, g, i, OTHER_NUMBERS) + e])
            sl.put3(others, sl.DENT, e, sl.at3(fields, MOVED, number))


@kernel
def column_of(plan, row, g, k):
    """Which of the group's unknowns a member's k-th is."""
    i = number_in_group(plan, row)
    if k < 6:
        return 6 * i + k
    _, _, n = sl.table_of(plan, row)
    if k < 6 + n:
        return of_body(plan, g, of_member(plan, g, i, OWN), FIRST_MODE) + k - 6
    return of_body(plan, g, of_member(plan, g, i, OTHER), FIRST_MODE) + k - 6 - n


@kernel
def _couple(plan, work, g, b, j, count, R):
    """The couple, in F's axes of member j, that a tried motion of its body's patches has with its forces."""
    vectors = matrix_view(work.generalized, of_group(plan, g, VECTORS), N_VECTOR, of_group(plan, g, N_SLOTS))
    fields = matrix_view(work.generalized, of_body(plan, g, b, FIELDS), N_FIELD, padded_patches(plan, g, b))
    total = (0.0, 0.0, 0.0)
    for k in range(count):
        a = int(vectors[ORDER, k])
        if int(vectors[OWNER, a]) == j:
            moved = sl.at3(fields, TRIED, int(vectors[PATCH, a]))
            total = add3(total, cross3(moved, scale3(vectors[FORCE, a], sl.at3(vectors, OWN_NORMAL, a))))
    return rotate(R, total)


@kernel
def _rotation_of(known, j):
    """R of a member."""
    k = known[j]
    return (k[0], k[1], k[2], k[3], k[4], k[5], k[6], k[7], k[8])


@kernel
def _add_couples(plan, work, g, b, i, count, sign, out):
    """Add to ``out``, numbers of all unknowns, the couples on all other members than i by a tried motion of body b."""
    known = matrix_view(work.generalized, of_group(plan, g, MEMBERS), of_group(plan, g, N_MEMBERS) + 1, N_KNOWN)
    for j in range(of_group(plan, g, N_MEMBERS)):
        if j != i and of_member(plan, g, j, OWN) == b:
            couple = _couple(plan, work, g, b, j, count, _rotation_of(known, j))
            for c in range(3):
                out[6 * j + 3 + c] += sign * couple[c]


@kernel
def add_couples_by_forces(plan, work, g, count):
    """Add to B what a unit of force on each contact changes of the couples on all other members."""
    vectors = matrix_view(work.generalized, of_group(plan, g, VECTORS), N_VECTOR, of_group(plan, g, N_SLOTS))
    N = padded(of_group(plan, g, N_UNKNOWNS))
    B = matrix_view(work.generalized, of_group(plan, g, ROWS), count, N)
    for k in range(count):
        a = int(vectors[ORDER, k])
        i = int(vectors[OWNER, a])
        for b in range(of_group(plan, g, N_BODIES)):
            if not _presses(plan, g, b, i):
                continue
            fields = matrix_view(work.generalized, of_body(plan, g, b, FIELDS), N_FIELD, padded_patches(plan, g, b))
            clear_others(fields, TRIED)
            _move(plan, work, g, b, a, sl.at3(vectors, NORMAL, a), sl.at3(vectors, OWN_NORMAL, a), 1.0, TRIED)
            _add_couples(plan, work, g, b, i, count, 1.0, B[k])


@kernel
def add_couples_by_turns(plan, work, g, count):
    """Add to K what a turn of each member, with its forces at rest, changes of the couples on all others."""
    vectors = matrix_view(work.generalized, of_group(plan, g, VECTORS), N_VECTOR, of_group(plan, g, N_SLOTS))
    known = matrix_view(work.generalized, of_group(plan, g, MEMBERS), of_group(plan, g, N_MEMBERS) + 1, N_KNOWN)
    N = padded(of_group(plan, g, N_UNKNOWNS))
    K = matrix_view(work.generalized, of_group(plan, g, STIFFNESS), N, N)
    for i in range(of_group(plan, g, N_MEMBERS)):
        b, R = of_member(plan, g, i, OWN), _rotation_of(known, i)
        for c in range(3):
            fields = matrix_view(work.generalized, of_body(plan, g, b, FIELDS), N_FIELD, padded_patches(plan, g, b))
            clear_others(fields, TRIED)
            e = (1.0 if c == 0 else 0.0, 1.0 if c == 1 else 0.0, 1.0 if c == 2 else 0.0)
            for k in range(count):
                a = int(vectors[ORDER, k])
                if int(vectors[OWNER, a]) == i:
                    turned = cross3(e, sl.at3(vectors, NORMAL, a))
                    _move(plan, work, g, b, a, turned, rotate_back(R, turned), vectors[FORCE, a], TRIED)
            _add_couples(plan, work, g, b, i, count, -1.0, K[:, 6 * i + 3 + c])
