"""A part's mesh and its reduction are the same whatever the part's size or the unit of length."""

from __future__ import annotations

import numpy as np
import pytest

from flexmbd import forms, meshes
from flexmbd.continuum import ContinuumModel, Interface
from flexmbd.continuum.compat import cell_nodes
from flexmbd.reduction import craig_bampton

ROD = {
    "length": 0.3, "h": 12e-3, "big_bore": 0.07, "small_bore": 0.036, "big_wall": 0.013, "small_wall": 0.01,
    "thickness": 0.028, "shank_thickness": 0.016, "shank_width_big": 0.044, "shank_width_small": 0.03,
}  # fmt: skip
CRANK = {
    "throw": 0.08, "h": 0.02, "journal": 0.08, "pin": 0.07, "journal_wall": 0.015, "pin_wall": 0.015,
    "journal_length": 0.035, "pin_length": 0.03, "web_thickness": 0.022,
}  # fmt: skip
TUBE = {"length": 0.5, "outer_radius": 0.05, "inner_radius": 0.04, "h": 0.02}
PARTS = {
    "rod": (meshes.connecting_rod, ROD, {}),
    "rod of hexahedra": (meshes.connecting_rod, ROD, {"cell": "hexahedron"}),
    "crank": (meshes.crank, CRANK, {}),
    "tube": (meshes.tube, TUBE, {}),
    "tube of hexahedra": (meshes.tube, TUBE, {"cell": "hexahedron"}),
    "beam": (meshes.beam, {"length": 1.0, "width": 0.1, "height": 0.05, "h": 0.04}, {}),
    "plate": (meshes.plate, {"length": 1.0, "width": 0.5, "thickness": 0.01, "h": 0.1}, {}),
    "block": (meshes.block, {"length": 1.0, "width": 0.1, "height": 0.05}, {"divisions": (4, 2, 2)}),
    "ring": (
        meshes.quarter_ring,
        {"height": 0.1, "outer_radius": 0.2, "inner_radius": 0.1},
        {"divisions": (2, 6, 2)},
    ),
    "gear": (
        meshes.spur_gear,
        {"module": 3e-3, "width": 5e-3, "bore": 0.012, "backlash": 1e-4},
        {"teeth": 20, "divisions": (2, 4, 2, 1), "fine": (0,)},
    ),
    "sheet": (meshes.sheet, {"length": 1.0, "width": 0.5}, {"divisions": (4, 3)}),
    "line": (meshes.line, {"length": 1.0}, {"divisions": 5}),
}


@pytest.mark.parametrize("name", PARTS)
def test_a_mesh_scales_with_its_part_to_the_bit(name):
    make, lengths, others = PARTS[name]
    one = make(**lengths, **others)
    for power in (-24, 20):
        other = make(**{key: 2.0**power * value for key, value in lengths.items()}, **others)
        np.testing.assert_array_equal(other.mesh.geometry.x, 2.0**power * one.mesh.geometry.x)
        np.testing.assert_array_equal(cell_nodes(other.mesh), cell_nodes(one.mesh))


@pytest.mark.parametrize("size", [1e-6, 1e-3, 1e6])
def test_a_part_of_any_size_is_meshed_and_reduced(size):
    """Frequencies of geometrically similar parts go as 1/size; sizes that are no powers of two get another mesh."""

    def frequencies(size):
        mesh = meshes.connecting_rod(**{key: size * value for key, value in ROD.items()})
        steel = forms.solid_linear.Parameters(E=2.1e11, nu=0.3, rho=7850.0)
        ends = [Interface("big_end"), Interface("small_end")]
        model = ContinuumModel(mesh, forms.solid_linear, steel, degree=2, interfaces=ends)
        body = craig_bampton(model, modes=4, frame="big_end")
        return body.frequencies(clamped=["big_end"])[:4]

    np.testing.assert_allclose(size * frequencies(size), frequencies(1.0), rtol=2e-3)
