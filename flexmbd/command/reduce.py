"""`flexmbd reduce part.msh ... -o rod.h5`: from a mesh file to a record, in one command."""

from __future__ import annotations

import argparse
import dataclasses
import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flexmbd.coupling import Coupling
from flexmbd.errors import FlexmbdError, FormulationError, InterfaceError
from flexmbd.record_file import check_destination

if TYPE_CHECKING:
    from types import ModuleType

    from flexmbd.continuum import Interface

_EXAMPLE = (
    "flexmbd reduce rod.msh --form solid_linear --parameter E=2.1e11 --parameter nu=0.3 --parameter rho=7850 "
    "--interface big_end --interface small_end:averaged --frame big_end --modes 12 -o rod.h5"
)


def describe(parser: argparse.ArgumentParser) -> None:
    """Give the subcommand's parser its arguments."""
    parser.description = "Reduce a meshed part by Craig-Bampton to the record of a flexible body, a HDF5 file."
    parser.epilog = f"Example: {_EXAMPLE}. On several processes: mpirun -n 4 flexmbd reduce ..."
    parser.add_argument("mesh", type=Path, help="a file (.msh, .h5, .inp, .bdf, .nas), lengths in m, named groups")
    parser.add_argument("--form", required=True, help="a form file (my_form.py), or the name of a form of flexmbd")
    parser.add_argument(
        "--parameter", action="append", default=[], metavar="NAME=VALUE", help="of the form, in SI units; repeat it"
    )
    parser.add_argument("--degree", type=int, default=2, help="of the displacement (default: 2)")
    parser.add_argument(
        "--interface",
        action="append",
        default=[],
        metavar="NAME[:COUPLING]",
        help="a physical group that becomes a frame, rigid (the default) or averaged; repeat it",
    )
    frame = parser.add_mutually_exclusive_group(required=True)
    frame.add_argument("--frame", metavar="NAME", help="the interface that carries the body frame")
    frame.add_argument("--floating", action="store_true", help="the body frame floats on the mean axis")
    parser.add_argument("--modes", type=int, metavar="N", help="number of fixed-interface modes")
    parser.add_argument(
        "--below-hz", type=float, metavar="F", help="instead of a number: all of them below F Hz; with --tol its range"
    )
    parser.add_argument(
        "--tol",
        type=float,
        metavar="E",
        help="instead of a number: as many as bring the relative error of the eigenvalues (2 pi f)^2 down to E",
    )
    parser.add_argument(
        "--damping-ratio", type=float, metavar="Z", help="of every mode, between 0 and 1 (default: no damping)"
    )
    parser.add_argument("--no-geometric-stiffness", action="store_true", help="leave out what loads add to it")
    parser.add_argument("--keep-modes", action="store_true", help="keep the modes at all nodes of the mesh")
    parser.add_argument("--keep-surface", action="store_true", help="keep the surface, for pictures")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="FILE", help="the record, as rod.h5")
    parser.set_defaults(run=reduce)


def reduce(arguments: argparse.Namespace) -> int:
    """Read the mesh, assemble, reduce, and write the record whole or not at all. Collective.

    Raises:
        FlexmbdError: on all ranks, with whatever is wrong; what can be seen early is seen before the mesh is read.
    """
    from mpi4py import MPI

    from flexmbd.continuum import ContinuumModel, parallel
    from flexmbd.continuum.formulation import load
    from flexmbd.meshes import read
    from flexmbd.reduction import ModalDamping, craig_bampton
    from flexmbd.reduction.truncation import chosen_truncation

    comm = MPI.COMM_WORLD
    interfaces = [parse_interface(text) for text in arguments.interface]
    values = parse_parameters(arguments.parameter)
    damping = None if arguments.damping_ratio is None else ModalDamping(arguments.damping_ratio)
    chosen_truncation(modes=arguments.modes, below_hz=arguments.below_hz, tol=arguments.tol)
    parallel.on_root(comm, lambda: check_destination(arguments.output))
    name: str = arguments.form
    form: Any = load(Path(name) if name.endswith(".py") or "/" in name else name)
    parameters = make_parameters(form, values)
    mesh = read(arguments.mesh, comm=comm)
    model = ContinuumModel(mesh, form, parameters, degree=arguments.degree, interfaces=interfaces)
    body = craig_bampton(
        model,
        modes=arguments.modes,
        below_hz=arguments.below_hz,
        tol=arguments.tol,
        frame=None if arguments.floating else arguments.frame,
        geometric_stiffness=not arguments.no_geometric_stiffness,
        damping=damping,
        keep_modes=arguments.keep_modes,
        keep_surface=arguments.keep_surface,
    )
    parallel.on_root(comm, lambda: body.save(arguments.output))
    if comm.rank == 0:
        frequency = f", the lowest at {math.sqrt(body.stiffness[0]) / (2 * math.pi):.6g} Hz" if body.n_modes else ""
        print(f"{arguments.output}: {body.n_modes} modes{frequency}; `flexmbd inspect {arguments.output}` shows it")
    return 0


def parse_interface(text: str) -> Interface:
    """The interface `NAME`, `NAME:rigid` or `NAME:averaged`.

    Raises:
        InterfaceError: another coupling, or no name.
    """
    from flexmbd.continuum import Interface

    name, colon, coupling = text.rpartition(":")
    if not colon:
        name, coupling = text, "rigid"
    known = {one.name.lower(): one for one in Coupling}
    if coupling not in known or not name:
        raise InterfaceError(f"--interface {text}: write NAME, or NAME:COUPLING with {' or '.join(known)}")
    return Interface(name, coupling=known[coupling])


def parse_parameters(texts: Sequence[str]) -> dict[str, float]:
    """The values of `NAME=VALUE` texts.

    Raises:
        FormulationError: a text is another, its value no number, or a name is given twice.
    """
    values: dict[str, float] = {}
    for text in texts:
        name, _, number = (part.strip() for part in text.partition("="))
        try:
            value = float(number)
        except ValueError:
            raise FormulationError(f"--parameter {text}: write NAME=VALUE with a number, as E=2.1e11") from None
        if not name or name in values:
            raise FormulationError(f"--parameter {text}: {'is given twice' if name else 'it has no name'}")
        values[name] = value
    return values


def make_parameters(form: ModuleType, values: dict[str, float]) -> Any:
    """The form's `Parameters` with these values.

    Raises:
        FormulationError: a field is missing or unknown, or a value out of its range.
    """
    fields = dataclasses.fields(form.Parameters)
    needed = [
        field.name
        for field in fields
        if field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING
    ]
    missing = [name for name in needed if name not in values]
    unknown = [name for name in values if name not in {field.name for field in fields}]
    faults = [f"{kind} {', '.join(names)}" for kind, names in (("no", missing), ("unknown", unknown)) if names]
    if faults:
        raise FormulationError(
            f"{form.__name__} has the parameters {', '.join(field.name for field in fields)}; {'; '.join(faults)}: "
            "give each as --parameter NAME=VALUE"
        )
    try:
        return form.Parameters(**values)
    except FlexmbdError:
        raise
    except (TypeError, ValueError) as error:
        raise FormulationError(f"{form.__name__}: {error}") from error
