"""`flexmbd check my_form.py`: the contract of a form file."""

from __future__ import annotations

import argparse
from pathlib import Path

from flexmbd.command.terminal import print_line
from flexmbd.errors import FormulationError
from flexmbd.libraries import OF_THE_CONTINUUM, require


def describe(parser: argparse.ArgumentParser) -> None:
    """Give the subcommand's parser its arguments."""
    parser.description = (
        "Run the contract of a form file: every check on each cell and degree that the file claims, with figures; then "
        "reduce a small part and move it in a machine. The file is Python code, which runs: check only files whose "
        "source you trust. Exit code 0: all passed; 1: a check failed; 2: the file breaks the contract."
    )
    parser.epilog = "The check over ranks needs two of them: mpirun -n 2 flexmbd check my_form.py"
    parser.add_argument("form", help="a form file (my_form.py), or the name of a form of flexmbd")
    parser.add_argument(
        "--report",
        type=Path,
        metavar="DIR",
        help="write a page with tables and pictures for a paper into this folder, which is not there or empty: orders "
        "on meshes of several shapes, locking, inf-sup numbers, eigenvalues of one cell; a minute or two",
    )
    parser.set_defaults(run=check)


def check(arguments: argparse.Namespace) -> int:
    """The contract suite, printed as a sheet. Collective.

    Raises:
        MissingLibraryError: DOLFINx is not installed.
        FormulationError: the file cannot be loaded, or breaks the contract without a mesh.
        ExportError, PictureError: on all ranks: a report cannot be written there.
    """
    require("flexmbd check", *OF_THE_CONTINUUM, "gmsh")
    from mpi4py import MPI

    from flexmbd.command.form_report import form_report, stopped_report
    from flexmbd.command.form_road import road_checks
    from flexmbd.continuum import parallel
    from flexmbd.continuum.contract_suite import check_form
    from flexmbd.report import refuse_folder, write_report

    comm, folder = MPI.COMM_WORLD, arguments.report
    if folder is not None:
        parallel.on_root(comm, lambda: refuse_folder(folder))

    name: str = arguments.form
    source = Path(name) if name.endswith(".py") or "/" in name else name
    if isinstance(source, Path):
        _announce(source)
    try:
        sheet = check_form(source, comm=comm, further=road_checks)
    except FormulationError as error:
        stopped = error
        if folder is not None and isinstance(source, Path) and source.is_file():
            page = parallel.on_root(comm, lambda: write_report(stopped_report(source, stopped), folder))
            print_line(f"report: {page}")
        raise
    print_line(sheet.text())
    if folder is not None:
        page = parallel.on_root(comm, lambda: write_report(form_report(sheet, source), folder))
        print_line(f"report: {page}")
    return 0 if sheet.passed else 1


def _announce(source: Path) -> None:
    """Say that the file runs, if it does: one that cannot be read, or imports what it may not, is refused before."""
    from flexmbd.continuum.contract.violations import import_violations

    try:
        if not import_violations(source):
            print_line(f"{source} is Python code and runs now: check files whose source you trust")
    except FormulationError:
        return
