"""A kept result of a benchmark, and what it was measured on: a JSON file each, in `benchmarks/results`."""

from __future__ import annotations

import datetime as dt
import importlib.metadata
import json
import os
import platform
import subprocess
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field
from pathlib import Path

from benchmark import Comparison

ROOT = Path(__file__).resolve().parents[1]
RESULTS = ROOT / "benchmarks" / "results"
_OURS = ("numpy", "scipy", "numba", "fenics-dolfinx")


@dataclass(frozen=True)
class Setting:
    """The machine, the state and the versions of a measurement.

    Attributes:
        date: of the measurement, as 2026-11-23.
        commit: of this checkout, with "+" where files differ from it.
        machine: processor, cores, system.
        load: what else the machine did as it began: processes that wanted to run, the mean of a minute.
        versions: of Python, of flexmbd's libraries, and of the peers that were there.
        missing: peers that were not.
    """

    date: str
    commit: str
    machine: str
    load: float
    versions: dict[str, str]
    missing: list[str]

    def text(self) -> str:
        """For the page, in one paragraph."""
        versions = ", ".join(f"{name} {version}" for name, version in self.versions.items())
        without = f"; not there: {', '.join(self.missing)}" if self.missing else ""
        return f"{self.date}, state {self.commit}, {self.machine}, load {self.load:.1f}; {versions}{without}."


@dataclass(frozen=True)
class Result:
    """What a run of a benchmark found.

    Attributes:
        name: of the benchmark.
        quick: whether it was the short run.
        seconds: that it took, by the wall's clock.
        setting: on what.
        lines: of markdown.
        pictures: names of files.
        failure: why it ended early; "" where it did not.
        comparisons: with other programs.
    """

    name: str
    quick: bool
    seconds: float
    setting: Setting
    lines: list[str]
    pictures: list[str]
    failure: str = ""
    comparisons: list[Comparison] = field(default_factory=list)


def save(result: Result, path: Path) -> None:
    """Write a result as JSON."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(asdict(result), indent=1) + "\n", encoding="utf-8")


def load(path: Path) -> Result:
    """Read a result."""
    kept = json.loads(path.read_text(encoding="utf-8"))
    beside = [Comparison(**one) for one in kept.get("comparisons", ())]
    return Result(**{**kept, "setting": Setting(**kept["setting"]), "comparisons": beside})


def setting(peers: Iterable[str]) -> Setting:
    """Of this machine and this checkout, now."""
    named = {name: _version(name) for name in (*_OURS, *peers)}
    versions = {"Python": platform.python_version(), **{name: version for name, version in named.items() if version}}
    return Setting(
        dt.datetime.now(dt.UTC).date().isoformat(),
        _commit(),
        f"{_processor()}, {os.cpu_count()} cores, {platform.system()}",
        round(os.getloadavg()[0], 1),
        versions,
        [name for name, version in named.items() if not version],
    )


def _version(distribution: str) -> str:
    try:
        return importlib.metadata.version(distribution)
    except importlib.metadata.PackageNotFoundError:
        return ""


def _commit() -> str:
    def git(*words: str) -> str:
        command = ["git", "-c", "safe.directory=*", *words]
        return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False).stdout.strip()

    sources = ("flexmbd", "forms", "meshes", "benchmarks/*.py")
    changed = git("status", "--porcelain", "--untracked-files=no", "--", *sources)
    return (git("rev-parse", "--short=7", "HEAD") or "unknown") + ("+" if changed else "")


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.machine()
    return next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")), platform.machine())
