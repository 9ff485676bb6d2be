"""Closed surfaces of triangles, corners anticlockwise as seen from outside."""

from itertools import product

import numpy as np


def box(low, high):
    """Points (8, 3) and triangles (12, 3)."""
    low, high = np.asarray(low, float), np.asarray(high, float)
    points = low + np.array(list(product((0, 1), repeat=3))) * (high - low)
    faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return points, np.array([t for a, b, c, d in faces for t in ((a, b, c), (a, c, d))])


def prism(sides, radius, height):
    """A regular prism about z from z = 0; points (2 sides + 2, 3) and triangles (4 sides, 3)."""
    angle = 2 * np.pi * np.arange(sides) / sides
    ring = radius * np.column_stack([np.cos(angle), np.sin(angle)])
    points = np.vstack(
        [np.column_stack([ring, np.full(sides, z)]) for z in (0.0, height)] + [[[0, 0, 0], [0, 0, height]]]
    )
    k, after = np.arange(sides), (np.arange(sides) + 1) % sides
    foot, top = np.full(sides, 2 * sides), np.full(sides, 2 * sides + 1)
    walls = [np.column_stack([k, after, after + sides]), np.column_stack([k, after + sides, k + sides])]
    ends = [np.column_stack([foot, after, k]), np.column_stack([top, k + sides, after + sides])]
    return points, np.vstack(walls + ends)


def prism_moments(sides, radius, height):
    """Volume, and second moments of it about the centre: along a direction across the axis, and along the axis."""
    area = 0.5 * sides * radius**2 * np.sin(2 * np.pi / sides)
    across = area * radius**2 * (2 + np.cos(2 * np.pi / sides)) / 12
    return area * height, across * height, area * height**3 / 12


def ball(times):
    """A unit octahedron whose triangles are cut in four, points put on the sphere, so many times."""
    points = np.vstack([np.eye(3), -np.eye(3)])
    triangles = np.array([[0, 1, 2], [1, 3, 2], [3, 4, 2], [4, 0, 2], [1, 0, 5], [3, 1, 5], [4, 3, 5], [0, 4, 5]])
    for _ in range(times):
        a, b, c = (points[triangles[:, k]] for k in range(3))
        middles = [m / np.linalg.norm(m, axis=1, keepdims=True) for m in (a + b, b + c, c + a)]
        n, t = len(points), len(triangles)
        points = np.vstack([points, *middles])
        ab, bc, ca = (n + k * t + np.arange(t) for k in range(3))
        i, j, k = triangles.T
        rows = ([i, ab, ca], [ab, j, bc], [ca, bc, k], [ab, bc, ca])
        triangles = np.vstack([np.column_stack(row) for row in rows])
    return points, triangles
