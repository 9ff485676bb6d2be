"""Which shapes are near each other within a step: boxes about them in the world, and a tree of these boxes.

Leaves are sorted along Morton's curve through their centres; the tree is complete and needs no pointers: the children
of node i are 2 i and 2 i + 1.  It is built anew at each call, in O(n), so that what is found depends on nothing but
where the bodies are, and the pairs come in the order of their numbers.
"""

from __future__ import annotations

import math

from flexmbd.multibody.kernels.algebra.so3 import (
    add3,
    compose,
    cross3,
    dot3,
    load3,
    load9,
    rotate,
    rotate_back,
    store3,
    store9,
    sub3,
)
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.contact.finding.shape_table import FIRST_VERTEX, VERTICES
from flexmbd.multibody.kernels.contact.signed_distance import CYLINDER, HALF_SPACE, HOLLOW_CYLINDER

_CELLS = 2097151.0  # along each axis of Morton's curve: 21 bits, three of which are one key
_ZERO = (0.0, 0.0, 0.0)


@kernel
def place_shapes(table, work, positions, rotations, velocities, spins):
    """Write where each shape is and how it moves; False if a number is not finite."""
    size = 0.0
    for s in range(table.body.shape[0]):
        centre, turn = load3(table.place[s], 0), load9(table.turn[s], 0)
        velocity, spin = _ZERO, _ZERO
        b = table.body[s]
        if b >= 0:
            R = rotations[b]
            axes = (R[0, 0], R[0, 1], R[0, 2], R[1, 0], R[1, 1], R[1, 2], R[2, 0], R[2, 1], R[2, 2])
            arm = rotate(axes, centre)
            centre, turn = add3(load3(positions[b], 0), arm), compose(axes, turn)
            spin = load3(spins[b], 0)
            velocity = add3(load3(velocities[b], 0), cross3(spin, arm))
        store3(work.centre[s], 0, centre)
        store9(work.turn[s], 0, turn)
        store3(work.velocity[s], 0, velocity)
        store3(work.spin[s], 0, spin)
        size += dot3(centre, centre) + dot3(velocity, velocity) + dot3(spin, spin)
        for k in range(9):
            size += abs(turn[k])
    return size < math.inf


@kernel
def approach(table, work, a, b, h):
    """How far (m) a point of the bounded shape a can move within h (s) as seen from shape b."""
    arm = sub3(load3(work.centre[a], 0), load3(work.centre[b], 0))
    spin = load3(work.spin[b], 0)
    rate = sub3(sub3(load3(work.velocity[a], 0), load3(work.velocity[b], 0)), cross3(spin, arm))
    turning = sub3(load3(work.spin[a], 0), spin)
    return h * (math.sqrt(dot3(rate, rate)) + math.sqrt(dot3(turning, turning)) * table.bound[a])


@kernel
def _lay_box(table, work, s, h, margin):
    """The box that contains a bounded shape throughout the step, and half of the margin about it."""
    head = table.cores.head[table.core[s]]
    first = head[FIRST_VERTEX]
    scale, turn = load3(table.scale[s], 0), load9(work.turn[s], 0)
    x, y, z = -math.inf, -math.inf, -math.inf
    low_x, low_y, low_z = math.inf, math.inf, math.inf
    for k in range(head[VERTICES]):
        v = load3(table.cores.vertices[first + k], 0)
        p = rotate(turn, (scale[0] * v[0], scale[1] * v[1], scale[2] * v[2]))
        x, y, z = max(x, p[0]), max(y, p[1]), max(z, p[2])
        low_x, low_y, low_z = min(low_x, p[0]), min(low_y, p[1]), min(low_z, p[2])
    spin = load3(work.spin[s], 0)
    bound = table.bound[s]
    wider = table.radius[s] + h * math.sqrt(dot3(spin, spin)) * bound
    high, low = (x, y, z), (low_x, low_y, low_z)
    for k in range(3):
        centre, path = work.centre[s, k], h * work.velocity[s, k]
        above = min(high[k] + wider, bound) + 0.5 * margin
        below = max(low[k] - wider, -bound) - 0.5 * margin
        work.boxes[s, k] = centre + min(path, 0.0) + below
        work.boxes[s, 3 + k] = centre + max(path, 0.0) + above


@kernel
def _spread(x):
    """The 21 bits of x, two zeros between each and the next."""
    x = (x | (x << 32)) & 0x1F00000000FFFF
    x = (x | (x << 16)) & 0x1F0000FF0000FF
    x = (x | (x << 8)) & 0x100F00F00F00F00F
    x = (x | (x << 4)) & 0x10C30C30C30C30C3
    return (x | (x << 2)) & 0x1249249249249249


@kernel
def _sort_keys(keys, order, spare_keys, spare_order, counts):
    """Sort keys >= 0, and ``order`` along with them, by eight bits at a time."""
    count = keys.shape[0]
    for shift in range(0, 64, 8):
        for k in range(257):
            counts[k] = 0
        for k in range(count):
            counts[((keys[k] >> shift) & 255) + 1] += 1
        if counts[((keys[0] >> shift) & 255) + 1] == count:
            continue
        for k in range(256):
            counts[k + 1] += counts[k]
        for k in range(count):
            digit = (keys[k] >> shift) & 255
            to = counts[digit]
            counts[digit] = to + 1
            spare_keys[to] = keys[k]
            spare_order[to] = order[k]
        for k in range(count):
            keys[k] = spare_keys[k]
            order[k] = spare_order[k]


@kernel
def _along_curve(table, work):
    """Order the bounded shapes along Morton's curve."""
    low_x, low_y, low_z, size = math.inf, math.inf, math.inf, 0.0
    for s in table.bounded:
        low_x, low_y, low_z = min(low_x, work.boxes[s, 0]), min(low_y, work.boxes[s, 1]), min(low_z, work.boxes[s, 2])
    for s in table.bounded:
        size = max(size, work.boxes[s, 3] - low_x, work.boxes[s, 4] - low_y, work.boxes[s, 5] - low_z)
    cells = _CELLS / size if size > 0.0 else 0.0
    for k in range(table.bounded.shape[0]):
        s = table.bounded[k]
        i = _spread(int(cells * (0.5 * (work.boxes[s, 0] + work.boxes[s, 3]) - low_x)))
        j = _spread(int(cells * (0.5 * (work.boxes[s, 1] + work.boxes[s, 4]) - low_y)))
        q = _spread(int(cells * (0.5 * (work.boxes[s, 2] + work.boxes[s, 5]) - low_z)))
        work.keys[k] = i | (j << 1) | (q << 2)
        work.order[k] = s
    _sort_keys(work.keys, work.order, work.spare_keys, work.spare_order, work.counts)


@kernel
def _grow_tree(work):
    """The boxes of all nodes, from the leaves up; returns where the leaves begin."""
    tree, leaves = work.tree, work.tree.shape[0] // 2
    for k in range(leaves):
        node = tree[leaves + k]
        if k < work.order.shape[0]:
            box = work.boxes[work.order[k]]
            for i in range(6):
                node[i] = box[i]
        else:
            for i in range(3):
                node[i], node[3 + i] = math.inf, -math.inf
    for k in range(leaves - 1, 0, -1):
        for i in range(3):
            tree[k, i] = min(tree[2 * k, i], tree[2 * k + 1, i])
            tree[k, 3 + i] = max(tree[2 * k, 3 + i], tree[2 * k + 1, 3 + i])
    return leaves


@kernel
def _apart(one, other):
    """Whether two boxes have no point in common."""
    return (
        (one[0] > other[3]) | (other[0] > one[3])
        | (one[1] > other[4]) | (other[1] > one[4])
        | (one[2] > other[5]) | (other[2] > one[5])
    )  # fmt: skip


@kernel
def _may_touch(table, a, b):
    """Whether two shapes, a < b, are to touch at all."""
    if table.body[a] == table.body[b] or table.law[table.group[a], table.group[b]] < 0:
        return False
    low, high = 0, table.excluded.shape[0]
    key = a * table.body.shape[0] + b
    while low < high:
        middle = (low + high) // 2
        if table.excluded[middle] < key:
            low = middle + 1
        else:
            high = middle
    return not (low < table.excluded.shape[0] and table.excluded[low] == key)


@kernel
def _note(table, work, one, other, count):
    """Write a pair, if it may touch and there is room; how many there are."""
    a, b = min(one, other), max(one, other)
    if not _may_touch(table, a, b):
        return count
    if count < work.pairs.shape[0]:
        work.pairs[count, 0], work.pairs[count, 1] = a, b
    return count + 1


@kernel
def _search(table, work, root, leaves, leaf, count):
    """Note the pairs of a leaf with the leaves below ``root``."""
    tree = work.tree
    box, node = tree[leaves + leaf], root
    while True:
        if not _apart(box, tree[node]):
            if node < leaves:
                node *= 2
                continue
            count = _note(table, work, work.order[leaf], work.order[node - leaves], count)
        while node != root and node & 1:
            node >>= 1
        if node == root:
            return count
        node += 1


@kernel
def _reaches(table, work, u, s, reach):
    """Whether the sphere about a bounded shape is within reach of an unbounded one."""
    centre, bound = sub3(load3(work.centre[s], 0), load3(work.centre[u], 0)), table.bound[s]
    p = rotate_back(load9(work.turn[u], 0), centre)
    kind = table.numbers[4 * u]
    if kind == HALF_SPACE:
        return dot3(load3(table.numbers, 4 * u + 1), p) <= bound + reach
    size = table.numbers[4 * u + 1]
    if kind == CYLINDER:
        return math.hypot(p[0], p[1]) <= size + bound + reach
    away = math.hypot(p[0], p[1]) if kind == HOLLOW_CYLINDER else math.sqrt(dot3(p, p))
    return away >= size - bound - reach


@kernel
def _sort_pairs(work, count, shapes):
    """Sort the pairs by their second shape, then by the first."""
    one, other = work.pairs, work.spare_pairs
    for column in range(1, -1, -1):
        for k in range(shapes + 1):
            work.counts[k] = 0
        for k in range(count):
            work.counts[one[k, column] + 1] += 1
        for k in range(shapes):
            work.counts[k + 1] += work.counts[k]
        for k in range(count):
            to = work.counts[one[k, column]]
            work.counts[one[k, column]] = to + 1
            other[to, 0], other[to, 1] = one[k, 0], one[k, 1]
        one, other = other, one


@kernel
def find_pairs(table, work, h, margin):
    """Write the pairs of shapes that may come within ``margin`` (m) of each other during h (s), sorted; their number.

    Not sorted, and not all written, where that is more than ``work.pairs`` holds.
    """
    count = 0
    for s in table.bounded:
        _lay_box(table, work, s, h, margin)
    for u in table.unbounded:
        for s in table.bounded:
            if _reaches(table, work, u, s, margin + approach(table, work, s, u, h)):
                count = _note(table, work, u, s, count)
    if table.bounded.shape[0] > 1:
        _along_curve(table, work)
        leaves = _grow_tree(work)
        for leaf in range(table.bounded.shape[0]):
            node = leaves + leaf
            while node > 1:  # what stands to the right of it, the nearest first
                if node & 1 == 0:
                    count = _search(table, work, node + 1, leaves, leaf, count)
                node >>= 1
    if count <= work.pairs.shape[0]:
        _sort_pairs(work, count, table.body.shape[0])
    return count
