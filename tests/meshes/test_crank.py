"""The crank against its exact volume and areas."""

from mpi4py import MPI

import dolfinx
import numpy as np
import pytest
from measures import area, extents, n_cells, n_owned, nodes_of, volume

from flexmbd import meshes
from flexmbd.continuum.compat import cell_nodes
from flexmbd.continuum.grid.cell_shape import cell_quality
from flexmbd.errors import MeshError

pytestmark = pytest.mark.mpi

COMM = MPI.COMM_WORLD

# The defaults: radii and lengths, m.
THROW, JOURNAL, PIN, WALL = 0.08, 0.04, 0.035, 0.015
JOURNAL_LENGTH, PIN_LENGTH, WEB = 0.035, 0.03, 0.022
HEIGHT = PIN_LENGTH / 2 + WEB + JOURNAL_LENGTH


def hull(a, b, distance):
    """Area and circumference of the hull of two circles."""
    slope = np.arccos((a - b) / distance)
    tangent = distance * np.sin(slope)
    around = 2 * (np.pi - slope) * a + 2 * slope * b + 2 * tangent
    # sectors of both circles, and two trapezoids between the radii to the tangents
    return (np.pi - slope) * a**2 + slope * b**2 + (a + b) * tangent, around


def exact(**sizes):
    """Volume, and areas by group."""
    p = {
        "throw": THROW, "journal": 2 * JOURNAL, "pin": 2 * PIN, "journal_wall": WALL,
        "pin_wall": WALL, "journal_length": JOURNAL_LENGTH, "pin_length": PIN_LENGTH,
        "web_thickness": WEB,
    } | sizes  # fmt: skip
    face, around = hull(
        p["journal"] / 2 + p["journal_wall"], p["pin"] / 2 + p["pin_wall"], p["throw"]
    )
    discs = np.pi / 4 * p["journal"] ** 2, np.pi / 4 * p["pin"] ** 2
    cylinder = np.pi * p["journal"] * p["journal_length"]
    return {
        "volume": 2 * p["journal_length"] * discs[0] + p["pin_length"] * discs[1]
        + 2 * p["web_thickness"] * face,
        "start": cylinder,
        "end": cylinder,
        "pin": np.pi * p["pin"] * p["pin_length"],
        # outer faces with the journals' ends, inner faces without the pin, and the rims
        "surface": 2 * face + 2 * (face - discs[1]) + 2 * p["web_thickness"] * around,
    }  # fmt: skip


def measured(crank):
    found = {name: area(crank, name) for name in crank.facet_groups}
    return found | {"volume": volume(crank)}


@pytest.fixture(scope="module")
def cranks():
    """By cell, size of the cells and degree of the geometry."""
    return {
        (cell, h, degree): meshes.crank(h=h, cell=cell, degree=degree)
        for cell in ("tetrahedron", "hexahedron")
        for h, degree in ((0.012, 1), (0.012, 2))
    }


def test_volume_and_areas(cranks):
    for (_, _, degree), crank in cranks.items():
        found = measured(crank)
        assert found.keys() == exact().keys()
        for name, value in exact().items():
            assert found[name] == pytest.approx(value, rel={1: 1e-2, 2: 2e-5}[degree]), name


def test_cylinders_are_where_they_should_be(cranks):
    """Every node of a cylinder, the curved edges' too, lies on it, and at the right height."""
    top = PIN_LENGTH / 2 + WEB
    places = {
        "pin": (THROW, PIN, -PIN_LENGTH / 2, PIN_LENGTH / 2),
        "start": (0.0, JOURNAL, -HEIGHT, -top),
        "end": (0.0, JOURNAL, top, HEIGHT),
    }
    for crank in cranks.values():
        for name, (x, radius, low, high) in places.items():
            nodes = nodes_of(crank, name)
            assert np.hypot(nodes[:, 0] - x, nodes[:, 1]) == pytest.approx(radius, abs=1e-9)
            ends = COMM.allgather(nodes[:, 2])
            assert min(z.min(initial=1) for z in ends) == pytest.approx(low, abs=1e-12)
            assert max(z.max(initial=-1) for z in ends) == pytest.approx(high, abs=1e-12)


def test_groups_cover_the_boundary_once(cranks):
    for (cell, _, _), crank in cranks.items():
        assert crank.mesh.topology.cell_name() == cell
        assert n_owned(crank, 3, crank.cells("crank")) == n_cells(crank)
        crank.mesh.topology.create_connectivity(2, 3)
        boundary = dolfinx.mesh.exterior_facet_indices(crank.mesh.topology)
        assert np.array_equal(np.sort(crank.facet_tags.indices), np.sort(boundary))
        high = [THROW + PIN + WALL, JOURNAL + WALL, HEIGHT]
        low = [-JOURNAL - WALL, -JOURNAL - WALL, -HEIGHT]
        # no node need lie where the eyes stand out furthest
        assert extents(crank) == pytest.approx(np.array([low, high]), abs=2e-4)


def test_hexahedra_are_of_use(cranks):
    for (cell, _, _), crank in cranks.items():
        element = crank.mesh.ufl_domain().ufl_coordinate_element().basix_element
        x = crank.mesh.geometry.x[cell_nodes(crank.mesh)]
        lowest = COMM.allreduce(cell_quality(x, element).min(), op=MPI.MIN)
        assert lowest > (0.2 if cell == "hexahedron" else 0.05)


@pytest.mark.parametrize("cell", ["tetrahedron", "hexahedron"])
def test_pin_and_journals_that_overlap(cell):
    """A short throw, seen along the axis: the pin's circle crosses the journal's."""
    sizes = {"throw": 0.04, "journal": 0.06, "pin": 0.05, "web_thickness": 0.03, "pin_length": 0.02}
    found = measured(meshes.crank(h=0.006, cell=cell, **sizes))
    for name, value in exact(**sizes).items():
        assert found[name] == pytest.approx(value, rel=1e-5), name


@pytest.mark.parametrize(
    ("bad", "pattern"),
    [
        ({"throw": 0.0}, "throw must be a positive"),
        ({"pin": "thick"}, "pin must be a positive, finite length in m, got 'thick'"),
        ({"journal_wall": 0.1}, r"throw must exceed 0\.09 m, or one eye of the web lies within"),
        ({"cell": "prism"}, "cell must be"),
        ({"degree": 3}, "degree of the geometry"),
        ({"cell": "hexahedron", "h": 0.03}, r'quadrilaterals of use; .* cell="tetrahedron"'),
    ],
)
def test_bad_arguments(bad, pattern):
    with pytest.raises(MeshError, match=pattern):
        meshes.crank(**bad)
    assert COMM.allreduce(1) == COMM.size
