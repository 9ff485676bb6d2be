"""The command `flexmbd`; its subcommands stand in flexmbd.command, one a file (docs/command_line.md).

Exit codes: 0 for success, 1 where what was asked for failed (a check, a simulation), 2 for wrong arguments and whatever
else ends in an error of flexmbd, 130 after Ctrl-C. Under `mpirun` every rank runs the same command, and rank 0 speaks;
a subcommand that is not collective runs there alone.
"""

from __future__ import annotations

import argparse
import importlib
import io
import os
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from flexmbd.command.terminal import Parser, is_root, print_line, print_warning
from flexmbd.errors import FlexmbdError

_FAULT = 2
_INTERRUPTED = 130
_BROKEN_PIPE = 141  # as a shell has it for a program that SIGPIPE ended


@dataclass(frozen=True)
class Subcommand:
    """One word after `flexmbd`; its module in `flexmbd.command` loads when it is asked for.

    Attributes:
        name: the word, and the name of the module, whose `describe` gives the parser its arguments and sets `run`,
            which takes them and returns the exit code.
        help: one line of `flexmbd --help`.
        collective: whether all ranks run it, or rank 0 alone.
    """

    name: str
    help: str
    collective: bool = False

    def describe(self, parser: argparse.ArgumentParser) -> None:
        """Load the subcommand, and give a parser its arguments."""
        importlib.import_module(f"flexmbd.command.{self.name}").describe(parser)


SUBCOMMANDS = (
    Subcommand("check", "run the contract of a form file on small meshes", collective=True),
    Subcommand("reduce", "reduce a STEP file or a mesh to a record", collective=True),
    Subcommand("inspect", "print a record as a readable summary"),
    Subcommand("export", "write a record for another program"),
    Subcommand("convert", "turn a file of a reduced body into another"),
    Subcommand("simulate", "simulate a scene from a TOML file"),
    Subcommand("plot", "draw results over time, or a record's frequencies"),
    Subcommand("compile", "compile the kernels of integrators, so that no simulation waits for them"),
    Subcommand("doctor", "say what is installed, and what to do about what is broken"),
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
        words = sys.argv[1:] if arguments is None else list(arguments)
        chosen = _parser(words).parse_args(words)
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


def _parser(words: Sequence[str]) -> Parser:
    """The parser of these words, with the arguments of the one subcommand that they name."""
    parser = Parser(
        prog="flexmbd",
        description="From a UFL form to a body that moves in a machine.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action=_Version)
    subcommands = parser.add_subparsers(title="subcommands", required=True, metavar="SUBCOMMAND")
    named = next((word for word in words if not word.startswith("-")), None)
    for one in SUBCOMMANDS:
        under = subcommands.add_parser(one.name, help=one.help, formatter_class=argparse.RawDescriptionHelpFormatter)
        under.set_defaults(collective=one.collective, refuse=under.error)
        if one.name == named:
            one.describe(under)
    return parser


class _Version(argparse.Action):
    """Prints the installed version, which it looks up when asked."""

    def __init__(self, option_strings: Sequence[str], dest: str) -> None:
        super().__init__(option_strings, dest, nargs=0, help="show program's version number and exit")

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> None:

        from importlib.metadata import PackageNotFoundError, version

        try:
            found = version("flexmbd")
        except PackageNotFoundError:  # run from a folder, not installed
            found = "(not installed)"
        print_line(f"flexmbd {found}")
        parser.exit()


def _forget_stdout() -> None:
    """Let the interpreter flush what the reader no longer wants into nothing."""
    try:
        nothing = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nothing, sys.stdout.fileno())
    except (OSError, ValueError):  # no file behind stdout
        return
