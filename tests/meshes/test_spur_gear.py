"""A spur gear: its flanks are involutes, of the thickness and the length that these have, and its teeth are alike."""

from mpi4py import MPI

import numpy as np
import pytest
import ufl
from dolfinx import fem
from dolfinx.mesh import entities_to_geometry

from flexmbd import meshes
from flexmbd.errors import MeshError

COMM = MPI.COMM_WORLD
TEETH, MODULE, WIDTH, BORE, BACKLASH = 20, 3e-3, 5e-3, 0.012, 6e-5
GOOD = {"teeth": TEETH, "module": MODULE, "width": WIDTH, "bore": BORE, "divisions": (4, 8, 2, 1), "backlash": BACKLASH}
PITCH, ANGLE = 0.5 * TEETH * MODULE, np.deg2rad(20.0)
BASE, TIP, FOOT = PITCH * np.cos(ANGLE), PITCH + MODULE, PITCH - 0.85 * MODULE


def total(form):
    return COMM.allreduce(fem.assemble_scalar(fem.form(form)))


def flanks(gear, tooth):
    """(n, 2) m: all nodes of both flanks of a tooth, which is turned onto the x axis."""
    nodes = np.unique(entities_to_geometry(gear.mesh, 2, gear.facets(f"tooth_{tooth}"), False))
    turn = 2.0 * np.pi * tooth / TEETH
    back = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    return gear.mesh.geometry.x[nodes, :2] @ back


@pytest.mark.parametrize("tooth", [0, 7])
def test_flanks_are_involutes_of_the_base_circle(tooth):
    """A taut string that is unwound: its free length is the arc that it has left."""
    x = flanks(meshes.spur_gear(**GOOD, comm=MPI.COMM_SELF), tooth)
    radius, angle = np.hypot(*x.T), abs(np.arctan2(x[:, 1], x[:, 0]))
    assert radius.max() == pytest.approx(TIP, rel=1e-12)
    assert radius.min() == pytest.approx(FOOT, rel=1e-12)
    outside = radius > BASE
    string = np.sqrt(np.maximum(radius**2 - BASE**2, 0.0))
    begins = angle + string / BASE - np.arctan2(string, BASE)  # where it left the circle
    np.testing.assert_allclose(begins[outside], begins[outside][0], rtol=1e-12)
    np.testing.assert_allclose(angle[~outside], begins[outside][0], rtol=1e-12)
    thickness = 2.0 * PITCH * (begins[outside][0] - np.tan(ANGLE) + ANGLE)
    assert thickness == pytest.approx(0.5 * np.pi * MODULE - BACKLASH, rel=1e-12)


@pytest.mark.mpi
def test_areas_of_the_flanks_and_the_hub():
    """Of an involute of the base circle b out to r: (r^2 - b^2) / 2 b."""
    gear = meshes.spur_gear(**GOOD | {"divisions": (4, 16, 2, 1), "fine": (3, 4)})
    ds = ufl.Measure("ds", domain=gear.mesh, subdomain_data=gear.facet_tags)
    one = fem.Constant(gear.mesh, 1.0)
    length = (TIP**2 - BASE**2) / (2.0 * BASE) + BASE - FOOT
    assert gear.facet_groups.keys() == {"hub", *(f"tooth_{k}" for k in range(TEETH))}
    for name, exact, within in (
        ("tooth_3", 2.0 * length * WIDTH, 1e-4), ("tooth_19", 2.0 * length * WIDTH, 1e-3),
        ("hub", 2.0 * np.pi * BORE * WIDTH, 1e-6),
    ):  # fmt: skip
        assert total(one * ds(gear.facet_groups[name])) == pytest.approx(exact, rel=within)
    cells = COMM.allreduce(gear.mesh.topology.index_map(3).size_local)
    assert cells == TEETH * (4 + 2 * 2) * 2 + 2 * 4 * 17 + 18 * 4 * 4


@pytest.mark.mpi
def test_a_smaller_bore_adds_a_ring_and_the_teeth_are_alike():
    """Parabolas over cells of 2 degrees at most follow a circle to 1e-5."""
    one = fem.Constant
    wide, narrow = (meshes.spur_gear(**GOOD | {"bore": bore}) for bore in (0.012, 0.006))
    volumes = [total(one(gear.mesh, 1.0) * ufl.dx(domain=gear.mesh)) for gear in (wide, narrow)]
    assert volumes[1] - volumes[0] == pytest.approx(np.pi * (0.012**2 - 0.006**2) * WIDTH, rel=1e-5)
    second = total(ufl.SpatialCoordinate(wide.mesh)[0] ** 2 * ufl.dx(domain=wide.mesh))
    other = total(ufl.SpatialCoordinate(wide.mesh)[1] ** 2 * ufl.dx(domain=wide.mesh))
    assert second == pytest.approx(other, rel=1e-9)
    assert abs(total(ufl.SpatialCoordinate(wide.mesh)[0] * ufl.dx(domain=wide.mesh))) < 1e-9 * volumes[0] * PITCH


@pytest.mark.mpi
@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"teeth": 7}, "8 teeth at least, got 7"),
        ({"bore": 0.0235}, "bore must be a module below the root circle"),
        ({"fine": (0, 20)}, r"fine has the teeth \[20\], and they are counted from 0 to 19"),
        ({"pressure_angle": 20.0}, "pressure_angle must be between 0 and pi/4 rad, got 20"),
        ({"backlash": 1.0}, "backlash must be from 0 to half a pitch"),
        ({"backlash": 2e-3}, "meet below its tip"),
        ({"divisions": (4, 8, 2)}, "divisions must be four positive whole numbers"),
    ],
)
def test_bad_input(change, named):
    with pytest.raises(MeshError, match=named):
        meshes.spur_gear(**GOOD | change)
