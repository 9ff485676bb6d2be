"""The documentation's site: its tutorials run and say what is so, and it is built without a warning."""

import json
import os
import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

import flexmbd as fm
from flexmbd.cli import main

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
#: A folder in which `./run docs` has just built the site without a warning, which takes a minute.
BUILT = os.environ.get("FLEXMBD_SITE")


def run_page(page, folder, monkeypatch):
    """What the python blocks of a page leave, run one after the other in a folder."""
    monkeypatch.chdir(folder)
    text = (DOCS / f"{page}.md").read_text(encoding="utf-8")
    names = {}
    for match in re.finditer(r"^```python\n(.*?)^```$", text, re.DOTALL | re.MULTILINE):
        exec(compile("\n" * text[: match.start(1)].count("\n") + match.group(1), f"{page}.md", "exec"), names)
    return names


def test_start(tmp_path, monkeypatch):
    found = run_page("start", tmp_path, monkeypatch)
    angle = found["run"].beta(found["hinge"], t=np.linspace(0.0, 2.0, 20001))
    assert angle.max() == pytest.approx(np.pi, abs=1e-5)  # it starts level and swings to the other side
    assert (tmp_path / "pendulum.png").exists()


def test_pendulum(tmp_path, monkeypatch):
    found = run_page("tutorials/pendulum", tmp_path, monkeypatch)
    amplitude = np.radians(10.0)
    assert found["period"] / found["small"] == pytest.approx(1 + amplitude**2 / 16 + 11 * amplitude**4 / 3072, abs=1e-5)
    assert "1.0019" in (DOCS / "tutorials" / "pendulum.md").read_text()
    assert {file.name for file in tmp_path.iterdir()} == {"angle.png", "pendulum.csv", "pendulum.h5"}


def test_flexible_rod(tmp_path, monkeypatch):
    found = run_page("tutorials/flexible_rod", tmp_path, monkeypatch)
    slender = 1.875104**2 / (2 * np.pi * 0.6**2) * np.sqrt(5e7 * 0.03**2 / 12 / 1100.0)  # Euler and Bernoulli
    assert found["body"].frequencies(clamped=["x_min"])[0] == pytest.approx(slender, rel=0.03)  # bonded ends stiffen it
    assert (tmp_path / "stress.png").exists()


def test_own_form(tmp_path, monkeypatch):
    """Along cords of thrice the rubber's stiffness the modulus is fourfold, whatever Poisson's ratio."""
    text = (DOCS / "tutorials" / "own_form.md").read_text(encoding="utf-8")
    (tmp_path / "corded.py").write_text(text.split("```python\n")[1].split("```")[0])
    found = run_page("tutorials/own_form", tmp_path, monkeypatch)
    slender = 1.875104**2 / (2 * np.pi * 0.6**2) * np.sqrt(5e7 * 0.03**2 / 12 / 1100.0)  # Euler and Bernoulli
    assert found["lowest"](0.0) == pytest.approx(slender, rel=0.01)
    assert found["lowest"](1.5e8) == pytest.approx(2.0 * slender, rel=0.01)
    assert main(["check", str(tmp_path / "corded.py")]) == 0


def test_reduction(tmp_path, monkeypatch):
    found = run_page("reduction", tmp_path, monkeypatch)
    body = fm.ReducedBody.load("link.h5")
    slender = 1.875104**2 / (2 * np.pi * 0.3**2) * np.sqrt(2.1e11 * 0.01**2 / 12 / 7850.0)  # Euler and Bernoulli
    assert body.frequencies(clamped=["x_min"])[0] == pytest.approx(slender, rel=0.02)
    assert found["arm"].mass == pytest.approx(0.3 * 0.02 * 0.01 * 7850.0)


def test_loops(tmp_path, monkeypatch):
    found = run_page("tutorials/loops", tmp_path, monkeypatch)
    again = found["scene"].simulate(1.0, h=2e-3)
    torque, energy = again.drive(found["drive"]), again.energy().total
    given = np.cumsum(10.0 * 0.5 * (torque[1:] + torque[:-1]) * np.diff(again.t))
    # what the drive gives goes into the machine
    np.testing.assert_allclose(given, energy[1:] - energy[0], atol=1e-3 * np.ptp(energy))
    assert found["run"].stats.constraint_residual < 1e-9


def test_yielding(tmp_path, monkeypatch):
    found = run_page("tutorials/yielding", tmp_path, monkeypatch)
    assert found["energies"]["plastic"][-1] > 0.1
    assert found["fields"].values("plastic_strain", row=-1).max() > 1e-3
    assert found["end"][-1, 2] > 0.00525 + 0.001  # it keeps a bend beyond where the carriage stands


def test_controller(tmp_path, monkeypatch):
    found = run_page("tutorials/controller", tmp_path, monkeypatch)
    carried = 2.0 * 9.81 * 0.5 * np.cos(found["TARGET"])
    assert found["rest"].states(found["pid"])[0] * found["KI"] == pytest.approx(carried, rel=1e-9)
    assert found["samples"].t.tolist() == [k * 0.005 for k in range(800)]
    assert abs(found["samples"].measurements[-1, 0] - found["TARGET"]) < 1e-3
    # what falls is the pole on a cart that runs freely (Ogata 2010, section 3.6)
    falls = np.sqrt(0.5 * 9.81 * 0.4 / (0.02 + 0.5 * 0.4**2 * (1.0 - 0.5 / 1.5)))
    assert found["linear"].eigenvalues().real.max() == pytest.approx(falls, rel=1e-9)
    assert abs(found["run"].beta(found["hinge"])[-1] - np.pi / 2) < 2e-3


def test_study(tmp_path, monkeypatch):
    found = run_page("tutorials/study", tmp_path, monkeypatch)
    assert not found["study"].failures
    heavy = np.corrcoef(found["samples"]["m"], found["lowest"])[0, 1]
    stiff = np.corrcoef(found["samples"]["k"], found["lowest"])[0, 1]
    assert heavy > 0.4
    assert stiff < -0.4


SAY = """
import json
import error_page
docstring = "Does.\\n\\nRaises:\\n    AError, BError: a\\n        b: c.\\n    CError: d.\\n\\nMore."
print(json.dumps([error_page.page(), list(error_page.raised(docstring))]))
"""


def test_the_page_of_errors_tells_what_each_means_and_who_raises_it():
    """Docstrings that name an error which there is not are refused."""
    found = subprocess.run(
        [sys.executable, "-c", SAY], cwd=ROOT / "tools", capture_output=True, text=True, check=True
    )
    text, raised = json.loads(found.stdout)
    told = dict(re.findall(r"^## (\w+)\n\n(.*?)(?=^## |\Z)", text, re.DOTALL | re.MULTILINE))
    public = {name for name in dir(fm) if isinstance(getattr(fm, name), type) and name.endswith(("Error", "Warning"))}
    assert public < set(told)
    for name in public - {"FlexmbdError", "ModesWarning"}:
        assert "Remedy: " in told[name], name
    assert re.search(r"- `fm.System.simulate`: \w+", told["SimulationError"])
    assert "- `fm.reduction.craig_bampton`: the eigensolver" in told["ConvergenceError"]
    assert raised == [[["AError", "BError"], "a b: c."], [["CError"], "d."]]


CARDS = """
import json
import tempfile
from pathlib import Path

import gallery
folder = Path(tempfile.mkdtemp()) / "gallery"
gallery.write_pages(folder, outputs=Path("no_runs"))
print(json.dumps({file.name: file.read_text() for file in folder.glob("*.md")}))
"""


def test_the_gallery_shows_a_picture_of_each_demo_and_its_result_before_its_code():
    """Also where no demo was run."""
    pytest.importorskip("jupytext")
    done = subprocess.run(
        [sys.executable, "-c", CARDS], cwd=ROOT / "tools", capture_output=True, text=True, check=True
    )
    pages = json.loads(done.stdout)
    demos = {demo.stem for demo in (ROOT / "demos").glob("*.py")}
    cards = dict(re.findall(r":link: (\w+)\n:link-type: doc\n:img-top: (\S+)", pages.pop("index.md")))
    assert set(cards) == demos  # a demo without a card's picture: put one of its name into docs/pictures
    for name in demos:
        text = pages[f"{name}.md"]
        assert text.index(f"]({name}-{cards[name]})") < text.index("```python")


class Links(HTMLParser):
    """Places on a page, and what it points to."""

    def __init__(self, page):
        super().__init__()
        self.ids, self.targets = set(), []
        self.feed(page.read_text(encoding="utf-8"))

    def handle_starttag(self, tag, attrs):
        given = dict(attrs)
        self.ids.update(value for key, value in attrs if key in ("id", "name") and value)
        for key in ("href", "src"):
            if given.get(key):
                self.targets.append(given[key])


@pytest.mark.slow
def test_the_site_is_built_without_a_warning_and_no_link_is_dead(tmp_path):
    pytest.importorskip("sphinx", reason="Sphinx 8 needs Python 3.11")
    if BUILT:
        site = Path(BUILT)
    else:
        site = tmp_path / "site"
        built = subprocess.run(
            [sys.executable, str(ROOT / "tools" / "build_site.py"), "-o", str(site)], capture_output=True, text=True
        )
        assert built.returncode == 0, built.stderr
    pages = {page: Links(page) for page in site.rglob("*.html")}
    assert len(pages) > 60
    dead = []
    for page, links in pages.items():
        for target in links.targets:
            if re.match(r"[a-z]+:", target):
                continue
            path, _, place = target.partition("#")
            other = (page.parent / path.split("?")[0]).resolve() if path else page
            if not other.exists() or (place and other in pages and place not in pages[other].ids):
                dead.append(f"{page.relative_to(site)}: {target}")
    assert dead == []
    # nothing is fetched from elsewhere, so that it reads without a network
    fetched = [
        target
        for page in pages
        for target in re.findall(r'<(?:script|link|img|video)[^>]*(?:src|href)="(https?:[^"]*)"', page.read_text())
    ]
    assert fetched == []
    found = (site / "searchindex.js").read_text()
    assert "craig_bampton" in found
    assert sum(file.stat().st_size for file in site.rglob("*") if file.suffix != ".mp4") < 60e6
