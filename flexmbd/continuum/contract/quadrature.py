"""Quadrature rules of terms: what a rule's degree and scheme mean in points and weights; said here and nowhere else.

Schemes are those of basix by name, "vertex", and "layers n" of hexahedra in layers: Gauss points of the degree in the
plane, at each of them n points through the third direction, from below upwards.  Up to three are Gauss's.  From four
on the half above the middle and that below have a rule each, with a point on the surface: Radau's where n is even,
Lobatto's where n is odd, and then the point in the middle is of both.  So the surface is seen to yield at once, and the
force and the moment of a stress that is constant in each half are exact; n = 5 is Simpson's rule, twice.
"""

from __future__ import annotations

import functools
from typing import Any

import basix
import basix.ufl
import numpy as np
from numpy.polynomial.legendre import Legendre, leggauss
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

_LAYERS = "layers "
_FEWEST, _MOST = 2, 99  # points through the thickness


def is_rule(rule: Any, cell: str) -> bool:
    """Whether an object states a degree and a scheme that there is on a cell, or on a facet by its name."""
    degree, scheme = getattr(rule, "degree", None), getattr(rule, "scheme", None)
    if type(degree) is not int or degree < 0 or not isinstance(scheme, str):
        return False
    if scheme == "vertex":
        return True
    if scheme.startswith(_LAYERS):
        return cell == "hexahedron" and _count(scheme) is not None
    try:
        kind = basix.quadrature.string_to_type(scheme)
        basix.make_quadrature(basix.CellType[cell], min(degree, 30), rule=kind)
    except (KeyError, ValueError, RuntimeError):  # no such name; a rule for other cells
        return False
    return True


def points_and_weights(cell: str, rule: Any) -> tuple[FloatArray, FloatArray]:
    """Points (n, dimension) and weights (n,) of a rule on the reference cell."""
    return _tabulated(cell, rule.degree, rule.scheme)


def metadata(cell: str, rule: Any) -> dict[str, Any]:
    """What a UFL measure is told of a rule."""
    if not rule.scheme.startswith(_LAYERS):
        return {"quadrature_degree": rule.degree, "quadrature_rule": rule.scheme}
    points, weights = points_and_weights(cell, rule)
    # as tuples, of which all digits count for the name of what is compiled
    places = tuple(tuple(float(x) for x in point) for point in points)
    custom = {"quadrature_points": places, "quadrature_weights": tuple(float(w) for w in weights)}
    return {"quadrature_degree": rule.degree, "quadrature_rule": "custom", **custom}


def point_element(cell: str, rule: Any, shape: tuple[int, ...]) -> Any:
    """The basix element with values of a shape at the points of a rule."""
    points, weights = points_and_weights(cell, rule)
    return basix.ufl.quadrature_element(cell, value_shape=shape, points=points, weights=weights, degree=rule.degree)


@functools.lru_cache(maxsize=100)
def _tabulated(cell: str, degree: int, scheme: str) -> tuple[FloatArray, FloatArray]:
    kind = basix.CellType[cell]
    if scheme == "vertex":  # the form compiler's own
        corners = basix.geometry(kind)
        return corners, np.full(len(corners), basix.cell.volume(kind) / len(corners))
    if scheme.startswith(_LAYERS):
        return _layered(degree, _count(scheme) or _FEWEST)
    return basix.make_quadrature(kind, degree, rule=basix.quadrature.string_to_type(scheme))


def _count(scheme: str) -> int | None:
    """n of "layers n"."""
    n = scheme.removeprefix(_LAYERS)
    return int(n) if n.isascii() and n.isdigit() and _FEWEST <= int(n) <= _MOST else None


def _layered(degree: int, n: int) -> tuple[FloatArray, FloatArray]:
    places, shares = basix.make_quadrature(basix.CellType.quadrilateral, degree)
    heights, parts = _across(n)
    points = np.column_stack([np.repeat(places, n, axis=0), np.tile(heights, len(places))])
    return np.ascontiguousarray(points), np.outer(shares, parts).ravel()


def _across(n: int) -> tuple[FloatArray, FloatArray]:
    """Points and weights on the interval from 0 to 1."""
    if n < 4:
        middle, shares = leggauss(n)
        return (1 + middle) / 2, shares / 2
    m = (n + 1) // 2
    # of the upper half, from -1 at the middle to 1 on the surface
    x: FloatArray
    if n % 2:
        x = np.array([-1.0, *np.sort(Legendre.basis(m - 1).deriv().roots().real), 1.0])
    else:
        x = np.sort(-(Legendre.basis(m) + Legendre.basis(m - 1)).roots().real)
        x[-1] = 1.0
    moments: FloatArray = np.array([Legendre.basis(k)(x) for k in range(m)], dtype=float)
    w = np.linalg.solve(moments, [2.0, *np.zeros(m - 1)])
    above, weights = (3 + x) / 4, w / 4
    if not n % 2:
        return np.concatenate([1 - above[::-1], above]), np.concatenate([weights[::-1], weights])
    weights[0] *= 2
    return np.concatenate([1 - above[:0:-1], above]), np.concatenate([weights[:0:-1], weights])
