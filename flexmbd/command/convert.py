"""`flexmbd convert IN OUT`: a file of a reduced body into another, through the record."""

from __future__ import annotations

import argparse
from pathlib import Path

from flexmbd.command.body_file import RECORD, check_free, kind_of, read_body, write_body
from flexmbd.command.export import add_writing, report_written
from flexmbd.command.format_options import add_options, given_options
from flexmbd.errors import RecordError
from flexmbd.export import FORMATS, format_named


def describe(parser: argparse.ArgumentParser) -> None:
    """Give the subcommand's parser its arguments."""
    readable = ", ".join([RECORD, *(one.name for one in FORMATS if one.read is not None)])
    writable = ", ".join([RECORD, *(one.name for one in FORMATS)])
    parser.description = "Read a reduced body from one file and write it to another, each by what its name ends in."
    parser.epilog = f"""\
from: {readable}
to:   {writable}

examples:
  flexmbd convert rod.SID_FEM rod.h5
  flexmbd convert rod.fem rod.npz --to exudyn
"""
    parser.add_argument("source", type=Path, metavar="IN", help="the file to read")
    parser.add_argument("output", type=Path, metavar="OUT", help="the file to write")
    parser.add_argument("--from", dest="source_kind", metavar="FORMAT", help="of IN; default: by its name")
    parser.add_argument("--to", dest="output_kind", metavar="FORMAT", help="of OUT; default: by its name")
    add_options(parser)
    add_writing(parser)
    parser.set_defaults(run=convert)


def convert(arguments: argparse.Namespace) -> int:
    """Read, write, and print what the new file leaves out. Not collective.

    Raises:
        RecordError, ExportError: as `flexmbd export`; or the body cannot be read.
    """
    kind: str = arguments.output_kind or kind_of(arguments.output)
    if kind == RECORD and arguments.options:
        raise RecordError("a record has no options; they are those of other programs' formats")
    options = {} if kind == RECORD else given_options(format_named(kind), arguments.options, with_deck=False)[0]
    check_free(arguments.output, force=arguments.force, source=arguments.source)
    body = read_body(arguments.source, kind=arguments.source_kind)
    left_out = write_body(body, arguments.output, kind=kind, lossy=arguments.lossy, options=options)
    report_written(arguments.output, kind, left_out, as_json=arguments.json)
    return 0
