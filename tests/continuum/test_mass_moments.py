"""Rigid bodies from meshes and models, against closed forms and against the surface's divergence theorem."""

import re
from pathlib import Path

import dolfinx.mesh
import numpy as np
import pytest

import flexmbd as fm
from flexmbd import meshes
from flexmbd.continuum import ContinuumModel, rigid_body_of, solid_of
from flexmbd.continuum.compat import cell_nodes
from flexmbd.continuum.grid.tagged_mesh import from_arrays
from flexmbd.errors import MeshError
from flexmbd.forms import beam_timoshenko, solid_linear

RHO = 1200.0
MATERIAL = solid_linear.Parameters(E=3.0e9, nu=0.28, rho=RHO)
SIZE = np.array([0.3, 0.1, 0.2])


def box_inertia(mass):
    return mass / 12 * np.diag(SIZE @ SIZE - SIZE**2)


@pytest.mark.mpi
@pytest.mark.parametrize(("cell", "degree"), [("hexahedron", 1), ("tetrahedron", 2)])
def test_a_box(cell, degree):
    """By the mesh and by a model on it."""
    mesh = meshes.block(*SIZE, divisions=(3, 1, 2), cell=cell, degree=degree)
    mass = RHO * SIZE.prod()
    model = ContinuumModel(mesh, solid_linear, MATERIAL, degree=degree)
    for body in (rigid_body_of(mesh, density=RHO), rigid_body_of(model)):
        assert body.mass == pytest.approx(mass, rel=1e-13)
        assert body.com == pytest.approx([SIZE[0] / 2, 0.0, 0.0], abs=1e-15)
        assert body.inertia == pytest.approx(box_inertia(mass), rel=1e-12, abs=1e-13 * mass)


@pytest.mark.mpi
def test_a_quarter_of_a_prism_far_from_the_origin():
    """A round bar of bricks is the prism of 24 sides, exactly."""
    mesh = meshes.round_bar(0.2, 0.7, divisions=(3, 2, 2))
    mesh.mesh.geometry.x[:] += [30.0, 0.0, -8.0]
    solid = solid_of(mesh, density=RHO)
    volume, across, along = 0.25 * np.array(prism_moments(24, 0.2, 0.7))
    arm = solid.com - [30.0, 0.0, -8.0]
    about_corner = solid.second + solid.mass * np.outer(arm, arm)
    about_corner[2, 2] -= solid.mass * 0.35**2
    assert solid.volume == pytest.approx(volume, rel=1e-12)
    assert solid.mass == pytest.approx(RHO * volume, rel=1e-12)
    assert np.diag(about_corner) == pytest.approx(RHO * np.array([across, across, along]), rel=1e-11)


def prism_moments(sides, radius, height):
    area = 0.5 * sides * radius**2 * np.sin(2 * np.pi / sides)
    across = area * radius**2 * (2 + np.cos(2 * np.pi / sides)) / 12
    return area * height, across * height, area * height**3 / 12


def boundary(mesh):
    """Points, and the triangles of the boundary of straight tetrahedra, facing outwards."""
    below, above = mesh.mesh.topology, mesh.mesh.geometry
    below.create_connectivity(2, 3)
    facets = dolfinx.mesh.exterior_facet_indices(below)
    triangles = dolfinx.mesh.entities_to_geometry(mesh.mesh, 2, facets).reshape(-1, 3)
    cell_of = below.connectivity(2, 3)
    middles = np.array([above.x[cell_nodes(mesh.mesh)[cell_of.links(f)[0]]].mean(axis=0) for f in facets])
    a, b, c = np.moveaxis(above.x[triangles], 1, 0)
    inwards = np.einsum("ti,ti->t", np.cross(b - a, c - a), a - middles) < 0
    triangles[inwards] = triangles[inwards][:, ::-1]
    return above.x, triangles


def test_a_step_file_and_its_boundary():
    """Of straight cells the boundary's flat triangles enclose the same; curved ones come near the bores' cylinders."""
    straight = meshes.from_step(meshes.BRACKET, tags={}, h=8e-3, degree=1)
    solid, shell = solid_of(straight, density=2700.0), fm.Solid.from_surface(*boundary(straight), density=2700.0)
    assert solid.volume == pytest.approx(shell.volume, rel=1e-12)
    assert solid.com == pytest.approx(shell.com, abs=1e-14)
    assert solid.second == pytest.approx(shell.second, rel=1e-11, abs=1e-11 * np.trace(shell.second))
    again = fm.Solid.from_surface(solid.outline.x, solid.outline.triangles, density=2700.0)
    assert again.volume == pytest.approx(solid.volume, rel=1e-12)
    assert len(solid.outline.x) == len(np.unique(solid.outline.triangles))


def test_curved_cells_come_near_the_cylinder():
    """A tube of bricks of degree 2: the error falls with the fourth power of their size."""
    inner, outer, length = 0.1, 0.2, 0.5
    volume = np.pi * (outer**2 - inner**2) * length
    square = np.pi * (outer**4 - inner**4) / 4 * length
    errors = []
    for h in (0.16, 0.08):  # 8 and 16 bricks around
        mesh = meshes.tube(length, outer, inner, h=h, cell="hexahedron", degree=2)
        solid = solid_of(mesh, density=1.0)
        errors.append([abs(solid.volume / volume - 1), abs(solid.second[1:, 1:].trace() / (2 * square) - 1)])
    assert np.log2(np.divide(*errors)) == pytest.approx([4.0, 4.0], abs=0.1)
    assert max(errors[1]) < 1e-4


@pytest.mark.mpi
def test_the_outline_is_the_same_on_any_number_of_ranks():
    """Two triangles a quadrilateral, facing outwards."""
    mesh = meshes.block(*SIZE, divisions=(3, 2, 2), cell="hexahedron", degree=1)
    outline = solid_of(mesh, density=1.0).outline
    middle = (outline.x.min(axis=0) + outline.x.max(axis=0)) / 2
    a, b, c = np.moveaxis(outline.x[outline.triangles] - middle, 1, 0)
    assert len(outline.triangles) == 2 * 2 * (3 * 2 + 3 * 2 + 2 * 2)
    assert len(outline.x) == 4 * 3 * 3 - 2
    assert np.einsum("ti,ti->t", a, np.cross(b, c)).min() > 0.0
    assert np.einsum("ti,ti->", a, np.cross(b, c)) / 6 == pytest.approx(SIZE.prod(), rel=1e-13)


def test_a_density_for_each_group():
    """Half of a box of steel, half of wood."""
    halves = {"steel": lambda x: x[0] < 0.15 + 1e-9, "wood": lambda x: x[0] > 0.15 - 1e-9}
    box = meshes.block(*SIZE, divisions=(2, 1, 1), cell="hexahedron", degree=1)
    mesh = from_arrays(
        box.comm, box.mesh.geometry.x, cell_nodes(box.mesh), cell="hexahedron", degree=1,
        facet_groups={}, cell_groups=halves,
    )
    body = rigid_body_of(mesh, density={"steel": 7800.0, "wood": 600.0})
    half = SIZE.prod() / 2
    assert body.mass == pytest.approx(8400.0 * half, rel=1e-13)
    assert body.com[0] == pytest.approx((7800 * 0.075 + 600 * 0.225) / 8400, rel=1e-13)
    with pytest.raises(MeshError, match="1 cells are in none of the groups"):
        rigid_body_of(mesh, density={"steel": 7800.0})
    with pytest.raises(MeshError, match="no cell group 'tin'"):
        rigid_body_of(mesh, density={"tin": 7800.0})


def test_a_beam_of_lines():
    """The model knows its sections; a mesh of lines alone has no volume."""
    line = meshes.line(2.0, divisions=4)
    parameters = beam_timoshenko.Parameters(
        E=2e11, nu=0.3, rho=7800.0, A=1e-2, Iy=4e-6, Iz=9e-6, J=1e-5, ky=0.8, kz=0.8, orientation=(0.0, 1.0, 0.0)
    )
    body = rigid_body_of(ContinuumModel(line, beam_timoshenko, parameters, degree=2))
    mass = 7800.0 * 2e-2
    moments = [7800.0 * 2 * 13e-6, mass / 3 + 7800.0 * 2 * 4e-6, mass / 3 + 7800.0 * 2 * 9e-6]
    assert body.mass == pytest.approx(mass, rel=1e-12)
    assert np.diag(body.inertia) == pytest.approx(moments, rel=1e-10)
    with pytest.raises(MeshError, match="mesh of lines has no volume"):
        rigid_body_of(line, density=1.0)
    with pytest.raises(MeshError, match="mesh of lines has no volume"):
        solid_of(ContinuumModel(line, beam_timoshenko, parameters, degree=2))


@pytest.mark.parametrize("density", [0.0, -1.0, np.nan, {}, {"block": -3.0}])
def test_a_density_that_is_none(density):
    mesh = meshes.block(*SIZE, divisions=(1, 1, 1), cell="hexahedron", degree=1)
    with pytest.raises(MeshError, match="density must be positive"):
        rigid_body_of(mesh, density=density)


def test_a_density_where_none_is_asked_and_none_where_one_is():
    mesh = meshes.block(*SIZE, divisions=(3, 1, 2), cell="hexahedron", degree=1)
    with pytest.raises(MeshError, match="give density="):
        rigid_body_of(mesh)
    with pytest.raises(MeshError, match="leave density out"):
        rigid_body_of(ContinuumModel(mesh, solid_linear, MATERIAL, degree=1), density=1.0)


def test_the_page_on_rigid_bodies():
    """Its code runs, and gives the tetrahedron's mass and the block's."""
    text = (Path(__file__).parents[2] / "docs" / "rigid_bodies.md").read_text(encoding="utf-8")
    names = {}
    for block in re.findall(r"^```python\n(.*?)^```$", text, re.DOTALL | re.MULTILINE):
        exec(compile(block, "rigid_bodies.md", "exec"), names)
    assert names["tetrahedron"].mass == pytest.approx(1000.0 * 1e-3 / 6.0, rel=1e-12)
    assert names["block"].mass == pytest.approx(7850.0 * 6e-3, rel=1e-12)
    assert names["moments"][0] + names["moments"][1] > names["moments"][2]
