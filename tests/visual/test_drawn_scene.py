"""What pictures are made of: shapes, colours that never repeat, cameras that see the whole motion, scales, meshes."""

import importlib.machinery
import sys
import types

import numpy as np
import pytest
from particles import particle_body

import flexmbd as fm
from flexmbd.errors import PictureError, SceneError
from flexmbd.visual import show as show_machine
from flexmbd.visual.drawn_scene import drawn_scene
from flexmbd.visual.palette import GROUND, JOINT, body_colours
from flexmbd.visual.part import placed
from flexmbd.visual.scales import bar_end
from flexmbd.visual.view import PANEL, SceneView

SMALL = (320, 240)


def thrown():
    """A wheel and a box that fly apart; the ground has a floor far larger than both."""
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    wheel = scene.add(fm.RigidBody.from_shape(fm.Shape.wheel(0.3, 0.1, axis="y"), density=700.0), name="wheel")
    block = fm.RigidBody(1.0, (1.0, 1.0, 1.0), shape=fm.Shape.box((0.2, 0.3, 0.4), colour="#336699"))
    scene.add(block, name="block")
    one = scene.connect(fm.joint.Free(), scene.ground.frame(), wheel.frame())
    two = scene.connect(fm.joint.Free(), scene.ground.frame((0.0, 0.0, 1.0)), block.frame())
    one.velocity = (2.0, 0.0, 3.0, 0.0, 5.0, 0.0)
    two.velocity = (-1.0, 0.5, 0.0, 3.0, 0.0, 0.0)
    scene.ground.shape = fm.Shape.floor((20.0, 20.0), at=(0.0, 0.0, -0.3))
    return scene


@pytest.fixture(scope="module")
def flight():
    return thrown().simulate(0.5, rtol=1e-6)


def parts_of(run, times):
    return drawn_scene(run, times, notes=[""] * len(times))


def test_shapes_are_where_the_bodies_are(flight):
    """By the closed form of free flight, and no symbol stands beside a shape."""
    times = np.array([0.0, 0.2, 0.5])
    scene = parts_of(flight, times)
    assert {part.label for part in scene.parts} == {"wheel", "block"}
    assert {part.label for part in scene.fixed} == {"ground"}
    (block,) = (part for part in scene.parts if part.label == "block")
    assert (block.colour, scene.legend["block"]) == ("#336699", "#336699")
    shape = flight.bodies["block"].shape.points
    for k, t in enumerate(times):
        turn = np.array([[1, 0, 0], [0, np.cos(3 * t), -np.sin(3 * t)], [0, np.sin(3 * t), np.cos(3 * t)]])
        expected = shape @ turn.T + np.array([-t, 0.5 * t, 1.0 - 0.5 * 9.81 * t * t])
        np.testing.assert_allclose(placed(block, k)[0], expected, atol=1e-5)


def test_the_camera_sees_all_that_moves_and_not_the_floor(flight):
    scene = parts_of(flight, np.linspace(0.0, 0.5, 11))
    for aspect, view in ((1.6, None), (0.5, None), (1.6, np.array([0.0, 0.0, 1.0])), (1.0, np.array([0.6, 0.0, -0.8]))):
        camera = scene.camera(aspect, view)
        across = np.cross(camera.up, camera.towards)
        corners = np.vstack([placed(part, k)[0] for part in scene.parts for k in range(11)]) - camera.focus
        assert np.abs(corners @ camera.up).max() <= camera.half_height
        assert np.abs(corners @ across).max() <= aspect * camera.half_height
        assert np.abs(corners @ camera.towards).max() < camera.distance
        assert camera.half_height < 3.0  # the floor is 20 m wide
        assert camera.up @ camera.towards == pytest.approx(0.0, abs=1e-12)
        assert view is None or camera.towards @ view == pytest.approx(1.0)


@pytest.mark.parametrize("count", range(1, 61))
def test_colours_never_repeat(count):
    """Nor are they the background's, the ground's or the joints'; neighbours in red, green and blue differ visibly."""
    colours = body_colours(count)
    assert len(set(colours) | {"#ffffff", GROUND, JOINT}) == count + 3
    assert colours == body_colours(60)[:count]
    rgb = np.array([[int(c[k : k + 2], 16) for k in (1, 3, 5)] for c in colours], dtype=float)
    apart = np.linalg.norm(rgb[:, None] - rgb, axis=2) + 1e3 * np.eye(count)
    assert apart.min() > 20.0


def test_thousands_of_colours_differ():
    assert len(set(body_colours(6000))) == 6000


def test_a_picture_has_the_colours_of_its_bodies(tmp_path):
    """Twelve balls in a row, drawn flat: as many hues as bodies, beside a legend with the same ones."""
    imageio = pytest.importorskip("imageio.v2")
    scene = fm.System()
    for k in range(12):
        ball = scene.add(fm.RigidBody(1.0, (1.0, 1.0, 1.0), shape=fm.Shape.sphere(0.5)), name=f"ball {k}")
        scene.connect(fm.joint.Fixed(), scene.ground.frame((float(k), 0.0, 0.0)), ball.frame())
    path = scene.show(path=tmp_path / "balls.png", size=(960, 240))
    picture = np.asarray(imageio.imread(path))[..., :3].astype(float)
    machine, panel = np.split(picture, [int(960 * (1.0 - PANEL))], axis=1)
    for name, colour in zip((f"ball {k}" for k in range(12)), body_colours(12), strict=True):
        rgb = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)])
        for half in (machine, panel):
            shade = half / np.maximum(half.max(axis=2, keepdims=True), 1.0) - rgb / rgb.max()
            assert (np.abs(shade).max(axis=2) < 0.04).sum() > 10, (name, half.shape)
    dark = (panel.max(axis=2) < 130).sum()
    assert dark > 100  # names are written in the colour of words


def test_the_legend_stands_beside_the_picture(flight):
    """The scene's renderer ends where the panel's begins, and nothing of the machine is in the panel."""
    pytest.importorskip("pyvista")
    scene = parts_of(flight, np.array([0.0, 0.5]))
    view = SceneView(scene, size=SMALL)
    try:
        machine, panel = view.plotter.renderers[0], view.plotter.renderers[1]
        assert machine.GetViewport()[2] <= panel.GetViewport()[0] + 1e-12
        words = [
            {actor.GetInput() for actor in renderer.GetViewProps() if actor.IsA("vtkTextActor")}
            for renderer in (machine, panel)
        ]
        assert not {"wheel", "block"} & words[0]
        assert words[1] == {"wheel", "block"}
        assert machine.camera.parallel_scale == view.camera.half_height
    finally:
        view.close()


@pytest.mark.parametrize("largest", [1e-9, 0.031, 0.1, 0.3, 0.7, 1.0, 3.3, 4.96, 5.0, 9.99, 37.0, 496.0, 999.0, 2.5e7])
def test_scalar_bars_end_on_round_numbers(largest):
    end, labels = bar_end(largest)
    step = end / (labels - 1)
    assert largest * (1.0 - 1e-9) <= end <= largest + step
    assert 2 <= labels <= 6
    for label in step * np.arange(1, labels):
        assert float(f"{label:.3g}") == pytest.approx(label, rel=1e-12)
    assert step / 10.0 ** np.floor(np.log10(step) + 1e-12) == pytest.approx(1.0) or np.isclose(
        step / 10.0 ** np.floor(np.log10(step) + 1e-12), [2.0, 2.5, 5.0]
    ).any()


def test_a_bar_without_values():
    assert bar_end(0.0) == (1.0, 2)


def test_meshes_of_a_machine(flight):
    pyvista = pytest.importorskip("pyvista")
    blocks = flight.to_pyvista(0.5)
    assert isinstance(blocks, pyvista.MultiBlock)
    assert {"wheel", "block", "ground"} <= set(blocks.keys())
    assert blocks["block"].volume == pytest.approx(0.024, rel=1e-5)
    np.testing.assert_allclose(blocks["block"].center, [-0.5, 0.25, 1.0 - 0.125 * 9.81], atol=1e-5)
    start = thrown().to_pyvista()
    np.testing.assert_allclose(start["block"].center, [0.0, 0.0, 1.0], atol=1e-6)
    with pytest.raises(SceneError, match="outside"):
        flight.to_pyvista(1.0)


def test_without_a_display_one_line_says_what_to_do(flight, monkeypatch, tmp_path):
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    for call in (flight.show, thrown().show):
        with pytest.raises(PictureError, match=r"no display here.*path='machine.png'"):
            call()
    with pytest.raises(PictureError, match=r"\.png"):
        flight.show(path=tmp_path / "a.jpg")
    with pytest.raises(PictureError, match="view is a direction"):
        flight.show(path=tmp_path / "a.png", view=(0.0, 0.0, 0.0))
    with pytest.raises(PictureError, match="one time"):
        flight.show(path=tmp_path / "a.png", t="now")
    with pytest.raises(SceneError, match="outside"):
        flight.show(path=tmp_path / "a.png", t=2.0)
    assert not list(tmp_path.iterdir())


def test_a_window_is_opened_where_there_is_a_display(flight, monkeypatch):
    """Off-screen here, by pyvista's own switch: what it would show is drawn and closed."""
    pyvista = pytest.importorskip("pyvista")
    monkeypatch.setenv("DISPLAY", ":77")
    monkeypatch.setattr(pyvista, "OFF_SCREEN", True)
    shown = []
    monkeypatch.setattr(pyvista.Plotter, "show", lambda self, **how: shown.append(self.window_size))
    assert show_machine(flight, size=SMALL) is None
    assert shown == [list(SMALL)]


@pytest.mark.parametrize("live", [True, False])
def test_a_notebook_has_the_slider_where_it_can_be_moved(flight, monkeypatch, live):
    pyvista = pytest.importorskip("pyvista")
    monkeypatch.setattr(pyvista.plotting.plotter.scooby, "in_ipykernel", lambda: True)
    monkeypatch.setenv("DISPLAY", ":77")
    missing = None if not live else types.ModuleType("trame")
    for name in ("pyvista.trame", "ipywidgets"):
        monkeypatch.setitem(sys.modules, name, missing)
        if live:
            missing.__spec__ = importlib.machinery.ModuleSpec(name, None)
    sliders, shown = [], []
    monkeypatch.setattr(pyvista.Plotter, "add_slider_widget", lambda self, *given, **how: sliders.append(how["value"]))
    monkeypatch.setattr(pyvista.Plotter, "show", lambda self, **how: shown.append(how["jupyter_backend"]))
    show_machine(flight, size=SMALL)
    assert (shown, sliders) == ((["trame"], [0.0]) if live else (["static"], []))


def test_a_flexible_body_without_a_surface_says_why_it_is_drawn_as_sticks():
    """Of rigid bodies, and of a flexible one with a shape, nothing is said."""
    scene = fm.System()
    record = particle_body(3, modes=4).record
    bodies: dict[str, fm.FlexibleBody | fm.RigidBody] = {
        "bare": fm.FlexibleBody(record),
        "shaped": fm.FlexibleBody(record, shape=fm.Shape.box((0.1, 0.1, 0.1))),
        "rigid": fm.RigidBody(1.0, (1.0, 1.0, 1.0)),
    }
    for name, body in bodies.items():
        body.name = name
        scene.add(body)  # type: ignore[type-var]
        scene.connect(fm.joint.Revolute("y"), scene.ground.frame(), body.frame())
    (note,) = drawn_scene(scene.at_start(), np.zeros(1), notes=["t = 0 s"]).notes
    first, second = note.splitlines()
    assert first == "t = 0 s"
    assert second.startswith("bare as sticks: no surface in the record; reduce with keep=Keep(surface=True)")
