"""The code of docs/contact.md runs, from top to bottom, and does what the page says."""

import re
from pathlib import Path

import numpy as np
import pytest

PAGE = Path(__file__).parents[3] / "docs" / "contact.md"


def test_the_page_runs():
    names = {}
    for block in re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), flags=re.S):
        exec(block, names)
    assert names["run"].velocity(names["ball"].frame())[-1, 0] == pytest.approx(10.0 / 7.0, rel=1e-4)
    assert names["hit"].normal_force[-1] == pytest.approx(0.17 * 9.81, rel=1e-6)
    times = np.sqrt(1.0 / 9.81) * np.array([1.0, 2.2])
    assert [impact.t for impact in names["swift"].events] == pytest.approx(times, rel=1e-6)
