"""A quarter of a thick ring in a regular grid of bricks, as a quarter model of a cylinder has it."""

from __future__ import annotations

from mpi4py import MPI

import gmsh
import numpy as np

from flexmbd.continuum.grid.mesh_input import MeshInput
from flexmbd.continuum.grid.tagged_mesh import TaggedMesh
from flexmbd.errors import MeshError
from flexmbd.meshes import session
from flexmbd.meshes.dimension import check_arguments, checked_part, require_counts, require_degree, require_positive
from flexmbd.meshes.extrusion import ExtrudedLayer, Wall, extrude, mesh_profile


@checked_part
def quarter_ring(
    height: float,
    outer_radius: float,
    inner_radius: float,
    *,
    divisions: tuple[int, int, int],
    degree: int = 1,
    comm: MPI.Comm = MPI.COMM_WORLD,
) -> TaggedMesh:
    """Mesh the quarter x, y >= 0 of a ring about the z axis, from z = 0 to z = height. Collective.

    Facet groups: "inner", "outer" (the cylinders), "x_min" (x = 0), "y_min" (y = 0), "bottom" (z = 0),
    "top"; cell group "ring". The cells are hexahedra.

    Args:
        height: along z, m.
        outer_radius: m.
        inner_radius: m; less than the outer one.
        divisions: number of equal intervals along the radius, around and along z.
        degree: degree of the geometry: 1 makes a prism of the ring, 2 curves the cells.
        comm: the communicator of the mesh.

    Raises:
        MeshError: on all ranks; an argument is out of range, or not the same on all ranks.
    """
    arguments = dict(locals())

    def check() -> None:
        require_positive(height=height, outer_radius=outer_radius, inner_radius=inner_radius)
        if inner_radius >= outer_radius:
            raise MeshError(f"inner_radius must be below outer_radius, {outer_radius:g} m, got {inner_radius:g}")
        require_counts("divisions", divisions, number=3)
        require_degree(degree)

    check_arguments(comm, arguments, check)
    unit = session.working_unit(height, outer_radius)
    height, outer_radius, inner_radius = (x / unit for x in (height, outer_radius, inner_radius))

    def build() -> MeshInput:
        curves = _sector((inner_radius, outer_radius), divisions[:2])
        profile = mesh_profile(h=None, degree=degree)
        layer = ExtrudedLayer(height, divisions[2], {int(piece) for piece in np.unique(profile.pieces)})
        walls = [Wall(name, [curve], [0]) for name, curve in curves.items()]
        return extrude(profile, [layer], z=0.0, walls=walls, start="bottom", end="top", name="ring")

    return session.built_mesh(comm, build, unit=unit)


def _sector(radii: tuple[float, float], divisions: tuple[int, ...]) -> dict[str, int]:
    """Make the sector with its regular grid; its curves by the names of their walls."""
    add = gmsh.model.occ
    centre = add.addPoint(0.0, 0.0, 0.0)
    along_x = [add.addPoint(r, 0.0, 0.0) for r in radii]
    along_y = [add.addPoint(0.0, r, 0.0) for r in radii]
    inner, outer = (add.addCircleArc(along_x[i], centre, along_y[i]) for i in range(2))
    bottom, left = add.addLine(*along_x), add.addLine(*along_y)
    face = add.addPlaneSurface([add.addCurveLoop([bottom, outer, -left, -inner])])
    add.remove([(0, centre)])
    add.synchronize()
    for curves, count in (((bottom, left), divisions[0]), ((inner, outer), divisions[1])):
        for curve in curves:
            gmsh.model.mesh.setTransfiniteCurve(curve, count + 1)
    gmsh.model.mesh.setTransfiniteSurface(face)
    return {"inner": inner, "outer": outer, "y_min": bottom, "x_min": left}
