"""`flexmbd export part.h5 --to FORMAT`: a record for another program."""

from __future__ import annotations

import argparse
from pathlib import Path

from flexmbd.command.body_file import check_free, read_body, write_body
from flexmbd.command.format_options import add_options, given_options, options_told
from flexmbd.command.terminal import add_json, print_json, print_line
from flexmbd.errors import ExportError
from flexmbd.export import FORMATS, format_named


def describe(parser: argparse.ArgumentParser) -> None:
    """Give the subcommand's parser its arguments."""
    width = max(len(one.name) for one in FORMATS)
    formats = "\n".join(f"  {one.name:<{width}}  {one.suffix:<10}  {one.programs}" for one in FORMATS)
    parser.description = "Write a reduced body in the format of another program, and say what the file leaves out."
    parser.epilog = f"""\
formats:
{formats}

options, with what holds without them:
{options_told()}

examples:
  flexmbd export rod.h5 --to mbdyn
  flexmbd export rod.h5 --to fmu --option fmi=2 --option step=1e-4
  flexmbd export tower.h5 --to openfast --option interface=foot
  flexmbd export rod.h5 --to mbdyn --deck pendulum.mbd --option end=2.0
  flexmbd export rod.h5 --to exudyn -o for_a_friend.npz --lossy --force --json
"""
    parser.add_argument("record", type=Path, help="a record, or another file of a reduced body that can be read")
    parser.add_argument("--to", required=True, metavar="FORMAT", help="see below, or a Python file of your own")
    parser.add_argument(
        "-o", "--output", type=Path, metavar="FILE", help="default: beside the record, with the format's suffix"
    )
    parser.add_argument("--deck", type=Path, metavar="FILE", help="also an input deck that runs it, where there is one")
    add_options(parser)
    add_writing(parser)
    parser.set_defaults(run=export)


def add_writing(parser: argparse.ArgumentParser) -> None:
    """Give a parser the arguments of all that write a body."""
    parser.add_argument("--force", action="store_true", help="replace a file that exists")
    parser.add_argument(
        "--lossy", action="store_true", help="write the body even where the format cannot carry all that it is"
    )
    add_json(parser)


def export(arguments: argparse.Namespace) -> int:
    """Read the body, write the file, and print what it leaves out. Not collective.

    Raises:
        RecordError, ExportError: there is no such format; a file cannot be read or written, or exists; the format
            cannot carry the body.
    """
    chosen = format_named(arguments.to)
    deck: Path | None = arguments.deck
    if deck is not None and chosen.deck is None:
        having = ", ".join(one.name for one in FORMATS if one.deck is not None)
        raise ExportError(f"there is no deck for {chosen.name}; there is for {having}")
    options, of_deck = given_options(chosen, arguments.options, with_deck=deck is not None)
    source: Path = arguments.record
    output: Path = arguments.output or source.with_name(source.stem + chosen.suffix)
    check_free(output, force=arguments.force, source=source)
    if deck is not None:
        check_free(deck, force=arguments.force, source=source)
    body = read_body(source)
    left_out = write_body(body, output, kind=arguments.to, lossy=arguments.lossy, options=options)
    if deck is not None and chosen.deck is not None:
        chosen.deck(body, output, deck, **of_deck)
    report_written(output, chosen.name, left_out, as_json=arguments.json)
    return 0


def report_written(path: Path, kind: str, left_out: tuple[str, ...], *, as_json: bool) -> None:
    """Say what was written, and what the file leaves out."""
    if as_json:
        print_json({"file": path, "format": kind, "bytes": path.stat().st_size, "left_out": left_out})
        return
    print_line(f"{path}: written as {kind}")
    for phrase in left_out:
        print_line(f"  left out: {phrase}")
