"""Pictures of single bodies, and what a notebook shows: records, their modes, stress, shapes, machines."""

import base64
import re

import numpy as np
import pytest
from two_crosses_body import two_crosses

import flexmbd as fm
from flexmbd.errors import PictureError
from flexmbd.record.groups import Surface
from flexmbd.record.stress_field import StressField
from flexmbd.visual import notebook
from flexmbd.visual.portraits import record_scene

SMALL = (160, 120)


@pytest.fixture(scope="module")
def record():
    """A tetrahedron of triangles with three modes: it moves along x, y, z by its corners' own x, y, z."""
    from dataclasses import replace

    body = two_crosses()
    x = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.5, 0.0], [0.0, 0.0, 0.2]])
    triangle = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
    phi = np.zeros((4, 3, body.n_modes))
    phi[:, 0, 0] = x[:, 0]
    phi[:, 2, 1] = -7.0 * x[:, 1]
    return replace(body, surface=Surface(x, triangle, phi))


def png_of(path):
    imageio = pytest.importorskip("imageio.v2")
    return np.asarray(imageio.imread(path))[..., :3]


def test_a_mode_is_drawn_in_proportion(record):
    """Its largest displacement is a tenth of the length, along the mode; colours are shares of it."""
    (part,) = record_scene(record, mode=1).parts
    places, share = part.at(0)
    expected = record.surface.x.copy()
    expected[2, 2] -= 0.1
    np.testing.assert_allclose(places, expected, atol=1e-15)
    np.testing.assert_allclose(share, [0.0, 0.0, 1.0, 0.0], atol=1e-15)
    assert record.to_pyvista(mode=1).n_points == 4


def test_a_film_of_a_mode_swings_once(record, tmp_path):
    imageio = pytest.importorskip("imageio.v2")
    path = record.animate(tmp_path / "mode.gif", mode=0, seconds=0.8, fps=10, size=SMALL, amplitude=0.3)
    with imageio.get_reader(path) as reader:
        pictures = [np.asarray(one)[..., :3].astype(int) for one in reader]
    assert len(pictures) == 8
    still, out, back = pictures[0], pictures[2], pictures[6]
    assert min(np.abs(a - b).max() for a, b in ((still, out), (still, back), (out, back))) > 80
    scene = record_scene(record, mode=0, phases=np.sin(2.0 * np.pi * np.arange(8) / 8))
    moved = [scene.parts[0].at(k)[0][1, 0] for k in range(8)]
    np.testing.assert_allclose(moved, 1.0 + 0.1 * np.sin(2.0 * np.pi * np.arange(8) / 8), atol=1e-12)


def test_bodies_are_shown_by_file(record, tmp_path):
    flexible = fm.FlexibleBody(record)
    for name, show in (
        ("record", record.show), ("body", flexible.show), ("shape", fm.Shape.wheel(0.3, 0.1).show),
        ("mode", lambda **how: flexible.show(mode=0, **how)),
    ):  # fmt: skip
        path = show(path=tmp_path / f"{name}.png", size=SMALL)
        assert 0.01 < (png_of(path).min(axis=2) < 240).mean() < 0.9


@pytest.mark.parametrize(
    ("how", "message"),
    [
        ({"mode": 99}, r"one of the \d+ there are, counted from 0, got 99"),
        ({"mode": "first"}, "got 'first'"),
        ({"mode": 0, "amplitude": "large"}, "amplitude must be a finite number"),
        ({"path": "a.jpg"}, r"\.png"),
        ({"path": "nowhere/a.png"}, "nowhere"),
        ({"path": "a.png", "size": (3, 3)}, "even"),
        ({"path": "a.png", "view": "x"}, "view is a direction"),
    ],
)
def test_bad_choices_are_refused(record, tmp_path, monkeypatch, how, message):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(PictureError, match=message):
        record.show(**{"path": "b.png", **how})
    assert not list(tmp_path.iterdir())


def test_a_record_without_a_surface_says_so():
    for ask in (lambda: two_crosses().show(path="a.png"), lambda: two_crosses().animate("a.gif", mode=0)):
        with pytest.raises(PictureError, match=r"keep=Keep\(surface=True\)"):
            ask()


def stressed(record):
    surface = record.surface
    values = 1e6 * np.arange(4.0)
    return StressField(
        np.arange(4), surface.x, surface.triangle, np.zeros((4, 3)), np.zeros((4, 3, 3)), values, 3e6, surface.x[3]
    )


def machine():
    scene = fm.System()
    ball = scene.add(fm.RigidBody(1.0, (1.0, 1.0, 1.0), shape=fm.Shape.sphere(0.1)), name="ball")
    scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(), ball.frame())
    return scene


def test_a_notebook_shows_text_and_a_picture(record):
    """Short texts; the picture is a whole .png with something on it."""
    imageio = pytest.importorskip("imageio.v2")
    assert notebook.can_draw()
    scene = machine()
    run = scene.simulate(0.1, rtol=1e-3)
    for thing in (scene, run, record, stressed(record)):
        assert len(repr(thing)) < 250
        html = thing._repr_html_()
        (code,) = re.findall(r'src="data:image/png;base64,([^"]+)"', html)
        picture = np.asarray(imageio.imread(base64.b64decode(code)))[..., :3]
        assert picture.shape == (360, 640, 3)
        assert (picture.min(axis=2) < 240).sum() > 300


def test_a_notebook_without_graphics_shows_text(record, monkeypatch):
    """Where nothing can be drawn, where drawing fails, and where there is nothing to draw."""
    assert "img" not in two_crosses()._repr_html_()
    crowd = fm.System()
    for k in range(201):
        body = crowd.add(fm.RigidBody(1.0, (1.0, 1.0, 1.0)))
        crowd.connect(fm.joint.Fixed(), crowd.ground.frame((float(k), 0.0, 0.0)), body.frame())
    assert "img" not in crowd._repr_html_()
    unfit = fm.System()
    unfit.add(fm.RigidBody(1.0, (1.0, 1.0, 1.0)))
    assert unfit._repr_html_() == "<pre>&lt;System: 1 bodies, 0 joints, 0 forces, 0 couplings&gt;</pre>"
    monkeypatch.setattr(notebook, "can_draw", lambda: False)
    assert record._repr_html_().startswith("<pre>&lt;ReducedBody: ")


def test_graphics_that_hang_are_no_graphics(monkeypatch):
    monkeypatch.setattr(notebook, "_TRIAL", "import time; time.sleep(60)")
    monkeypatch.setattr(notebook, "_PATIENCE", 0.2)
    assert not notebook.can_draw.__wrapped__()
    monkeypatch.setattr(notebook, "_TRIAL", "import os; os.abort()")
    monkeypatch.setattr(notebook, "_PATIENCE", 20.0)
    assert not notebook.can_draw.__wrapped__()
