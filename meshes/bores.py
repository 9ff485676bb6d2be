"""The bores of a part: round holes, found among the faces of a STEP file and named."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flexmbd.meshes.step_faces import Cylinder, StepFace, SurfacePoint

# Of the radius: how far two faces of one bore may differ; CAD programs write seven digits and more.
_EQUAL = 1e-5


@dataclass(frozen=True)
class Bore:
    """A round hole whose wall goes all the way around.

    Attributes:
        name: bore_1, bore_2, ... in the order of their centres' x, of equal ones y, of equal ones z.
        centre: on the axis, halfway, m.
        axis: unit vector.
        radius: m.
        length: m.
        faces: numbers of its faces, from 1.
    """

    name: str
    centre: SurfacePoint
    axis: SurfacePoint
    radius: float
    length: float
    faces: tuple[int, ...]


def find_bores(faces: Sequence[StepFace]) -> tuple[Bore, ...]:
    """The bores among the faces of a part: hollow cylinders that lie on each other and close around their axis.

    Args:
        faces: as `step_faces` lists them.
    """
    clusters: list[list[int]] = []
    for number, face in enumerate(faces, start=1):
        if face.cylinder is None or not face.cylinder.hollow:
            continue
        touched = [one for one in clusters if any(_one_bore(face.cylinder, faces[k - 1].cylinder) for k in one)]
        merged = [k for one in touched for k in one]
        clusters = [one for one in clusters if one not in touched] + [[*merged, number]]
    bores = [bore for bore in (_bore(faces, sorted(one)) for one in clusters) if bore is not None]
    size = max((max(map(abs, bore.centre)) for bore in bores), default=0.0) or 1.0
    bores.sort(key=lambda bore: tuple(round(x / size, 6) for x in (*bore.centre, bore.radius)))
    return tuple(
        Bore(f"bore_{k}", bore.centre, bore.axis, bore.radius, bore.length, bore.faces)
        for k, bore in enumerate(bores, start=1)
    )


def _one_bore(one: Cylinder, other: Cylinder | None) -> bool:
    """Whether two faces lie on one cylinder and beside each other along it."""
    if other is None or abs(one.radius - other.radius) > _EQUAL * one.radius:
        return False
    axis = np.array(one.axis)
    if np.linalg.norm(np.cross(axis, other.axis)) > _EQUAL:
        return False
    apart = np.subtract(other.centre, one.centre)
    along = float(abs(apart @ axis))
    across = float(np.linalg.norm(apart - (apart @ axis) * axis))
    return across <= _EQUAL * one.radius and along < (one.length + other.length) / 2 * (1 - _EQUAL)


def _bore(faces: Sequence[StepFace], numbers: Sequence[int]) -> Bore | None:
    parts = [part for part in (faces[number - 1].cylinder for number in numbers) if part is not None]
    if sum(part.angle for part in parts) < 2 * math.pi * (1 - _EQUAL):
        return None
    axis, origin = np.array(parts[0].axis), np.array(parts[0].centre)
    ends = [
        float((np.array(part.centre) - origin) @ axis) + side * part.length / 2 for part in parts for side in (-1, 1)
    ]
    x, y, z = origin + (min(ends) + max(ends)) / 2 * axis
    length = max(ends) - min(ends)
    return Bore("", (float(x), float(y), float(z)), parts[0].axis, parts[0].radius, length, tuple(numbers))
