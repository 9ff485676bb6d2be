"""The command `flexmbd`: one subcommand a function, which loads what it needs when it is called.

Each subcommand has a function `_add_NAME` that describes its arguments, and the function that runs
it and returns the exit code: 0 for success, 1 where what was asked for failed. Errors of flexmbd
end the command with one message and the exit code 2, as wrong arguments do. Under `mpirun` every
rank runs the same command, and rank 0 speaks.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from flexmbd.cli_reduce import describe as describe_reduce
from flexmbd.errors import FlexmbdError
from flexmbd.reduced import ReducedBody

if TYPE_CHECKING:
    Subcommands = argparse._SubParsersAction[argparse.ArgumentParser]

_FAULT = 2


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one subcommand; collective where the subcommand is.

    Args:
        arguments: the words after `flexmbd`; those of the command line if None.

    Returns:
        The exit code.
    """
    parser = argparse.ArgumentParser(
        prog="flexmbd", description="From a UFL form to a body that moves in a machine."
    )
    subcommands = parser.add_subparsers(title="subcommands", required=True, metavar="SUBCOMMAND")
    for add in (_add_check, _add_reduce, _add_inspect):
        add(subcommands)
    chosen = parser.parse_args(arguments)
    run: Callable[[argparse.Namespace], int] = chosen.run
    try:
        return run(chosen)
    except FlexmbdError as error:
        if _is_root():
            print(f"flexmbd: {error}", file=sys.stderr)
        return _FAULT


def _is_root() -> bool:
    """Whether this process speaks; without loading MPI where nothing else has."""
    if "mpi4py.MPI" not in sys.modules:
        return True
    from mpi4py import MPI

    return bool(MPI.COMM_WORLD.rank == 0)


def _add_check(subcommands: Subcommands) -> None:
    parser = subcommands.add_parser(
        "check",
        help="run the contract of a form file on small meshes",
        description="Run the contract of a form file: every check on each cell and degree that the file claims, "
        "with figures. Exit code 0: all passed; 1: a check failed; 2: the file breaks the contract.",
        epilog="The check over ranks needs two of them: mpirun -n 2 flexmbd check my_form.py",
    )
    parser.add_argument("form", help="a form file (my_form.py), or the name of a form of flexmbd")
    parser.set_defaults(run=check)


def check(arguments: argparse.Namespace) -> int:
    """`flexmbd check my_form.py`: the contract suite, printed as a sheet. Collective.

    Raises:
        FormulationError: the file cannot be loaded, or breaks the contract without a mesh.
    """
    from mpi4py import MPI

    from flexmbd.continuum.contract_suite import check_form

    name: str = arguments.form
    source = Path(name) if name.endswith(".py") or "/" in name else name
    sheet = check_form(source, comm=MPI.COMM_WORLD)
    if MPI.COMM_WORLD.rank == 0:
        print(sheet.text())
    return 0 if sheet.passed else 1


def _add_reduce(subcommands: Subcommands) -> None:
    describe_reduce(
        subcommands.add_parser(
            "reduce",
            help="reduce a meshed part to a record",
            description="Reduce a meshed part by Craig-Bampton to the record of a flexible body, a HDF5 file.",
        )
    )


def _add_inspect(subcommands: Subcommands) -> None:
    parser = subcommands.add_parser(
        "inspect",
        help="print a record as a readable sheet",
        description="Print the sheet of a reduced body: mass, interfaces, modes, what else is in it, where it is from.",
    )
    parser.add_argument("record", type=Path, help="a file that `flexmbd reduce` or ReducedBody.save wrote")
    parser.set_defaults(run=inspect)


def inspect(arguments: argparse.Namespace) -> int:
    """`flexmbd inspect rod.h5`: the record's sheet. Loads nothing of the continuum side; not collective.

    Raises:
        RecordError: the file is missing, damaged, foreign, or of another version.
    """
    print(ReducedBody.load(arguments.record).inspect(), end="")
    return 0
