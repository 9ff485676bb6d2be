"""Kernels for several cells at a time, compiled beside FFCx's and kept in its cache.

As many cells as the processor's registers have numbers: the results are the same to the bit for any number, and so on
any processor.  Products and sums are not contracted.
"""

from __future__ import annotations

import ctypes
import hashlib
import platform
import re
import shlex
import subprocess
import tempfile
from functools import cache
from pathlib import Path
from typing import Any

from mpi4py import MPI

from dolfinx import jit

from flexmbd.continuum.history import lane_code as rewriting
from flexmbd.continuum.history.lane_code import NotRewrittenError, lane_code
from flexmbd.files.form_compiler import form_compiler
from flexmbd.files.whole_file import replace_file

_NAME = "tabulate_lanes"
# GCC makes roots of powers where it has registers for several, which changes digits
_OPTIONS = ("-std=gnu17", "-O2", "-w", "-fPIC", "-fno-math-errno", "-ffp-contract=off", "-fno-builtin-pow")

# a loop of FFCx
_LOOP = re.compile(r"for \(int \w+ = 0; \w+ < (\d+); ")

# what a processor of x86-64 can do, how a compiler is told, and how many numbers its registers then have
_WIDE = (
    ({"avx512f", "avx512dq", "avx512vl"}, ("-mavx512f", "-mavx512dq", "-mavx512vl"), 8),
    ({"avx2"}, ("-mavx2",), 4),
)


@cache
def processor_lanes() -> tuple[int, tuple[str, ...]]:
    """How many numbers this processor's registers have, and what a compiler is told to use them; not collective."""
    if platform.machine() in ("x86_64", "AMD64"):
        try:
            lines = Path("/proc/cpuinfo").read_text(encoding="ascii", errors="replace").splitlines()
        except OSError:
            lines = []
        able = next((set(line.split()) for line in lines if line.startswith("flags")), set())
        for needed, told, count in _WIDE:
            if needed <= able:
                return count, told
    return 2, ()


def common_lanes(comm: MPI.Comm) -> int:
    """The number of lanes that all ranks' processors have registers for; collective."""
    return int(comm.allreduce(processor_lanes()[0], op=MPI.MIN))


def lane_kernel(module: Any, *, lanes: int) -> tuple[int, Any] | None:
    """The code of an FFCx module's one kernel for cells in lanes; not collective, compiles.

    Args:
        module: as FFCx loaded it.
        lanes: cells at a time, no more than the processor's registers have numbers.

    Returns:
        Its address, which is to be called as FFCx's, and the library to be kept; None where there is no compiler
        that has vectors, or FFCx wrote what `lane_code` does not know.
    """
    path, compiler = Path(module.__file__), form_compiler()
    told = next((told for _, told, count in _WIDE if count == lanes), ())
    command = [*shlex.split(compiler), *_OPTIONS, *told]
    writer = Path(rewriting.__file__).read_bytes()
    what = hashlib.sha256(repr((path.name, lanes, command)).encode() + writer).hexdigest()[:24]
    name = f"flexmbd_lanes_{what}.so"
    for folder in (Path(jit.get_options()["cache_dir"]), _own_folder()):
        try:
            if not (folder / name).exists():
                replace_file(folder / name, _compiled(path, command, lanes))
            library = ctypes.CDLL(str(folder / name))
            return int(ctypes.cast(library[_NAME], ctypes.c_void_p).value or 0), library
        except (NotRewrittenError, subprocess.SubprocessError):
            return None
        except OSError:  # a folder that cannot be written to
            continue
    return None


def work_of_kernel(module: Any) -> int:
    """How many statements the code of an FFCx module's one kernel carries out for a cell; not collective."""
    try:
        code = _code(Path(module.__file__))
    except OSError:
        return 0
    turns, inside, found = 1, [1], 0
    for line in map(str.strip, code[code.find("void tabulate_tensor") :].splitlines()):
        if loop := _LOOP.match(line):
            turns = int(loop[1])
        elif line == "{":
            inside.append(turns * inside[-1])
            turns = 1
        elif line == "}":
            inside.pop()
            if len(inside) == 1:
                break
        elif line.endswith(";") and not line.startswith(("static", "//")):
            found += inside[-1]
    return found


def _code(path: Path) -> str:
    """What FFCx wrote, of the module at a path."""
    return path.with_name(f"{path.name.partition('.')[0]}.c").read_text(encoding="utf-8")


def _compiled(path: Path, command: list[str], lanes: int) -> bytes:
    """A shared library of the kernel of the FFCx module at a path.

    Raises:
        NotRewrittenError: its code has what is not known.
        SubprocessError: the compiler refuses it.
        OSError: a file cannot be read or written; there is no compiler.
    """
    code = _code(path)
    with tempfile.TemporaryDirectory() as folder:
        source, made = Path(folder, "lanes.c"), Path(folder, "lanes.so")
        source.write_text(lane_code(code, _NAME, lanes=lanes), encoding="utf-8")
        subprocess.run([*command, "-shared", "-o", str(made), str(source), "-lm"], check=True, capture_output=True)
        return made.read_bytes()


@cache
def _own_folder() -> Path:
    """A folder of this process alone."""
    _held.append(tempfile.TemporaryDirectory())
    return Path(_held[-1].name)


_held: list[tempfile.TemporaryDirectory[str]] = []
