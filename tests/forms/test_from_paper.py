"""The page from paper to machine runs as it stands, and does what it says."""

import re
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).parents[2]
PAGE = REPOSITORY / "docs" / "from_paper_to_machine.md"


def test_the_page(monkeypatch):
    """Both blocks as a reader would: the stress of a block by three numbers, and a strap that swings."""
    monkeypatch.chdir(REPOSITORY)
    text, found = PAGE.read_text(encoding="utf-8"), {}
    for block in re.findall(r"^```python\n(.*?)^```$", text, re.DOTALL | re.MULTILINE):
        exec(compile(block, str(PAGE), "exec"), found)
    assert found["body"].stress()[0][..., 0, 0] == pytest.approx(found["exact"], rel=1e-9)
    # a mathematical pendulum's quarter of a period is 0.224 s
    x, _, z = found["swing"].position(found["ball"].frame())[-1]
    assert abs(x) < 0.03
    assert z == pytest.approx(-0.2, abs=2e-3)


def test_what_the_page_quotes_is_the_file_s():
    quoted = re.search(r"^```text\n(def _energy.*?)^```$", PAGE.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE)
    form = (REPOSITORY / "demos" / "from_paper" / "fibre_solid.py").read_text(encoding="utf-8")
    assert quoted.group(1) in form
