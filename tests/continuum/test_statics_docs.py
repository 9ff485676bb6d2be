"""The code of docs/statics.md runs as it stands, and does what the page says."""

import re
from pathlib import Path

import numpy as np
import pytest

import flexmbd as fm

PAGE = Path(__file__).parents[2] / "docs" / "statics.md"


def test_the_page(capsys):
    """Both blocks, one after the other, as a reader would."""
    blocks = re.findall(r"^```python\n(.*?)^```$", PAGE.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE)
    found: dict = {}
    loading, beyond = blocks
    exec(compile(loading, str(PAGE), "exec"), found)
    path, limit = found["path"], 2 * 240e6 / np.sqrt(3) * np.log(2)
    assert path.steps[-1].t == pytest.approx(limit, rel=5e-3)
    assert path.cuts > 0
    assert capsys.readouterr().out.startswith("1.0000e+08 Pa 1e+00 ")
    with pytest.warns(fm.PathWarning, match="is closed"):
        exec(compile(beyond, str(PAGE), "exec"), found)
    (told,) = re.findall(r"# \.\.\. (bifurcation .*)$", beyond, re.MULTILINE)
    assert told in capsys.readouterr().out
    assert found["aside"].end is fm.PathEnd.CLOSED
