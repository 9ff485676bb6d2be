"""Shapes of bodies: surfaces that close, masses by closed forms, files of other programs, bad input."""

import copy
import pickle

import numpy as np
import pytest

import flexmbd as fm
from flexmbd.errors import SceneError

RHO = 7850.0


def of_its_triangles(shape):
    """The mass integrals of what its triangles enclose: each piece by the divergence theorem."""
    return fm.Solid.together([fm.Solid.from_surface(p.points, p.triangles, density=RHO) for p in shape.pieces()])


def tube(r, inner, h):
    mass = RHO * np.pi * (r**2 - inner**2) * h
    across = mass * (3.0 * (r**2 + inner**2) + h**2) / 12.0
    return mass, np.diag([across, across, 0.5 * mass * (r**2 + inner**2)])


@pytest.mark.parametrize(
    ("shape", "mass", "inertia"),
    [
        (fm.Shape.box((0.1, 0.2, 0.4)), RHO * 0.008, RHO * 0.008 / 12.0 * np.diag([0.2, 0.17, 0.05])),
        (fm.Shape.sphere(0.3), RHO * 4.0 / 3.0 * np.pi * 0.027, RHO * 8.0 / 15.0 * np.pi * 0.3**5 * np.eye(3)),
        (fm.Shape.cylinder(0.1, 0.5), *tube(0.1, 0.0, 0.5)),
        (fm.Shape.cylinder(0.1, 0.5, bore=0.08), *tube(0.1, 0.08, 0.5)),
    ],
    ids=["box", "sphere", "cylinder", "tube"],
)
def test_mass_by_closed_form(shape, mass, inertia):
    """And what is drawn encloses it, to the polygons' error: 36 corners a turn, 2 per cent of a ball's inertia."""
    body = fm.RigidBody.from_shape(shape, density=RHO)
    assert body.mass == pytest.approx(mass, rel=1e-14)
    np.testing.assert_allclose(body.inertias()[1], inertia, rtol=1e-13, atol=1e-15)
    assert body.shape is shape
    drawn = of_its_triangles(shape)
    assert 0.98 * mass < drawn.mass <= mass * (1.0 + 1e-12)
    np.testing.assert_allclose(drawn.inertia, inertia, rtol=0.03, atol=1e-12)


def test_a_turned_and_shifted_shape():
    """By the parallel axes of a rod along (1, 2, 2)/3 whose middle is not at the origin."""
    a, b = np.array([0.1, 0.0, -0.2]), np.array([0.4, 0.6, 0.4])
    body = fm.RigidBody.from_shape(fm.Shape.rod(a, b, 0.02), density=RHO)
    mass, inertia = tube(0.02, 0.0, 0.9)
    e = np.array([1.0, 2.0, 2.0]) / 3.0
    expected = inertia[0, 0] * (np.eye(3) - np.outer(e, e)) + inertia[2, 2] * np.outer(e, e)
    assert body.mass == pytest.approx(mass)
    np.testing.assert_allclose(body.com, 0.5 * (a + b), rtol=1e-13)
    np.testing.assert_allclose(body.inertias()[1], expected, rtol=1e-12, atol=1e-15)
    ends = body.shape.points @ e
    assert (ends.min(), ends.max()) == pytest.approx((a @ e, b @ e))


def test_several_parts_add_up():
    ball, bar = fm.Shape.sphere(0.1, at=(0.0, 0.0, 1.0), colour="#112233"), fm.Shape.box((0.02, 0.02, 0.8))
    both = fm.RigidBody.from_shape(ball + bar, density=RHO)
    one, two = (part.solid(density=RHO) for part in (ball, bar))
    assert both.mass == pytest.approx(one.mass + two.mass)
    np.testing.assert_allclose(both.com, [0.0, 0.0, one.mass / both.mass], atol=1e-15)
    reduced = one.mass * two.mass / both.mass
    np.testing.assert_allclose(both.inertias()[1][0, 0], one.inertia[0, 0] + two.inertia[0, 0] + reduced)
    assert [part.colour for part in (ball + bar).pieces()] == ["#112233", None]


def test_a_wheel_turns_about_its_axis():
    wheel = fm.Shape.wheel(0.3, 0.1, axis="y", at=(1.0, 0.0, 0.5))
    low, high = wheel.points.min(axis=0), wheel.points.max(axis=0)
    np.testing.assert_allclose(low, [0.7, -0.055, 0.2], atol=2e-3)
    np.testing.assert_allclose(high, [1.3, 0.055, 0.8], atol=2e-3)
    body = fm.RigidBody.from_shape(wheel, density=RHO)
    np.testing.assert_allclose(body.com, [1.0, 0.0, 0.5], atol=1e-14)
    along = body.inertias()[1]
    assert along[1, 1] > along[0, 0] == pytest.approx(along[2, 2])
    np.testing.assert_allclose(of_its_triangles(wheel).mass, body.mass, rtol=0.01)


def test_a_mesh_of_a_solid_has_its_mass():
    """A box as a mesh of triangles: the mass is that of its closed form, the shape that of the mesh."""
    box = fm.Solid.box((0.1, 0.2, 0.3), density=RHO)
    shape = fm.Shape.from_surface(box.outline.x + 0.5, box.outline.triangles)
    body = fm.RigidBody.from_shape(shape, density=RHO)
    assert body.mass == pytest.approx(box.mass)
    np.testing.assert_allclose(body.inertias()[1], box.inertia, rtol=1e-12, atol=1e-12)
    np.testing.assert_array_equal(fm.RigidBody.from_solid(box).shape.points, box.outline.x)


@pytest.mark.parametrize("suffix", [".stl", ".ply", ".obj"])
def test_read_back_from_a_file(tmp_path, suffix):
    """As pyvista writes it, in mm, with the axes turned: the extents and the mass are those of the box."""
    pyvista = pytest.importorskip("pyvista")
    path = tmp_path / f"block{suffix}"
    pyvista.Box(bounds=(0.0, 100.0, 0.0, 40.0, 0.0, 20.0)).triangulate().save(path)
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    shape = fm.Shape.from_file(path, scale=1e-3, at=(0.5, 0.0, 0.0), R=turn)
    np.testing.assert_allclose(shape.points.min(axis=0), [0.46, 0.0, 0.0], atol=1e-8)
    np.testing.assert_allclose(shape.points.max(axis=0), [0.5, 0.1, 0.02], atol=1e-8)
    assert fm.RigidBody.from_shape(shape, density=RHO).mass == pytest.approx(RHO * 8e-5, rel=1e-6)


def test_files_that_are_none(tmp_path):
    pytest.importorskip("pyvista")
    with pytest.raises(SceneError, match="there is no such file"):
        fm.Shape.from_file(tmp_path / "part.stl")
    with pytest.raises(SceneError, match=r"a shape is read from .*\.stl"):
        fm.Shape.from_file(tmp_path / "part.step")
    for name, text in (("empty.stl", ""), ("noise.stl", "no solid at all"), ("noise.ply", "no"), ("noise.vtp", "<")):
        (tmp_path / name).write_text(text)
        with pytest.raises(SceneError, match=f"{name} (holds no triangles|cannot be read)"):
            fm.Shape.from_file(tmp_path / name)


def test_a_shape_that_is_not_closed_has_no_mass():
    box = fm.Solid.box((1.0, 1.0, 1.0), density=1.0).outline
    opened = fm.Shape.from_surface(box.x, box.triangles[:-1])
    for shape in (opened, fm.Shape.sphere(0.1) + opened, fm.Shape.floor((2.0, 2.0))):
        with pytest.raises(SceneError, match=r"open.*close its holes"):
            fm.RigidBody.from_shape(shape, density=RHO)
    body = fm.RigidBody(1.0, (1.0, 1.0, 1.0), shape=opened)  # it may be shown
    assert body.shape is opened


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: fm.Shape.sphere(-1.0), "radius of a sphere must be positive"),
        (lambda: fm.Shape.sphere(True), "radius of a sphere"),
        (lambda: fm.Shape.box((1.0, 0.0, 1.0)), "sides of a box"),
        (lambda: fm.Shape.box((1.0, 1.0, 1.0), at=(0.0, np.nan, 0.0)), "place of a shape"),
        (lambda: fm.Shape.box((1.0, 1.0, 1.0), R=2.0 * np.eye(3)), "rotation of a shape"),
        (lambda: fm.Shape.cylinder(0.1, 1.0, bore=0.1), "a radius that exceeds it"),
        (lambda: fm.Shape.cylinder("0.1", 1.0), "radius '0.1'"),
        (lambda: fm.Shape.cylinder(0.1, 1.0, axis="w"), "axis 'w'"),
        (lambda: fm.Shape.rod((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.1), "two ends that differ"),
        (lambda: fm.Shape.wheel(0.3, np.inf), "width of a wheel"),
        (lambda: fm.Shape.floor(2.0), "size of a floor"),
        (lambda: fm.Shape.sphere(1.0, colour="red"), "colour of a shape"),
        (lambda: fm.Shape.from_surface([[0.0, 0.0, 0.0]], [[0, 1, 2]]), "points 0 to 0"),
        (lambda: fm.Shape.from_surface([[0.0, 0.0]], [[0, 0, 0]]), r"\(n, 3\)"),
        (lambda: fm.Shape.of_solid(fm.Solid(1.0, 1.0, np.zeros(3), np.eye(3))), "no outline"),
        (lambda: fm.Shape.sphere(1.0) + 2, "added to a shape"),
        (lambda: fm.RigidBody(1.0, (1.0, 1.0, 1.0), shape="ball"), "shape of a rigid body"),
        (lambda: setattr(fm.System().ground, "shape", 1.0), "shape of the ground"),
        (lambda: fm.Shape.sphere(1.0).solid(density=-1.0), "density must be positive"),
    ],
)
def test_bad_shapes_are_refused(make, message):
    with pytest.raises(SceneError, match=message):
        make()


def test_shapes_are_copied_with_their_bodies():
    body = fm.RigidBody.from_shape(fm.Shape.wheel(0.3, 0.1), density=RHO)
    for other in (copy.deepcopy(body), pickle.loads(pickle.dumps(body))):
        np.testing.assert_array_equal(other.shape.points, body.shape.points)
