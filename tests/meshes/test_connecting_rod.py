"""The connecting rod against the volume and areas of its exact shape."""

import dolfinx
import numpy as np
import pytest
from measures import area, extents, n_cells, nodes_of, volume
from scipy.integrate import quad

from flexmbd import meshes
from flexmbd.errors import MeshError

pytestmark = pytest.mark.mpi

LENGTH, THICKNESS, SHANK = 0.3, 0.028, 0.016
BORES = {"big_end": (0.0, 0.035), "small_end": (LENGTH, 0.018)}


def exact_volume():
    """Two rings, and the part of the tapered plate that lies outside both eyes."""
    big, small = 0.048, 0.028

    def outside(x):
        half_width = 0.022 + (0.015 - 0.022) * x / LENGTH
        eye = max(big**2 - x**2, small**2 - (x - LENGTH) ** 2, 0.0)
        return 2 * max(half_width - np.sqrt(eye), 0.0)

    breaks = [big, LENGTH - small]
    plate = quad(outside, 0, LENGTH, points=breaks, limit=400, epsabs=1e-12)[0]
    rings = np.pi * (big**2 - 0.035**2 + small**2 - 0.018**2)
    return THICKNESS * rings + SHANK * plate


@pytest.fixture(scope="module")
def rods():
    """By cell size and degree of the geometry."""
    return {
        (h, degree): meshes.connecting_rod(h=h, degree=degree)
        for h, degree in ((0.012, 2), (0.006, 2), (0.006, 1))
    }


def test_defaults_are_the_tours(rods):
    named = meshes.connecting_rod(length=0.3, h=6e-3)
    assert named.fingerprint() == rods[0.006, 2].fingerprint()
    assert named.facet_groups.keys() == {"big_end", "small_end", "surface"}
    assert named.cell_groups.keys() == {"rod"}
    assert 5e3 < n_cells(named) < 2e4


def test_bores_are_where_they_should_be(rods):
    """Every node of a bore, the curved edges' too, lies on its cylinder."""
    for rod in rods.values():
        for name, (x, radius) in BORES.items():
            nodes = nodes_of(rod, name)
            distance = np.hypot(nodes[:, 0] - x, nodes[:, 1])
            assert distance == pytest.approx(radius, abs=1e-9)
            ends = rod.comm.allgather(nodes[:, 2])
            assert min(z.min(initial=0) for z in ends) == pytest.approx(-THICKNESS / 2, abs=1e-12)
            assert max(z.max(initial=0) for z in ends) == pytest.approx(THICKNESS / 2, abs=1e-12)


def test_extents(rods):
    low, high = [-0.048, -0.048, -THICKNESS / 2], [LENGTH + 0.028, 0.048, THICKNESS / 2]
    # no node need lie at the very ends of the round eyes
    assert extents(rods[0.006, 2]) == pytest.approx(np.array([low, high]), abs=1e-4)


def test_volume_and_bores_converge_with_the_order_of_curved_cells(rods):
    """Halving h: degree 2 gains h^4, and is far ahead of flat facets."""
    exact = {name: 2 * np.pi * radius * THICKNESS for name, (_, radius) in BORES.items()}
    for measure, value in [
        (volume, exact_volume()),
        (lambda rod: area(rod, "big_end"), exact["big_end"]),
        (lambda rod: area(rod, "small_end"), exact["small_end"]),
    ]:
        errors = {key: abs(measure(rod) / value - 1) for key, rod in rods.items()}
        assert errors[0.006, 2] < errors[0.012, 2] / 8
        assert errors[0.006, 2] < errors[0.006, 1] / 50
        assert errors[0.006, 2] < 1e-4


def test_each_boundary_facet_is_in_one_group(rods):
    rod = rods[0.012, 2]
    rod.mesh.topology.create_connectivity(2, 3)
    boundary = dolfinx.mesh.exterior_facet_indices(rod.mesh.topology)
    grouped = np.concatenate([rod.facets(name) for name in rod.facet_groups])
    assert np.array_equal(np.sort(grouped), np.sort(boundary))


@pytest.mark.parametrize("degree", [1, 2])
def test_hexahedra(rods, degree):
    """The same part drawn up from a planar mesh: volume, bores and the rest of the surface."""
    rod = meshes.connecting_rod(h=0.008, cell="hexahedron", degree=degree)
    assert rod.mesh.topology.cell_name() == "hexahedron"
    assert n_cells(rod) < 2000
    # a parabola for a sixteenth of a circle is 2.45e-5 too short
    loose = {1: 0.01, 2: 3e-5}[degree]
    assert volume(rod) == pytest.approx(exact_volume(), rel=loose)
    for name, (x, radius) in BORES.items():
        nodes = nodes_of(rod, name)
        assert np.hypot(nodes[:, 0] - x, nodes[:, 1]) == pytest.approx(radius, abs=1e-9)
        assert area(rod, name) == pytest.approx(2 * np.pi * radius * THICKNESS, rel=loose)
    assert area(rod, "surface") == pytest.approx(area(rods[0.006, 2], "surface"), rel=loose * 3)
    rod.mesh.topology.create_connectivity(2, 3)
    boundary = dolfinx.mesh.exterior_facet_indices(rod.mesh.topology)
    assert np.array_equal(np.sort(rod.facet_tags.indices), np.sort(boundary))


def test_hexahedra_of_one_thickness():
    rod = meshes.connecting_rod(h=0.008, cell="hexahedron", shank_thickness=THICKNESS)
    tets = meshes.connecting_rod(h=0.012, shank_thickness=THICKNESS)
    assert volume(rod) == pytest.approx(volume(tets), rel=1e-4)
    assert area(rod, "surface") == pytest.approx(area(tets, "surface"), rel=1e-4)


def test_other_dimensions():
    rod = meshes.connecting_rod(
        length=0.12, h=8e-3, big_bore=0.04, small_bore=0.02, big_wall=0.008, small_wall=0.006,
        thickness=0.02, shank_thickness=0.02, shank_width_big=0.02, shank_width_small=0.012,
    )  # fmt: skip
    assert area(rod, "small_end") == pytest.approx(np.pi * 0.02 * 0.02, rel=1e-3)
    nodes = nodes_of(rod, "small_end")
    assert np.hypot(nodes[:, 0] - 0.12, nodes[:, 1]) == pytest.approx(0.01, abs=1e-9)


@pytest.mark.parametrize(
    "name",
    [
        "length",
        "h",
        "big_bore",
        "small_bore",
        "big_wall",
        "small_wall",
        "thickness",
        "shank_thickness",
        "shank_width_big",
        "shank_width_small",
    ],
)
def test_bad_lengths_are_named(name):
    with pytest.raises(MeshError, match=f"^{name} must be a positive"):
        meshes.connecting_rod(**{name: -0.01})


@pytest.mark.parametrize(
    ("bad", "pattern"),
    [
        ({"length": 0.07}, "^length must exceed 0.076 m"),
        ({"shank_thickness": 0.03}, "^shank_thickness must be at most 0.028 m, got 0.03"),
        ({"shank_width_big": 0.096}, "^shank_width_big must be below 0.096"),
        ({"shank_width_small": 0.06}, "^shank_width_small must be below 0.056"),
        ({"degree": 0}, "^degree of the geometry must be 1 or 2"),
    ],
)
def test_dimensions_that_do_not_fit_are_named(bad, pattern):
    with pytest.raises(MeshError, match=pattern):
        meshes.connecting_rod(**bad)


def test_cells_too_big_for_the_bores_are_refused():
    """Middle nodes pulled onto the bores fold the cells there over."""
    with pytest.raises(MeshError, match=r"cells are inverted or flat .* use smaller cells"):
        meshes.connecting_rod(h=0.1)
