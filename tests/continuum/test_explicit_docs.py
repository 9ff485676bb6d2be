"""The code of docs/explicit.md runs."""

import re
from pathlib import Path

TEXT = (Path(__file__).parents[2] / "docs" / "explicit.md").read_text()


def test_the_code_runs(capsys):
    names: dict = {}
    blocks = re.findall(r"```python\n(.*?)```", TEXT, re.DOTALL)
    assert len(blocks) == 2
    for block in blocks:
        exec(block, names)
    assert "closes within" in capsys.readouterr().out
    assert names["account"].error < 0.01
    assert names["trajectory"].t[-1] == 2e-5
