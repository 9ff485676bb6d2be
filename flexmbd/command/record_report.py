"""The report of `flexmbd inspect part.h5 --report DIR`: the record, and with its mesh the full model beside it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from flexmbd.command.inspect import ratio_facts
from flexmbd.command.terminal import print_progress
from flexmbd.errors import RecordError
from flexmbd.record.held_modes import interface_motion
from flexmbd.record.reduced_body import ReducedBody
from flexmbd.report import Cell, Content, Line, Listing, Paragraph, Picture, Report, Section, Table, diagram
from flexmbd.report.folder import file_digest

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from flexmbd.reduction.full_comparison import Comparison

FloatArray = NDArray[np.float64]

_COUNT = 40  # of frequencies of a response
_BEGIN, _END = 0.2, 1.05  # of the first frequency, and of the last that the record is shown for
_NO_MODEL = (
    "A record holds no mesh and no matrices, so that it was not compared with the full model. Give --mesh with the mesh that "
    "it was reduced from, and --material with its form and parameters; modes are compared by MAC where it was reduced "
    "with --keep-modes."
)


def record_report(body: ReducedBody, path: Path, *, mesh: Path | None, scale: float, material: Path | None) -> Report:
    """The report of a record; on one process.

    Args:
        body: the record.
        path: of its file.
        mesh: that it was reduced from; None: it is not compared with the full model.
        scale: factor on the mesh's lengths.
        material: file of the form and its parameters.

    Raises:
        FlexmbdError: the mesh or the material cannot be read, or are of another body.
    """
    sources = {path.name: file_digest(path)}
    comparison: Comparison | None = None
    why = _NO_MODEL
    if mesh is not None and material is not None:
        sources.update({one.name: file_digest(one) for one in (mesh, material)})
        comparison, why = _compared(body, mesh, scale=scale, material=material)
    sections = [
        Section("The record", [Listing(body.inspect())]),
        Section("Mass", [_mass(body, comparison)]),
        Section("Frequencies", [_frequencies(body, comparison)]),
        Section("Modes against the full model", _modes(body, comparison, why)),
        Section("Responses", _responses(body, comparison, why)),
    ]
    summary = f"A reduced body of {body.n_modes} modes and {len(body.interfaces)} interfaces"
    summary += ", beside the model that it was reduced from." if comparison is not None else "."
    return Report(f"Record {path.stem}", "", summary, sections, sources)


def _compared(body: ReducedBody, mesh: Path, *, scale: float, material: Path) -> tuple[Comparison | None, str]:
    """The comparison, or why there is none.

    Raises:
        FlexmbdError: as `record_report`.
    """
    from mpi4py import MPI

    from flexmbd.command.material_file import read_material
    from flexmbd.command.reduce import make_parameters
    from flexmbd.continuum import ContinuumModel, Interface, NodalInterface
    from flexmbd.continuum.contract.formulation import load_form
    from flexmbd.coupling import Coupling
    from flexmbd.meshes import read
    from flexmbd.reduction.full_comparison import compare

    for key in ("supports", "surfaces", "springs on facets", "prestress", "strain energy"):
        if key in body.provenance:
            return None, f"It was reduced with {key}, of which the mesh and the material say nothing: it was not compared."
    degree = body.provenance.get("degree", "")
    if not degree.isdecimal() or body.n_modes == 0:
        return None, "The record does not say of which degree its model was, or is rigid: it was not compared."
    chosen = read_material(material)
    is_path = chosen.form.endswith(".py") or "/" in chosen.form
    form: Any = load_form(Path(chosen.form) if is_path else chosen.form)
    print_progress(f"reading {mesh}")
    found = read(mesh, scale=scale, comm=MPI.COMM_SELF)
    if found.fingerprint() != body.provenance.get("mesh"):
        raise RecordError(f"the record is of another mesh than {mesh}: give the one that it was reduced from, and its --scale")
    averaged = body.provenance.get("averaged interfaces", "").split(", ")
    interfaces: list[Interface | NodalInterface] = [
        Interface(
            one.name,
            origin=body.p_MB_M + body.R_MB @ one.p_BI_B,
            axes=body.R_MB @ one.R_BI,
            coupling=Coupling.AVERAGED if one.name in averaged else Coupling.RIGID,
        )
        for one in body.interfaces
    ]
    interfaces += [NodalInterface(name) for name in (body.nodal.names if body.nodal is not None else ())]
    print_progress("assembling")
    model = ContinuumModel(
        found, form, make_parameters(form, chosen.parameters), degree=int(degree), interfaces=interfaces
    )
    return compare(body, model, frequencies=_range(body), tell=print_progress), ""


def _range(body: ReducedBody) -> FloatArray:
    """Frequencies (Hz) from below the first to the last of the free body."""
    free = body.frequencies()
    return np.geomspace(_BEGIN * free[0], _END * free[-1], _COUNT)


def _mass(body: ReducedBody, comparison: Comparison | None) -> Table:
    own = body.mass_matrix()[:6, :6]
    names = ("mass [kg]", *(f"first moment {axis} [kg m]" for axis in "xyz"), *(
        f"inertia {pair} about B [kg m^2]" for pair in ("xx", "yy", "zz", "xy", "xz", "yz")
    ))  # fmt: skip

    def values(matrix: FloatArray) -> list[float]:
        first = matrix[[1, 2, 0], [5, 3, 4]]  # of -m [c]x, between translation and rotation
        return [*matrix[:1, 0], *first, *matrix[[3, 4, 5, 3, 3, 4], [3, 4, 5, 4, 5, 5]]]

    if comparison is None:
        rows = tuple((name, float(value)) for name, value in zip(names, values(own), strict=True))
        return Table("mass", "Mass of the rigid body, in the axes of B", ("what", "record"), rows)
    pairs = zip(names, values(own), values(comparison.mass), strict=True)
    return Table(
        "mass", "Mass of the rigid body, in the axes of B", ("what", "record", "full model"),
        tuple((name, float(one), float(other)) for name, one, other in pairs),
    )  # fmt: skip


def _frequencies(body: ReducedBody, comparison: Comparison | None) -> Table:
    columns: dict[str, FloatArray] = {"free [Hz]": body.frequencies()}
    if comparison is not None:
        columns["free, full model [Hz]"] = comparison.frequencies
        columns["record over full, less 1"] = comparison.of_record[: len(comparison.frequencies)] / comparison.frequencies - 1
    for one in body.interfaces:
        columns[f"{one.name} held [Hz]"] = body.frequencies([one.name])
    columns["damping ratio, free"] = np.asarray(ratio_facts(body)["free"])
    rows: list[tuple[Cell, ...]] = []
    for k in range(max((len(one) for one in columns.values()), default=0)):
        rows.append((k + 1, *(float(one[k]) if k < len(one) else float("nan") for one in columns.values())))
    return Table("frequencies", "Natural frequencies", ("number", *columns), tuple(rows))


def _modes(body: ReducedBody, comparison: Comparison | None, why: str) -> list[Content]:
    if comparison is None:
        return [Paragraph(why)]
    off = comparison.of_record[: len(comparison.frequencies)] / comparison.frequencies - 1.0
    contents: list[Content] = [
        Paragraph(
            "The full model has the same rigid interfaces and nothing else held. Its modes are found by another solver "
            "(ARPACK) than the reduction's."
        ),
        diagram(
            "frequency_errors", "Error of the free frequencies", [Line("record", range(1, len(off) + 1), abs(off).tolist())],
            x="mode", y="relative error", scales=("linear", "log"),
        ),
    ]  # fmt: skip
    mac = comparison.mac
    if mac is None:
        return [*contents, Paragraph("The record does not keep its modes (--keep-modes), so that there is no MAC.")]
    best = tuple((k + 1, int(np.argmax(row)) + 1, float(row.max()), float(row[k]) if k < len(row) else float("nan"))
                 for k, row in enumerate(mac))  # fmt: skip
    table = Table("mac", "MAC of each of the record's free modes", ("mode", "most like full mode", "MAC", "of equal number"), best)
    return [*contents, table, Picture("mac", "MAC of the record's free modes and the full ones, by the mass", _draw_mac(mac))]


def _draw_mac(mac: FloatArray):  # type: ignore[no-untyped-def]
    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        extent = (0.5, mac.shape[1] + 0.5, mac.shape[0] + 0.5, 0.5)
        image = axes.imshow(mac, vmin=0.0, vmax=1.0, cmap="Blues", extent=extent, aspect="auto")
        axes.set_xlabel("mode of the full model")
        axes.set_ylabel("mode of the record")
        figure.colorbar(image, ax=axes)

    return draw


def _responses(body: ReducedBody, comparison: Comparison | None, why: str) -> list[Content]:
    if not body.interfaces or body.n_modes == 0:
        return [Paragraph("The body has no interface with modes, and so no response.")]
    contents: list[Content] = [
        Paragraph(
            "Displacement of an interface of the free body along its own axes, per force along the same there; without "
            "damping, up to the record's last frequency."
            + ("" if comparison is not None else f" {why}")
        )
    ]
    for k, one in enumerate(body.interfaces, start=1):
        frequencies = _range(body)
        reduced = _response(body, one.name, frequencies)
        full = None if comparison is None else next(r.full for r in comparison.responses if r.interface == one.name)
        headings = ["frequency [Hz]", *(f"{axis}, record [m/N]" for axis in "xyz")]
        columns = [frequencies, *reduced.T]
        lines = [Line(f"{axis}, record", frequencies.tolist(), abs(reduced[:, i]).tolist()) for i, axis in enumerate("xyz")]
        if full is not None:
            headings += [f"{axis}, full model [m/N]" for axis in "xyz"]
            columns += [*full.T]
            lines += [
                Line("full model", frequencies.tolist(), abs(full[:, i]).tolist(), is_measured=False) for i in range(3)
            ]
            headings.append("largest difference over the largest response")
            columns.append(abs(reduced - full).max(axis=1) / abs(full).max(axis=1))
        rows = tuple(tuple(float(value) for value in row) for row in np.column_stack(columns))
        contents.append(Table(f"response_{k}", f"Response of interface {one.name}", tuple(headings), rows))
        caption = f"Response of interface {one.name}"
        contents.append(diagram(f"response_{k}", caption, lines, x="frequency in Hz", y="m/N"))
    return contents


def _response(body: ReducedBody, interface: str, frequencies: FloatArray) -> FloatArray:
    """(k, 3) m/N of the free undamped body at an interface, along each of its axes per force along it."""
    rows = interface_motion(body.interface(interface))[:3]
    mass, stiffness = body.mass_matrix(), np.concatenate([np.zeros(6), body.stiffness])
    found = np.empty((len(frequencies), 3))
    for k, omega in enumerate(2.0 * np.pi * frequencies):
        found[k] = np.einsum("ij,ji->i", rows, np.linalg.solve(np.diag(stiffness) - omega**2 * mass, rows.T))
    return found
