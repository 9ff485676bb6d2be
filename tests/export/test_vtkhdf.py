"""VTKHDF read back by VTK: modes on a surface, and the surfaces of a machine where its frames are."""

import dataclasses

import numpy as np
import pytest
from exported_bodies import damped_rod, soft_bar

import flexmbd as fm
from flexmbd.errors import ExportError, SceneError
from flexmbd.export import vtkhdf_file


def opened(path):
    """VTK's reader of a file, and the instants that it finds."""
    from vtkmodules.vtkCommonExecutionModel import vtkStreamingDemandDrivenPipeline
    from vtkmodules.vtkIOHDF import vtkHDFReader

    reader = vtkHDFReader()
    assert reader.CanReadFile(str(path))
    reader.SetFileName(str(path))
    reader.UpdateInformation()
    information, key = reader.GetOutputInformation(0), vtkStreamingDemandDrivenPipeline.TIME_STEPS()
    return reader, [information.Get(key, i) for i in range(information.Length(key))] if information.Has(key) else []


def grid(reader, t=None):
    """Places, triangles, arrays at points and at cells by name."""
    from vtkmodules.util.numpy_support import vtk_to_numpy

    if t is None:
        reader.Update()
    else:
        reader.UpdateTimeStep(t)
    output = reader.GetOutputDataObject(0)
    cells = vtk_to_numpy(output.GetCells().GetConnectivityArray()).copy()
    kinds = {output.GetCellType(i) for i in range(output.GetNumberOfCells())}
    at = []
    for data in (output.GetPointData(), output.GetCellData(), output.GetFieldData()):
        names = [data.GetArrayName(i) for i in range(data.GetNumberOfArrays())]
        at.append({name: vtk_to_numpy(data.GetArray(name)).copy() for name in names})
    return vtk_to_numpy(output.GetPoints().GetData()).copy(), cells, kinds, *at


def test_modes_on_the_surface(tmp_path):
    body, path = soft_bar(), tmp_path / "modës.vtkhdf"
    (told,) = fm.export.vtkhdf_modes(body, path)
    assert "for pictures" in told
    x, cells, kinds, points, _, fields = grid(opened(path)[0])
    np.testing.assert_array_equal(x, body.surface.x)
    np.testing.assert_array_equal(cells.reshape(-1, 3), body.surface.triangle)
    assert kinds == {5}
    assert set(points) == {f"mode {i}" for i in range(1, body.n_modes + 1)}
    for i in range(body.n_modes):
        np.testing.assert_array_equal(points[f"mode {i + 1}"], body.surface.phi[:, :, i])
    np.testing.assert_allclose(fields["frequency"], body.frequencies(["x_min"]), rtol=1e-9)
    assert [one.name for one in tmp_path.iterdir()] == ["modës.vtkhdf"]


def test_modes_at_nodes_alone(tmp_path):
    body = dataclasses.replace(soft_bar(), surface=None)
    fm.export.vtkhdf_modes(body, tmp_path / "nodes.vtkhdf")
    x, cells, kinds, points, *_ = grid(opened(tmp_path / "nodes.vtkhdf")[0])
    np.testing.assert_array_equal(x, body.modes.x)
    np.testing.assert_array_equal(cells, np.arange(len(x)))
    assert kinds == {1}
    np.testing.assert_array_equal(points["mode 3"], body.modes.phi[:, :, 2])


@pytest.fixture(scope="module")
def machine():
    """Two soft bars, one hanging from the other and turned against it, and a rigid ball at the end."""
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    record = soft_bar()
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    upper = scene.add(fm.FlexibleBody(record), name="upper")
    lower = scene.add(fm.FlexibleBody(record), name="löwer")
    ball = scene.add(fm.RigidBody(0.1, (1e-3, 1e-3, 1e-3)), name="ball")
    hinge = scene.connect(fm.joint.Revolute("y"), scene.ground.frame(R=turn), upper.frame("x_min"))
    scene.connect(fm.joint.Spherical(), upper.frame("x_max"), lower.frame("x_min"))
    scene.connect(fm.joint.Fixed(), lower.frame("x_max"), ball.frame())
    hinge.velocity = 1.0
    return scene.simulate(0.02, h=1e-3, integrator=fm.GeneralizedAlpha()), upper, lower


@pytest.mark.parametrize("at_once", [1, 3, None])
def test_a_machine_on_its_way(tmp_path, machine, monkeypatch, at_once):
    """Vertices at the ends lie where the interface frames carry them; the displacement is what deforms the body.

    Written so many instants at once.
    """
    run, upper, lower = machine
    if at_once is not None:
        fm.export.vtkhdf(run, tmp_path / "one.vtkhdf", t=run.t[:1])
        monkeypatch.setattr(vtkhdf_file, "_BLOCK", at_once * len(grid(opened(tmp_path / "one.vtkhdf")[0])[0]))
    path = tmp_path / "run.vtkhdf"
    assert fm.export.vtkhdf(run, path) == ("bodies shown by symbols, for want of a shape or a surface: ball",)
    reader, times = opened(path)
    np.testing.assert_array_equal(times, run.t)
    surface = upper.record.surface
    n, triangles = len(surface.x), len(surface.triangle)
    for k in (0, 7, len(run.t) - 1):
        x, cells, _, points, at_cells, _ = grid(reader, run.t[k])
        assert len(x) > 2 * n  # the ball's symbol
        np.testing.assert_array_equal(cells.reshape(-1, 3)[triangles : 2 * triangles], surface.triangle + n)
        np.testing.assert_array_equal(at_cells["body"][: 2 * triangles], np.repeat([0, 1], triangles))
        assert set(at_cells["body"][2 * triangles :]) == {2}
        centre = run.position(run.bodies["ball"].frame())[k]
        assert 0.0 < np.linalg.norm(x[2 * n :] - centre, axis=1).max() < 0.2
        np.testing.assert_array_equal(points["displacement"][2 * n :], 0.0)
        for number, body in enumerate((upper, lower)):
            mine = x[number * n : (number + 1) * n]
            for name in ("x_min", "x_max"):
                # a rigid interface moves its vertices as its own frame does, to first order in its rotation
                frame, interface = body.frame(name), body.record.interface(name)
                end = np.abs(surface.x[:, 0] - interface.p_BI_B[0]) < 1e-9
                assert end.sum() >= 4
                middle = mine[end].mean(axis=0)
                away = surface.x[end].mean(axis=0) - interface.p_BI_B
                R = run.rotation(body.frame())[k]
                bent = interface.modes[3:] @ run.q(body)[k]
                wanted = run.position(frame)[k] + R @ (away + np.cross(bent, away))
                np.testing.assert_allclose(middle, wanted, rtol=0.0, atol=1e-12)
            R = run.rotation(body.frame())[k]
            moved = points["displacement"][number * n : (number + 1) * n]
            rigid = run.position(body.frame())[k] + surface.x @ R.T
            np.testing.assert_allclose(mine - rigid, moved, rtol=0.0, atol=1e-7 * max(np.abs(moved).max(), 1e-3))
    assert np.abs(moved).max() > 1e-5


def whole(run, folder, t):
    """The reader of all steps, and an instant."""
    fm.export.vtkhdf(run, folder / "whole.vtkhdf")
    return opened(folder / "whole.vtkhdf")[0], t


def test_names_and_instants(tmp_path, machine):
    import h5py

    run, *_ = machine
    path = tmp_path / "run.vtkhdf"
    wanted = [0.0, 0.0123, 0.02]
    fm.export.vtkhdf(run, path, t=wanted)
    assert opened(path)[1] == wanted
    with h5py.File(path) as file:
        assert [name.decode() for name in file["bodies"]] == ["upper", "löwer", "ball"]
    fm.export.vtkhdf(run, path, t=run.t[10])
    places = grid(opened(path)[0])[0]  # one instant is no motion to VTK
    np.testing.assert_allclose(places[0], grid(*whole(run, tmp_path, run.t[10]))[0][0], rtol=0.0, atol=1e-15)
    with pytest.raises(ExportError, match="ascend"):
        fm.export.vtkhdf(run, path, t=[0.01, 0.01])
    with pytest.raises(SceneError, match="outside the trajectory"):
        fm.export.vtkhdf(run, path, t=[0.5])


def test_refused(tmp_path):
    with pytest.raises(ExportError, match=r"Keep\(surface=True\) or Keep\(modes=True\)"):
        fm.export.vtkhdf_modes(damped_rod(), tmp_path / "x.vtkhdf")
    with pytest.raises(ExportError, match="the machine has no body, and so nothing to be shown: add one"):
        fm.export.vtkhdf(fm.System().simulate(0.1), tmp_path / "x.vtkhdf")
    assert list(tmp_path.iterdir()) == []


def test_shapes_and_the_floor(tmp_path):
    """A thrown block by the closed form of its flight, a floor that stays, read by VTK's own reader at each instant."""
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    block = fm.RigidBody.from_shape(fm.Shape.box((0.2, 0.3, 0.4), at=(0.1, 0.0, 0.0)), density=1000.0)
    flight = scene.connect(fm.joint.Free(), scene.ground.frame(), scene.add(block, name="block").frame())
    flight.velocity = (1.0, 0.0, 2.0, 0.0, 0.0, 0.0)
    scene.ground.shape = fm.Shape.floor((4.0, 4.0))
    run = scene.simulate(0.3, rtol=1e-6)
    assert fm.export.vtkhdf(run, tmp_path / "a.vtkhdf", t=[0.0, 0.1, 0.3]) == ()
    reader, times = opened(tmp_path / "a.vtkhdf")
    assert times == [0.0, 0.1, 0.3]
    n = len(block.shape.points)
    for t in times:
        x, cells, kinds, points, at_cells, _ = grid(reader, t)
        assert kinds == {5}
        moved = block.shape.points + np.array([t, 0.0, 2.0 * t - 0.5 * 9.81 * t * t])
        np.testing.assert_allclose(x[:n], moved, rtol=0.0, atol=1e-5)
        np.testing.assert_array_equal(x[n:], np.vstack([part.points for part in scene.ground.shape.pieces()]))
        np.testing.assert_array_equal(points["displacement"], 0.0)
        a, b, c = np.moveaxis(x[cells.reshape(-1, 3)[at_cells["body"] == 0]], 1, 0)
        volume = np.einsum("ti,ti->", a - x[0], np.cross(b - x[0], c - x[0])) / 6.0
        assert volume == pytest.approx(0.024, rel=1e-6)
