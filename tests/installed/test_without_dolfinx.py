"""An installed flexmbd without DOLFINx and pictures: what runs, and what says in one line what is missing.

`tools/try_wheel.py` runs it in a plain virtual environment that holds the wheel, numpy, scipy, numba, h5py and pytest.
It imports nothing of the other tests; where DOLFINx is installed it is skipped.
"""

from __future__ import annotations

import importlib
import importlib.util
import subprocess
import sys
from dataclasses import dataclass

import numpy as np
import pytest
from scipy.special import ellipk

import flexmbd as fm
from flexmbd.command.subcommands import SUBCOMMANDS

if importlib.util.find_spec("dolfinx") is not None:
    pytest.skip("tools/try_wheel.py runs these where DOLFINx is not", allow_module_level=True)

CONTINUUM = {"continuum", "forms", "meshes", "reduction"}
SCENE = """\
gravity = [0, 0, -9.81]

[[body]]
name = "rod"
record = "rod.h5"

[[joint]]
name = "hinge"
kind = "revolute"
axis = "y"
child = "rod:root"

[simulate]
t_end = 0.05
rtol = 1e-4

[output]
every = 0.01
positions = ["rod:tip"]
"""


@dataclass(frozen=True)
class RoundSteel:
    """A section for `fm.beams`, whose usual ones are forms' and need UFL."""

    E: float = 2.1e11
    nu: float = 0.3
    rho: float = 7850.0
    A: float = np.pi * 4e-3**2
    Iy: float = np.pi * 4e-3**4 / 4
    Iz: float = np.pi * 4e-3**4 / 4
    Iyz: float = 0.0
    J: float = np.pi * 4e-3**4 / 2
    ky: float = 0.9
    kz: float = 0.9
    orientation: tuple[float, float, float] = (0.0, 1.0, 0.0)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Files for the commands: a record, a scene, a form, a STEP file that is none."""
    place = tmp_path_factory.mktemp("files")
    points = {"root": (0.0, 0.0, 0.0), "tip": (0.5, 0.0, 0.0)}
    frame = fm.beams.DiscreteFrame(points, {"rod": [("root", "tip")]}, {"rod": RoundSteel()}, divisions=10)
    rod = fm.beams.discrete_body(frame, interfaces=["root", "tip"], frame="root", modes=4)
    rod.save(place / "rod.h5")
    (place / "swing.toml").write_text(SCENE)
    (place / "my_form.py").write_text("import ufl\n")
    (place / "part.step").write_text("ISO-10303-21;\n")
    (place / "steel.toml").write_text('form = "solid_linear"\n[parameters]\nE = 2.1e11\nnu = 0.3\nrho = 7850.0\n')
    return place


def test_a_pendulum_swings_to_the_other_side():
    """From 120 degrees it hangs after a quarter of its period, sqrt(l/g) K(sin^2(60 degrees))."""
    scene = fm.System(gravity=(0.0, -9.81, 0.0))
    bob = scene.add(fm.RigidBody(2.0, (1e-9, 1e-9, 1e-9), com=(0.0, -1.0, 0.0)), name="bob")
    hinge = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), bob.frame())
    hinge.position = np.radians(120.0)
    quarter = np.sqrt(1.0 / 9.81) * ellipk(np.sin(np.radians(60.0)) ** 2)
    run = scene.simulate(quarter, rtol=1e-8)
    assert run.beta(hinge)[-1] == pytest.approx(0.0, abs=1e-6)


def test_a_flexible_rod_keeps_its_energy(folder):
    record = fm.ReducedBody.load(folder / "rod.h5")
    slender = 1.875104**2 / (2 * np.pi * 0.5**2) * np.sqrt(2.1e11 * 4e-3**2 / 4 / 7850.0)  # Euler and Bernoulli
    assert record.frequencies(clamped=["root"])[0] == pytest.approx(slender, rel=0.02)
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    rod = scene.add(fm.FlexibleBody(record), name="rod")
    scene.connect(fm.joint.Revolute("y"), scene.ground.frame(), rod.frame("root"))
    energy = scene.simulate(0.2, rtol=1e-7, integrator=fm.ExplicitRungeKutta()).energy()
    assert np.ptp(energy.total) < 1e-5 * np.ptp(energy.kinetic)


@pytest.mark.parametrize("method", [fm.GeneralizedAlpha, fm.RadauIIA, fm.EnergyMomentum, fm.CentralDifference])
def test_integrators_agree_on_a_loop(method):
    """A four-bar that a motor turns, with explicit pairs as the reference."""

    def end(integrator):
        scene = fm.System(gravity=(0.0, 0.0, -9.81))
        left, top, right = (scene.add(fm.RigidBody(1.0, (0.01, 0.01, 0.01)), name=name) for name in "abc")
        crank = scene.connect(fm.joint.Revolute("y"), scene.ground.frame(), left.frame())
        pin = scene.connect(fm.joint.Revolute("y"), left.frame(p=(0.0, 0.0, 1.0)), top.frame())
        scene.connect(fm.joint.Revolute("y"), top.frame(p=(2.0, 0.0, 0.0)), right.frame())
        scene.connect(fm.joint.Revolute("y"), scene.ground.frame(p=(2.0, 0.0, 0.0)), right.frame(p=(0.0, 0.0, -1.0)))
        crank.position, pin.position = 0.3, -0.3
        crank.velocity, pin.velocity = 2.0, -2.0
        return scene.simulate(0.5, rtol=1e-6, integrator=integrator).position(top.frame())[-1]

    np.testing.assert_allclose(end(method()), end(fm.ExplicitRungeKutta()), atol=1e-3)


def one_line(text, *words):
    """A message for a user: one line, which names what is missing and where it comes from."""
    assert len(text.strip().splitlines()) == 1, text
    assert "Traceback" not in text
    assert all(word in text for word in words), text


@pytest.mark.parametrize("room", sorted(fm._ROOMS))
def test_every_room_is_there_or_says_what_is_missing(room):
    if room not in CONTINUUM:
        for name in dir(importlib.import_module(f"flexmbd.{room}")):
            getattr(importlib.import_module(f"flexmbd.{room}"), name)
        return
    with pytest.raises(fm.MissingLibraryError) as raised:
        importlib.import_module(f"flexmbd.{room}")
    one_line(str(raised.value), f"flexmbd.{room}", "ufl", "./run", "conda")
    with pytest.raises(ImportError):  # as whoever asks whether there is a continuum expects
        getattr(fm, room)


def test_every_name_of_the_root_is_there():
    missing = [name for name in dir(fm) if name not in CONTINUUM and getattr(fm, name) is None]
    assert missing == []
    assert len(dir(fm)) > 60


def test_pictures_and_bars_say_what_is_missing(folder, tmp_path):
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    body = scene.add(fm.RigidBody(1.0, (1.0, 1.0, 1.0), com=(0.5, 0.0, 0.0)))
    scene.connect(fm.joint.Revolute("y"), scene.ground.frame(), body.frame())
    run = scene.simulate(0.1)
    for asked, library in (
        (lambda: run.plot(path=tmp_path / "angle.png"), "matplotlib"),
        (lambda: run.animate(tmp_path / "film.mp4"), "pip install 'flexmbd[pictures]'"),
        (lambda: run.table().to_pandas(), "pip install pandas"),
        (lambda: scene.simulate(0.1, progress=True), "tqdm"),
    ):
        with pytest.raises(fm.FlexmbdError) as raised:
            asked()
        one_line(str(raised.value), library)


#: What each command is given, its exit code, and words of its answer; commands that are not here show their help.
COMMANDS = {
    "check": (["my_form.py"], 2, ["dolfinx"]),
    "reduce": (["part.step", "--list"], 2, ["dolfinx"]),
    "inspect": (["rod.h5"], 0, ["root", "tip"]),
    "export": (["rod.h5", "--to", "mbdyn"], 0, []),
    "convert": (["rod.h5", "other.npz", "--to", "exudyn", "--lossy"], 0, []),
    "simulate": (["swing.toml", "--quiet"], 0, []),
    "plot": (["swing_results/results.csv", "-o", "tip.png"], 2, ["matplotlib"]),
    "doctor": ([], 0, ["dolfinx", "not installed"]),
}


def test_every_command_runs_or_says_what_is_missing(folder):
    """In their order, since `plot` draws what `simulate` wrote."""
    for one in SUBCOMMANDS:
        words, code, said = COMMANDS.get(one.name, (["--help"], 0, [one.name]))
        done = subprocess.run(
            [sys.executable, "-m", "flexmbd", one.name, *words], capture_output=True, text=True, cwd=folder, check=False
        )
        assert done.returncode == code, (one.name, done.stdout, done.stderr)
        text = done.stdout + done.stderr
        assert all(word in text for word in said), (one.name, text)
        if code == 2:
            one_line(text)
    assert (folder / "swing_results" / "results.csv").exists()
