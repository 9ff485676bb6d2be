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

from flexmbd.command.launch import launched_rank


class Parser(argparse.ArgumentParser):
    """A parser that prints on rank 0 alone."""

    def long_options(self) -> list[str]:
        """The options that it knows, as "--json"."""
        return [word for word in self._option_string_actions if word.startswith("--")]

    def choices_of_options(self) -> dict[str, list[str]]:
        """The values that options may have, where these are listed, as "none" of "--damping"."""
        chosen = [action for action in self._actions if action.choices is not None]
        return {word: [*map(str, one.choices or ())] for one in chosen for word in one.option_strings}

    def positional_choices(self) -> list[str]:
        """The words that may stand without an option, where these are listed."""
        positional = [action for action in self._actions if not action.option_strings]
        return [str(word) for action in positional for word in action.choices or ()]

    def _print_message(self, message: str, file: Any = None) -> None:
        if is_root():
            super()._print_message(message, file)


def is_root() -> bool:
    """Whether this process prints; without loading MPI where nothing else has."""
    if "mpi4py.MPI" in sys.modules:
        from mpi4py import MPI

        return bool(MPI.COMM_WORLD.rank == 0)
    return launched_rank() == 0


def print_line(text: str) -> None:
    """Print a line on stdout, on rank 0."""
    if is_root():
        print(text)


def print_warning(text: str) -> None:
    """Print a line on stderr, on rank 0."""
    if is_root():
        print(f"flexmbd: {text}", file=sys.stderr)


def print_progress(text: str) -> None:
    """Print the progress on a terminal; nothing where stderr is not one."""
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
