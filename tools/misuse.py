"""Random misuse by the hour: machines of right and wrong parts, used in right and wrong ways, in children with limits.

    ./run python tools/misuse.py --hours 1              # seeds from 0 on; what is found is told at once
    ./run python tools/misuse.py --first 5000 --count 200
    ./run python tools/misuse.py --seed 1234            # one machine, its statements one by one, in this process

A machine and what is done with it follow from its seed alone. A finding is what is neither an answer nor one clear
error: another exception than flexmbd's, a text from inside a library, numbers that are not finite where nobody said
so, a warning of numpy's, a crash, a statement that never ends, more memory than 3 GB. Ends with 1 where there are any.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "helpers"))

from random_misuse.children import Outcome, tried
from random_misuse.watching import Finding

AT_ONCE = 200  # seeds of one child, which grows


def main() -> int:
    """Run as told; returns whether anything was found."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--hours", type=float, default=1.0, help="how long")
    parser.add_argument("--first", type=int, default=0, help="the first seed")
    parser.add_argument("--count", type=int, help="how many seeds, instead of hours")
    parser.add_argument("--seed", type=int, help="one machine alone")
    given = parser.parse_args()
    if given.seed is not None:
        return _one(given.seed)
    ends, seed = time.monotonic() + 3600.0 * given.hours, given.first
    last = None if given.count is None else given.first + given.count
    known: dict[tuple[str, str], int] = {}
    total = Outcome(0, 0, 0, ())

    def say(finding: Finding) -> None:
        known[finding.key] = known.get(finding.key, 0) + 1
        if known[finding.key] == 1:
            last = finding.statements[-1:]
            print(f"{finding.kind} at {finding.where}, seed {finding.seed}, after {last}:", flush=True)
            print(f"    {finding.text[:600]}", flush=True)

    while (last is None and time.monotonic() < ends) or (last is not None and seed < last):
        some = range(seed, seed + AT_ONCE if last is None else min(last, seed + AT_ONCE))
        seed = some.stop
        found = tried(some, say=say)
        total = Outcome(
            total.seeds + found.seeds, total.statements + found.statements, total.refused + found.refused, ()
        )
        print(f"{seed - given.first} machines, {total.statements} statements, {total.refused} refused, "
              f"{sum(known.values())} findings of {len(known)} kinds", flush=True)  # fmt: skip
    for (kind, where), count in sorted(known.items(), key=lambda one: -one[1]):
        print(f"{count:6} {kind:8} {where}")
    return int(bool(known))


def _one(seed: int) -> int:
    """One machine in this process: each statement before it is run, then what was found."""
    from random_misuse.operations import misuse

    with tempfile.TemporaryDirectory() as folder:
        session = misuse(seed, Path(folder), lambda what: print(f"  {what}", flush=True), time.process_time)
    for finding in session.findings:
        print(f"{finding.kind} at {finding.where}: {finding.text}")
    return int(bool(session.findings))


if __name__ == "__main__":
    sys.exit(main())
