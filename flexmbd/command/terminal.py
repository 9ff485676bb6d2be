"""Output of the command: on rank 0 alone, as lines for people and JSON for scripts."""

from __future__ import annotations

import argparse
import importlib.util
import json
import math
import os
import sys
from collections.abc import Mapping
from typing import Any

_RANKS = ("OMPI_COMM_WORLD_RANK", "PMIX_RANK", "PMI_RANK")
_SIZES = ("OMPI_COMM_WORLD_SIZE", "PMI_SIZE")


class Parser(argparse.ArgumentParser):
    """A parser that prints on rank 0 alone."""

    def _print_message(self, message: str, file: Any = None) -> None:
        if is_root():
            super()._print_message(message, file)


def is_root() -> bool:
    """Whether this process prints; without loading MPI where nothing else has."""
    if "mpi4py.MPI" in sys.modules:
        from mpi4py import MPI

        return bool(MPI.COMM_WORLD.rank == 0)
    return _first_number(_RANKS, 0) == 0


def launched_ranks() -> int:
    """Number of processes that mpirun started with this one; 1 without it."""
    return _first_number(_SIZES, 1)


def _first_number(names: tuple[str, ...], default: int) -> int:
    """The number in the first of these environment variables of mpirun that has one."""
    for name in names:
        text = os.environ.get(name, "")
        if text.isdecimal():
            return int(text)
    return default


def print_line(text: str) -> None:
    """Print a line on stdout, on rank 0."""
    if is_root():
        print(text)


def print_warning(text: str) -> None:
    """Print a line on stderr, on rank 0."""
    if is_root():
        print(f"flexmbd: {text}", file=sys.stderr)


def print_progress(text: str) -> None:
    """Print on a terminal what is being done; nothing where stderr is not one."""
    if is_root() and sys.stderr.isatty():
        print(f"flexmbd: {text} ...", file=sys.stderr)


def wants_bar() -> bool:
    """Whether a progress bar is of use: a person looks on, and tqdm is there."""
    return sys.stderr.isatty() and importlib.util.find_spec("tqdm") is not None


def print_json(values: Mapping[str, Any]) -> None:
    """Print an object as JSON on rank 0; arrays become lists, and numbers that are not finite null."""
    print_line(json.dumps(_plain(values), indent=2, ensure_ascii=False, allow_nan=False))


def _plain(value: Any) -> Any:
    import numpy as np

    if isinstance(value, np.ndarray):
        return _plain(value.tolist())
    if isinstance(value, np.generic):
        return _plain(value.item())
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if isinstance(value, os.PathLike):
        return str(value)
    return value


def add_json(parser: argparse._ActionsContainer) -> None:
    """Give a parser the argument `--json`."""
    parser.add_argument("--json", action="store_true", help="print one JSON object, for scripts (docs/command_line.md)")
