"""Published problems with numbers: computes them, tells what is met, and writes docs/verification.md.

    ./run python -m verification --list              # their names, and about how long each takes
    ./run python -m verification --quick             # the quick ones
    ./run python -m verification                     # all
    ./run python -m verification machines.andrews    # some
    ./run python -m verification --page              # docs/verification.md from what is kept, and stop
    ./run python -m verification --times             # keep the processor times of this run, too

Ends with 0 where every quantity is met that is not known to fail, and with 1 otherwise; a script that raises is told,
and the rest go on.
"""

from __future__ import annotations

import argparse
import time
import traceback
from collections.abc import Sequence

from verification import page, results, scripts
from verification.reference import Computed, Script


def main(words: Sequence[str] | None = None) -> int:
    """Run what is asked for."""
    parser = argparse.ArgumentParser(
        prog="python -m verification", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("names", nargs="*", metavar="NAME", help="which (default: all), as machines.andrews")
    parser.add_argument("--quick", action="store_true", help=f"those of up to {scripts.QUICK:g} s")
    parser.add_argument("--list", action="store_true", help="names and times, and stop")
    parser.add_argument("--page", action="store_true", help="write the page from what is kept, and stop")
    parser.add_argument("--times", action="store_true", help="keep this run's processor times")
    asked = parser.parse_args(words)
    there = scripts.names()
    for name in asked.names:
        if name not in there:
            parser.error(f"{name} is not there; there are {', '.join(there)}")
    kept = {name: result for name, result in results.load().items() if name in there}
    chosen = asked.names or there
    if asked.quick:
        chosen = [name for name in chosen if name in scripts.quick(kept)]
    if asked.list:
        for name in chosen:
            taken = f"{kept[name].seconds:7.2f} s" if name in kept else "not run"
            print(f"{name:40} {taken:>9}   {scripts.title(name)}")
        return 0
    failed = [] if asked.page else [name for name in chosen if not _run(name, kept, new_time=asked.times)]
    changed = page.write(kept)
    print(f"docs/verification.md {'was written anew' if changed else 'stays as it was'}")
    if failed:
        print(f"not as said: {', '.join(failed)}")
    return 1 if failed else 0


def _run(name: str, kept: dict[str, results.Result], *, new_time: bool) -> bool:
    """Compute one, print its rows, keep what was found; whether all is met that should be."""
    script = scripts.load(name)
    print(f"\n{name}: {scripts.title(name)}", flush=True)
    began = time.process_time()
    try:
        found = script.compute()
        good = _told(script, found)
    except Exception:
        traceback.print_exc()
        return False
    seconds = time.process_time() - began
    print(f"  {found.mesh or 'no mesh'}; {found.accuracy or 'exact'}; {seconds:.2f} s")
    kept[name] = results.settled(
        found, kept.get(name), references=script.REFERENCES, seconds=seconds, new_time=new_time
    )
    results.save(kept)
    return good


def _told(script: Script, found: Computed) -> bool:
    """Print a script's rows; whether each is met that should be, and none that should not."""
    good = True
    for reference, values in zip(script.REFERENCES, found.values, strict=True):
        met = reference.is_met(values)
        verdict = "met" if met else "NOT MET"
        if reference.fails:
            verdict = "MET, though said to fail" if met else "not met, as said"
        good = good and met != bool(reference.fails)
        ours = ", ".join(f"{one:.13g}" for one in values)
        print(
            f"  {reference.quantity}: {ours} {reference.unit}, difference {reference.difference(values):.1e}: {verdict}"
        )
    return good


if __name__ == "__main__":
    raise SystemExit(main())
