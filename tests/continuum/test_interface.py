"""Interfaces: frames, nodes and averages, on any number of ranks, and what is refused."""

import dataclasses

from mpi4py import MPI

import dolfinx
import numpy as np
import pytest

from flexmbd import meshes
from flexmbd.continuum import ContinuumModel, Interface
from flexmbd.continuum.compat import cell_nodes
from flexmbd.continuum.grid.tagged_mesh import from_arrays
from flexmbd.coupling import Coupling
from flexmbd.errors import InterfaceError
from flexmbd.forms import solid_linear

MATERIAL = solid_linear.Parameters(E=3.0e9, nu=0.28, rho=1200.0)


def model(mesh, *interfaces):
    return ContinuumModel(mesh, solid_linear, MATERIAL, degree=1, interfaces=interfaces)


def block(divisions=(6, 1, 1), comm=MPI.COMM_WORLD, cell="hexahedron"):
    return meshes.block(0.6, 0.1, 0.2, divisions=divisions, cell=cell, comm=comm)


def wedge(comm=MPI.COMM_WORLD):
    """A box whose top is steep on one side: facets of very different areas on x = 0 and x = 1."""
    grid = [(x, y, z) for z in range(2) for y in range(3) for x in range(2)]
    points = np.array(grid, dtype=float)
    points[:, 1] = np.where(points[:, 1] == 1.0, 1.8, points[:, 1])
    points[:, 2] *= 1.0 + points[:, 1]
    corner = [0, 1, 2, 3, 6, 7, 8, 9]
    cells = np.array([corner, [i + 2 for i in corner]])
    groups = {"left": lambda x: x[0] < 1e-9, "right": lambda x: x[0] > 1 - 1e-9}
    return from_arrays(comm, points, cells, cell="hexahedron", degree=1, facet_groups=groups)


@pytest.mark.mpi
def test_origin_is_the_centroid_by_area():
    """Face between z = 0 and z = 1 + y, 0 <= y <= 2: area 4, moments by the closed form."""
    found = model(wedge(), Interface("left"), Interface("right")).interface("left")
    area = 4.0
    y = (2.0**2 / 2 + 2.0**3 / 3) / area
    z = ((3.0**3 - 1.0) / 6) / area
    assert found.p == pytest.approx([0.0, y, z], abs=1e-14)
    assert np.array_equal(found.R, np.eye(3))


@pytest.mark.mpi
def test_origin_and_axes_of_the_user():
    axes = [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
    asked = Interface("x_max", origin=(0.7, 0.0, 0.3), axes=axes)
    found = model(block(), asked).interface("x_max")
    assert np.array_equal(found.p, [0.7, 0.0, 0.3])
    assert np.array_equal(found.R, axes)


def test_axes_with_seven_digits_become_a_rotation():
    c, s = round(np.cos(0.3), 7), round(np.sin(0.3), 7)
    found = model(
        block(comm=MPI.COMM_SELF), Interface("x_max", axes=[[c, -s, 0], [s, c, 0], [0, 0, 1]])
    )
    R = found.interface("x_max").R
    assert abs(R.T @ R - np.eye(3)).max() < 1e-15
    assert R[:, 0] == pytest.approx([np.cos(0.3), np.sin(0.3), 0.0], abs=1e-7)


@pytest.mark.mpi
def test_nodes_are_those_of_the_facets_also_on_a_rank_without_any():
    body = model(block(), Interface("x_min"), Interface("x_max"))
    x = body.space.tabulate_dof_coordinates()
    for name, place in (("x_min", 0.0), ("x_max", 0.6)):
        nodes = body.interface(name).nodes
        assert np.array_equal(np.sort(nodes), np.flatnonzero(abs(x[:, 0] - place) < 1e-9))
        owned = nodes[nodes < body.n_owned // 3]
        counts = body.comm.allgather(len(owned))
        assert sum(counts) == 4
    if body.comm.size > 1:
        # the mesh is long, so that the ranks' parts lie one behind the other
        assert 0 in counts


@pytest.mark.mpi
@pytest.mark.parametrize(
    ("names", "message"),
    [
        (["bore"], "'bore': the mesh has no such group of facets, edges, vertices or cells; it has: 'block', 'empty'"),
        (["x_min", "x_min"], "'x_min' is given twice"),
        (["empty"], "'empty' has no facets; tag"),
        (["x_max", "x_min", "y_max"], "'x_max' and 'y_max' share nodes"),
    ],
)
def test_groups_that_cannot_be_interfaces(names, message):
    mesh = block()
    mesh = dataclasses.replace(mesh, facet_groups={**mesh.facet_groups, "empty": 99})
    with pytest.raises(InterfaceError, match=message):
        model(mesh, *map(Interface, names))


MIDDLE = 0.13, 0.06
GROUPS = {
    "facet_groups": {"face": lambda x: x[0] > 0.6 - 1e-9},
    # two sides of the face, of different lengths
    "edge_groups": {"bent": lambda x: (x[0] > 0.6 - 1e-9) & ((x[1] < 1e-9) | (x[2] > 0.2 - 1e-9))},
    "vertex_groups": {"corners": lambda x: (x[0] > 0.6 - 1e-9) & (x[1] + x[2] < 0.25)},
}


def tagged(*, facet_groups=None, **groups):
    """The long block in tetrahedra, a corner of it at the origin; what parts the two cells along z lies askew."""
    source = block((6, 1, 2), comm=MPI.COMM_SELF, cell="tetrahedron").mesh
    points = source.geometry.x + np.array([0.0, 0.05, 0.1])
    middle = abs(points[:, 2] - 0.1) < 1e-9
    points[middle, 2] = np.where(points[middle, 1] < 0.05, *MIDDLE)
    return from_arrays(
        MPI.COMM_WORLD, points, cell_nodes(source), degree=1, facet_groups=facet_groups or {}, **groups
    )


def averaged(name, *, origin=None, degree=2):
    """With one averaged interface at its end, so that a rank may have none of it."""
    mesh = tagged(**GROUPS)
    interface = Interface(name, origin=origin, coupling=Coupling.AVERAGED)
    return ContinuumModel(mesh, solid_linear, MATERIAL, degree=degree, interfaces=[interface])


def average(body, displacement):
    """(6,) of a displacement, a function of positions (n, 3)."""
    found = body.interfaces[0]
    own = found.dofs < body.n_owned
    nodal = displacement(body.node_x)
    dofs = body.displacement_dofs
    u = np.zeros(len(body.layout.kinematic))
    u[dofs.ravel()] = nodal.ravel()
    return body.comm.allreduce(found.average[own].T @ u[found.dofs[own]])


@pytest.mark.mpi
@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("name", ["face", "bent", "corners"])
def test_average_of_a_rigid_motion_is_that_motion(name, degree):
    origin = np.array([0.7, 0.2, -0.1])
    body = averaged(name, origin=origin, degree=degree)
    if body.comm.size > 1:
        assert min(body.comm.allgather(len(body.interfaces[0].dofs))) == 0
    t, r = np.array([0.3, -1.0, 2.0]), np.array([0.7, 0.4, -0.2])
    found = average(body, lambda x: t + np.cross(r, x - origin))
    assert found == pytest.approx(np.concatenate([t, r]), abs=1e-12)


def curved(x):
    """No rigid motion; quadratic."""
    _, y, z = x.T
    return np.stack([y * z + z**2, 3 * z**2 - y, y**2], axis=1)


def least_squares(points, weights):
    """The motion (t, r) about the centroid that fits `curved` best, in weighted points."""
    c = weights @ points / weights.sum()
    arm = points - c
    rigid = np.zeros((len(points), 3, 6))
    rigid[:, :, :3] = np.eye(3)
    for axis in range(3):
        rigid[:, :, 3 + axis] = np.cross(np.eye(3)[axis], arm)
    root = np.sqrt(weights)[:, None]
    columns = (rigid * root[:, :, None]).reshape(-1, 6)
    return np.linalg.lstsq(columns, (curved(points) * root).ravel())[0]


def gauss(start, end):
    at, weights = np.polynomial.legendre.leggauss(4)
    return start + (end - start) * (1 + at) / 2, weights * (end - start) / 2


@pytest.mark.mpi
@pytest.mark.parametrize("name", ["face", "bent", "corners"])
def test_average_is_the_best_fit(name):
    """Over the rectangle 0.1 x 0.2, two of its sides, or its vertices but one, by Gauss points."""
    (y, v), (z, w) = gauss(0.0, 0.1), gauss(0.0, 0.2)
    if name == "face":
        yz, weights = np.stack(np.meshgrid(y, z, indexing="ij"), axis=-1).reshape(-1, 2), np.outer(v, w).ravel()
    elif name == "bent":
        yz = np.vstack([np.stack([y, 0 * y + 0.2], axis=1), np.stack([0 * z, z], axis=1)])
        weights = np.concatenate([v, w])
    else:
        yz, weights = np.array([[0.0, 0.0], [0.1, 0.0], *zip([0.0, 0.1], MIDDLE, strict=True), [0.0, 0.2]]), np.ones(5)
    points = np.column_stack([np.full(len(yz), 0.6), yz])
    assert average(averaged(name), curved) == pytest.approx(least_squares(points, weights), rel=1e-11)


@pytest.mark.mpi
@pytest.mark.parametrize(
    ("edges", "message"),
    [
        (lambda x: (x[0] > 0.6 - 1e-9) & (x[1] < 1e-9), "a straight line of a solid carries no rotation about itself"),
        (None, "a point of a solid carries no rotation"),
    ],
)
def test_lines_and_points_of_a_solid_that_carry_no_frame(edges, message):
    if edges is None:
        mesh = tagged(vertex_groups={"tip": lambda x: x.sum(axis=0) > 0.9 - 1e-9})
    else:
        mesh = tagged(edge_groups={"tip": edges})
    for coupling in Coupling:
        with pytest.raises(InterfaceError, match=message):
            model(mesh, Interface("tip", coupling=coupling))


@pytest.mark.mpi
def test_averages_of_bound_nodes_alone_are_refused():
    bodies = [Interface("x_max"), Interface("y_max", coupling=Coupling.AVERAGED)]
    assert len(model(block(), *bodies).interfaces) == 2
    mesh = block()
    mesh = dataclasses.replace(mesh, facet_groups={**mesh.facet_groups, "again": mesh.facet_groups["x_max"]})
    with pytest.raises(InterfaceError, match="'again' averages only nodes that rigid interfaces bind"):
        model(mesh, Interface("x_max"), Interface("again", coupling=Coupling.AVERAGED))


def one_cell(thickness):
    points = np.array([[0, 0, 0], [1, 0, 0], [0, thickness, 0], [0, 0, 1.0]])
    groups = {"base": lambda x: abs(x[2]) < 1e-9}
    return from_arrays(MPI.COMM_WORLD, points, [[0, 1, 2, 3]], degree=1, facet_groups=groups)


@pytest.mark.mpi
def test_nodes_in_one_line_are_refused():
    assert len(model(one_cell(1e-3), Interface("base")).interfaces) == 1
    with pytest.raises(InterfaceError, match=r"'base' has 3 nodes, .*not in one line"):
        model(one_cell(1e-8), Interface("base"))


@pytest.mark.mpi
def test_facets_inside_the_part_are_refused():
    mesh = block()
    topology = mesh.mesh.topology
    topology.create_connectivity(2, 3)
    own = np.arange(topology.index_map(2).size_local, dtype=np.int32)
    inner = np.setdiff1d(own, dolfinx.mesh.exterior_facet_indices(topology))
    tags = dolfinx.mesh.meshtags(mesh.mesh, 2, inner, np.full(len(inner), 7, dtype=np.int32))
    cut = dataclasses.replace(mesh, facet_tags=tags, facet_groups={"cut": 7})
    with pytest.raises(InterfaceError, match="'cut' has 5 facets inside the part"):
        model(cut, Interface("cut"))


def test_name_alone_is_no_interface():
    with pytest.raises(InterfaceError, match=r"write Interface\('x_min'\)"):
        model(block(comm=MPI.COMM_SELF), "x_min")


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"origin": (0.0, 1.0)}, r"origin must be finite numbers of shape \(3,\)"),
        ({"origin": (0.0, 1.0, float("nan"))}, "origin must be finite"),
        ({"origin": "centre"}, "origin must be finite"),
        ({"axes": np.ones(3)}, r"axes must be finite numbers of shape \(3, 3\)"),
        ({"axes": np.diag([1.0, 1.0, -1.0])}, "right-handed"),
        ({"axes": 2.0 * np.eye(3)}, "orthonormal"),
    ],
)
def test_bad_frames(values, message):
    with pytest.raises(InterfaceError, match=message):
        Interface("bore", **values)
