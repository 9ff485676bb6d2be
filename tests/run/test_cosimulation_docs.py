"""The code of docs/cosimulation.md runs, from top to bottom, and its table is what it gives."""

import re
from pathlib import Path

import numpy as np

PAGE = Path(__file__).parents[2] / "docs" / "cosimulation.md"


def test_the_page_runs():
    names, text = {}, PAGE.read_text(encoding="utf-8")
    for block in re.findall(r"```python\n(.*?)```", text, flags=re.S):
        exec(block, names)
    assert names["ends"] == sorted(names["ends"])
    assert names["stepper"].t == 0.0
    assert abs(names["angle"] - 0.5) < 0.05
    table = re.findall(r"^\| 1/(\d+) \| (\S+) \| (\S+) \|$", text, flags=re.M)
    for way, column in (("held", 1), ("linear", 2)):
        told = np.array([float(row[column]) for row in table])
        np.testing.assert_allclose(told, names["errors"][way], rtol=0.06)
        orders = np.log2(told[:-1] / told[1:])
        np.testing.assert_allclose(orders, {"held": 1.0, "linear": 2.0}[way], atol=0.25)
