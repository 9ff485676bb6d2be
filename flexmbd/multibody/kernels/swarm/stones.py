"""The arrays of pseudo-rigid bodies that touch: what is constant, and the scratch of their steps.

The shape of body b is row b of the table of shapes, before the walls', and has a core of its own: its vertices and
normals are laid anew in each step as F carries them, in the world's axes about the body's centre.  So contacts are
found among convex polytopes, which a linear map leaves convex, by what finds them among rigid ones.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexmbd.multibody.kernels.base.array_struct import ArrayStruct
from flexmbd.multibody.kernels.base.arrays import FloatArray, IntArray
from flexmbd.multibody.kernels.contact.finding.shape_table import ShapeTable
from flexmbd.multibody.kernels.swarm.free_flight import LANES, N_ROWS

#: Places in ``StoneWork.whole``: steps taken; 1 where the half step before the forces is taken; near pairs, -1 where
#: they are to be found anew; points now and in the step before; a body that ended the steps.
STEP, DRIFTED, PAIRS, POINTS, BEFORE, BODY, N_WHOLE = range(7)

#: Places in ``StoneWork.told``: within how much (m) near pairs were found; det F or the longest step (s) of ``BODY``.
MARGIN, VALUE, N_TOLD = range(3)


@dataclass(frozen=True, eq=False)
class Stones(ArrayStruct):
    """n bodies and what they touch, constant while they are stepped, but for what is laid into the table's cores.

    corners: (v, 3) m the vertices of all cores as the table has them, of undeformed bodies about their centres.
    faces: (f, 3) normals alike.  reach: (n,) m of the farthest vertex.  inverse: (n, 6) V J^-1 xx xy xz yy yz zz.
    lame: (n, 2) Pa.  per_mass: (n,) 1/kg.  per_second: (n, 9) J^-1, 1/(kg m^2).  stiffest: (n,) 1/s^2, a bound
    of the fastest vibration's square.  data: the law's numbers (``contact_law``), a bristle's stiffness zero
    without friction.  gravity: (3,) m/s^2.  retardation: s, of the material's damping.
    """

    table: ShapeTable
    corners: FloatArray
    faces: FloatArray
    reach: FloatArray
    inverse: FloatArray
    lame: FloatArray
    per_mass: FloatArray
    per_second: FloatArray
    stiffest: FloatArray
    data: FloatArray
    gravity: FloatArray
    retardation: float


@dataclass(frozen=True, eq=False)
class StoneWork(ArrayStruct):
    """Scratch of n bodies and of the points where they touch.

    whole, told: see their places.  back, spin: (n, 9) F^-1, (n, 3) rad/s.  at_r, at_F: where near pairs were found.
    push, pull: (n, 3), (n, 9) accelerations of r and F.  stiff, damp: (n,) 1/s^2, 1/s bounds of what contacts add.
    z: (c, 3) m bristles of the points; id_before, z_before: points and bristles of the step before.  force: (c, 3) N
    on the first of the two.  energy: (c,) J.  lanes: scratch of ``free_flight``.  upright, still: (n, 3, 3), (n, 3).
    """

    whole: IntArray
    told: FloatArray
    back: FloatArray
    spin: FloatArray
    at_r: FloatArray
    at_F: FloatArray
    push: FloatArray
    pull: FloatArray
    stiff: FloatArray
    damp: FloatArray
    z: FloatArray
    id_before: IntArray
    z_before: FloatArray
    force: FloatArray
    energy: FloatArray
    lanes: FloatArray
    upright: FloatArray
    still: FloatArray


def new_stone_work(n: int, points: int) -> StoneWork:
    """Allocate scratch for n bodies and so many points."""
    return StoneWork(
        whole=np.zeros(N_WHOLE, np.int64), told=np.zeros(N_TOLD), back=np.zeros((n, 9)), spin=np.zeros((n, 3)),
        at_r=np.zeros((n, 3)), at_F=np.zeros((n, 9)), push=np.zeros((n, 3)), pull=np.zeros((n, 9)), stiff=np.zeros(n),
        damp=np.zeros(n), z=np.zeros((points, 3)), id_before=np.zeros(points, np.int64),
        z_before=np.zeros((points, 3)), force=np.zeros((points, 3)), energy=np.zeros(points),
        lanes=np.zeros(N_ROWS * LANES), upright=np.tile(np.eye(3), (n, 1, 1)), still=np.zeros((n, 3)),
    )  # fmt: skip


def with_room(work: StoneWork, points: int) -> StoneWork:
    """The same with room for so many points; bristles are kept."""
    if points <= len(work.z):
        return work
    more = new_stone_work(len(work.stiff), points)
    more.id_before[: len(work.z)] = work.id_before
    more.z_before[: len(work.z)] = work.z_before
    grown = {name: getattr(more, name) for name in ("z", "id_before", "z_before", "force", "energy")}
    return work.replace(**grown)
