"""Benchmarks by one command: a file each, failures that stop nothing, and a page that nobody wrote by hand."""

from __future__ import annotations

import json
import os
import re
import runpy
import subprocess
import sys
from pathlib import Path

import pytest
from benchmark_command import Report, benchmarks, minutes_of, page, results, text_of

ROOT = Path(__file__).parents[2]

OWN = """\
\"\"\"A benchmark of a stranger.\"\"\"

MINUTES = 0.01
PEERS = ("numpy", "no-such-peer")


def quick(report):
    report.table("n", "n squared")
    for n in (2, 3):
        report.say(f"| {n} | {n * n} |")
    report.picture("dot.png", lambda path: path.write_bytes(b"a picture"))


def full(report):
    quick(report)
"""


def ran(folder, *words):
    command = [sys.executable, str(ROOT / "benchmarks"), *words]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)


def test_the_page_is_written_from_the_results():
    assert (ROOT / "docs" / "benchmarks.md").read_text(encoding="utf-8") == page.text(), (
        "write it anew: ./run python -m benchmarks --page"
    )


def test_readme_and_paper_quote_the_comparisons_as_they_are_kept():
    for name, text in (("README.md", page.readme()), ("paper.md", page.paper())):
        assert (ROOT / name).read_text(encoding="utf-8") == text, "write it anew: ./run python -m benchmarks --page"


def test_the_paper_tells_all_that_is_lost():
    kept = [one for path in results.RESULTS.glob("*.json") for one in results.load(path).comparisons]
    told = page.lost()
    assert all(one.scene in told and one.peer in told for one in kept if one.times < 1.0)
    assert told.count("; ") + 1 == len({(one.scene, one.task) for one in kept if one.times < 1.0})


def test_the_first_table_has_every_comparison_and_those_that_are_lost_first():
    kept = [one for path in results.RESULTS.glob("*.json") for one in results.load(path).comparisons]
    table = page.text().partition("## Beside other programs")[2].partition("\n## ")[0]
    rows = [line.split(" | ") for line in table.splitlines() if line.startswith("| ")][1:]
    assert len(rows) == len(kept)
    lost = [row[3].startswith("**") for row in rows]
    assert lost == sorted(lost, reverse=True)
    assert sum(lost) == sum(one.times < 1.0 for one in kept) > 0
    assert f"in {len(kept) - sum(lost)} and more in {sum(lost)}" in page.headline()


def test_a_comparison_of_turns_is_of_medians_and_has_the_range_of_the_turns(tmp_path):
    report = Report(tmp_path)
    report.beside("s", task="t", peer="p", theirs=[2.0, 9.0, 3.0], ours=[1.0, 3.0, 2.0])
    report.beside("s", task="t", peer="never there", theirs=float("nan"), ours=1.0)
    report.beside("s", task="t", peer="q", theirs=1.0, ours=4.0)
    first, second = report.comparisons
    assert (first.times, first.least, first.most) == (1.5, 1.5, 3.0)
    assert (second.times, second.least, second.most) == (0.25, None, None)


def test_a_whole_run_is_refused_on_a_machine_that_does_other_work(tmp_path, monkeypatch):
    command = runpy.run_path(str(ROOT / "benchmarks" / "__main__.py"), run_name="command")
    own = tmp_path / "squares.py"
    own.write_text(OWN)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(os, "getloadavg", lambda: (0.4, 0.0, 0.0))
    monkeypatch.setattr(sys, "argv", ["benchmarks", "squares.py"])
    with pytest.raises(SystemExit, match="2"):
        command["main"]()
    assert not (tmp_path / "out_benchmarks").exists()


def test_kept_results_are_of_whole_runs_that_passed():
    for path in results.RESULTS.glob("*.json"):
        result = results.load(path)
        assert (result.name, result.quick, result.failure) == (path.stem, False, ""), path
        assert all((ROOT / "docs" / "pictures" / name).exists() for name in result.pictures), path


@pytest.mark.parametrize("file", benchmarks(), ids=lambda file: file.stem)
def test_every_benchmark_says_what_it_is(file):
    assert len(text_of(file)) > 100
    assert 0.0 < minutes_of(file) < 60.0
    source = file.read_text(encoding="utf-8")
    assert "def quick(report: Report) -> None:" in source
    assert "def full(report: Report) -> None:" in source
    assert re.search(r"^PEERS\b.* = \(", source, re.MULTILINE)


def test_a_stranger_s_file_runs_and_a_failure_stops_nothing(tmp_path):
    own, broken = tmp_path / "squares.py", tmp_path / "broken.py"
    own.write_text(OWN)
    broken.write_text(OWN.replace("for n in (2, 3):", "for n in (2, 3 / 0):"))
    done = ran(tmp_path, "--quick", "broken.py", "squares.py")
    assert done.returncode == 1
    assert "broken               FAILED: ZeroDivisionError: division by zero" in done.stdout
    assert "squares              passed" in done.stdout
    result = json.loads((tmp_path / "out_benchmarks" / "squares" / "result.json").read_text())
    assert result["lines"] == ["| n | n squared |", "|---|---|", "| 2 | 4 |", "| 3 | 9 |"]
    assert result["setting"]["missing"] == ["no-such-peer"]
    assert result["setting"]["versions"].keys() >= {"Python", "numpy"}
    told = (tmp_path / "out_benchmarks" / "page.md").read_text()
    assert "| 3 | 9 |" in told
    assert "![dot.png](squares/dot.png)" in told
    assert "**Failed**: ZeroDivisionError" in told


def test_what_is_no_benchmark_is_refused(tmp_path):
    done = ran(tmp_path, "--quick", "work_prescision")
    assert done.returncode == 2
    assert "work_prescision is no benchmark; there are beams," in done.stderr
    assert "Traceback" not in done.stderr


def test_a_report_prints_as_it_keeps(tmp_path, capsys):
    report = Report(tmp_path)
    report.table("a", "b")
    report.say("| 1 | 2 |")
    assert capsys.readouterr().out.splitlines() == report.lines == ["| a | b |", "|---|---|", "| 1 | 2 |"]
