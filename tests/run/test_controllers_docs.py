"""The code of docs/controllers.md runs, from top to bottom, and does what the page says."""

import re
from pathlib import Path

import numpy as np

PAGE = Path(__file__).parents[2] / "docs" / "controllers.md"


def test_the_page_runs(capsys):
    names = {}
    for block in re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), flags=re.S):
        exec(block, names)
    assert len(names["samples"].t) == 1500
    assert abs(names["run"].beta(names["slide"])[-1]) < 0.05
    states = names["swing"].states(names["motor"])
    assert abs(states[-1, 0]) < 0.05
    assert np.abs(states).max() > 0.5
    printed = capsys.readouterr().out
    assert "controller 'controller 2': sets 'more' every 0.02 s, remembers 1 numbers" in printed
