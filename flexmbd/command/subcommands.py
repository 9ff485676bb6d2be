"""The words that may follow `flexmbd`, and the parser of a command line."""

from __future__ import annotations

import argparse
import difflib
import importlib
from collections.abc import Sequence
from dataclasses import dataclass

from flexmbd.command.terminal import Parser, print_line


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
    Subcommand("sweep", "simulate a scene from a TOML file many times, with other values"),
    Subcommand("plot", "draw results over time, or a record's frequencies"),
    Subcommand("example", "write a scene to begin with, and its files, into a folder"),
    Subcommand("completion", "print a script that completes commands and options in a shell"),
    Subcommand("compile", "compile the kernels of integrators, so that no simulation waits for them"),
    Subcommand("doctor", "say what is installed, and what to do about what is broken"),
)

_EPILOG = """\
exit codes: 0 success; 1 what was asked for failed (a check, a simulation); 2 wrong arguments or files; 130 Ctrl-C

flexmbd SUBCOMMAND --help shows the arguments of each, with examples
"""


def new_parser(words: Sequence[str]) -> Parser:
    """The parser of these words, with the arguments of the one subcommand that they name."""
    parser = Parser(
        prog="flexmbd",
        description="From a UFL form to a body that moves in a machine.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action=_Version)
    parser.set_defaults(subcommands=SUBCOMMANDS)  # which `completion` lists
    subcommands = parser.add_subparsers(title="subcommands", required=True, metavar="SUBCOMMAND")
    named = next((word for word in words if not word.startswith("-")), None)
    if named is not None and named not in (one.name for one in SUBCOMMANDS):
        parser.error(f"there is no subcommand {named!r}; {_meant(named, [one.name for one in SUBCOMMANDS])}")
    for one in SUBCOMMANDS:
        under = subcommands.add_parser(one.name, help=one.help, formatter_class=argparse.RawDescriptionHelpFormatter)
        under.set_defaults(collective=one.collective, refuse=under.error, options=under.long_options)
        if one.name == named:
            one.describe(under)
    return parser


def parsed(words: Sequence[str]) -> argparse.Namespace:
    """The arguments of a command line; wrong words end the process with code 2, and the nearest right ones."""
    found, unknown = new_parser(words).parse_known_args(words)
    if unknown:
        options = [word.partition("=")[0] for word in unknown if word.startswith("-")]
        meant = f"; {_meant(options[0], found.options())}" if options else ""
        found.refuse(f"unrecognized arguments: {' '.join(unknown)}{meant}")
    return found


def _meant(word: str, known: Sequence[str]) -> str:
    near = difflib.get_close_matches(word, known, n=1)
    return f"did you mean {near[0]!r}?" if near else f"there are {', '.join(known)}"


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
