"""A straight tube of circular section along x."""

from __future__ import annotations

import math
from dataclasses import replace

from mpi4py import MPI

import gmsh
import numpy as np

from flexmbd.continuum.grid.mesh_input import MeshInput
from flexmbd.continuum.grid.tagged_mesh import TaggedMesh
from flexmbd.errors import MeshError
from flexmbd.meshes import session
from flexmbd.meshes.dimension import (
    check_arguments,
    checked_part,
    intervals,
    require_cell,
    require_degree,
    require_memory,
    require_positive,
)
from flexmbd.meshes.extrusion import ExtrudedLayer, Wall, extrude, mesh_profile


@checked_part
def tube(
    length: float,
    outer_radius: float,
    inner_radius: float,
    *,
    h: float,
    cell: str = "tetrahedron",
    degree: int = 2,
    comm: MPI.Comm = MPI.COMM_WORLD,
) -> TaggedMesh:
    """Mesh a tube about the x axis, from x = 0 to x = length. Collective.

    Facet groups: "start" (x = 0), "end" (x = length), "inner" and "outer" (the cylinders); cell
    group "tube".

    Args:
        length: along x, m.
        outer_radius: m.
        inner_radius: m; less than the outer one.
        h: size of the cells, m.
        cell: "tetrahedron", in a free mesh, or "hexahedron", in a regular grid of edges up to h, and
            of eight cells around at least.
        degree: degree of the geometry: 2 curves the cells, 1 makes a prism of the tube.
        comm: the communicator of the mesh.

    Raises:
        MeshError: on all ranks; an argument is out of range, or not the same on all ranks.
    """
    arguments = dict(locals())

    def check() -> None:
        require_positive(
            length=length, outer_radius=outer_radius, inner_radius=inner_radius, h=h
        )
        if inner_radius >= outer_radius:
            raise MeshError(
                f"inner_radius must be below outer_radius, {outer_radius:g} m, got {inner_radius:g}"
            )
        require_memory(h, length, outer_radius, outer_radius - inner_radius)
        require_cell(cell)
        require_degree(degree)

    check_arguments(comm, arguments, check)
    unit = session.working_unit(length, outer_radius)
    length, outer_radius, inner_radius, h = (x / unit for x in (length, outer_radius, inner_radius, h))

    def fill() -> None:
        whole, bore = (
            gmsh.model.occ.addCylinder(0.0, 0.0, 0.0, length, 0.0, 0.0, radius)
            for radius in (outer_radius, inner_radius)
        )
        gmsh.model.occ.cut([(3, whole)], [(3, bore)])
        gmsh.model.occ.synchronize()
        for name, tag in _faces(length, (inner_radius + outer_radius) / 2).items():
            gmsh.model.addPhysicalGroup(2, [tag], name=name)
        tags = [tag for _, tag in gmsh.model.getEntities(3)]
        gmsh.model.addPhysicalGroup(3, tags, name="tube")
        session.generate(h=h, degree=degree)

    def build() -> MeshInput:
        radii = (inner_radius, outer_radius)
        circles = _ring(radii, around=max(2, intervals(math.pi / 2 * outer_radius, h)), h=h)
        profile = mesh_profile(h=None, degree=degree)
        layer = ExtrudedLayer(length, intervals(length, h), {int(piece) for piece in np.unique(profile.pieces)})
        upright = extrude(
            profile,
            [layer],
            z=0.0,
            walls=[Wall(name, circles[i], [0]) for i, name in enumerate(("inner", "outer"))],
            start="start",
            end="end",
            name="tube",
        )
        return replace(upright, points=np.roll(upright.points, 1, axis=1))  # z becomes x

    if cell == "tetrahedron":
        return session.tagged_mesh(comm, fill, unit=unit)
    return session.built_mesh(comm, build, unit=unit)


def _faces(length: float, middle_radius: float) -> dict[str, int]:
    """The four faces of the tube by their names."""
    named = {}
    for _, tag in gmsh.model.getEntities(2):
        x = gmsh.model.occ.getCenterOfMass(2, tag)[0]
        if abs(x - length / 2) > 0.25 * length:
            named["start" if x < length / 2 else "end"] = tag
        else:
            radius = gmsh.model.occ.getMass(2, tag) / (2 * math.pi * length)
            named["inner" if radius < middle_radius else "outer"] = tag
    return named


def _ring(radii: tuple[float, float], *, around: int, h: float) -> list[list[int]]:
    """Make a ring of four sectors with a regular grid; the arcs of each radius."""
    add = gmsh.model.occ
    centre = add.addPoint(0.0, 0.0, 0.0)
    corners = [
        [add.addPoint(r * x, r * y, 0.0) for x, y in ((1, 0), (0, 1), (-1, 0), (0, -1))]
        for r in radii
    ]
    arcs = [
        [add.addCircleArc(ring[i], centre, ring[(i + 1) % 4]) for i in range(4)] for ring in corners
    ]
    spokes = [add.addLine(corners[0][i], corners[1][i]) for i in range(4)]
    for i in range(4):
        loop = add.addCurveLoop([spokes[i], arcs[1][i], -spokes[(i + 1) % 4], -arcs[0][i]])
        add.addPlaneSurface([loop])
    add.remove([(0, centre)])
    add.synchronize()
    for arc in arcs[0] + arcs[1]:
        gmsh.model.mesh.setTransfiniteCurve(arc, around + 1)
    for spoke in spokes:
        gmsh.model.mesh.setTransfiniteCurve(spoke, intervals(radii[1] - radii[0], h) + 1)
    for _, face in gmsh.model.getEntities(2):
        gmsh.model.mesh.setTransfiniteSurface(face)
    return arcs
