"""The points of groups of shapes, as they are found in a step (``contact.finding``)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.kernels.algebra.so3 import add3, cross3, dot3, load3, load9, rotate, scale3, store3, sub3
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.array_struct import ArrayStruct
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.contact.finding.find_contacts import find_contacts
from flexmbd.multibody.kernels.contact.finding.shape_table import ContactPoints, FindingWork, ShapeTable
from flexmbd.multibody.kernels.elements.hard_element import N_LAW

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
_ZERO = (0.0, 0.0, 0.0)


@dataclass(frozen=True, eq=False)
class ShapeGroups(ArrayStruct):
    """All shapes of groups, and what finding them takes.

    Attributes:
        table, work, out: of ``contact.finding``.
        frame: (n,) row of ``Plan.frames`` of each shape.
        law: (g, N_LAW) of each group (``hard_element``); number: (g,) that of its element in the scene.
        positions, rotations, velocities, spins: of the bodies, in the world.
    """

    table: ShapeTable
    work: FindingWork
    out: ContactPoints
    frame: IntArray
    law: FloatArray
    number: IntArray
    positions: FloatArray
    rotations: FloatArray
    velocities: FloatArray
    spins: FloatArray


@kernel
def take_motions(plan, work, groups):
    """Write where all bodies are and how they move, by the kinematics in ``work``; the largest squared speed."""
    fastest = 0.0
    for b in range(plan.tree.shape[0]):
        body = work.body[b]
        R = load9(body, at.B_R)
        v = rotate(R, load3(body, at.B_V))
        store3(groups.positions[b], 0, load3(body, at.B_P))
        store3(groups.velocities[b], 0, v)
        store3(groups.spins[b], 0, rotate(R, load3(body, at.B_W)))
        for k in range(9):
            groups.rotations[b, k // 3, k % 3] = R[k]
        fastest = max(fastest, dot3(v, v))
    return fastest


@kernel
def body_velocity(groups, b, p):
    """Velocity (m/s) of a point p of body b, -1: the ground, as ``take_motions`` found it."""
    if b < 0:
        return _ZERO
    arm = sub3(p, load3(groups.positions[b], 0))
    return add3(load3(groups.velocities[b], 0), cross3(load3(groups.spins[b], 0), arm))


@kernel
def find_groups(plan, work, groups, watched, h):
    """Append the points found to ``watched``, by the kinematics in ``work``; how many, or why not (negative)."""
    if groups.frame.shape[0] == 0:
        return 0
    fastest = take_motions(plan, work, groups)
    weight = load3(plan.gravity, 0)
    margin = h * (math.sqrt(fastest) + h * math.sqrt(dot3(weight, weight)))
    found = find_contacts(
        groups.table, groups.positions, groups.rotations, groups.velocities, groups.spins, h, margin, groups.work,
        groups.out,
    )  # fmt: skip
    first = watched.element.shape[0]
    for i in range(found):
        k = first + i
        a, b = groups.out.shapes[i, 0], groups.out.shapes[i, 1]
        watched.shapes[k, 0], watched.shapes[k, 1] = a, b
        watched.frames[k, 0], watched.frames[k, 1] = groups.frame[b], groups.frame[a]
        for j in range(N_LAW):
            watched.law[k, j] = groups.law[groups.out.law[i], j]
        normal, gap = load3(groups.out.normal[i], 0), groups.out.gap[i]
        store3(watched.point[k], 0, add3(load3(groups.out.position_b[i], 0), scale3(0.5 * gap, normal)))
        store3(watched.normal[k], 0, normal)
        watched.gap[k] = gap
        watched.id[k] = groups.out.id[i]
    return found
