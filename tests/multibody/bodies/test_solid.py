"""Solids and rigid bodies from closed surfaces, against closed forms."""

import numpy as np
import polyhedra
import pytest

import flexmbd as fm
from flexmbd.errors import SceneError

SIDES = np.array([0.3, 0.1, 0.2])
PLACE = np.array([40.0, -3.0, 7.0])


def turned():
    """A rotation along no axis."""
    q, r = np.linalg.qr(np.array([[1.0, 0.3, -0.5], [0.8, 1.0, 0.3], [-0.5, 0.8, 1.0]]))
    q = q * np.sign(np.diag(r))
    return q * np.linalg.det(q)


def test_a_box_far_from_the_origin():
    """Places of 40 m leave round-off of 1e-14 m on sides of 0.1 m."""
    R, mass = turned(), 2700.0 * SIDES.prod()
    points, triangles = polyhedra.box(-SIDES / 2, SIDES / 2)
    body = fm.RigidBody.from_surface(points @ R.T + PLACE, triangles, density=2700.0)
    moments = mass / 12 * (SIDES @ SIDES - SIDES**2)
    assert body.mass == pytest.approx(mass, rel=1e-12)
    assert body.com == pytest.approx(PLACE, rel=1e-14)
    assert body.inertia == pytest.approx(R @ np.diag(moments) @ R.T, rel=1e-12, abs=1e-12 * moments.max())
    found, axes = body.principal_axes()
    order = np.argsort(moments)
    assert found == pytest.approx(moments[order], rel=1e-12)
    assert np.linalg.det(axes) == pytest.approx(1.0, abs=1e-14)
    assert abs(axes.T @ R[:, order]) == pytest.approx(np.eye(3), abs=1e-10)


@pytest.mark.parametrize("sides", [3, 4, 7, 64])
def test_a_prism(sides):
    volume, across, along = polyhedra.prism_moments(sides, 0.2, 0.7)
    solid = fm.Solid.from_surface(*polyhedra.prism(sides, 0.2, 0.7), density=3.0)
    assert solid.volume == pytest.approx(volume, rel=1e-14)
    assert solid.mass == pytest.approx(3.0 * volume, rel=1e-14)
    assert solid.com == pytest.approx([0.0, 0.0, 0.35], abs=1e-15)
    assert solid.second == pytest.approx(3.0 * np.diag([across, across, along]), rel=1e-13, abs=1e-16)


def test_an_ellipsoid_is_approached_with_order_two():
    axes = np.array([0.5, 0.3, 0.2])
    exact = fm.Solid.ellipsoid(axes, density=1200.0)
    errors = []
    for times in (2, 3, 4):
        points, triangles = polyhedra.ball(times)
        solid = fm.Solid.from_surface(points * axes, triangles, density=1200.0)
        errors.append([solid.mass / exact.mass - 1.0, np.linalg.norm(solid.second - exact.second)])
    assert np.log2(np.abs(errors[1]) / np.abs(errors[2])) == pytest.approx([2.0, 2.0], abs=0.05)
    assert abs(errors[2][0]) < 7e-3


def test_forms_given_by_numbers():
    box, ball = fm.Solid.box(SIDES, density=10.0), fm.Solid.ellipsoid((0.2, 0.2, 0.2), density=10.0)
    found = fm.Solid.from_surface(*polyhedra.box(-SIDES / 2, SIDES / 2), density=10.0)
    assert box.second == pytest.approx(found.second, rel=1e-13, abs=1e-16)
    assert fm.RigidBody.from_solid(ball).inertia == pytest.approx(0.4 * ball.mass * 0.04 * np.eye(3))


def test_a_surface_inside_out_is_turned():
    points, triangles = polyhedra.box(-SIDES / 2, SIDES / 2)
    body = fm.RigidBody.from_surface(points, triangles[:, ::-1], density=2.0)
    assert body.mass == pytest.approx(2.0 * SIDES.prod())


@pytest.mark.parametrize("turn", [1, -1])
@pytest.mark.parametrize("outer_turn", [1, -1])
def test_a_cavity_and_a_body_beside(turn, outer_turn):
    """Whichever way the pieces face; a solid block in the cavity counts again."""
    parts = [
        polyhedra.box((-1, -1, -1), (1, 1, 1)),
        polyhedra.box((-0.5, -0.6, -0.4), (0.5, 0.6, 0.4)),
        polyhedra.box((-0.1, -0.1, -0.1), (0.1, 0.1, 0.1)),
        polyhedra.box((3, 0, 0), (4, 1, 1)),
    ]
    turns = [outer_turn, turn, outer_turn, turn]
    points = np.vstack([p for p, _ in parts])
    triangles = np.vstack([t[:, ::way] + 8 * k for k, ((_, t), way) in enumerate(zip(parts, turns, strict=True))])
    solid = fm.Solid.from_surface(points, triangles, density=1.0)
    volumes = np.array([8.0, -1.0 * 1.2 * 0.8, 0.008, 1.0])
    assert solid.volume == pytest.approx(volumes.sum(), rel=1e-13)
    assert solid.com == pytest.approx(np.array([3.5, 0.5, 0.5]) / volumes.sum(), rel=1e-12)


def test_corners_listed_anew_for_each_triangle():
    points, triangles = polyhedra.prism(9, 0.2, 0.7)
    soup = points[triangles].reshape(-1, 3)
    solid = fm.Solid.from_surface(soup, np.arange(len(soup)).reshape(-1, 3), density=1.0)
    assert solid.volume == pytest.approx(polyhedra.prism_moments(9, 0.2, 0.7)[0], rel=1e-13)


def enclosed(outline):
    """m^3, by the outline's own sense: positive where it faces outwards."""
    a, b, c = np.moveaxis(outline.x[outline.triangles], 1, 0)
    return np.einsum("ti,ti->", a, np.cross(b, c)) / 6.0


def test_outlines_are_the_solids_surfaces():
    """They face outwards; a ball's corners lie on it."""
    assert enclosed(fm.Solid.box(SIDES, density=1.0).outline) == pytest.approx(SIDES.prod(), rel=1e-14)
    ball = fm.Solid.ellipsoid(SIDES, density=1.0)
    assert (ball.outline.x**2 / SIDES**2).sum(axis=1) == pytest.approx(np.ones(len(ball.outline.x)))
    assert 0.97 * ball.volume < enclosed(ball.outline) < ball.volume
    # closed, or it is refused
    again = fm.Solid.from_surface(ball.outline.x, ball.outline.triangles, density=1.0)
    assert again.volume == pytest.approx(enclosed(ball.outline), rel=1e-12)


@pytest.mark.parametrize("turns", [(1, 1), (1, -1), (-1, 1)])
def test_an_outline_faces_away_from_the_material(turns):
    """A cavity's faces look into it."""
    outer, inner = polyhedra.box((-1, -1, -1), (1, 1, 1)), polyhedra.box((-0.5, -0.6, -0.4), (0.5, 0.6, 0.4))
    points, triangles = (
        np.vstack([outer[0], inner[0]]),
        np.vstack([outer[1][:, :: turns[0]], inner[1][:, :: turns[1]] + 8]),
    )
    outline = fm.Solid.from_surface(points, triangles, density=1.0).outline
    a, b, c = np.moveaxis(outline.x[outline.triangles], 1, 0)
    outside = np.abs(a).max(axis=1) == 1.0
    assert (np.einsum("ti,ti->t", np.cross(b - a, c - a), a) > 0.0).tolist() == outside.tolist()


POINTS, TRIANGLES = polyhedra.box((0, 0, 0), (1, 2, 3))


@pytest.mark.parametrize(
    ("points", "triangles", "density", "says"),
    [
        (POINTS, TRIANGLES[1:], 1.0, r"open: 3 edges .*\(0, 0, 0\) to \(0, 0, 3\) m.*close its holes"),
        (POINTS, np.vstack([TRIANGLES[:1, ::-1], TRIANGLES[1:]]), 1.0, "do not agree which side is out: on 3 edges"),
        (POINTS * [1, 1, 0], TRIANGLES, 1.0, "open|no volume"),
        (np.vstack([POINTS[:4], POINTS[:4]]), np.array([[0, 1, 2], [0, 2, 1]]), 1.0, "encloses no volume"),
        (POINTS, TRIANGLES, 0.0, "density must be positive"),
        (POINTS, TRIANGLES, -7800.0, "density must be positive .*got -7800"),
        (POINTS, TRIANGLES, np.nan, "density must be positive"),
        (POINTS[:7], TRIANGLES, 1.0, "must name points 0 to 6, got 0 to 7"),
        (POINTS * np.nan, TRIANGLES, 1.0, "finite"),
        (POINTS[:, :2], TRIANGLES, 1.0, r"shape \(n, 3\)"),
        (POINTS, TRIANGLES[:, :2], 1.0, r"shape \(t, 3\)"),
        (POINTS, TRIANGLES.astype(float), 1.0, "whole numbers"),
    ],
)
def test_surfaces_that_enclose_nothing(points, triangles, density, says):
    with pytest.raises(SceneError, match=says):
        fm.RigidBody.from_surface(points, triangles, density=density)


@pytest.mark.parametrize(
    ("numbers", "says"),
    [
        ((0.0, 1.0, np.zeros(3), np.eye(3)), "mass must be positive"),
        ((1.0, -1.0, np.zeros(3), np.eye(3)), "volume must be positive"),
        ((1.0, 1.0, np.zeros(2), np.eye(3)), "com must be three"),
        ((1.0, 1.0, np.zeros(3), np.diag([1.0, 1.0, 0.0])), "positive definite"),
        ((1.0, 1.0, np.zeros(3), np.eye(3) + np.eye(3, k=1)), "symmetric"),
    ],
)
def test_numbers_that_no_solid_has(numbers, says):
    with pytest.raises(SceneError, match=says):
        fm.Solid(*numbers)


@pytest.mark.parametrize("sides", [(1.0, 0.0, 1.0), (1.0, 1.0), (1.0, np.inf, 1.0)])
def test_lengths_that_no_box_has(sides):
    with pytest.raises(SceneError, match="three positive numbers"):
        fm.Solid.box(sides, density=1.0)
