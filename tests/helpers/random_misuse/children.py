"""Seeds in child processes with limits of time and memory: what a crash or a hang leaves is a finding as well."""

from __future__ import annotations

import faulthandler
import json
import os
import resource
import select
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import IO

from random_misuse.watching import Finding

HELPERS = Path(__file__).parents[1]
MEMORY = 3 << 30  # bytes beyond what a process has once it has begun
HUNG = 40.0  # s of one statement, its compilation apart, after which a child ends itself
STUCK = 400.0  # s of silence, compilation included, after which a child is killed


@dataclass(frozen=True)
class Outcome:
    """What the seeds of some children gave."""

    seeds: int
    statements: int
    refused: int
    findings: tuple[Finding, ...]


def tried(seeds: Sequence[int], *, say: Callable[[Finding], None] = lambda finding: None) -> Outcome:
    """Try seeds one after the other, in a new child wherever one dies.

    Args:
        seeds: of the machines.
        say: hears of each finding at once.
    """
    waiting, findings, counts = list(seeds), list[Finding](), [0, 0, 0]
    while waiting:
        for told in _child(waiting):
            if "finding" in told:
                told["finding"]["statements"] = tuple(told["finding"]["statements"])
                findings.append(Finding(**told["finding"]))
                say(findings[-1])
                waiting = [seed for seed in waiting if seed != told.get("died")]
            else:
                waiting.remove(told["seed"])
                counts = [a + b for a, b in zip(counts, (1, told["statements"], told["refused"]), strict=True)]
    return Outcome(counts[0], counts[1], counts[2], tuple(findings))


def _child(seeds: Sequence[int]) -> Iterator[dict]:
    """What one child tells; at last how it died, where it did."""
    command = [sys.executable, "-m", "random_misuse.children", json.dumps(list(seeds))]
    paths = os.pathsep.join([str(HELPERS), *filter(None, [os.environ.get("PYTHONPATH")])])
    environment = {**os.environ, "PYTHONPATH": paths}
    with tempfile.TemporaryFile() as errors:
        child = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=errors, env=environment)
        assert child.stdout is not None
        seed, statements, hung = seeds[0], list[str](), False
        for line in _lines(child.stdout):
            if line is None:
                hung = True
                child.kill()
                break
            told = json.loads(line)
            if "begin" in told:
                seed, statements = told["begin"], []
            elif "statement" in told:
                statements.append(told["statement"])
            else:
                yield told
        code = child.wait()
        child.stdout.close()
        if code == 0:
            return
        errors.seek(0)
        text = errors.read().decode(errors="replace")[-1500:]
    kind = "hang" if hung or code == 77 else "memory" if "MemoryError" in text else "crash"
    last = statements[-1].split()[0] if statements else "start"
    finding = Finding(kind, last, f"ended with {code}: {text}", tuple(statements), seed)
    yield {"finding": asdict(finding), "died": seed}


def _lines(pipe: IO[bytes]) -> Iterator[bytes | None]:
    """Lines as they come; None where nothing came for too long."""
    rest = b""
    while True:
        ready, _, _ = select.select([pipe], [], [], STUCK)
        if not ready:
            yield None
            return
        part = os.read(pipe.fileno(), 1 << 16)
        if not part:
            return
        *lines, rest = (rest + part).split(b"\n")
        yield from lines


class _Clock:
    """Time of the wall without that of numba's compiler, and an end to what takes too long."""

    def __init__(self) -> None:
        self._began = self()
        threading.Thread(target=self._watch, daemon=True).start()

    def __call__(self) -> float:
        from time_limit import COMPILED

        return time.monotonic() - COMPILED.seconds()

    def begin(self) -> None:
        self._began = self()

    def _watch(self) -> None:
        while True:
            time.sleep(0.5)
            if self() - self._began > HUNG:
                faulthandler.dump_traceback(all_threads=True)
                os._exit(77)


class _ProcessorTime:
    """s of the processor without those of numba's compiler: what else runs on a machine makes no statement slow."""

    def __init__(self) -> None:
        from numba.core import event
        from time_limit import CompilationTime

        self._compiled = CompilationTime(time.process_time)
        event.register("numba:compiler_lock", self._compiled)

    def __call__(self) -> float:
        return time.process_time() - self._compiled.seconds()


def main(seeds: Sequence[int]) -> None:
    """In a child: try seeds, and tell on the standard output."""
    out = os.fdopen(os.dup(1), "w", buffering=1)
    os.dup2(2, 1)  # what others print
    faulthandler.enable()
    from random_misuse.operations import misuse

    clock, processor = _Clock(), _ProcessorTime()
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    resource.setrlimit(resource.RLIMIT_AS, (pages * resource.getpagesize() + MEMORY,) * 2)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))

    def begin(what: str) -> None:
        clock.begin()
        out.write(json.dumps({"statement": what}) + "\n")

    for seed in seeds:
        out.write(json.dumps({"begin": seed}) + "\n")
        with tempfile.TemporaryDirectory() as folder:
            os.chdir(folder)
            session = misuse(seed, Path(folder), begin, processor)
            os.chdir("/")
        for finding in session.findings:
            out.write(json.dumps({"finding": asdict(finding)}) + "\n")
        told = {"seed": seed, "statements": len(session.statements), "refused": session.refused}
        out.write(json.dumps(told) + "\n")
    out.flush()
    os._exit(0)  # threads of pools may still run


if __name__ == "__main__":
    main(json.loads(sys.argv[1]))
