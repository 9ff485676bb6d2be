"""Every part, of both cells and both degrees: volume, first and second moments against its exact shape.

Boxes are met to round-off; round parts with an error that falls with the size of the cells, and is far
smaller for curved ones.
"""

from mpi4py import MPI

import numpy as np
import pytest
from measures import moments
from scipy.integrate import quad

from flexmbd import meshes
from flexmbd.continuum.compat import geometry_degree

pytestmark = pytest.mark.mpi

COMM = MPI.COMM_WORLD


def disc(radius, x=0.0, y=0.0):
    """Integrals of 1, x, y, xx, yy."""
    area, own = np.pi * radius**2, np.pi / 4 * radius**4
    return np.array([area, area * x, area * y, own + area * x * x, own + area * y * y])


def rectangle(x, y):
    (a, b), (c, d) = x, y
    wide, high = b - a, d - c
    area = wide * high
    return np.array(
        [area, area * (a + b) / 2, area * (c + d) / 2, (b**3 - a**3) / 3 * high, (d**3 - c**3) / 3 * wide]
    )


def between(low, high, start, end, breaks):
    """Of what lies between +-low(x) and +-high(x)."""

    def integral(function):
        return quad(function, start, end, points=breaks, limit=400, epsabs=1e-15, epsrel=1e-12)[0]

    def width(x):
        return 2 * max(high(x) - low(x), 0.0)

    def cubed(x):
        return 2 / 3 * max(high(x) ** 3 - low(x) ** 3, 0.0)

    return np.array(
        [integral(width), integral(lambda x: x * width(x)), 0.0, integral(lambda x: x * x * width(x)), integral(cubed)]
    )


def prism(section, low, high):
    """Integrals of 1, x, y, z, xx, yy, zz of a section drawn up along z."""
    h = high - low
    area, x, y, xx, yy = section
    z, zz = area * (high**2 - low**2) / 2, area * (high**3 - low**3) / 3
    return np.array([area * h, x * h, y * h, z, xx * h, yy * h, zz])


def about_x(moments):
    """What was drawn up along z, with x, y for y, z and z for x."""
    return moments[[0, 3, 1, 2, 6, 4, 5]]


def box(x, y, z):
    return prism(rectangle(x, y), *z)


def hull(a, b, distance):
    """Half the height of the hull of two circles at x."""
    slope = np.arccos((a - b) / distance)
    left, right = a * np.cos(slope), distance + b * np.cos(slope)

    def height(x):
        if x < left:
            return np.sqrt(max(a * a - x * x, 0.0))
        if x > right:
            return np.sqrt(max(b * b - (x - distance) ** 2, 0.0))
        return (a - x * np.cos(slope)) / np.sin(slope)

    return height, [left, right]


def rod():
    big, small, length = 0.048, 0.028, 0.3

    def eye(x):
        return np.sqrt(max(big**2 - x * x, small**2 - (x - length) ** 2, 0.0))

    def shank(x):
        return 0.022 + (0.015 - 0.022) * x / length

    def outside(x):
        return max(shank(x), eye(x))

    plate = between(eye, outside, 0.0, length, [big, length - small])
    rings = disc(big) - disc(0.035) + disc(small, length) - disc(0.018, length)
    return prism(rings, -0.014, 0.014) + prism(plate, -0.008, 0.008)


def crank():
    height, breaks = hull(0.055, 0.05, 0.08)
    web = between(lambda x: 0.0, height, -0.055, 0.13, breaks)
    pin, inner, outer = 0.015, 0.037, 0.072
    whole = prism(disc(0.035, 0.08), -pin, pin)
    for sign in (-1, 1):
        for section, low, high in ((web, pin, inner), (disc(0.04), inner, outer)):
            whole = whole + prism(section, *sorted((sign * low, sign * high)))
    return whole


def bracket():
    foot = rectangle((-0.04, 0.04), (-0.02, 0.02)) - disc(0.0045, 0.028) - disc(0.0045, -0.028)
    r, middle = 0.02, 4 * 0.02 / (3 * np.pi)
    half, own = np.pi * r * r / 2, np.pi * r**4 / 8
    eye = np.array([half, 0.0, half * (0.04 + middle), own, own + half * 0.04 * (0.04 + 2 * middle)])
    lug = rectangle((-0.02, 0.02), (0.008, 0.04)) + eye - disc(0.008, 0.0, 0.04)
    return prism(foot, 0.0, 0.008) + about_x(prism(lug, -0.01, 0.01))


SIZES = (0.3, 0.06, 0.04)
BOX = box((0.0, 0.3), (-0.03, 0.03), (-0.02, 0.02))
TUBE = about_x(prism(disc(0.05) - disc(0.03), 0.0, 0.2))

# name: the part by size of cells, its exact moments, a size of cells, another if the part is round.
PARTS = {
    "beam": (lambda h, **how: meshes.beam(*SIZES, h=h, **how), BOX, (0.03,)),
    "block": (lambda h, **how: meshes.block(*SIZES, divisions=(3, 2, 4), layers=("a", "b"), **how), BOX, (0.1,)),
    "plate": (lambda h, **how: meshes.plate(*SIZES, h=h, **how), BOX, (0.05,)),
    "tube": (lambda h, **how: meshes.tube(0.2, 0.05, 0.03, h=h, **how), TUBE, (0.02, 0.01)),
    "connecting_rod": (lambda h, **how: meshes.connecting_rod(h=h, **how), rod(), (0.012, 0.006)),
    "crank": (lambda h, **how: meshes.crank(h=h, **how), crank(), (0.014, 0.007)),
    "from_step": (
        lambda h, **how: meshes.from_step(meshes.BRACKET, tags={}, h=h, **how), bracket(), (0.0045,),
    ),
}  # fmt: skip


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("cell", ["tetrahedron", "hexahedron"])
@pytest.mark.parametrize("name", PARTS)
def test_moments(name, cell, degree):
    make, exact, sizes = PARTS[name]
    length = np.sqrt(exact[4:].max() / exact[0])
    scales = exact[0] * np.array([1.0, *[length] * 3, *[length**2] * 3])
    errors = []
    for h in sizes:
        part = make(h, cell=cell, degree=degree)
        assert part.mesh.topology.cell_name() == cell
        assert geometry_degree(part.mesh) == degree
        found = moments(part, degree=6)
        errors.append(abs((np.concatenate((found[0], np.diag(found)[1:])) - exact) / scales).max())
    if exact is BOX:
        assert errors[0] < 1e-12
    else:
        assert errors[-1] < {1: 1e-2, 2: 2e-5}[degree]
    if len(sizes) > 1:  # of half the size, where not all edges are halved
        assert errors[1] < errors[0] / {1: 2, 2: 4}[degree]
