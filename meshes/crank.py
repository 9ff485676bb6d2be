"""One throw of a crankshaft: two webs, the crank pin between them, a journal on either side."""

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
    require_memory,
    require_positive,
)
from flexmbd.meshes.extrusion import ExtrudedLayer, Wall, extrude, mesh_profile


@checked_part
def crank(
    *,
    throw: float = 0.08,
    h: float = 1e-2,
    journal: float = 0.08,
    pin: float = 0.07,
    journal_wall: float = 0.015,
    pin_wall: float = 0.015,
    journal_length: float = 0.035,
    pin_length: float = 0.03,
    web_thickness: float = 0.022,
    cell: str = "tetrahedron",
    degree: int = 2,
    comm: MPI.Comm = MPI.COMM_WORLD,
) -> TaggedMesh:
    """Mesh one throw of a crankshaft. Collective.

    The journals' axis is the z axis, the pin's is parallel to it at x = throw; the crank is
    symmetric to the planes y = 0 and z = 0. A web is the hull of two round eyes, about the journal
    and about the pin. Fillets, counterweights and oil bores are left out.

    Facet groups: "start" and "end" (the cylinders of the journals at z < 0 and z > 0), "pin" (that of
    the pin), "surface" (all the rest); cell group "crank".

    The defaults fit the big end of `connecting_rod`.

    Args:
        throw: distance of the two axes, m.
        h: size of the cells, m.
        journal: diameter of the journals, m.
        pin: diameter of the pin, m.
        journal_wall: by which a web stands out around the journal, m.
        pin_wall: by which a web stands out around the pin, m.
        journal_length: of each journal along z, m.
        pin_length: of the pin along z, m.
        web_thickness: of each web along z, m.
        cell: "tetrahedron", in a free mesh, or "hexahedron", drawn up from a planar mesh.
        degree: degree of the geometry: 2 curves the cells, 1 makes facets of the cylinders.
        comm: the communicator of the mesh.

    Raises:
        MeshError: on all ranks; an argument is out of range, or not the same on all ranks; or the
            cells are too big for the part.
    """
    arguments = dict(locals())

    def check() -> None:
        require_positive(
            throw=throw,
            h=h,
            journal=journal,
            pin=pin,
            journal_wall=journal_wall,
            pin_wall=pin_wall,
            journal_length=journal_length,
            pin_length=pin_length,
            web_thickness=web_thickness,
        )
        require_memory(h, throw, journal, web_thickness)
        least = abs(journal / 2 + journal_wall - pin / 2 - pin_wall)
        if throw <= least:
            raise MeshError(
                f"throw must exceed {least:g} m, or one eye of the web lies within the other, "
                f"got {throw:g}"
            )
        require_cell(cell)
        require_degree(degree)

    check_arguments(comm, arguments, check)
    unit = session.working_unit(throw, journal_length, pin_length)
    throw, h, journal, pin, journal_wall = (x / unit for x in (throw, h, journal, pin, journal_wall))
    pin_wall, journal_length, pin_length, web_thickness = (
        x / unit for x in (pin_wall, journal_length, pin_length, web_thickness)
    )
    eyes = (journal / 2 + journal_wall, pin / 2 + pin_wall)
    journal_top = pin_length / 2 + web_thickness

    def fill() -> None:
        add = gmsh.model.occ
        parts = [add.addCylinder(throw, 0, -pin_length / 2, 0, 0, pin_length, pin / 2)]
        for z, up in ((-journal_top, -1), (journal_top, 1)):
            parts.append(add.addCylinder(0, 0, z, 0, 0, up * journal_length, journal / 2))
            web = _web(throw, eyes, z=z)
            parts += [tag for dim, tag in add.extrude([(2, web)], 0, 0, -up * web_thickness) if dim == 3]
        add.fuse([(3, parts[0])], [(3, part) for part in parts[1:]])
        add.synchronize()
        _group_surfaces(throw, pin=pin, pin_length=pin_length, journal=journal)
        gmsh.model.addPhysicalGroup(3, [tag for _, tag in gmsh.model.getEntities(3)], name="crank")
        session.generate(h=h, degree=degree)

    def build() -> MeshInput:
        add = gmsh.model.occ
        web = _web(throw, eyes, z=0.0)
        round_journal = add.addDisk(0, 0, 0, journal / 2, journal / 2)
        round_pin = add.addDisk(throw, 0, 0, pin / 2, pin / 2)
        _, pieces = add.fragment([(2, web)], [(2, round_journal), (2, round_pin)])
        add.synchronize()
        of_web, of_journal, of_pin = ({tag for _, tag in piece} for piece in pieces)
        profile = mesh_profile(h=h, degree=degree)
        outer = ExtrudedLayer(journal_length, intervals(journal_length, h), of_journal)
        cheek = ExtrudedLayer(web_thickness, intervals(web_thickness, h), of_web)
        middle = ExtrudedLayer(pin_length, intervals(pin_length, h), of_pin)
        around_journal, around_pin = _outline(of_journal), _outline(of_pin)
        return extrude(
            profile,
            [outer, cheek, middle, cheek, outer],
            z=-journal_top - journal_length,
            walls=[
                Wall("start", around_journal, [0]),
                Wall("end", around_journal, [4]),
                Wall("pin", around_pin, [2]),
            ],
            rest="surface",
            name="crank",
        )

    if cell == "tetrahedron":
        return session.tagged_mesh(comm, fill, unit=unit)
    return session.built_mesh(comm, build, unit=unit)


def _web(throw: float, eyes: tuple[float, float], *, z: float) -> int:
    """The hull of two circles as a plane surface at the height z."""
    add = gmsh.model.occ
    slope = math.acos((eyes[0] - eyes[1]) / throw)
    centres = [add.addPoint(x, 0, z) for x in (0.0, throw)]
    low, high = (
        [
            add.addPoint(x + r * math.cos(slope), sign * r * math.sin(slope), z)
            for x, r in ((0.0, eyes[0]), (throw, eyes[1]))
        ]
        for sign in (-1, 1)
    )
    back, front = add.addPoint(-eyes[0], 0, z), add.addPoint(throw + eyes[1], 0, z)
    around = [
        add.addLine(low[0], low[1]),
        add.addCircleArc(low[1], centres[1], front),
        add.addCircleArc(front, centres[1], high[1]),
        add.addLine(high[1], high[0]),
        add.addCircleArc(high[0], centres[0], back),
        add.addCircleArc(back, centres[0], low[0]),
    ]
    add.remove([(0, centre) for centre in centres])
    return int(add.addPlaneSurface([add.addCurveLoop(around)]))


def _outline(surfaces: set[int]) -> list[int]:
    """The curves around some surfaces together."""
    boundary = gmsh.model.getBoundary([(2, tag) for tag in surfaces], combined=True, oriented=False)
    return [tag for _, tag in boundary]


def _group_surfaces(throw: float, *, pin: float, pin_length: float, journal: float) -> None:
    """Name the cylinders of the journals and the pin, and the rest."""
    groups: dict[str, list[int]] = {"start": [], "end": [], "pin": [], "surface": []}
    for _, tag in gmsh.model.getEntities(2):
        z = gmsh.model.occ.getCenterOfMass(2, tag)[2]
        if session.lies_on_cylinder(tag, (throw, 0.0), pin / 2) and abs(z) < pin_length / 2:
            groups["pin"].append(tag)
        elif session.lies_on_cylinder(tag, (0.0, 0.0), journal / 2):
            groups["start" if z < 0 else "end"].append(tag)
        else:
            groups["surface"].append(tag)
    for name, tags in groups.items():
        gmsh.model.addPhysicalGroup(2, tags, name=name)
