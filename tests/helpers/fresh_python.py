"""Statements, each in a python of its own that has loaded nothing of flexmbd: forks of one that has its libraries."""

import json
import subprocess
import sys
from collections.abc import Sequence
from typing import NamedTuple

_SERVER = """
import json, os, sys, traceback
import numba, numpy.random, scipy.interpolate, scipy.linalg, scipy.optimize, scipy.sparse.linalg

for statement in json.loads(sys.stdin.read()):
    if os.fork() == 0:
        error = ""
        try:
            exec(statement, {"__name__": "__main__"})
        except BaseException:
            error = traceback.format_exc()
        print(json.dumps([sorted({name.partition(".")[0] for name in sys.modules}), error]), flush=True)
        os._exit(0)
    os.wait()
"""


class Ran(NamedTuple):
    """What a statement loaded, as top-level packages, and the traceback of its error, or an empty text."""

    packages: set[str]
    error: str


def ran_afresh(statements: Sequence[str]) -> list[Ran]:
    """Run each by itself, in the order given."""
    done = subprocess.run(
        [sys.executable, "-c", _SERVER], input=json.dumps(list(statements)), capture_output=True, text=True, cwd="/"
    )
    found = [json.loads(line) for line in done.stdout.splitlines()]
    assert len(found) == len(statements), done.stderr
    return [Ran(set(packages), error) for packages, error in found]
