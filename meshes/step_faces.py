"""The faces of a STEP model that gmsh has read: centre, area, normal, and the cylinder that a face lies on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import gmsh
import numpy as np

SurfacePoint: TypeAlias = tuple[float, float, float]


@dataclass(frozen=True)
class Cylinder:
    """The cylinder that a face lies on, as far as the face goes along it.

    Attributes:
        centre: on the axis, halfway along the face, m.
        axis: unit vector.
        radius: m.
        length: of the face along the axis, m.
        angle: that the face goes around the axis, rad.
        hollow: whether the material lies outside, as around a bore.
    """

    centre: SurfacePoint
    axis: SurfacePoint
    radius: float
    length: float
    angle: float
    hollow: bool


@dataclass(frozen=True)
class StepFace:
    """A face of a part, as `from_step` shows it to the functions that choose faces.

    Attributes:
        centre: its centroid by area, m.
        area: m².
        normal: unit normal of a plane face, out of the part or into it; None for others.
        radius: m, of a cylindrical face; None for others.
        cylinder: more about a cylindrical face; None for others.
    """

    centre: SurfacePoint
    area: float
    normal: SurfacePoint | None
    radius: float | None
    cylinder: Cylinder | None = None

    def __str__(self) -> str:
        kind = "curved"
        if self.normal is not None:
            kind = f"plane, normal to {point_text(self.normal)}"
        if self.radius is not None:
            kind = f"cylinder of radius {self.radius:.6g} m"
        return f"{kind}, centre {point_text(self.centre)} m, area {self.area:.4g} m²"


def volume(scale: float) -> float:
    """m^3, of all solids of the model."""
    return scale * scale * scale * sum(gmsh.model.occ.getMass(*entity) for entity in gmsh.model.getEntities(3))


def read_faces(scale: float) -> dict[int, StepFace]:
    """The faces of the model's boundary by gmsh's tags."""
    volumes = gmsh.model.getEntities(3)
    boundary = gmsh.model.getBoundary(volumes, combined=True, oriented=False)
    faces = {}
    for _, tag in boundary:
        low, high = gmsh.model.getParametrizationBounds(2, tag)
        middle = [(a + b) / 2 for a, b in zip(low, high, strict=True)]
        kind = gmsh.model.getType(2, tag)
        x, y, z = (scale * x for x in gmsh.model.occ.getCenterOfMass(2, tag))
        normal = radius = cylinder = None
        if kind == "Plane":
            a, b, c = (float(part) for part in gmsh.model.getNormal(tag, middle))
            normal = (a, b, c)
        elif kind == "Cylinder":
            most, least, _, _ = gmsh.model.getPrincipalCurvatures(tag, middle)
            radius = scale / max(abs(float(most[0])), abs(float(least[0])))
            cylinder = _cylinder(tag, radius, scale)
        area = scale * scale * gmsh.model.occ.getMass(2, tag)
        faces[tag] = StepFace((x, y, z), area, normal, radius, cylinder)
    return faces


def _cylinder(tag: int, radius: float, scale: float) -> Cylinder:
    """The cylinder of a cylindrical face, whose parameters are the angle and the way along the axis."""
    (u, v), (u_end, v_end) = gmsh.model.getParametrizationBounds(2, tag)
    middle = [(u + u_end) / 2, (v + v_end) / 2]
    start, end, on = gmsh.model.getValue(2, tag, [middle[0], v, middle[0], v_end, *middle]).reshape(3, 3)
    normal = gmsh.model.getNormal(tag, middle)
    # the axis lies to that side of the face to which its normals converge
    beside = [middle[0] + 0.1 * (u_end - u), middle[1]]
    apart = gmsh.model.getValue(2, tag, beside) - on
    outward = normal if np.dot(gmsh.model.getNormal(tag, beside) - normal, apart) > 0.0 else -normal
    probe = on + 1e-4 * radius / scale * outward
    hollow = any(gmsh.model.isInside(3, volume, probe.tolist()) for _, volume in gmsh.model.getEntities(3))
    x, y, z = (scale * on - radius * outward).tolist()
    a, b, c = ((end - start) / np.linalg.norm(end - start)).tolist()
    length = scale * float(np.linalg.norm(end - start))
    return Cylinder((x, y, z), (a, b, c), radius, length, abs(float(u_end - u)), hollow)


def point_text(numbers: Sequence[float]) -> str:
    """Coordinates in parentheses, for messages."""
    return f"({', '.join(f'{number:.6g}' for number in np.round(numbers, 12) + 0.0)})"
