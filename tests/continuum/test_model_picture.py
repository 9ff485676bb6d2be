"""Pictures of models: the whole mesh on any number of ranks, with the axes of its interfaces."""

from mpi4py import MPI

import numpy as np
import pytest

from flexmbd import meshes
from flexmbd.continuum import ContinuumModel, Interface
from flexmbd.continuum.finite_elements.model_picture import PicturedModel
from flexmbd.forms import beam_timoshenko, solid_linear

pytestmark = pytest.mark.mpi


@pytest.fixture(scope="module")
def block():
    mesh = meshes.block(2.0, 1.0, 0.5, divisions=(4, 2, 1))
    steel = solid_linear.Parameters(E=2.1e11, nu=0.3, rho=7850.0)
    return ContinuumModel(mesh, solid_linear, steel, degree=1, interfaces=[Interface("x_min"), Interface("x_max")])


def blocks_of(model):
    pytest.importorskip("pyvista")
    return model.to_pyvista()


def test_a_solid_shows_its_surface_and_its_interfaces(block):
    shown = blocks_of(block)
    assert shown["mesh"].volume == pytest.approx(1.0)
    assert np.ptp(shown["mesh"].points, axis=0) == pytest.approx([2.0, 1.0, 0.5])
    for face in block.interfaces:
        assert np.array(shown[face.name].center) == pytest.approx(face.p, abs=1e-12)


def test_beams_show_sticks():
    line = meshes.line(2.0, divisions=4)
    parameters = beam_timoshenko.Parameters(
        E=2e11, nu=0.3, rho=7800.0, A=1e-2, Iy=4e-6, Iz=9e-6, J=1e-5, ky=0.8, kz=0.8, orientation=(0.0, 1.0, 0.0)
    )
    shown = blocks_of(ContinuumModel(line, beam_timoshenko, parameters, degree=2))
    assert shown.n_blocks == 4
    assert np.array(shown.bounds)[:2] == pytest.approx([0.0, 2.0], abs=1e-9)


@pytest.mark.parametrize("cell", ["triangle", "quadrilateral"])
def test_shells_show_their_sheet(cell):
    sheet = meshes.sheet(2.0, 1.0, divisions=(4, 2), cell=cell)
    from flexmbd.continuum.finite_elements.model_picture import _flat_triangles, _whole_mesh

    x, cells = _whole_mesh(sheet)
    a, b, c = np.moveaxis(x[_flat_triangles(cells, sheet)], 1, 0)
    assert 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() == pytest.approx(2.0)


def test_a_model_is_written_once(block, tmp_path):
    path = MPI.COMM_WORLD.bcast(str(tmp_path / "block.png"))
    assert isinstance(block, PicturedModel)
    block.show(path=path, size=(160, 120))
    with open(path, "rb") as file:
        assert file.read(4) == b"\x89PNG"
    assert repr(block) == f"<ContinuumModel: {3 * 30} unknowns, 8 cells of degree 1, interfaces x_min, x_max>"
    assert ("img" in block._repr_html_()) == (MPI.COMM_WORLD.size == 1)


def test_a_mesh_for_pyvista(block):
    pyvista = pytest.importorskip("pyvista")
    grid = block.mesh.to_pyvista()
    assert isinstance(grid, pyvista.UnstructuredGrid)
    assert MPI.COMM_WORLD.allreduce(grid.volume) >= 1.0 - 1e-12
    assert set(grid.cell_data["group"]) <= {0, *block.mesh.cell_groups.values()}
