"""The report of `flexmbd inspect part.h5 --report DIR`: the record, and with its mesh the full model beside it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from flexmbd.command.terminal import print_progress
from flexmbd.errors import RecordError
from flexmbd.record.held_modes import interface_motion
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
        ReportSection("Mass", [_mass(body, comparison)]),
        ReportSection("Frequencies", [_frequencies(body, comparison)]),
        ReportSection("Modes against the full model", _modes(body, comparison, why)),
        ReportSection("Responses", _responses(body, comparison)),
        ReportSection("All of the record", [Listing(body.inspect())]),
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


def _mass(body: ReducedBody, comparison: Comparison | None) -> ReportTable:
    own = body.mass_matrix()[:6, :6]
    names = ("mass [kg]", *(f"first moment {axis} [kg m]" for axis in "xyz"), *(
        f"inertia {pair} about B [kg m^2]" for pair in ("xx", "yy", "zz", "xy", "xz", "yz")
    ))  # fmt: skip

    def values(matrix: FloatArray) -> list[float]:
        first = matrix[[1, 2, 0], [5, 3, 4]]  # of -m [c]x, between translation and rotation
        return [*matrix[:1, 0], *first, *matrix[[3, 4, 5, 3, 3, 4], [3, 4, 5, 4, 5, 5]]]

    if comparison is None:
        rows = tuple((name, float(value)) for name, value in zip(names, values(own), strict=True))
        return ReportTable("mass", "Mass of the rigid body, in the axes of B", ("what", "record"), rows)
    pairs = zip(names, values(own), values(comparison.mass), strict=True)
    return ReportTable(
        "mass", "Mass of the rigid body, in the axes of B", ("what", "record", "full model"),
        tuple((name, float(one), float(other)) for name, one, other in pairs),
    )  # fmt: skip


def _frequencies(body: ReducedBody, comparison: Comparison | None) -> ReportTable:
    columns: dict[str, FloatArray] = {"free [Hz]": body.frequencies()}
    if comparison is not None:
        columns["free, full model [Hz]"] = comparison.frequencies
        columns["relative error"] = comparison.errors
    for one in body.interfaces:
        columns[f"{one.name} held [Hz]"] = body.frequencies([one.name])
    ratios = damping_ratios(body)[""]
    if np.any(ratios):
        columns["damping ratio, free"] = ratios
    rows: list[tuple[Cell, ...]] = []
    for k in range(max((len(one) for one in columns.values()), default=0)):
        rows.append((k + 1, *(float(one[k]) if k < len(one) else float("nan") for one in columns.values())))
    return ReportTable("frequencies", "Natural frequencies", ("number", *columns), tuple(rows))


def _modes(body: ReducedBody, comparison: Comparison | None, why: str) -> list[Content]:
    if comparison is None:
        return [Paragraph(why)]
    off = abs(comparison.errors)
    contents: list[Content] = [
        Paragraph(
            "The full model has the same rigid interfaces and nothing else held. Its modes are found by another solver "
            "(ARPACK) than the reduction's."
        ),
        diagram(
            "frequency_errors", "Error of the free frequencies", [Line("record", range(1, len(off) + 1), off)],
            x="mode", y="relative error", scales=("linear", "log"),
        ),
    ]  # fmt: skip
    mac = comparison.mac
    if mac is None:
        return [*contents, Paragraph("The record does not keep its modes (--keep-modes), so that there is no MAC.")]
    best: list[tuple[Cell, ...]] = []
    for k, row in enumerate(mac):
        equal = float(row[k]) if k < len(row) else float("nan")
        best.append((k + 1, int(np.argmax(row)) + 1, float(row.max()), equal))
    headings = ("mode", "most like full mode", "MAC", "MAC with the mode of its number")
    table = ReportTable("mac", "MAC of each of the record's free modes", headings, tuple(best))
    caption = "MAC of the record's free modes and the full model's, by the mass"
    return [*contents, table, ReportPicture("mac", caption, _draw_mac(mac))]


def _draw_mac(mac: FloatArray) -> Callable[[Figure], None]:
    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        extent = (0.5, mac.shape[1] + 0.5, mac.shape[0] + 0.5, 0.5)
        image = axes.imshow(mac, vmin=0.0, vmax=1.0, cmap="Blues", extent=extent, aspect="auto")
        axes.set_xlabel("mode of the full model")
        axes.set_ylabel("mode of the record")
        figure.colorbar(image, ax=axes)

    return draw


def _responses(body: ReducedBody, comparison: Comparison | None) -> list[Content]:
    if not body.interfaces or body.n_modes == 0:
        return [Paragraph("The body has no interface with modes, and so no response.")]
    contents: list[Content] = [
        Paragraph(
            "Displacement of an interface of the free body along its own axes, per force along the same there; without "
            "damping, up to the record's last frequency."
        )
    ]
    frequencies, dense = _range(body, _COUNT), _range(body, _SHOWN)
    for k, one in enumerate(body.interfaces, start=1):
        reduced, shown = _response(body, one.name, frequencies), _response(body, one.name, dense)
        headings = ["frequency [Hz]", *(f"{axis}, record [m/N]" for axis in "xyz")]
        columns = [frequencies, *reduced.T]
        lines = [
            Line(f"{axis}, record", dense, abs(shown[:, i]), is_marked=False)
            for i, axis in enumerate("xyz")
        ]
        if comparison is not None:
            full = next(found.full for found in comparison.responses if found.interface == one.name)
            headings += [f"{axis}, full model [m/N]" for axis in "xyz"]
            headings.append("largest difference over the largest response")
            columns += [*full.T, abs(reduced - full).max(axis=1) / abs(full).max(axis=1)]
            lines += [
                Line(f"{axis}, full model", frequencies, abs(full[:, i]), is_joined=False)
                for i, axis in enumerate("xyz")
            ]
        rows = tuple(tuple(float(value) for value in row) for row in np.column_stack(columns))
        caption = f"Response of interface {one.name}"
        contents.append(ReportTable(f"response_{k}", caption, tuple(headings), rows))
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
