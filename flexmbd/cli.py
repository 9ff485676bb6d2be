"""The command `flexmbd`; its subcommands stand in flexmbd.command, one a file (docs/command_line.md).

Exit codes: 0 for success, 1 where what was asked for failed (a check, a simulation), 2 for wrong arguments and whatever
else ends in an error of flexmbd, 130 after Ctrl-C. Under `mpirun` every rank runs the same command, and rank 0 speaks;
a subcommand that is not collective runs there alone.
"""

from __future__ import annotations

import argparse
import io
import os
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version

from flexmbd.command import check, convert, doctor, export, inspect, plot, reduce, simulate
from flexmbd.command.terminal import Parser, is_root, print_warning
from flexmbd.errors import FlexmbdError

_FAULT = 2
_INTERRUPTED = 130
_BROKEN_PIPE = 141  # as a shell has it for a program that SIGPIPE ended


@dataclass(frozen=True)
class Subcommand:
    """One word after `flexmbd`.

    Attributes:
        name: the word.
        help: one line of `flexmbd --help`.
        describe: gives the parser its arguments, and sets `run`, which takes them and returns the exit code.
        collective: whether all ranks run it, or rank 0 alone.
    """

    name: str
    help: str
    describe: Callable[[argparse.ArgumentParser], None]
    collective: bool = False


SUBCOMMANDS = (
    Subcommand("check", "run the contract of a form file on small meshes", check.describe, collective=True),
    Subcommand("reduce", "reduce a STEP file or a mesh to a record", reduce.describe, collective=True),
    Subcommand("inspect", "print a record as a readable sheet", inspect.describe),
    Subcommand("export", "write a record for another program", export.describe),
    Subcommand("convert", "turn a file of a reduced body into another", convert.describe),
    Subcommand("simulate", "simulate a scene from a TOML file", simulate.describe),
    Subcommand("plot", "draw results over time, or a record's frequencies", plot.describe),
    Subcommand("doctor", "say what is installed, and what to do about what is broken", doctor.describe),
)

_EPILOG = """\
exit codes: 0 success; 1 what was asked for failed (a check, a simulation); 2 wrong arguments or files; 130 Ctrl-C

flexmbd SUBCOMMAND --help shows the arguments of each, with examples
"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one subcommand; collective where the subcommand is.

    Args:
        arguments: the words after `flexmbd`; those of the command line if None.

    Returns:
        The exit code.
    """
    if isinstance(sys.stdout, io.TextIOWrapper):  # what the terminal has no letters for, as in names of files
        sys.stdout.reconfigure(errors="backslashreplace")
    try:
        chosen = _parser().parse_args(arguments)
        if not chosen.collective and not is_root():
            return 0
        run: Callable[[argparse.Namespace], int] = chosen.run
        code = run(chosen)
        sys.stdout.flush()
        return code
    except FlexmbdError as error:
        print_warning(str(error))
        return _FAULT
    except KeyboardInterrupt:
        print_warning("stopped by Ctrl-C")
        return _INTERRUPTED
    except BrokenPipeError:
        _forget_stdout()
        return _BROKEN_PIPE


def _parser() -> Parser:
    parser = Parser(
        prog="flexmbd",
        description="From a UFL form to a body that moves in a machine.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"flexmbd {_version()}")
    words = parser.add_subparsers(title="subcommands", required=True, metavar="SUBCOMMAND")
    for one in SUBCOMMANDS:
        under = words.add_parser(one.name, help=one.help, formatter_class=argparse.RawDescriptionHelpFormatter)
        under.set_defaults(collective=one.collective, refuse=under.error)
        one.describe(under)
    return parser


def _version() -> str:
    try:
        return version("flexmbd")
    except PackageNotFoundError:  # run from a folder, not installed
        return "(not installed)"


def _forget_stdout() -> None:
    """Let the interpreter flush what the reader no longer wants into nothing."""
    try:
        nothing = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nothing, sys.stdout.fileno())
    except (OSError, ValueError):  # no file behind stdout
        return
