"""`flexmbd inspect rod.h5`: a record as a sheet for people, or as JSON for scripts."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np

from flexmbd.command.body_file import read_body
from flexmbd.command.terminal import add_json, print_json, print_line
from flexmbd.errors import InterfaceError
from flexmbd.libraries import OF_THE_CONTINUUM, require
from flexmbd.record.file_kind import RECORD
from flexmbd.record.groups import FRAME_DOFS, GROUPS
from flexmbd.record.record_comparison import compare_records
from flexmbd.record.reduced_body import ReducedBody
from flexmbd.record.summary import damping_ratios

_EXAMPLES = """\
examples:
  flexmbd inspect rod.h5
  flexmbd inspect rod.h5 --clamped big_end                     frequencies with an interface clamped
  flexmbd inspect rod.h5 --clamped big_end:x,y,z,rx,ry         on a hinge about z of its axes
  flexmbd inspect rod.h5 --report rod_report --mesh rod.msh --material steel.toml
  flexmbd inspect rod.h5 --report both --beside finer.h5       what another record of the part says
  flexmbd inspect rod.h5 --json | jq .frequencies.free[0]
"""


def describe(parser: argparse.ArgumentParser) -> None:
    """Give the subcommand's parser its arguments."""
    parser.description = (
        "Print the sheet of a reduced body: mass, interfaces, modes, what else is in it, where it is from."
    )
    parser.epilog = _EXAMPLES
    parser.add_argument("record", type=Path, help="a record, or another file of a reduced body that can be read")
    parser.add_argument(
        "--clamped",
        action="append",
        default=[],
        metavar="NAME[:DOFS]",
        help="tell the frequencies with this interface clamped, all of it or some of x,y,z,rx,ry,rz; repeat it",
    )
    report = parser.add_argument_group("a report")
    report.add_argument(
        "--report",
        type=Path,
        metavar="DIR",
        help="write a page with tables and pictures for a paper into this folder, which is not there or empty",
    )
    report.add_argument(
        "--mesh", type=Path, metavar="PART", help="of the report: the mesh that it was reduced from, to compare with"
    )
    report.add_argument("--scale", type=float, default=1.0, metavar="S", help="factor on the mesh's lengths")
    report.add_argument("--material", type=Path, metavar="FILE", help="of the report: the material file, with --mesh")
    report.add_argument(
        "--beside",
        type=Path,
        metavar="RECORD",
        help="of the report: another record of the part, as of more modes or another mesh, to compare with",
    )
    add_json(parser)
    parser.set_defaults(run=inspect)


def inspect(arguments: argparse.Namespace) -> int:
    """Print the record's sheet. Loads nothing of the continuum side but with --mesh; not collective.

    Raises:
        RecordError, ExportError: a file is missing, damaged, foreign, or of another version; a report cannot be
            written there, the mesh is another one, or the other record has no interface of the same name.
        InterfaceError: no interface, or no component of one, has that name.
    """
    folder = arguments.report
    if (arguments.mesh is None) != (arguments.material is None) or (arguments.mesh is not None and folder is None):
        arguments.refuse("--mesh PART and --material FILE go together, and with --report DIR")
    if arguments.beside is not None and folder is None:
        arguments.refuse("--beside RECORD goes with --report DIR")
    if folder is not None:
        from flexmbd.report import refuse_folder

        refuse_folder(folder)
    body = read_body(arguments.record)
    clamped = parse_clamped(arguments.clamped)
    held = body.frequencies(clamped) if clamped else None
    page = None if folder is None else _reported(arguments, body)
    if arguments.json:
        written = {} if page is None else {"report": page}
        print_json({**facts(body, file=arguments.record, clamped=clamped), **written})
        return 0
    print_line(body.inspect().rstrip("\n"))
    if held is not None:
        print_line(f"\nfrequencies (Hz) with {' and '.join(arguments.clamped)} clamped")
        for number, frequency in enumerate(held, start=1):
            print_line(f"  {number:>5}{frequency:>14.6g}")
    if page is not None:
        print_line(f"\nreport: {page}")
    return 0


def _reported(arguments: argparse.Namespace, body: ReducedBody) -> Path:
    """Write the report; return its page."""
    from flexmbd.command.record_report import record_report
    from flexmbd.report import write_report

    other = arguments.beside
    beside = None if other is None else compare_records(body, read_body(other))
    if arguments.mesh is not None:
        require("flexmbd inspect --mesh", *OF_THE_CONTINUUM, "gmsh")
    found = record_report(
        body, arguments.record, mesh=arguments.mesh, scale=arguments.scale, material=arguments.material,
        beside=beside, other=other,
    )  # fmt: skip
    return write_report(found, arguments.report)


def ratio_facts(body: ReducedBody) -> dict[str, Any]:
    """Damping ratios of the free body, and of the one held at each interface by itself."""
    free, *held = damping_ratios(body).items()
    return {"free": free[1], "held": dict(held)}


def parse_clamped(texts: list[str]) -> dict[str, tuple[str, ...]]:
    """Components by interface, of texts `NAME` or `NAME:x,y,rz`.

    Raises:
        InterfaceError: a name is given twice, or no component after the colon.
    """
    clamped: dict[str, tuple[str, ...]] = {}
    for text in texts:
        name, colon, components = text.rpartition(":")
        chosen = tuple(part.strip() for part in components.split(",")) if colon else FRAME_DOFS
        name = name if colon else text
        if name in clamped or not name:
            raise InterfaceError(f"--clamped {text}: {'is given twice' if name else 'it has no name'}")
        clamped[name] = chosen
    return clamped


def facts(body: ReducedBody, *, file: Path, clamped: dict[str, tuple[str, ...]]) -> dict[str, Any]:
    """The facts that `flexmbd inspect --json` prints; docs/command_line.md lists them."""
    held = None
    if clamped:
        held = {"interfaces": clamped, "hz": body.frequencies(clamped)}
    return {
        "file": file,
        "record_version": RECORD.version,
        "fingerprint": body.fingerprint(),
        "mass": body.mass,
        "com": body.com,
        "inertia": body.inertia,
        "frame": body.frame,
        "p_MB_M": body.p_MB_M,
        "R_MB": body.R_MB,
        "n_modes": body.n_modes,
        "interfaces": [{"name": one.name, "p_BI_B": one.p_BI_B, "R_BI": one.R_BI} for one in body.interfaces],
        "frequencies": {
            "free": body.frequencies(),
            "frame_held": np.sqrt(body.stiffness) / (2.0 * np.pi),
            "clamped": held,
        },
        "damping_ratios": ratio_facts(body),
        "partition": body.partition_names,
        "groups": {name: getattr(body, name) is not None for name in GROUPS},
        "provenance": dict(body.provenance),
    }
