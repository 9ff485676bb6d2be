"""docs/beams.md: its code runs, from top to bottom."""

import re
from pathlib import Path

import numpy as np
import pytest

TEXT = (Path(__file__).parents[2] / "docs" / "beams.md").read_text()


def test_the_code_runs():
    names = {}
    for block in re.findall(r"```python\n(.*?)```", TEXT, re.DOTALL):
        exec(block, names)
    by_elements, by_lumps = names["boom"].frequencies(["hitch"]), names["twin"].frequencies(["hitch"])
    assert by_lumps[:4] == pytest.approx(by_elements[:4], rel=0.03)
    assert names["twin"].mass == pytest.approx(names["boom"].mass, rel=5e-3)
    assert (names["moved"][names["lumped"].node("left tip"), 2] < 0).all()
    assert np.isfinite(names["moved"]).all()
