"""All benchmarks by one command: runs them, and writes tables, pictures, machine and versions on one page.

    ./run python -m benchmarks --list              # their names, and how long each takes
    ./run python -m benchmarks --quick             # short runs: do they work? some three minutes
    ./run python -m benchmarks                     # all of them, and docs/benchmarks.md is written from what they found
    ./run python -m benchmarks stability beams     # some of them
    ./run python -m benchmarks my_benchmark.py     # a file of your own (benchmarks/benchmark.py says what it holds)
    ./run python -m benchmarks --page              # docs/benchmarks.md from the results that are kept

Each runs in a process of its own; one that fails is reported, and the rest go on. What was found lies in
out_benchmarks/NAME, the page of this run in out_benchmarks/page.md. A whole run (not --quick) of a benchmark of this
folder that passed is kept in benchmarks/results, its pictures in docs/pictures. Times mean something on a machine
that does nothing else: above a load of 0.3 at its start a whole run is refused (--busy: it runs, and keeps nothing).
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))

import page  # noqa: E402
import results  # noqa: E402
from benchmark import Report  # noqa: E402
from discovery import benchmarks, is_benchmark, is_timed, load, minutes_of, text_of  # noqa: E402

OUT = Path("out_benchmarks")
#: Processes that want to run, the mean of a minute, above which times are not kept.
MOST_LOAD = 0.3
PICTURES = results.ROOT / "docs" / "pictures"
#: As long as no benchmark takes unless it hangs: of the short run, and times what a whole one should take.
_LONGEST_QUICK, _PATIENCE = 300.0, 5.0


def main() -> int:
    """Run what is asked for; 0 where all passed."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("names", nargs="*", metavar="NAME", help="which (default: all), or files of your own")
    parser.add_argument("--quick", action="store_true", help="short runs")
    parser.add_argument("--busy", action="store_true", help="measure beside other work, and keep nothing")
    parser.add_argument("--list", action="store_true", help="names and times, and stop")
    parser.add_argument("--page", action="store_true", help="write docs/benchmarks.md from what is kept, and stop")
    parser.add_argument("--one", type=Path, metavar="FILE", help=argparse.SUPPRESS)  # in the process of one of them
    asked = parser.parse_args()
    if asked.one:
        return _one(asked.one, quick=asked.quick)
    if asked.page:
        page.write()
        return 0
    files = [_file(name, parser) for name in asked.names] or benchmarks()
    minutes = {file: minutes_of(file) for file in files}
    if asked.list:
        for file in files:
            print(f"{file.stem:20} {minutes[file]:5.1f} min   {text_of(file).splitlines()[0]}")
        return 0
    keep = not (asked.quick or asked.busy)
    if keep and os.getloadavg()[0] > MOST_LOAD and any(map(is_timed, files)):
        parser.error(
            f"the machine's load is {os.getloadavg()[0]:.1f}; times mean something below {MOST_LOAD}. Wait until it "
            "does nothing else, or measure with --busy, which keeps no result"
        )
    if not asked.quick:
        print(f"{len(files)} benchmarks, about {sum(minutes.values()):.0f} minutes", flush=True)
    found = [_run(file, minutes[file], quick=asked.quick, keep=keep) for file in files]
    (OUT / "page.md").write_text(page.of_run(found, OUT), encoding="utf-8")
    if keep:
        page.write()
    return _summary(found)


def _file(name: str, parser: argparse.ArgumentParser) -> Path:
    own = Path(name).resolve() if name.endswith(".py") else HERE / f"{name}.py"
    if not own.exists() or not is_benchmark(own):
        parser.error(f"{name} is no benchmark; there are {', '.join(file.stem for file in benchmarks())}")
    return own


def _run(file: Path, minutes: float, *, quick: bool, keep: bool) -> results.Result:
    """One, in a process of its own, which writes its result; or what became of it."""
    folder = OUT / file.stem
    folder.mkdir(parents=True, exist_ok=True)
    told = folder / "result.json"
    told.unlink(missing_ok=True)
    print(f"\n======== {file.stem}", flush=True)
    command = [sys.executable, "-m", "benchmarks", "--one", str(file), *(["--quick"] if quick else [])]
    began = time.monotonic()
    limit = _LONGEST_QUICK if quick else max(_LONGEST_QUICK, 60.0 * _PATIENCE * minutes)
    try:
        code: int | None = subprocess.run(command, timeout=limit, check=False).returncode
    except subprocess.TimeoutExpired:
        code = None
    if told.exists():
        result = results.load(told)
    else:
        failure = f"stopped after {limit:.0f} s" if code is None else f"ended with {code}"
        result = results.Result(file.stem, quick, time.monotonic() - began, results.setting(()), [], [], failure)
    if keep and not result.failure and file.parent == HERE:
        for picture in result.pictures:
            shutil.copy(folder / picture, PICTURES)
        results.save(result, results.RESULTS / f"{file.stem}.json")
    return result


def _one(file: Path, *, quick: bool) -> int:
    """Measure in this process, and write what was found until the end or a failure."""
    began = time.monotonic()
    report, failure, peers = Report(OUT / file.stem), "", ()
    where = results.setting(())
    try:
        module = load(file)
        peers = tuple(module.PEERS)
        where = results.setting(peers)
        (module.quick if quick else module.full)(report)
    except (Exception, SystemExit) as reason:
        if not isinstance(reason, SystemExit) or reason.code:
            failure = f"{type(reason).__name__}: {reason}"
            print(failure, file=sys.stderr)
    pictures = [path.name for path in report.pictures]
    taken = round(time.monotonic() - began, 1)
    results.save(
        results.Result(file.stem, quick, taken, where, report.lines, pictures, failure, report.comparisons),
        report.folder / "result.json",
    )
    return 1 if failure else 0


def _summary(found: Sequence[results.Result]) -> int:
    print("\n======== summary")
    for result in found:
        verdict = f"FAILED: {result.failure}" if result.failure else "passed"
        print(f"{result.seconds:7.1f} s  {result.name:20} {verdict}")
    print(json.dumps({"page": str(OUT / "page.md")}))
    return 1 if any(result.failure for result in found) else 0


if __name__ == "__main__":
    raise SystemExit(main())
