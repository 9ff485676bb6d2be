"""The report of `flexmbd inspect part.h5 --report DIR`: the record, with its mesh the full model, another record."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from flexmbd.command.terminal import print_progress
from flexmbd.errors import RecordError
from flexmbd.record.groups import InterfaceFrame
from flexmbd.record.record_comparison import PlacedRecord, RecordComparison
from flexmbd.record.reduced_body import ReducedBody
from flexmbd.record.summary import damping_ratios
from flexmbd.report import (
    Cell,
    Content,
    Line,
    Listing,
    Paragraph,
    Report,
    ReportPicture,
    ReportSection,
    ReportTable,
    diagram,
    number_text,
)
from flexmbd.report.folder import file_digest

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from flexmbd.reduction.full_comparison import Comparison

FloatArray = NDArray[np.float64]

_COUNT, _SHOWN = 40, 600  # frequencies of a response: that are solved for, and that the record is drawn at
_BEGIN, _END = 0.2, 1.05  # of the first frequency, and of the last that the record is shown for
_NO_MODEL = (
    "A record holds no mesh and no matrices, so that it was not compared with the full model. Give --mesh with the "
    "mesh that it was reduced from, and --material with its form and parameters; modes are compared by MAC where "
    "it was reduced with --keep-modes."
)


_OTHER = "other record"


def record_report(
    body: ReducedBody,
    path: Path,
    *,
    mesh: Path | None,
    scale: float,
    material: Path | None,
    beside: RecordComparison | None = None,
    other: Path | None = None,
) -> Report:
    """The report of a record; on one process.

    Args:
        body: the record.
        path: of its file.
        mesh: that it was reduced from; None: it is not compared with the full model.
        scale: factor on the mesh's lengths.
        material: file of the form and its parameters.
        beside: the record and another one; None: it is not compared with another one.
        other: the file of that.

    Raises:
        FlexmbdError: the mesh or the material cannot be read, or are of another body.
    """
    sources = {path.name: file_digest(path)}
    if other is not None:
        sources[str(other) if other.name == path.name else other.name] = file_digest(other)
    comparison: Comparison | None = None
    why = _NO_MODEL
    if mesh is not None and material is not None:
        sources.update({one.name: file_digest(one) for one in (mesh, material)})
        comparison, why = _compared(body, mesh, scale=scale, material=material)
    sections = [
        ReportSection("Mass", [_mass(body, comparison, beside)]),
        ReportSection("Frequencies", [_frequencies(body, comparison, beside)]),
        ReportSection("Modes against the full model", _modes(comparison, why, beside)),
        *([ReportSection("The other record", _other_record(beside))] if beside is not None else []),
        ReportSection("Responses", _responses(body, comparison, beside)),
        ReportSection("All of the record", [Listing(body.inspect())]),
    ]
    summary = f"A reduced body of {body.n_modes} modes and {len(body.interfaces)} interfaces"
    summary += ", beside the model that it was reduced from" if comparison is not None else ""
    if beside is not None and other is not None:
        summary += ", and" if comparison is not None else ""
        summary += f" beside the record {other.name} of {beside.other.body.n_modes} modes, called the other one"
    summary += "."
    return Report(f"Record {path.stem}", "", summary, sections, sources)


def _compared(body: ReducedBody, mesh: Path, *, scale: float, material: Path) -> tuple[Comparison | None, str]:
    """The comparison, or why there is none.

    Raises:
        FlexmbdError: as `record_report`.
    """
    from mpi4py import MPI

    from flexmbd.command.material_file import make_parameters, read_material
    from flexmbd.continuum import ContinuumModel, Interface, NodalInterface
    from flexmbd.continuum.contract.formulation import load_form
    from flexmbd.coupling import Coupling
    from flexmbd.meshes import read
    from flexmbd.reduction.full_comparison import compare

    for key in ("supports", "surfaces", "springs on facets", "prestress", "strain energy"):
        if key in body.provenance:
            return None, f"It was not compared: it was reduced with {key}, of which mesh and material say nothing."
    degree = body.provenance.get("degree", "")
    if not degree.isdecimal() or body.n_modes == 0:
        return None, "It was not compared: the record does not say of which degree its model was, or is rigid."
    chosen = read_material(material)
    is_path = chosen.form.endswith(".py") or "/" in chosen.form
    form: Any = load_form(Path(chosen.form) if is_path else chosen.form)
    print_progress(f"reading {mesh}")
    found = read(mesh, scale=scale, comm=MPI.COMM_SELF)
    if found.fingerprint() != body.provenance.get("mesh"):
        raise RecordError(
            f"the record is of another mesh than {mesh}: give the one that it was reduced from, and its --scale"
        )
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
    return compare(body, model, frequencies=_range(body, _COUNT), tell=print_progress), ""


def _range(body: ReducedBody, count: int) -> FloatArray:
    """Frequencies (Hz) from below the first to the last of the free body."""
    free = body.frequencies()
    return np.geomspace(_BEGIN * free[0], _END * free[-1], count)


def _mass(body: ReducedBody, comparison: Comparison | None, beside: RecordComparison | None) -> ReportTable:
    names = ("mass [kg]", *(f"first moment {axis} [kg m]" for axis in "xyz"), *(
        f"inertia {pair} about B [kg m^2]" for pair in ("xx", "yy", "zz", "xy", "xz", "yz")
    ))  # fmt: skip
    matrices = {"record": body.mass_matrix()}
    if comparison is not None:
        matrices["full model"] = comparison.mass
    if beside is not None:
        matrices[_OTHER] = beside.other.mass_matrix()
    columns: list[list[float]] = []
    for matrix in matrices.values():
        first = matrix[[1, 2, 0], [5, 3, 4]]  # of -m [c]x, between translation and rotation
        columns.append([*matrix[:1, 0], *first, *matrix[[3, 4, 5, 3, 3, 4], [3, 4, 5, 4, 5, 5]]])
    rows = tuple((name, *map(float, values)) for name, *values in zip(names, *columns, strict=True))
    return ReportTable("mass", "Mass of the rigid body, in the axes of B", ("what", *matrices), rows)


def _frequencies(
    body: ReducedBody, comparison: Comparison | None, beside: RecordComparison | None
) -> ReportTable:
    columns: dict[str, FloatArray] = {"free [Hz]": body.frequencies()}
    if comparison is not None:
        columns["free, full model [Hz]"] = comparison.frequencies
        columns["relative error"] = comparison.errors
    if beside is not None:
        columns[f"free, {_OTHER} [Hz]"] = beside.other.body.frequencies()
    for one in body.interfaces:
        columns[f"{one.name} held [Hz]"] = body.frequencies([one.name])
        if beside is not None and one in beside.common:
            columns[f"{one.name} held, {_OTHER} [Hz]"] = beside.other.body.frequencies([one.name])
    ratios = damping_ratios(body)[""]
    if np.any(ratios):
        columns["damping ratio, free"] = ratios
    rows: list[tuple[Cell, ...]] = []
    for k in range(max((len(one) for one in columns.values()), default=0)):
        rows.append((k + 1, *(float(one[k]) if k < len(one) else float("nan") for one in columns.values())))
    return ReportTable("frequencies", "Natural frequencies", ("number", *columns), tuple(rows))


def _modes(comparison: Comparison | None, why: str, beside: RecordComparison | None) -> list[Content]:
    if comparison is None:
        return [Paragraph(why)]
    off = {"record": comparison.errors}
    if beside is not None:
        count = min(len(comparison.frequencies), beside.other.body.n_modes)
        off[_OTHER] = beside.other.body.frequencies()[:count] / comparison.frequencies[:count] - 1.0
    lines = [Line(name, range(1, len(one) + 1), abs(one)) for name, one in off.items()]
    contents: list[Content] = [
        Paragraph(
            "The full model has the same rigid interfaces and nothing else held. Its modes are found by another solver "
            "(ARPACK) than the reduction's."
        ),
        diagram(
            "frequency_errors", "Error of the free frequencies", lines,
            x="mode", y="relative error", scales=("linear", "log"),
        ),
    ]  # fmt: skip
    mac = comparison.mac
    if mac is None:
        return [*contents, Paragraph("The record does not keep its modes (--keep-modes), so that there is no MAC.")]
    caption = "MAC of the record's free modes and the full model's, by the mass"
    headings = ("mode", "most like full mode", "MAC", "MAC with the mode of its number")
    table = ReportTable("mac", "MAC of each of the record's free modes", headings, tuple(_best(mac)))
    return [*contents, table, ReportPicture("mac", caption, _draw_mac(mac, "full model"))]


def _numbered(values: FloatArray, number: float) -> float:
    """The value of a number, from 1; NaN where there is none."""
    return float(values[int(number) - 1]) if 1 <= number <= len(values) else float("nan")


def _best(mac: FloatArray) -> Iterator[tuple[int, float, float, float]]:
    """Of each row its number, the number of the column that is most like it, that MAC, and the one of its number."""
    for k, row in enumerate(mac):
        equal = float(row[k]) if k < len(row) else float("nan")
        best = int(np.argmax(np.nan_to_num(row, nan=-1.0)))
        yield k + 1, best + 1 if np.isfinite(row[best]) else float("nan"), float(row[best]), equal


def _draw_mac(mac: FloatArray, other: str) -> Callable[[Figure], None]:
    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        extent = (0.5, mac.shape[1] + 0.5, mac.shape[0] + 0.5, 0.5)
        image = axes.imshow(mac, vmin=0.0, vmax=1.0, cmap="Blues", extent=extent, aspect="auto")
        axes.set_xlabel(f"mode of the {other}")
        axes.set_ylabel("mode of the record")
        figure.colorbar(image, ax=axes)

    return draw


def _other_record(beside: RecordComparison) -> list[Content]:
    """Places of common interfaces, and modes by MAC."""
    ways, turns = zip(*(beside.apart(at.name) for at in beside.common), strict=True)
    apart = tuple(zip((at.name for at in beside.common), ways, turns, strict=True))
    where = (
        "Each lies where the coordinates of its mesh have it"
        if beside.by_meshes
        else f"The other one lies so that its interface {apart[0][0]} is on the record's"
    )
    alone = [
        f"{whose} alone has {', '.join(names)}"
        for whose, names in (("the record", beside.only(beside.one)), ("the other one", beside.only(beside.other)))
        if names
    ]
    contents: list[Content] = [
        Paragraph(
            f"{where}: common interfaces are up to {number_text(max(ways))} m and {number_text(max(turns))} rad apart. "
            "What is compared of the other one is at the places and in the axes of the record's, faces carried rigidly."
            + (f" Not compared: {'; '.join(alone)}." if alone else "")
        ),
        ReportTable(
            "places", "How far common interfaces are apart", ("interface", "way [m]", "turn [rad]"), apart
        ),
    ]
    if beside.one.body.n_modes == 0 or beside.other.body.n_modes == 0:
        return [*contents, Paragraph("One of the records has no modes, so that there is no MAC.")]
    mac, own, others = beside.mac(), beside.one.body.frequencies(), beside.other.body.frequencies()
    rows: list[tuple[Cell, ...]] = []
    for k, like, value, equal in _best(mac):
        mine, there = _numbered(own, k), _numbered(others, like)
        rows.append((k, mine, like, there, there / mine - 1.0, value, equal))
    what = (
        f"displacements of the {len(beside.nodes)} nodes that both records have of their one mesh"
        if len(beside.nodes)
        else "motions of the common interfaces, turns times the radius of gyration; modes that differ between these "
        "alone look alike (records of one mesh made with --keep-modes are compared at its nodes)"
    )
    headings = (
        "mode", "frequency [Hz]", f"most like mode of the {_OTHER}", "its frequency [Hz]", "relative difference", "MAC",
        "MAC with the mode of its number",
    )  # fmt: skip
    caption = "MAC of the free modes of both records"
    return [
        *contents,
        Paragraph(f"MAC compares {what}."),
        ReportTable("mac_other", caption, headings, tuple(rows)),
        ReportPicture("mac_other", caption, _draw_mac(mac, _OTHER)),
    ]


def _responses(
    body: ReducedBody, comparison: Comparison | None, beside: RecordComparison | None
) -> list[Content]:
    if not body.interfaces or body.n_modes == 0:
        return [Paragraph("The body has no interface with modes, and so no response.")]
    contents: list[Content] = [
        Paragraph(
            "Displacement of an interface of the free body along its own axes, per force along the same there; without "
            "damping, up to the record's last frequency."
        )
    ]
    frequencies, dense = _range(body, _COUNT), _range(body, _SHOWN)
    own = PlacedRecord(body, np.zeros(3), np.eye(3))
    for k, one in enumerate(body.interfaces, start=1):
        reduced, shown = _response(own, one, frequencies), _response(own, one, dense)
        headings = ["frequency [Hz]", *(f"{axis}, record [m/N]" for axis in "xyz")]
        columns = [frequencies, *reduced.T]
        lines = [Line(f"{axis}, record", dense, abs(shown[:, i]), is_marked=False) for i, axis in enumerate("xyz")]
        if comparison is not None:
            full = next(found.full for found in comparison.responses if found.interface == one.name)
            headings += [f"{axis}, full model [m/N]" for axis in "xyz"]
            headings.append("largest difference over the largest response")
            columns += [*full.T, abs(reduced - full).max(axis=1) / abs(full).max(axis=1)]
            lines += [
                Line(f"{axis}, full model", frequencies, abs(full[:, i]), is_joined=False)
                for i, axis in enumerate("xyz")
            ]
        if beside is not None and one in beside.common:
            found = _response(beside.other, one, frequencies)
            headings += [f"{axis}, {_OTHER} [m/N]" for axis in "xyz"]
            headings.append(f"largest difference from the {_OTHER} over its largest response")
            columns += [*found.T, abs(reduced - found).max(axis=1) / abs(found).max(axis=1)]
            dashed = abs(_response(beside.other, one, dense))
            lines += [
                Line(f"{axis}, {_OTHER}", dense, dashed[:, i], is_marked=False, is_dashed=True)
                for i, axis in enumerate("xyz")
            ]
        rows = tuple(tuple(float(value) for value in row) for row in np.column_stack(columns))
        caption = f"Response of interface {one.name}"
        contents.append(ReportTable(f"response_{k}", caption, tuple(headings), rows))
        contents.append(diagram(f"response_{k}", caption, lines, x="frequency in Hz", y="m/N"))
    return contents


def _response(placed: PlacedRecord, at: InterfaceFrame, frequencies: FloatArray) -> FloatArray:
    """(k, 3) m/N of the free undamped body at an interface, along each of its axes per force along it."""
    rows = placed.interface_motion(at)[:3]
    mass, stiffness = placed.mass_matrix(), np.concatenate([np.zeros(6), placed.body.stiffness])
    found = np.empty((len(frequencies), 3))
    for k, omega in enumerate(2.0 * np.pi * frequencies):
        found[k] = np.einsum("ij,ji->i", rows, np.linalg.solve(np.diag(stiffness) - omega**2 * mass, rows.T))
    return found
