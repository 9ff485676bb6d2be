"""Where shapes touch: the entry, and a call that makes room for what it finds."""

from __future__ import annotations

import math

from flexmbd.multibody.kernels.base.arrays import FloatArray
from flexmbd.multibody.kernels.base.compiling import entry_kernel
from flexmbd.multibody.kernels.contact.finding.near_pairs import approach, find_pairs, place_shapes
from flexmbd.multibody.kernels.contact.finding.shape_table import (
    ContactPoints,
    FindingWork,
    ShapeTable,
    new_contact_points,
    new_finding_work,
)
from flexmbd.multibody.kernels.contact.finding.touch import touch

#: What ``find_contacts`` returns where it found no number of points.
TOO_SMALL, NOT_FINITE = -1, -2


@entry_kernel
def find_contacts(table, positions, rotations, velocities, spins, h, margin, work, out):
    """Write all points where shapes touch, or may come within ``margin`` of each other in the step, into ``out``.

    Args:
        table: the shapes.
        positions: (n, 3) m of the bodies' origins in the world.
        rotations: (n, 3, 3) from each body's axes to the world's.
        velocities: (n, 3) m/s of the origins, in the world's axes.
        spins: (n, 3) rad/s, in the world's axes.
        h: s, the step; 0: where they are.
        margin: m; points whose gap is larger than this and what the shapes can approach in h are left out.
        work: ``new_finding_work(table)``.
        out: ``new_contact_points(...)``.

    Returns how many points there are, in an order that depends on the shapes' places alone.  TOO_SMALL: ``work.needed``
    has how many near pairs there are and, where these fit into ``work``, how many points; ``make_room`` answers it.
    NOT_FINITE: a body's place or velocity is not.
    """
    if not place_shapes(table, work, positions, rotations, velocities, spins):
        return NOT_FINITE
    pairs = find_pairs(table, work, h, margin)
    work.needed[0], work.needed[1] = pairs, 0
    if pairs > work.pairs.shape[0]:
        return TOO_SMALL
    count = 0
    for k in range(pairs):
        a, b = work.pairs[k, 0], work.pairs[k, 1]
        moved = approach(table, work, a, b, h) if table.bound[a] < math.inf else approach(table, work, b, a, h)
        count = touch(table, work, out, a, b, margin + moved, count)
    work.needed[1] = count
    return count if count <= out.gap.shape[0] else TOO_SMALL


def make_room(table: ShapeTable, work: FindingWork, out: ContactPoints) -> tuple[FindingWork, ContactPoints]:
    """Larger arrays after TOO_SMALL, with half as much again to spare."""
    pairs, points = (int(needed) for needed in work.needed)
    if pairs > len(work.pairs):
        work = new_finding_work(table, pairs=pairs + pairs // 2)
    if points > len(out.gap):
        out = new_contact_points(points + points // 2)
    return work, out


def contact_points(
    table: ShapeTable,
    positions: FloatArray,
    rotations: FloatArray,
    *,
    velocities: FloatArray,
    spins: FloatArray,
    h: float,
    margin: float,
) -> tuple[int, ContactPoints]:
    """As ``find_contacts``, with arrays of its own, for one call."""
    work, out = new_finding_work(table), new_contact_points(max(64, 4 * len(table.body)))
    while True:
        count = find_contacts(table, positions, rotations, velocities, spins, h, margin, work, out)
        if count != TOO_SMALL:
            return count, out
        work, out = make_room(table, work, out)
