"""A connecting rod: two bored eyes joined by a tapered shank."""

from __future__ import annotations

import math

from mpi4py import MPI

import gmsh

from flexmbd.continuum.tagged_mesh import TaggedMesh
from flexmbd.errors import MeshError
from flexmbd.meshes import session
from flexmbd.meshes.dimension import require_degree, require_positive


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
    degree: int = 2,
    comm: MPI.Comm = MPI.COMM_WORLD,
) -> TaggedMesh:
    """Mesh a connecting rod with tetrahedra. Collective.

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
        degree: degree of the geometry: 2 curves the cells at the bores, 1 makes facets of them.
        comm: the communicator of the mesh.

    Raises:
        MeshError: on all ranks; a parameter is out of range, or the cells are too big for the bores.
    """
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
    require_degree(degree)
    big_radius, small_radius = big_bore / 2 + big_wall, small_bore / 2 + small_wall
    if length <= big_radius + small_radius:
        raise MeshError(
            f"length must exceed {big_radius + small_radius:g} m, or the eyes meet, got {length:g}"
        )
    if shank_thickness > thickness:
        raise MeshError(f"shank_thickness must be at most {thickness:g} m, got {shank_thickness:g}")
    if shank_width_big >= 2 * big_radius:
        raise MeshError(
            f"shank_width_big must be below {2 * big_radius:g}, got {shank_width_big:g}"
        )
    if shank_width_small >= 2 * small_radius:
        raise MeshError(
            f"shank_width_small must be below {2 * small_radius:g}, got {shank_width_small:g}"
        )

    def fill() -> None:
        eyes = [_cylinder(0.0, big_radius, thickness), _cylinder(length, small_radius, thickness)]
        shank = _shank(length, (shank_width_big, shank_width_small), shank_thickness)
        bores = [
            _cylinder(0.0, big_bore / 2, 2 * thickness),
            _cylinder(length, small_bore / 2, 2 * thickness),
        ]
        whole, _ = gmsh.model.occ.fuse([(3, eyes[0])], [(3, eyes[1]), (3, shank)])
        rod, _ = gmsh.model.occ.cut(whole, [(3, bore) for bore in bores])
        gmsh.model.occ.synchronize()
        surfaces = [tag for _, tag in gmsh.model.getBoundary(rod, oriented=False)]
        groups = {
            "big_end": [tag for tag in surfaces if _lies_on(tag, 0.0, big_bore / 2)],
            "small_end": [tag for tag in surfaces if _lies_on(tag, length, small_bore / 2)],
        }
        bored = {tag for tags in groups.values() for tag in tags}
        groups["surface"] = [tag for tag in surfaces if tag not in bored]
        for name, tags in groups.items():
            gmsh.model.addPhysicalGroup(2, tags, name=name)
        gmsh.model.addPhysicalGroup(3, [tag for _, tag in rod], name="rod")
        session.generate(h=h, degree=degree)

    return session.tagged_mesh(comm, fill)


def _cylinder(x: float, radius: float, height: float) -> int:
    return int(gmsh.model.occ.addCylinder(x, 0.0, -height / 2, 0.0, 0.0, height, radius))


def _shank(length: float, widths: tuple[float, float], thickness: float) -> int:
    corners = [(0.0, -1, 0), (length, -1, 1), (length, 1, 1), (0.0, 1, 0)]
    points = [
        gmsh.model.occ.addPoint(x, sign * widths[end] / 2, -thickness / 2)
        for x, sign, end in corners
    ]
    edges = [gmsh.model.occ.addLine(points[i], points[(i + 1) % 4]) for i in range(4)]
    plate = gmsh.model.occ.addPlaneSurface([gmsh.model.occ.addCurveLoop(edges)])
    extruded = gmsh.model.occ.extrude([(2, plate)], 0.0, 0.0, thickness)
    return next(int(tag) for dim, tag in extruded if dim == 3)


def _lies_on(surface: int, x: float, radius: float) -> bool:
    """Does a surface lie on the cylinder about the axis through (x, 0)?"""
    low, high = gmsh.model.getParametrizationBounds(2, surface)
    grid = [low[i] + (high[i] - low[i]) * part for part in (0.1, 0.35, 0.8) for i in range(2)]
    points = gmsh.model.getValue(2, surface, grid).reshape(-1, 3)
    return all(abs(math.hypot(p[0] - x, p[1]) - radius) < 1e-6 * radius for p in points)
