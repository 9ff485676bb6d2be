"""`flexmbd reduce part.step ... -o rod.h5`: from a STEP file or a mesh to a record, in one command."""

from __future__ import annotations

import argparse
import dataclasses
import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flexmbd.command.body_file import check_free
from flexmbd.command.inspect import ratio_facts
from flexmbd.command.material_file import Material, make_damping, make_parameters, read_material
from flexmbd.command.terminal import add_json, print_json, print_line, print_progress, wants_bar
from flexmbd.coupling import Coupling
from flexmbd.errors import FormulationError, InterfaceError, MeshError
from flexmbd.libraries import OF_THE_CONTINUUM, require
from flexmbd.record.summary import ratio_lines

if TYPE_CHECKING:
    from flexmbd.continuum import Interface, NodalInterface, SurfaceSupport
    from flexmbd.record.reduced_body import ReducedBody
    from flexmbd.reduction import InterfaceModes

_EXAMPLES = """\
examples:
  flexmbd reduce part.step --list                              which faces there are, and which are bores
  flexmbd reduce part.step --material steel.toml --interface bore_1 --interface bore_2 --modes 20 -o part.h5
  flexmbd reduce part.step --tag foot=5 --tag pin=radius:0.008 --interface foot --interface pin:averaged \\
      --material steel.toml --size 0.004 --below-hz 2000 -o part.h5
  flexmbd reduce rod.msh --form solid_linear --parameter E=2.1e11 --parameter nu=0.3 --parameter rho=7850 \\
      --interface big_end --interface small_end --frame big_end --modes 12 -o rod.h5
  mpirun -n 4 flexmbd reduce ...

docs/command_line.md says what a material file holds.
"""


def describe(parser: argparse.ArgumentParser) -> None:
    """Give the subcommand's parser its arguments."""
    parser.description = (
        "Reduce a part, a STEP file or a mesh, by Craig-Bampton to the record of a flexible body, a HDF5 file."
    )
    parser.epilog = _EXAMPLES
    _describe_part(parser)
    _describe_model(parser)
    _describe_reduction(parser)
    parser.set_defaults(run=reduce)


def _describe_part(parser: argparse.ArgumentParser) -> None:
    part = parser.add_argument_group("the part")
    part.add_argument(
        "mesh",
        type=Path,
        metavar="PART",
        help="a STEP file (.step, .stp), or a mesh with groups (.msh, .h5, .inp, .bdf, .nas, .cdb, .med); lengths in m",
    )
    part.add_argument("--list", action="store_true", help="list the faces of the STEP file, or the mesh's groups; stop")
    part.add_argument(
        "--tag",
        action="append",
        default=[],
        metavar="NAME=FACES",
        help="of a STEP file: name faces by their numbers in --list (foot=5 or pins=11,12), by the radius of cylinders "
        "(pin=radius:0.008) or by points on them (top=point:0,0,0.1); repeat it. Bores have the names bore_1, ...",
    )
    part.add_argument("--size", type=float, metavar="H", help="of a STEP file: size of the cells (m; default: chosen)")
    part.add_argument(
        "--scale", type=float, default=1.0, metavar="S", help="factor on all lengths, 1e-3 for a mesh in millimetres"
    )
    part.add_argument("--solid", type=int, metavar="K", help="of a STEP file with several solids take this one, from 1")
    part.add_argument("--glue", action="store_true", help="of a STEP file with several solids take all, joined")


def _describe_model(parser: argparse.ArgumentParser) -> None:
    model = parser.add_argument_group("the model")
    kind = model.add_mutually_exclusive_group()
    kind.add_argument("--material", type=Path, metavar="FILE", help="a TOML file with form, parameters, damping")
    kind.add_argument("--form", help="instead: a form file (my_form.py), or the name of a form of flexmbd")
    model.add_argument(
        "--parameter",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="of the form, in SI units, also in place of the material file's; repeat it",
    )
    model.add_argument("--degree", type=int, default=2, help="of the displacement (default: 2)")
    model.add_argument(
        "--interface",
        action="append",
        default=[],
        metavar="NAME[:COUPLING]",
        help="a named group of faces that becomes a frame, rigid (the default) or averaged, or whose nodes keep their "
        "own dofs, nodal; repeat it",
    )
    model.add_argument(
        "--symmetry",
        action="append",
        default=[],
        metavar="NAME=AXIS",
        help="faces on a plane of symmetry with the normal x, y or z, of a half or a quarter of a part; repeat it",
    )
    model.add_argument(
        "--roller", action="append", default=[], metavar="NAME=AXIS", help="faces that do not move along x, y or z"
    )
    frame = model.add_mutually_exclusive_group()
    frame.add_argument("--frame", metavar="NAME", help="the interface that carries the body frame (default: the first)")
    frame.add_argument("--floating", action="store_true", help="the body frame floats on the mean axis")
    model.add_argument(
        "--damping-ratio",
        type=float,
        metavar="Z",
        help="of every mode of the free body, between 0 and 1, in place of the file's",
    )
    model.add_argument(
        "--damping-held",
        action="append",
        default=[],
        metavar="NAME",
        help="an interface that is held in the modes that have the ratio; repeat it",
    )


def _describe_reduction(parser: argparse.ArgumentParser) -> None:
    reduction = parser.add_argument_group("the reduction")
    reduction.add_argument("--modes", type=int, metavar="N", help="number of fixed-interface modes")
    reduction.add_argument(
        "--below-hz", type=float, metavar="F", help="instead of a number: all of them below F Hz; with --tol its range"
    )
    reduction.add_argument(
        "--tol",
        type=float,
        metavar="E",
        help="instead of a number: as many as bring the relative error of the eigenvalues (2 pi f)^2 down to E",
    )
    reduction.add_argument("--free", action="store_true", help="modes of the free body instead of fixed-interface ones")
    reduction.add_argument(
        "--interface-modes",
        type=int,
        metavar="N",
        help="N characteristic modes in the place of the static shapes of every interface but --joint and --frame",
    )
    reduction.add_argument(
        "--interface-tol",
        type=float,
        metavar="E",
        help="instead of N: as many as add no more than E to the relative error of the eigenvalues",
    )
    reduction.add_argument(
        "--joint", action="append", default=[], metavar="NAME", help="an interface that keeps its own; repeat it"
    )
    reduction.add_argument(
        "--residual-vectors",
        action="store_true",
        help="add what the modes that are left out do in statics under the body's own inertia forces, for stresses",
    )
    reduction.add_argument("--no-geometric-stiffness", action="store_true", help="leave out what loads add to it")
    reduction.add_argument("--keep-modes", action="store_true", help="keep the modes at all nodes of the mesh")
    reduction.add_argument("--keep-surface", action="store_true", help="keep the surface, for pictures")
    reduction.add_argument("-o", "--output", type=Path, metavar="FILE", help="the record, as rod.h5")
    reduction.add_argument("--force", action="store_true", help="replace a record that exists")
    add_json(reduction)


def reduce(arguments: argparse.Namespace) -> int:
    """Read or make the mesh, assemble, reduce, and write the record whole or not at all. Collective.

    Raises:
        FlexmbdError: on all ranks, with whatever is wrong; what can be seen early is seen before the mesh is read.
    """
    require("flexmbd reduce", *OF_THE_CONTINUUM, "gmsh")
    from mpi4py import MPI

    from flexmbd.command.part_file import list_part, mesh_part
    from flexmbd.continuum import ContinuumModel, NodalInterface, parallel
    from flexmbd.continuum.contract.formulation import load_form
    from flexmbd.reduction import Keep, Truncation, craig_bampton
    from flexmbd.reduction.modes.truncation import chosen_truncation

    comm = MPI.COMM_WORLD
    if arguments.list:
        print_line(list_part(arguments.mesh, scale=arguments.scale, comm=comm))
        return 0
    _require(arguments)
    interfaces = [parse_interface(text) for text in arguments.interface]
    supports = parse_supports(arguments.symmetry, arguments.roller)
    given = Truncation(arguments.modes, below_hz=arguments.below_hz, tol=arguments.tol, free=arguments.free)
    truncation = chosen_truncation(given)
    characteristic = _interface_modes(arguments)
    parallel.on_root(comm, lambda: check_free(arguments.output, force=arguments.force, source=arguments.mesh))
    material = parallel.on_root(comm, lambda: _material(arguments))
    damping = make_damping(material.damping, held=material.held)
    is_path = material.form.endswith(".py") or "/" in material.form
    form: Any = load_form(Path(material.form) if is_path else material.form)
    parameters = make_parameters(form, material.parameters)
    print_progress(f"reading {arguments.mesh}")
    mesh, size = mesh_part(
        arguments.mesh,
        tags=arguments.tag,
        size=arguments.size,
        scale=arguments.scale,
        solid=arguments.solid,
        glue=arguments.glue,
        degree=arguments.degree,
        comm=comm,
    )
    frames = [one.name for one in interfaces if not isinstance(one, NodalInterface)]
    frame = None if arguments.floating else arguments.frame or next(iter(frames), None)
    print_progress("assembling")
    model = ContinuumModel(
        mesh, form, parameters, degree=arguments.degree, interfaces=interfaces, supports=supports
    )
    print_progress("reducing")
    body = craig_bampton(
        model,
        modes=truncation,
        frame=frame,
        geometric_stiffness=not arguments.no_geometric_stiffness,
        damping=damping,
        keep=Keep(modes=arguments.keep_modes, surface=arguments.keep_surface),
        interface_modes=characteristic,
        residual_vectors=arguments.residual_vectors,
        progress=parallel.on_root(comm, wants_bar),
        stream=arguments.output,
    )
    _report(arguments.output, body, size, as_json=arguments.json)
    return 0


def _interface_modes(arguments: argparse.Namespace) -> InterfaceModes | None:
    """What --interface-modes, --interface-tol and --joint ask for."""
    from flexmbd.reduction import InterfaceModes, Truncation
    from flexmbd.reduction.modes.truncation import chosen_truncation

    if arguments.interface_modes is None and arguments.interface_tol is None:
        if arguments.joint:
            arguments.refuse("--joint NAME goes with --interface-modes or --interface-tol")
        return None
    wanted = Truncation(arguments.interface_modes, tol=arguments.interface_tol)
    return InterfaceModes(chosen_truncation(wanted), joints=tuple(arguments.joint))


def _require(arguments: argparse.Namespace) -> None:
    """End the command as argparse does where an argument lacks that `--list` alone can do without."""
    if arguments.output is None:
        arguments.refuse("the following arguments are required: -o/--output")
    if arguments.material is None and arguments.form is None:
        arguments.refuse("one of the arguments --material --form is required")


def _material(arguments: argparse.Namespace) -> Material:
    """The material file, or --form, with what the command line says in its place. Not collective."""
    given = parse_parameters(arguments.parameter)
    if arguments.material is None:
        material = Material(arguments.form, given, {})
    else:
        material = read_material(arguments.material)
        material = dataclasses.replace(material, parameters={**material.parameters, **given})
    if arguments.damping_ratio is not None:
        material = dataclasses.replace(material, damping={"ratio": arguments.damping_ratio}, held=())
    if arguments.damping_held:
        if not {"ratio", "alpha"} & set(material.damping):
            raise FormulationError(
                "--damping-held goes with --damping-ratio, or with a material file that has ratio, or alpha and beta"
            )
        material = dataclasses.replace(material, held=tuple(arguments.damping_held))
    return material


def _report(path: Path, body: ReducedBody, size: float | None, *, as_json: bool) -> None:
    """Say what was written."""
    lowest = math.sqrt(body.stiffness[0]) / (2 * math.pi) if body.n_modes else None
    if as_json:
        found = {"file": path, "n_modes": body.n_modes, "lowest_hz": lowest, "cell_size": size, "mass": body.mass}
        print_json({**found, "damping_ratios": ratio_facts(body), "fingerprint": body.fingerprint()})
        return
    cells = "" if size is None else f", cells of {size:.3g} m"
    frequency = "" if lowest is None else f", the lowest at {lowest:.6g} Hz"
    print_line(f"{path}: {body.n_modes} modes{frequency}{cells}; `flexmbd inspect {path}` shows it")
    for line in ratio_lines(body):
        print_line(line)


def parse_interface(text: str) -> Interface | NodalInterface:
    """The interface `NAME`, `NAME:rigid`, `NAME:averaged` or `NAME:nodal`.

    Raises:
        InterfaceError: another coupling, or no name.
    """
    from flexmbd.continuum import Interface, NodalInterface

    name, colon, coupling = text.rpartition(":")
    if not colon:
        name, coupling = text, "rigid"
    known = {one.name.lower(): one for one in Coupling}
    if coupling == "nodal" and name:
        return NodalInterface(name)
    if coupling not in known or not name:
        raise InterfaceError(f"--interface {text}: write NAME, or NAME:COUPLING with {', '.join(known)} or nodal")
    return Interface(name, coupling=known[coupling])


def parse_supports(symmetry: Sequence[str], rollers: Sequence[str]) -> list[SurfaceSupport]:
    """The supports of `NAME=AXIS` texts.

    Raises:
        MeshError: a text is another.
    """
    from flexmbd.continuum import Roller, SymmetryPlane

    found: list[SurfaceSupport] = []
    for word, texts in (("symmetry", symmetry), ("roller", rollers)):
        for text in texts:
            name, _, axis = (part.strip() for part in text.rpartition("="))
            if not name or axis not in ("x", "y", "z"):
                raise MeshError(f"--{word} {text}: write NAME=AXIS with x, y or z, as middle=x")
            direction = tuple(float(axis == one) for one in "xyz")
            found.append(SymmetryPlane(name, direction) if word == "symmetry" else Roller(name, direction))
    return found


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
