"""The code in the documents on the machine runs as it stands, block after block of a page, and does what it says."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

DOCS = Path(__file__).parents[2] / "docs"
PAGES = (
    "simulation", "machine", "joints", "forces", "contact", "integrators", "bodies_with_history", "linearized",
)  # fmt: skip


def blocks(page):
    """The python blocks of a page, each padded so that an error tells the page's own line."""
    text = (DOCS / f"{page}.md").read_text(encoding="utf-8")
    found = re.finditer(r"^```python\n(.*?)^```$", text, re.DOTALL | re.MULTILINE)
    return ["\n" * (text[: m.start(1)].count("\n")) + m.group(1) for m in found]


def run(page, folder, monkeypatch, **names):
    """The names that the page's blocks leave."""
    monkeypatch.chdir(folder)
    for block in blocks(page):
        exec(compile(block, str(DOCS / f"{page}.md"), "exec"), names)
    return names


@pytest.mark.parametrize("page", PAGES)
def test_all_code_is_in_blocks_that_are_run(page):
    """No code hides in an indented paragraph, where nothing would run it."""
    text = (DOCS / f"{page}.md").read_text(encoding="utf-8")
    prose = re.sub(r"^```.*?^```$", "", text, flags=re.DOTALL | re.MULTILINE)
    indented = [line for line in prose.splitlines() if re.match(r"    .*(?:\w\(.*\)|^    \w+ = )", line)]
    assert indented == []
    assert len(re.findall(r"^```(?!python$)\w+$", text, re.MULTILINE)) == 0
    assert blocks(page)


def test_simulation(tmp_path, monkeypatch):
    """A ball that falls 0.9 m and keeps 0.8 of its speed."""
    found = run("simulation", tmp_path, monkeypatch)
    first = np.sqrt(2.0 * 0.9 / 9.81)
    gaps = 2.0 * first * 0.8 ** np.arange(1, 3)
    assert [name for name, _ in found["impacts"]] == ["ground"] * 3
    np.testing.assert_allclose([t for _, t in found["impacts"]], first + np.cumsum([0.0, *gaps]), rtol=1e-6)
    np.testing.assert_array_equal(found["rest"].x[-1], found["whole"].x[-1])
    assert (tmp_path / "drop.png").exists()


def test_contact(tmp_path, monkeypatch):
    """A billiard ball rolls with 5/7 of the speed with which it began to slide."""
    found = run("contact", tmp_path, monkeypatch)
    velocity = found["run"].velocity(found["ball"].frame())
    assert velocity[-1, 0] == pytest.approx(2.0 * 5.0 / 7.0, rel=1e-5)
    assert found["met"].normal_force[-1] == pytest.approx(0.17 * 9.81, rel=1e-2)
    assert found["hit"].normal_force[-1] == pytest.approx(0.17 * 9.81, rel=1e-9)
    assert found["hit"].normal_work[-1] == pytest.approx(-0.17 * 9.81 * 0.5, rel=1e-3)


def test_bodies_with_history(tmp_path, monkeypatch):
    """A mass let go below a hook: it pulls by m g (1 - cos w t), and its energy is kept; a ball dents a slab."""
    found = run("bodies_with_history", tmp_path, monkeypatch)
    t, rate = found["run"].t, np.sqrt(800.0 / 2.0)
    want = 0.5 * 9.81 + 2.0 * 9.81 * (1.0 - np.cos(rate * t))
    np.testing.assert_allclose(found["pull"], want, atol=2.0 * 9.81 * 20.0 / 24.0 * 0.02**2 * 2.0)
    assert np.ptp(sum(found["spent"].values())) < 1e-3
    pushed = found["hit"].outer_forces(found["slab"])["ball"]
    momentum = 0.5 * (found["hit"].velocity(found["ball"].frame())[[0, -1]] + [[0, 0, 0], [0, 0, 9.81 * 0.01]])
    assert np.trapezoid(pushed, found["hit"].t, axis=0) == pytest.approx(momentum[0] - momentum[1], abs=1e-9)
    assert found["hit"].energies(found["slab"])["plastic"][-1] > 0.1


def test_machine(tmp_path, monkeypatch):
    """A rod on a hinge, 0.144 kg m^2 about it, horizontal."""
    found = run("machine", tmp_path, monkeypatch)
    inertia = 0.036 + 1.2 * 0.3**2
    assert found["a"] == pytest.approx([-1.2 * 9.81 * 0.3 / inertia])
    assert found["inverse"][0, 0] == pytest.approx(1.0 / inertia)
    assert found["matrix"][0, 0] == pytest.approx(100.0 * inertia)  # no torque changes with a level rod's angle


def test_joints(tmp_path, monkeypatch):
    """Wheel and bar fall as one: the bar's weight at 0.1 m, on 0.02 kg m^2 and the bar's own."""
    found = run("joints", tmp_path, monkeypatch)
    turned = found["turned"]
    np.testing.assert_allclose(turned.beta(found["pin"]), 0.2 * turned.t**2, atol=1e-9)
    motion = found["run"]
    rate = 3.0 - 0.5 * 9.81 * 0.1 / (0.02 + 0.5 * 0.1**2) * motion.t
    np.testing.assert_allclose(motion.beta_rate(found["axle"]), rate, rtol=1e-7)
    np.testing.assert_allclose(motion.beta_rate(found["guide"]), 0.1 * rate, rtol=1e-7)
    assert found["bearing"].shape == (len(motion.t), 3)


def test_forces(tmp_path, monkeypatch):
    """At the start, at rest: the spring gives 25 * 0.1, the governor 2 * 30."""
    found = run("forces", tmp_path, monkeypatch)
    assert found["sum_of_all"] == pytest.approx([-62.5], rel=1e-12)
    # and with the water's 2 kg at 0.3 m the rod falls from the horizontal at
    assert found["fall"].a[0] == pytest.approx([-1.2 * 9.81 * 0.3 / (0.04 + 1.2 * 0.3**2 + 2.0 * 0.3**2)], rel=1e-9)


def test_linearized(tmp_path, monkeypatch):
    """A crane: a trolley of 50 kg, a load of 20 kg 3 m below it, its hoist's spring beside."""
    found = run("linearized", tmp_path, monkeypatch)
    stretch = 20.0 * 9.81 / 8e4
    assert found["eq"].beta(found["hoist"]) == pytest.approx(-stretch, rel=1e-9)
    length = 3.0 + stretch
    swing = np.sqrt(9.81 / length * (1.0 + 20.0 / 50.0)) / (2.0 * np.pi)
    bounce = np.sqrt(8e4 / 20.0) / (2.0 * np.pi)
    np.testing.assert_allclose(found["lin"].frequencies(), [swing, bounce], rtol=1e-6)
    assert found["damping"][1] == pytest.approx(100.0 / (2.0 * np.sqrt(8e4 * 20.0)), rel=1e-6)
    # far above the swing's frequency the load stays where it is, and the trolley moves alone
    np.testing.assert_allclose(found["far"], -1.0 / (50.0 * (2.0 * np.pi * 300.0) ** 2), rtol=1e-3)
    assert found["signal"].A.shape == (6, 6)
    assert found["cosine"] == pytest.approx(found["exact_cosine"], rel=1e-10)
    assert (tmp_path / "crane.png").exists()
    assert (tmp_path / "swing.gif").exists()
    # the bicycle of Meijaard et al. 2007
    assert found["stable"] == {3.0: False, 5.0: True, 8.0: False}
    expected = [-0.32286643, -0.77534188 + 4.46486771j, -0.77534188 - 4.46486771j, -14.07838969]
    np.testing.assert_allclose(found["riding"][5.0].eigenvalues()[6:], expected, atol=6e-9)


def test_integrators(tmp_path, monkeypatch):
    """A pendulum of small swing."""
    found = run("integrators", tmp_path, monkeypatch)
    swings = found["run"].beta(found["hinge"])
    np.testing.assert_allclose(swings, 1e-3 * np.cos(np.sqrt(9.81) * found["run"].t), atol=1e-8)
