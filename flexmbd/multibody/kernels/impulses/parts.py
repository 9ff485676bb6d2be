"""Parts of a machine that nothing but contacts couples, with the inverse of the mass matrix of each.

A part is what hangs on one joint of the ground, with all that constraint rows join to it.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.array_struct import ArrayStruct
from flexmbd.multibody.kernels.base.arrays import Plan
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.base.row_blocks import body_velocities, root_of, row_bodies
from flexmbd.multibody.kernels.impulses.lone_bodies import LoneBodies, new_lone_bodies

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class CoupledParts(ArrayStruct):
    """The parts that contacts reach.

    Attributes:
        of: (bodies,) part of each body; -1 of those that no contact reaches.
        first: (parts + 1,) where the velocities of each part begin in ``velocity``.
        velocity: (n,) indices in v.
        square: (parts + 1,) where the inverses begin in ``inverse``, each (k, k) by rows.
        inverse: their entries.
        unit, answer: (1, nv) unit forces, and the velocities that these make.
        largest: (1,) velocities of the largest part.
        widest: (1,) those of the largest of which contacts reach more than a lone body; 0: there is none.
        lone: the bodies that are all that contacts reach of their parts.
    """

    of: IntArray
    first: IntArray
    velocity: IntArray
    square: IntArray
    inverse: FloatArray
    unit: FloatArray
    answer: FloatArray
    largest: IntArray
    widest: IntArray
    lone: LoneBodies


def new_parts(plan: Plan, reached: Iterable[int]) -> CoupledParts:
    """The parts of a plan that hold the bodies ``reached`` (rows of ``Plan.tree``, -1 the ground)."""
    above: Any = plan.tree[:, at.PARENT].tolist()
    joined = {b: b for b in range(len(above))}
    ties = [(b, p) for b, p in enumerate(above) if p >= 0]
    for row in plan.rows:
        bodies = [b for b in row_bodies(plan, row) if b >= 0]
        ties += [(bodies[0], b) for b in bodies[1:]]
    for a, b in ties:
        joined[root_of(joined, a)] = root_of(joined, b)
    wanted: dict[int, dict[int, None]] = {}
    for b in reached:
        if b >= 0:
            wanted.setdefault(root_of(joined, b), {})[b] = None
    numbers = {root: k for k, root in enumerate(wanted)}
    lone = lone_rows(plan, list(wanted.values()))
    of = [numbers.get(root_of(joined, b), -1) for b in range(len(above))]
    own: list[list[int]] = [[] for _ in numbers]
    velocities: Any = body_velocities(plan)
    for b, part in enumerate(of):
        if part >= 0:
            own[part] += velocities[b]
    sizes = [len(one) for one in own]
    nv = len(plan.free) + len(plan.driven)
    square = np.cumsum([0, *(n * n for n in sizes)], dtype=np.int64)
    return CoupledParts(
        np.array(of, np.int64),
        np.cumsum([0, *sizes], dtype=np.int64),
        np.array([k for one in own for k in one], np.int64),
        square,
        np.zeros(int(square[-1])),
        np.zeros((1, nv)),
        np.zeros((1, nv)),
        np.array([max(sizes, default=0)], np.int64),
        np.array([max((n for n, b in zip(sizes, lone, strict=True) if b < 0), default=0)], np.int64),
        new_lone_bodies(lone, sum(sizes)),
    )


def lone_rows(plan: Plan, reached: Sequence[Collection[int]]) -> IntArray:
    """(parts,) the body that contacts reach in each part, where that is one and rigid; -1 elsewhere."""
    rows = [next(iter(own)) if len(own) == 1 else -1 for own in reached]
    return np.array([b if b >= 0 and plan.tree[b, at.FLEX] < 0 else -1 for b in rows], np.int64)


@kernel
def size_of(parts, c):
    """How many velocities part c has; none of the ground's, -1."""
    return parts.first[c + 1] - parts.first[c] if c >= 0 else 0


@kernel
def rows_of(parts, c):
    """How many velocities of part c stand in the rows of its contacts: none of a lone body's."""
    return size_of(parts, c) if c >= 0 and parts.lone.body[c] < 0 else 0
