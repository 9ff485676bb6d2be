"""The example of docs/pictures_and_films.md runs, and the calls in its table are there."""

import re
from pathlib import Path

import flexmbd as fm

PAGE = Path(__file__).parents[2] / "docs" / "pictures_and_films.md"


def test_the_page_s_example_runs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (block,) = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    names = {}
    exec(compile(block, str(PAGE), "exec"), names)
    assert {path.name for path in tmp_path.iterdir()} == {"start.png", "later.png", "crank.gif", "crank.png"}
    piston, run = names["piston"], names["run"]
    reach = abs(run.position(piston.frame())[:, 0])
    assert 0.19 < reach.min() < reach.max() < 0.3101


def test_what_the_page_names_is_there():
    text = PAGE.read_text(encoding="utf-8")
    for name in re.findall(r"fm\.Shape\.(\w+)", text):
        assert hasattr(fm.Shape, name)
    for kind in (fm.System, fm.Trajectory, fm.ReducedBody, fm.FlexibleBody, fm.Shape, fm.StressField):
        assert callable(kind.show)
    for kind in (fm.System, fm.Trajectory, fm.ReducedBody, fm.StressField):
        assert callable(kind.to_pyvista)
