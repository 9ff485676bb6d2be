"""Pictures: what is drawn where, and files that are whole or not there."""

import subprocess
import sys
from dataclasses import dataclass, field, replace

import numpy as np
import pytest

import flexmbd as fm
from flexmbd.errors import PictureError, SceneError
from flexmbd.record.reduced_body import InterfaceFrame, Surface
from flexmbd.record.stress_field import StressField
from flexmbd.visual import camera, film, plot_stress, scales, sketch
from flexmbd.visual.drawn_scene import drawn_scene
from flexmbd.visual.palette import GROUND
from flexmbd.visual.part import placed
from flexmbd.visual.skin import DisplacementSkin, _rigid_motion, skins

SMALL = {"size": (160, 120), "fps": 10}


@dataclass
class Team:
    """A team of which this process is the root or not, which remembers the errors it was told."""

    is_root: bool
    size: int = 2
    told: list = field(default_factory=list)

    def agree(self, x):
        return x

    def fail(self, error):
        self.told.append(error)
        if error is not None:
            raise error


def slider_crank():
    scene = fm.System(gravity=(0.0, -9.81, 0.0))
    crank = scene.add(fm.RigidBody(0.4, (1e-4, 4e-4, 4e-4), (0.03, 0.0, 0.0)), name="crank")
    rod = scene.add(fm.RigidBody(0.6, (1e-4, 4e-3, 4e-3), (0.12, 0.0, 0.0)), name="rod")
    piston = scene.add(fm.RigidBody(0.3, (1e-4, 1e-4, 1e-4)), name="piston")
    turn = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), crank.frame())
    scene.connect(fm.joint.Revolute("z"), crank.frame((0.08, 0.0, 0.0)), rod.frame())
    scene.connect(fm.joint.Revolute("z"), rod.frame((0.3, 0.0, 0.0)), piston.frame())
    scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(), piston.frame())
    turn.velocity = 50.0
    return scene


@pytest.fixture(scope="module")
def machine():
    return slider_crank().simulate(0.1, rtol=1e-5)


def bar_record():
    """A bar of 12 triangles along x, eight masses at its corners, one mode that bends it."""
    x = np.array([[i, j, k] for i in (0.0, 1.0) for j in (-0.1, 0.1) for k in (-0.1, 0.1)])
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    triangle = np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])
    phi = np.zeros((8, 3, 1))
    phi[4:, 2, 0] = np.sqrt(2.0)  # of modal mass 1
    fields = np.vstack([np.ones(8), x.T, phi.reshape(8, 3).T])
    return fm.ReducedBody(
        gram=fields @ fields.T / 8.0,
        stiffness=np.array([400.0]),
        damping=np.zeros((1, 1)),
        interfaces=(InterfaceFrame("root", np.zeros(3), np.eye(3), np.zeros((6, 1))),),
        frame="root",
        partition=np.eye(1),
        partition_names=("bending",),
        surface=Surface(x, triangle, phi),
    )


@pytest.fixture(scope="module")
def bar():
    """A flexible body with a surface on a hinge."""
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    body = scene.add(fm.FlexibleBody(bar_record()), name="bar")
    scene.connect(fm.joint.Revolute("y"), scene.ground.frame(), body.frame("root"))
    return scene.simulate(0.3, rtol=1e-4), body


def film_pictures(path):
    imageio = pytest.importorskip("imageio.v2")
    with imageio.get_reader(path) as reader:
        return [np.asarray(picture)[..., :3].astype(int) for picture in reader]


@pytest.mark.parametrize("suffix", [".mp4", ".gif"])
def test_film_moves(machine, tmp_path, suffix):
    path = machine.animate(tmp_path / f"crank{suffix}", slow_motion=10.0, **SMALL)
    pictures = film_pictures(path)
    assert len(pictures) == 11
    assert pictures[0].shape == (120, 160, 3)
    assert np.abs(pictures[0] - pictures[5]).max() > 100
    # the background is white, and something is drawn on it
    assert 0.5 < (pictures[0].min(axis=2) > 240).mean() < 0.99
    assert [p.name for p in tmp_path.iterdir()] == [path.name]


def test_what_nowhere_deforms_has_no_scale_of_deformation(bar):
    run, _ = bar
    assert machine_parts(run, run.t[:1]).quantities == ()
    assert machine_parts(run, run.t).quantities == (("displacement", "m"),)


def test_film_of_a_surface(bar, tmp_path):
    run, _ = bar
    path = run.animate(tmp_path / "bar.gif", slow_motion=2.0, amplification=3.0, **SMALL)
    assert len(film_pictures(path)) == 7


def test_short_motions_are_slowed_and_long_ones_are_not(machine):
    times, slowness = film._times(machine, None, None, 30)
    assert len(times) == 241
    assert slowness == pytest.approx(80.0)
    times, slowness = film._times(machine, (0.02, 0.03), 100.0, 30)
    assert (times[0], times[-1], len(times)) == (0.02, 0.03, 31)
    assert film._notes(times, 100.0, 5.0)[1] == "t = 20.3 ms    slowed 100 times    deformation × 5"
    assert film._notes(np.array([0.0, 0.5, 5.0]), 1.0, 1.0)[1] == "t = 0.5 s"


@pytest.mark.parametrize(
    ("name", "choices", "message"),
    [
        ("film.avi", {}, r"\.gif or \.mp4"),
        ("film", {}, r"\.gif or \.mp4"),
        ("film.gif", {"fps": 0}, "fps"),
        ("film.gif", {"slow_motion": -1.0}, "slow_motion"),
        ("film.gif", {"size": (161, 120)}, "even"),
        ("film.gif", {"between": (0.05, 0.05)}, "nothing"),
        ("film.gif", {"amplification": float("nan")}, "amplification"),
        ("nowhere/film.gif", {}, "nowhere"),
    ],
)
def test_bad_films_are_refused(machine, tmp_path, name, choices, message):
    with pytest.raises(PictureError, match=message):
        machine.animate(tmp_path / name, **choices)
    assert not list(tmp_path.iterdir())


def test_film_outside_the_trajectory(machine, tmp_path):
    with pytest.raises(SceneError, match="outside"):
        machine.animate(tmp_path / "film.gif", between=(0.0, 1.0))


def test_old_file_survives_a_failure(machine, tmp_path, monkeypatch):
    old = tmp_path / "film.gif"
    old.write_text("old")

    def full(*_, **__):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(film, "_write_film", full)
    with pytest.raises(PictureError, match="No space left"):
        machine.animate(old, **SMALL)
    assert old.read_text() == "old"
    assert list(tmp_path.iterdir()) == [old]


def test_only_the_root_writes(machine, tmp_path):
    other = Team(is_root=False)
    run = replace(machine, team=other)
    run.animate(tmp_path / "film.gif", **SMALL)
    run.plot(path=tmp_path / "plot.png")
    run.show(path=tmp_path / "machine.png", size=(160, 120))
    assert not list(tmp_path.iterdir())
    assert other.told == []  # nothing waits for other ranks: the root may call alone
    for team in (other, Team(is_root=True)):
        with pytest.raises(PictureError, match="nowhere"):
            replace(machine, team=team).plot(path=tmp_path / "nowhere" / "plot.png")


def test_plot_of_series(machine, tmp_path):
    piston = machine.bodies["piston"].frame()
    figure = machine.plot(
        ("piston", machine.position(piston)), ("crank", machine.t), path=tmp_path / "a.png", ylabel="m"
    )
    axes = figure.axes[0]
    assert [line.get_label() for line in axes.lines] == ["piston x", "piston y", "piston z", "crank"]
    assert axes.get_ylabel() == "m"
    assert (tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")
    np.testing.assert_array_equal(axes.lines[0].get_ydata(), machine.position(piston)[:, 0])


def test_plot_of_energies(machine, tmp_path):
    figure = machine.plot(path=tmp_path / "energy.svg")
    # rigid: nothing elastic to show
    assert [line.get_label() for line in figure.axes[0].lines] == ["kinetic", "gravitational", "total"]


@pytest.fixture(scope="module")
def swing():
    """A pendulum of 1 m with a wall below its hinge, few long steps; angle from the vertical."""
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    bob = scene.add(fm.RigidBody(1.0, (1e-9, 1e-9, 1e-9), (0.0, 0.0, -1.0)), name="bob")
    hinge = scene.connect(fm.joint.Revolute("y"), scene.ground.frame(), bob.frame())
    hinge.position = 0.02
    wall = fm.Event(
        lambda m: m.beta(hinge), action=lambda m: m.set_rate(hinge, -0.5 * m.beta_rate(hinge)), name="wall"
    )
    return scene.simulate(2.0, rtol=1e-5, events=[wall], integrator=fm.RadauIIA()), bob, hinge


def test_curves_are_drawn_between_the_steps(swing, tmp_path):
    """By closed form, cos and its halves: a straight line between the steps would be far off."""
    run, bob, hinge = swing
    figure = run.plot(
        ("angle", hinge), ("bob", bob.frame((0.0, 0.0, -1.0))), ("rate", lambda t: run.beta_rate(hinge, t=t)),
        ("twice", lambda t: 2.0 * np.stack([t, t], axis=1)), path=tmp_path / "a.png",
    )  # fmt: skip
    lines = {line.get_label(): line for axes in figure.axes for line in axes.lines}
    omega = np.sqrt(9.81)
    quarter, half = 0.5 * np.pi / omega, np.pi / omega
    t, angle = lines["angle"].get_data()
    assert len(run.t) < 60 < 1000 < len(t)
    size = np.array([1.0, 0.5, 0.25, 0.125])[np.floor((t + quarter) / half).astype(int)]
    exact = 0.02 * size * np.abs(np.cos(omega * t))
    np.testing.assert_allclose(angle, exact, atol=2e-5)  # of the period's growth with the amplitude
    assert np.abs(np.interp(t, run.t, run.beta(hinge)) - exact).max() > 3e-4
    np.testing.assert_array_equal(angle, run.beta(hinge, t=t))
    np.testing.assert_allclose(lines["bob x"].get_ydata(), -np.sin(angle), atol=1e-12)
    np.testing.assert_array_equal(lines["twice [1]"].get_ydata(), 2.0 * t)


def test_events_are_marked(swing, tmp_path):
    """And a rate that jumps there is drawn with both its values."""
    run, _, hinge = swing
    figure = run.plot(("rate", lambda t: run.beta_rate(hinge, t=t)), path=tmp_path / "a.png")
    rate, *marks = figure.axes[0].lines
    assert [line.get_xdata()[0] for line in marks] == [e.t for e in run.events]
    assert len(marks) == 2
    assert [text.get_text() for text in figure.axes[0].get_legend().get_texts()] == ["rate", "wall"]
    for event in run.events:
        found = np.abs(rate.get_xdata() - event.t) < 1e-12
        before, after = rate.get_ydata()[found]
        assert after == pytest.approx(-0.5 * before, rel=1e-9)


def test_energies_are_drawn_between_the_steps(swing, tmp_path):
    run, _, _ = swing
    figure = run.plot(path=tmp_path / "a.png")
    t, kinetic = figure.axes[0].lines[0].get_data()
    assert len(t) > 1000
    np.testing.assert_allclose(kinetic, run.energy(t=t).kinetic)
    np.testing.assert_allclose(kinetic, 0.5 * run.beta_rate(swing[2], t=t) ** 2, rtol=1e-6)
    np.testing.assert_allclose(run.energy(t=run.t[1:3]).total, run.energy().total[1:3], rtol=1e-12)


def test_bad_plots_are_refused(machine, tmp_path):
    with pytest.raises(PictureError, match=r"'short' has shape \(3,\)"):
        machine.plot(("short", np.zeros(3)))
    with pytest.raises(PictureError, match=r"'short' has shape \(3,\).*times it was asked at"):
        machine.plot(("short", lambda t: np.zeros(3)))
    with pytest.raises(PictureError, match=r"\.pdf or \.png or \.svg"):
        machine.plot(path=tmp_path / "plot.jpeg")
    assert not list(tmp_path.iterdir())


def machine_parts(run, times, **how):
    return drawn_scene(run, times, notes=[""] * len(times), **how)


def test_symbols_are_where_the_bodies_are(machine):
    times = 0.025 * np.arange(5.0)
    drawn = machine_parts(machine, times)
    crank, rod, piston = (machine.bodies[name] for name in ("crank", "rod", "piston"))
    units = {"cylinder": sketch.unit_cylinder(), "ball": sketch.small_ball(), "box": sketch.unit_box()}
    parts = {
        (name, part.label): part for part in drawn.parts for name, (x, _) in units.items() if part.x is x
    }
    stick = parts["cylinder", "rod"]
    assert stick.colour == drawn.legend["rod"]
    ends = np.einsum("kij,jn->kni", stick.pose, np.array([[0, 0], [0, 0], [0, 1], [1, 1.0]]))[:, :, :3]
    np.testing.assert_allclose(ends[:, 0], machine.position(crank.frame((0.08, 0, 0)), t=times), atol=1e-12)
    np.testing.assert_allclose(ends[:, 1], machine.position(rod.frame((0.3, 0, 0)), t=times), atol=1e-12)
    block = parts["box", "piston"]
    np.testing.assert_allclose(block.pose[:, :3, 3], machine.position(piston.frame(), t=times), atol=1e-12)
    ball = parts["ball", "crank"]
    np.testing.assert_allclose(
        ball.pose[:, :3, 3], machine.position(crank.frame((0.03, 0, 0)), t=times), atol=1e-12
    )
    # the bearing and the rail
    assert [part.colour for part in drawn.parts].count(GROUND) == 2


def test_cylinder_runs_between_its_ends():
    rng = np.random.default_rng(1)
    a, b = rng.standard_normal((2, 6, 3))
    stick = sketch.cylinder(a, b, 0.1, "#000000", "stick")
    np.testing.assert_allclose(stick.pose[:, :3, 3], a)
    np.testing.assert_allclose(stick.pose[:, :3, 2], b - a)
    across = stick.pose[:, :3, :2]
    square = across.transpose(0, 2, 1) @ across
    np.testing.assert_allclose(square, [0.01 * np.eye(2)] * 6, atol=1e-15)
    assert (np.linalg.det(stick.pose[:, :3, :3]) > 0.0).all()


def test_positions_at_chosen_times_lie_on_the_trajectory(machine):
    frame = machine.bodies["piston"].frame()
    np.testing.assert_allclose(machine.position(frame, t=machine.t), machine.position(frame), atol=1e-14)
    np.testing.assert_allclose(machine.rotation(frame, t=machine.t[:3]), machine.rotation(frame)[:3], atol=1e-14)


def test_skin_shows_the_modes(bar):
    run, body = bar
    times = np.array([0.1, 0.2])
    (skin,) = skins(run, times, {}, amplification=3.0)
    assert isinstance(skin, DisplacementSkin)
    places, value = skin.at(1)
    u = body.record.surface.phi @ run.q(body, t=0.2)
    np.testing.assert_allclose(places, body.record.surface.x + 3.0 * u, atol=1e-15)
    np.testing.assert_allclose(value, np.linalg.norm(u, axis=1))
    assert skin.largest == max(skin.at(k)[1].max() for k in (0, 1))
    np.testing.assert_array_equal(
        skin.bounds[1], np.maximum(*(skin.at(k)[0].max(axis=0) for k in (0, 1)))
    )


def test_amplification_keeps_bodies_on_their_interfaces():
    """A field that is rigid at the interfaces but bends between them."""
    chord = np.array([0.1, 0.02, -0.3])
    tip = np.zeros((6, 1))
    tip[:3, 0] = np.cross((0.0, 0.1, 0.2), chord)
    record = replace(
        bar_record(),
        interfaces=(*bar_record().interfaces, InterfaceFrame("tip", chord, np.eye(3), tip)),
    )
    rigid = _rigid_motion(record, np.array([[0.0, 0.0, 0.0], chord, 0.5 * chord]))
    np.testing.assert_allclose(rigid[:, :, 0], np.outer((0.0, 1.0, 0.5), tip[:3, 0]), atol=1e-12)


def rubber(solid, **how):
    """A body on a ball joint at a corner, stretched and let go."""
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    body = scene.add(fm.PseudoRigidBody(solid, fm.StVenantKirchhoff(2e4, 0.3), **how), name="rubber")
    scene.connect(fm.joint.Spherical(), scene.ground.frame(), body.frame((0.3, 0.1, 0.2)))
    return scene.simulate(0.2, rtol=1e-5), body


def prism():
    """A box given by its surface, which lies beside the origin of its axes."""
    outline = fm.Solid.box((0.6, 0.2, 0.4), density=1.0).outline
    return fm.Solid.from_surface(outline.x + np.array([0.1, 0.0, -0.3]), outline.triangles, density=1000.0)


@pytest.mark.parametrize(
    "solid",
    [fm.Solid.box((0.6, 0.2, 0.4), density=1e3), fm.Solid.ellipsoid((0.6, 0.2, 0.4), density=1e3), prism()],
    ids=["box", "ellipsoid", "mesh"],
)
def test_a_pseudo_rigid_body_is_drawn_as_it_deforms(solid):
    """Each vertex is where the machine has its material point; the volume is that of det F."""
    run, body = rubber(solid, stretch=np.diag([1.3, 0.8, 1.0]))
    times = np.array([0.0, 0.1, 0.2])
    (skin,) = skins(run, times, {}, amplification=1.0)
    F = run.deformation_gradient(body, t=times)
    assert np.linalg.norm(F[2] - np.eye(3)) > 0.05
    a, b, c = np.moveaxis(skin.triangle, 1, 0)
    for k, t in enumerate(times):
        drawn = placed(skin, k)[0]
        for vertex in (0, 5, len(skin.x) - 1):
            assert drawn[vertex] == pytest.approx(run.position(body.frame(skin.x[vertex]), t=[t])[0], abs=1e-12)
        volumes = [np.einsum("ti,ti->", x[a], np.cross(x[b], x[c])) for x in (drawn, skin.x)]
        assert volumes[0] / volumes[1] == pytest.approx(np.linalg.det(F[k]), rel=1e-11)


def test_a_stretch_is_amplified_and_a_held_one_is_not_there():
    run, body = rubber(prism(), stretch=np.diag([1.1, 0.9, 1.0]))
    (skin,) = skins(run, np.array([0.0]), {}, amplification=2.0)
    arm = skin.x - body.solid.com
    np.testing.assert_allclose(skin.at(0)[0] - body.solid.com, arm * [1.2, 0.8, 1.0], atol=1e-14)
    np.testing.assert_allclose(skin.at(0)[1], np.linalg.norm(arm * [0.1, -0.1, 0.0], axis=1), atol=1e-14)
    run, body = rubber(prism(), rigid=True)
    (skin,) = skins(run, np.array([0.0, 0.2]), {}, amplification=2.0)
    np.testing.assert_array_equal(skin.at(1)[0], body.solid.outline.x)
    assert skin.largest == 0.0


def test_film_of_a_pseudo_rigid_body(tmp_path):
    """It fills much of the picture, which sticks would not."""
    for how in ({"stretch": np.diag([1.3, 0.8, 1.0])}, {"rigid": True}):
        run, _ = rubber(fm.Solid.box((0.6, 0.2, 0.4), density=1e3), **how)
        pictures = film_pictures(run.animate(tmp_path / "rubber.gif", slow_motion=2.0, **SMALL))
        assert len(pictures) == 5
        assert min((p.min(axis=2) < 240).mean() for p in pictures) > 0.1
        assert np.abs(pictures[0] - pictures[4]).max() > 100


def test_a_solid_without_a_surface_is_drawn_as_sticks():
    box = fm.Solid.box((0.6, 0.2, 0.4), density=1e3)
    run, _ = rubber(fm.Solid(box.mass, box.volume, box.com, box.second))
    assert skins(run, np.array([0.0]), {}, amplification=1.0) == []


class Model:
    """Stress as a continuum model gives it: also at nodes inside, here one."""

    def stress_field(self, body, q):
        surface = body.surface
        x = np.vstack([[0.5, 0.0, 0.0], surface.x])
        u = np.vstack([np.zeros(3), surface.phi @ q])
        von_mises = np.append(1e9, 1e6 * (1.0 + np.arange(8.0)) * abs(q[0]))
        return StressField(
            np.arange(9), x, surface.triangle + 1, u, np.zeros((9, 3, 3)), von_mises, 1e9, x[0]
        )


def test_film_coloured_by_stress(bar, tmp_path):
    run, body = bar
    times = np.array([0.1, 0.2])
    (skin,) = skins(run, times, {body: Model()}, amplification=3.0)
    places, value = skin.at(1)
    q = run.q(body, t=0.2)
    np.testing.assert_allclose(value, 1e6 * (1.0 + np.arange(8)) * abs(q[0]), rtol=1e-6)
    surface = body.record.surface
    np.testing.assert_allclose(places, surface.x + 3.0 * surface.phi @ q, rtol=1e-6, atol=1e-7)
    np.testing.assert_array_equal(skin.triangle, body.record.surface.triangle)
    path = run.animate(tmp_path / "a.gif", models={body: Model()}, slow_motion=1.0, **SMALL)
    assert len(film_pictures(path)) == 4


def test_plot_of_a_stress_picture(tmp_path):
    picture = Model().stress_field(bar_record(), np.array([0.1]))
    path = plot_stress(picture, tmp_path / "stress.png", amplification=2.0, size=(160, 120), title="bar")
    assert path.read_bytes().startswith(b"\x89PNG")
    with pytest.raises(PictureError, match=r"\.png"):
        plot_stress(picture, tmp_path / "stress.pdf")
    with pytest.raises(PictureError, match="nowhere"):
        plot_stress(picture, tmp_path / "nowhere" / "stress.png")
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(
    ("flat", "gravity", "towards", "up"),
    [
        (2, (0, 0, 0), (0, 0, 1), (0, 1, 0)),
        (2, (0, -9.81, 0), (0, 0, 1), (0, 1, 0)),
        (1, (0, 0, -9.81), (0, -1, 0), (0, 0, 1)),
        (0, (0, 0, -9.81), (1, 0, 0), (0, 0, 1)),
        (2, (-9.81, 0, 0), (0, 0, 1), (1, 0, 0)),
        (2, (0, 0, -9.81), (0, 0, 1), (0, 1, 0)),
    ],
)
def test_plane_motions_are_seen_along_their_normal(flat, gravity, towards, up):
    places = np.random.default_rng(2).standard_normal((20, 3))
    places[:, flat] = 0.001
    seen = camera.viewing_axes(places, gravity)
    np.testing.assert_allclose(seen[0], towards)
    np.testing.assert_allclose(seen[1], up)


def test_motion_along_a_line_is_not_seen_along_gravity():
    places = np.outer(np.arange(4.0), (1.0, 0.0, 0.0))
    towards, up = camera.viewing_axes(places, (0.0, 0.0, -9.81))
    np.testing.assert_allclose(towards, (0, -1, 0))
    np.testing.assert_allclose(up, (0, 0, 1))


@pytest.mark.parametrize("gravity", [(0, 0, 0), (0, 0, -9.81), (0, -9.81, 0), (9.81, 0, 0)])
def test_camera_sees_everything(gravity):
    points = np.random.default_rng(3).standard_normal((50, 3)) * (1.0, 2.0, 0.7)
    towards, up = camera.viewing_axes(points, gravity)
    assert up @ towards == pytest.approx(0.0, abs=1e-12)
    assert up @ np.array(gravity) <= 0.0
    seen = camera.frame_all(points, towards, up, aspect=1.5, above=0.1, below=0.2)
    height = (points - seen.focus) @ up / seen.half_height
    width = (points - seen.focus) @ np.cross(up, towards) / seen.half_height
    depth = (points - seen.focus) @ towards
    assert -0.6 - 1e-9 <= height.min()
    assert height.max() <= 0.8 + 1e-9
    assert np.abs(width).max() <= 1.5
    assert np.abs(depth).max() < seen.distance


@pytest.mark.parametrize(
    ("largest", "unit", "name"), [(3.1e8, "Pa", "MPa"), (2e-3, "m", "mm"), (0.0, "m", "m"), (12.0, "s", "s")]
)
def test_units_that_read_well(largest, unit, name):
    scale, readable = scales.readable(largest, unit)
    assert readable == name
    assert largest == 0.0 or 1.0 <= largest / scale < 1000.0


def test_pictures_load_their_libraries_only_when_asked():
    code = (
        "import sys, flexmbd.visual; "
        "loaded = {'pyvista', 'vtk', 'matplotlib', 'imageio', 'tqdm'} & set(sys.modules); "
        "assert not loaded, loaded"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
