"""Groups of points and curves on solids and shells: on every rank that holds them, and nowhere else."""

from mpi4py import MPI

import dolfinx
import gmsh
import numpy as np
import pytest
from dolfinx import fem
from measures import n_owned, nodes_of_entities

from flexmbd import meshes
from flexmbd.continuum.grid.tagged_mesh import from_arrays
from flexmbd.continuum.parallel import on_root
from flexmbd.errors import MeshError
from flexmbd.meshes import session

pytestmark = pytest.mark.mpi

COMM = MPI.COMM_WORLD

# Of the cube's edges and corners: which, by a function of the middle of a gmsh entity.
SHAFT = {"long": lambda x: x[1] < 1e-6 and x[2] < 1e-6, "top": lambda x: x[2] > 1 - 1e-6}
CORNERS = {
    "origin": lambda x: sum(x) < 1e-6,
    "ends": lambda x: x[0] > 2 - 1e-6,
    "all": lambda x: True,
}


def box(*, degree=1, h=0.4, recombine=False):
    """A box 2 x 1 x 1 with groups of faces, edges and corners; one edge in two groups."""

    def fill():
        gmsh.model.occ.addBox(0, 0, 0, 2, 1, 1)
        gmsh.model.occ.synchronize()
        for dim, groups in ((0, CORNERS), (1, SHAFT), (2, {"foot": lambda x: x[0] < 1e-6})):
            for name, lies_in in groups.items():
                tags = [t for _, t in gmsh.model.getEntities(dim) if lies_in(middle(dim, t))]
                gmsh.model.addPhysicalGroup(dim, tags, name=name)
        if recombine:
            for _, curve in gmsh.model.getEntities(1):
                gmsh.model.mesh.setTransfiniteCurve(curve, 4)
            for _, face in gmsh.model.getEntities(2):
                gmsh.model.mesh.setTransfiniteSurface(face)
                gmsh.model.mesh.setRecombine(2, face)
            gmsh.model.mesh.setTransfiniteVolume(1)
        session.generate(h=h, degree=degree)

    return session.tagged_mesh(COMM, fill)


def middle(dim, tag):
    if dim == 0:
        return gmsh.model.getValue(0, tag, [])
    return gmsh.model.occ.getCenterOfMass(dim, tag)


def vertex_points(tagged, vertices):
    """Coordinates of mesh vertices of this rank, by DOLFINx's own way to a vertex's node."""
    return nodes_of_entities(tagged, 0, vertices)


@pytest.mark.parametrize(("degree", "recombine"), [(1, False), (2, False), (2, True)])
def test_points_and_curves_of_a_solid(degree, recombine):
    part = box(degree=degree, recombine=recombine)
    assert part.vertex_groups.keys() == CORNERS.keys()
    assert part.edge_groups.keys() == SHAFT.keys()
    for name, count in (("origin", 1), ("ends", 4), ("all", 8)):
        points = vertex_points(part, part.vertices(name))
        assert all(CORNERS[name](x) for x in points)
        assert n_owned(part, 0, part.vertices(name)) == count
    assert vertex_points(part, part.vertices("origin")) == pytest.approx(0.0)

    for name in SHAFT:
        nodes = nodes_of_entities(part, 1, part.edges(name))
        assert all(SHAFT[name](x) for x in nodes)
    # the lengths of a named curve's edges, each counted by its owner, add up
    for name, length in (("long", 2.0), ("top", 6.0)):
        assert total_length(part, part.edges(name)) == pytest.approx(length, rel=1e-12)


def total_length(part, edges):
    part.mesh.topology.create_connectivity(1, 0)
    part.mesh.topology.create_connectivity(0, 3)
    links = part.mesh.topology.connectivity(1, 0)
    local = 0.0
    for edge in edges[edges < part.mesh.topology.index_map(1).size_local]:
        pair = dolfinx.mesh.entities_to_geometry(part.mesh, 0, links.links(edge)).ravel()
        local += np.linalg.norm(np.subtract(*part.mesh.geometry.x[pair]))
    return part.comm.allreduce(local)


def test_every_rank_that_holds_a_vertex_has_it():
    """DOLFINx's search by place finds the same vertices and edges on each rank."""
    part = box(degree=2)
    on_top = dolfinx.mesh.locate_entities(part.mesh, 0, lambda x: np.isclose(x[0] + x[1] + x[2], 0))
    assert np.array_equal(part.vertices("origin"), on_top)
    edges = dolfinx.mesh.locate_entities(
        part.mesh, 1, lambda x: np.isclose(x[1], 0) & np.isclose(x[2], 0)
    )
    assert np.array_equal(part.edges("long"), edges)


def test_dofs_of_a_curve():
    """What an interface asks for: the dofs of a quadratic displacement on a named curve."""
    part = box(degree=1)
    space = fem.functionspace(part.mesh, ("Lagrange", 2, (3,)))
    dofs = fem.locate_dofs_topological(space, 1, part.edges("long"))
    x = space.tabulate_dof_coordinates()[dofs]
    assert np.all(abs(x[:, 1:]) < 1e-12)
    owned = dofs[dofs < space.dofmap.index_map.size_local]
    edges = n_owned(part, 1, part.edges("long"))
    assert COMM.allreduce(len(owned)) == 2 * edges + 1


def test_unknown_groups_list_those_there_are():
    part = box()
    with pytest.raises(
        MeshError, match="no vertex group 'tip'; its vertex groups are: 'all', 'ends', 'origin'"
    ):
        part.vertices("tip")
    with pytest.raises(MeshError, match="no edge group 'x'; its edge groups are: 'long', 'top'"):
        part.edges("x")
    with pytest.raises(MeshError, match="no cell group 'x'; its cell groups are: none"):
        part.cells("x")


def test_from_a_file(shared_path):
    path = shared_path / "part.msh"

    def save():
        gmsh.model.occ.addBox(0, 0, 0, 1, 1, 1)
        gmsh.model.occ.synchronize()
        gmsh.model.addPhysicalGroup(0, [1], name="corner")
        gmsh.model.addPhysicalGroup(1, [1, 2], name="rim")
        gmsh.model.addPhysicalGroup(3, [1], name="part")
        session.generate(h=0.5, degree=2)
        gmsh.write(str(path))

    on_root(COMM, lambda: _in_session(save))
    part = meshes.read(path)
    assert part.facet_groups == {}
    assert n_owned(part, 0, part.vertices("corner")) == 1
    assert n_owned(part, 1, part.edges("rim")) == 4


def _in_session(save):
    with session.model():
        save()


def test_a_point_off_the_mesh_is_refused():
    def fill():
        cube = gmsh.model.occ.addBox(0, 0, 0, 1, 1, 1)
        point = gmsh.model.occ.addPoint(0.3, 0.3, 0.3)
        gmsh.model.occ.synchronize()
        gmsh.model.addPhysicalGroup(0, [point], name="inside")
        gmsh.model.addPhysicalGroup(3, [cube], name="cube")
        session.generate(h=0.5, degree=1)

    with pytest.raises(
        MeshError, match="vertex group 'inside': 1 of 1 belong to no cell; in gmsh, embed"
    ):
        session.tagged_mesh(COMM, fill)
    assert COMM.allreduce(1) == COMM.size


def test_a_surface_off_the_mesh_is_refused():
    def fill():
        cube = gmsh.model.occ.addBox(0, 0, 0, 1, 1, 1)
        face = gmsh.model.occ.addRectangle(3, 0, 0, 1, 1)
        gmsh.model.occ.synchronize()
        gmsh.model.addPhysicalGroup(2, [face], name="beside")
        gmsh.model.addPhysicalGroup(3, [cube], name="cube")
        session.generate(h=0.5, degree=1)

    with pytest.raises(
        MeshError, match=r"facet group 'beside': \d+ of the facets in groups belong to no cell"
    ):
        session.tagged_mesh(COMM, fill)


def test_by_predicates():
    x = np.array([(i, j, k) for k in (0, 1) for j in (0, 1) for i in range(5)], dtype=float)
    corner = np.array([0, 1, 5, 6, 10, 11, 15, 16])
    part = from_arrays(
        COMM, x, corner + np.arange(4)[:, None], cell="hexahedron", degree=1,
        facet_groups={"left": lambda x: np.isclose(x[0], 0)},
        cell_groups={"soft": lambda x: x[0] < 2.5, "hard": lambda x: x[0] > 1.5},
        edge_groups={"spine": lambda x: np.isclose(x[1] + x[2], 0)},
        vertex_groups={"tip": lambda x: np.isclose(x[0], 4) & np.isclose(x[1] + x[2], 2)},
    )  # fmt: skip
    assert [n_owned(part, 3, part.cells(name)) for name in ("soft", "hard")] == [2, 2]
    assert n_owned(part, 1, part.edges("spine")) == 4
    assert n_owned(part, 0, part.vertices("tip")) == 1
    assert vertex_points(part, part.vertices("tip")) == pytest.approx(
        np.array([[4.0, 1, 1]] * len(part.vertices("tip"))).reshape(-1, 3)
    )
    with pytest.raises(MeshError, match="cell groups 'soft' and 'all' share cells"):
        from_arrays(
            COMM, x, corner + np.arange(4)[:, None], cell="hexahedron", degree=1, facet_groups={},
            cell_groups={"soft": lambda x: x[0] < 2.5, "all": lambda x: x[0] > -1},
        )  # fmt: skip
    with pytest.raises(MeshError, match="vertex group 'tip': no vertex lies in it"):
        from_arrays(
            COMM, x, corner + np.arange(4)[:, None], cell="hexahedron", degree=1, facet_groups={},
            vertex_groups={"tip": lambda x: x[0] > 5},
        )  # fmt: skip
