"""The code of docs/yielding_parts.md runs as it stands, block after block, and does what the page says."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

PAGE = Path(__file__).parents[2] / "docs" / "yielding_parts.md"
MODULUS = 0.02**3 / 6.0


def test_the_page(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    text = PAGE.read_text(encoding="utf-8")
    found: dict = {}
    for match in re.finditer(r"^```python\n(.*?)^```$", text, re.DOTALL | re.MULTILINE):
        block = "\n" * text[: match.start(1)].count("\n") + match.group(1)
        exec(compile(block, str(PAGE), "exec"), found)
    history, stopped = found["history"], found["stopped"]
    # 6000 N/s times the arm to the first nodes that are watched, 5 mm from the clamped end
    assert history.first.t == pytest.approx(250e6 * MODULUS / (0.395 * 6000.0), rel=0.05)
    # the one between the rows of a run, the other where a step of another length ends: alike to the rtol of both
    assert stopped.t[-1] == pytest.approx(history.first.t, rel=1e-5)
    (slab,) = found["slabs"]
    reach = 0.4 - 0.9 * 250e6 * MODULUS / 1200.0
    assert slab.cuts == pytest.approx((reach + 0.02 * 2**0.5,), abs=0.01)
    assert list(found["cut"].pieces) == ["hinge", "rest 1"]
    printed = capsys.readouterr().out
    assert "hinge         may yield" in printed
    assert "first yields      1.000 at t = " in printed
    assert printed.rstrip().endswith("yields            nowhere")
    assert "beyond hinge/rest 1: rest 1, reduced, no history; its frame turns with it; a YieldMonitor tells" in printed
    tips = [
        run.position(body.frame("x_max"))[-1]
        for run, body in ((found["run"], found["arm"]), (found["again"], found["pieces"]["rest 1"]))
    ]
    assert tips[1] == pytest.approx(tips[0], abs=1e-5)
    # beyond first yield at the clamp, 833 N, the bar gives way more than an elastic one
    bent, hinge = found["bent"], found["hinge"]
    tip = bent.position(found["rest"].frame("x_max"))[-1]
    elastic = 1400.0 / 1200.0 * tips[0][2]
    assert 1.05 * elastic < tip[2] < 2.0 * elastic
    work = bent.energies(hinge)["plastic"][-1]
    assert 0.0 < work < 1400.0 * tip[2] / 2.0
