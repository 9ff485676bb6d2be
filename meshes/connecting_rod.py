"""A connecting rod: two bored eyes joined by a tapered shank."""

from __future__ import annotations

import math

from mpi4py import MPI

import gmsh

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
    require_fitting,
    require_memory,
    require_positive,
)
from flexmbd.meshes.extrusion import ExtrudedLayer, Wall, extrude, mesh_profile


@checked_part
def connecting_rod(
    *,
    length: float = 0.3,
    h: float = 6e-3,
    big_bore: float = 0.07,
    small_bore: float = 0.036,
    big_wall: float = 0.013,
    small_wall: float = 0.01,
    thickness: float = 0.028,
    shank_thickness: float = 0.016,
    shank_width_big: float = 0.044,
    shank_width_small: float = 0.03,
    cell: str = "tetrahedron",
    degree: int = 2,
    comm: MPI.Comm = MPI.COMM_WORLD,
) -> TaggedMesh:
    """Mesh a connecting rod. Collective.

    The big eye's axis is the z axis, the small eye's is parallel to it at x = length; the rod is
    symmetric to the planes y = 0 and z = 0. Eyes are rings, the shank a plate whose width tapers
    linearly between the two axes, where it is cut away by the bores. Fillets are left out.

    Facet groups: "big_end" and "small_end" (the cylinders of the bores), "surface" (all the rest);
    cell group "rod".

    The defaults are a forged steel rod of a diesel engine with a stroke of 0.16 m, 2.1 kg in steel:
    length 3.75 crank radii; crank pin 0.44 and piston pin 0.22 of the stroke, as where the lower
    one carries the inertia of the rod too; walls of a fifth to a quarter of the bores; a shank
    thinner than the eyes, and wider at the big end, where the bending by the rod's own inertia
    adds to the gas force.

    Args:
        length: distance of the two axes, m.
        h: size of the cells, m.
        big_bore: diameter of the bore at x = 0, m.
        small_bore: diameter of the bore at x = length, m.
        big_wall: radial thickness of the big eye, m.
        small_wall: radial thickness of the small eye, m.
        thickness: of both eyes along z, m.
        shank_thickness: of the shank along z, m; at most `thickness`.
        shank_width_big: of the shank along y, at x = 0, m; less than the big eye's diameter.
        shank_width_small: of the shank along y, at x = length, m; less than the small eye's.
        cell: "tetrahedron", in a free mesh, or "hexahedron", drawn up from a planar mesh.
        degree: degree of the geometry: 2 curves the cells at the bores, 1 makes facets of them.
        comm: the communicator of the mesh.

    Raises:
        MeshError: on all ranks; an argument is out of range, or not the same on all ranks; or the
            cells are too big for the bores.
    """
    arguments = dict(locals())

    def check() -> None:
        require_positive(
            length=length,
            h=h,
            big_bore=big_bore,
            small_bore=small_bore,
            big_wall=big_wall,
            small_wall=small_wall,
            thickness=thickness,
            shank_thickness=shank_thickness,
            shank_width_big=shank_width_big,
            shank_width_small=shank_width_small,
        )
        require_memory(h, length, shank_width_small, shank_thickness)
        require_cell(cell)
        require_degree(degree)
        big_radius, small_radius = big_bore / 2 + big_wall, small_bore / 2 + small_wall
        require_fitting(h, {"the eyes' diameters together,": 2 * (big_radius + small_radius)})
        if length <= big_radius + small_radius:
            raise MeshError(
                f"length must exceed {big_radius + small_radius:g} m, or the eyes meet, got {length:g}"
            )
        if shank_thickness > thickness:
            raise MeshError(f"shank_thickness must be at most {thickness:g} m, got {shank_thickness:g}")
        for name, width, radius in (("big", shank_width_big, big_radius), ("small", shank_width_small, small_radius)):
            if width >= 2 * radius:
                raise MeshError(f"shank_width_{name} must be below {2 * radius:g}, got {width:g}")

    check_arguments(comm, arguments, check)
    unit = session.working_unit(length)
    length, h, big_bore, small_bore, big_wall = (x / unit for x in (length, h, big_bore, small_bore, big_wall))
    small_wall, thickness, shank_thickness, shank_width_big, shank_width_small = (
        x / unit for x in (small_wall, thickness, shank_thickness, shank_width_big, shank_width_small)
    )
    big_radius, small_radius = big_bore / 2 + big_wall, small_bore / 2 + small_wall
    widths = (shank_width_big, shank_width_small)

    def fill() -> None:
        eyes = [_cylinder(0.0, big_radius, thickness), _cylinder(length, small_radius, thickness)]
        shank = _shank(length, widths, shank_thickness)
        bores = [
            _cylinder(0.0, big_bore / 2, 2 * thickness),
            _cylinder(length, small_bore / 2, 2 * thickness),
        ]
        whole, _ = gmsh.model.occ.fuse([(3, eyes[0])], [(3, eyes[1]), (3, shank)])
        rod, _ = gmsh.model.occ.cut(whole, [(3, bore) for bore in bores])
        gmsh.model.occ.synchronize()
        surfaces = [tag for _, tag in gmsh.model.getBoundary(rod, oriented=False)]
        groups = {
            name: [tag for tag in surfaces if session.lies_on_cylinder(tag, (x, 0.0), bore / 2)]
            for name, x, bore in (("big_end", 0.0, big_bore), ("small_end", length, small_bore))
        }
        bored = {tag for tags in groups.values() for tag in tags}
        groups["surface"] = [tag for tag in surfaces if tag not in bored]
        for name, tags in groups.items():
            gmsh.model.addPhysicalGroup(2, tags, name=name)
        gmsh.model.addPhysicalGroup(3, [tag for _, tag in rod], name="rod")
        session.generate(h=h, degree=degree)

    def build() -> MeshInput:
        eyes = _ring(0.0, big_bore / 2, big_radius), _ring(length, small_bore / 2, small_radius)
        discs = [_disc(0.0, big_radius), _disc(length, small_radius)]
        shank, _ = gmsh.model.occ.cut([(2, _outline(length, widths, z=0.0))], discs)
        _, pieces = gmsh.model.occ.fragment([shank[0]], [*eyes])
        gmsh.model.occ.synchronize()
        every = {tag for piece in pieces for _, tag in piece}
        of_eyes = {tag for piece in pieces[1:] for _, tag in piece}
        profile = mesh_profile(h=h, degree=degree)
        step = (thickness - shank_thickness) / 2
        layers = [ExtrudedLayer(shank_thickness, intervals(shank_thickness, h), every)]
        if step > 0:
            outer = ExtrudedLayer(step, intervals(step, h), of_eyes)
            layers = [outer, *layers, outer]
        return extrude(
            profile,
            layers,
            z=-thickness / 2,
            walls=[
                Wall("big_end", _circle(0.0, big_bore / 2), range(len(layers))),
                Wall("small_end", _circle(length, small_bore / 2), range(len(layers))),
            ],
            rest="surface",
            name="rod",
        )

    if cell == "tetrahedron":
        return session.tagged_mesh(comm, fill, unit=unit)
    return session.built_mesh(comm, build, unit=unit)


def _cylinder(x: float, radius: float, height: float) -> int:
    return int(gmsh.model.occ.addCylinder(x, 0.0, -height / 2, 0.0, 0.0, height, radius))


def _shank(length: float, widths: tuple[float, float], thickness: float) -> int:
    outline = _outline(length, widths, z=-thickness / 2)
    extruded = gmsh.model.occ.extrude([(2, outline)], 0.0, 0.0, thickness)
    return next(int(tag) for dim, tag in extruded if dim == 3)


def _outline(length: float, widths: tuple[float, float], *, z: float) -> int:
    """The shank, not cut away by the eyes, as a plane surface at the height z."""
    corners = [(0.0, -1, 0), (length, -1, 1), (length, 1, 1), (0.0, 1, 0)]
    points = [gmsh.model.occ.addPoint(x, sign * widths[end] / 2, z) for x, sign, end in corners]
    edges = [gmsh.model.occ.addLine(points[i], points[(i + 1) % 4]) for i in range(4)]
    return int(gmsh.model.occ.addPlaneSurface([gmsh.model.occ.addCurveLoop(edges)]))


def _disc(x: float, radius: float) -> tuple[int, int]:
    return 2, int(gmsh.model.occ.addDisk(x, 0.0, 0.0, radius, radius))


def _ring(x: float, inner: float, outer: float) -> tuple[int, int]:
    ring, _ = gmsh.model.occ.cut([_disc(x, outer)], [_disc(x, inner)])
    return 2, int(ring[0][1])


def _circle(x: float, radius: float) -> list[int]:
    """Curves of the model that lie on a circle about (x, 0)."""
    curves = []
    for _, tag in gmsh.model.getEntities(1):
        low, high = gmsh.model.getParametrizationBounds(1, tag)
        points = [low[0] + part * (high[0] - low[0]) for part in (0.1, 0.35, 0.8)]
        place = gmsh.model.getValue(1, tag, points).reshape(-1, 3)
        if all(abs(math.hypot(p[0] - x, p[1]) - radius) < 1e-6 * radius for p in place):
            curves.append(tag)
    return curves
