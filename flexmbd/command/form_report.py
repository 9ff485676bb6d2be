"""The report of `flexmbd check my_form.py --report DIR`: the sheet, and studies of all cells and degrees."""

from __future__ import annotations

import ast
import dataclasses
import importlib.util
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType
from typing import Any, cast

import numpy as np

from flexmbd.command.terminal import print_progress
from flexmbd.continuum.contract.formulation import Formulation, load_form
from flexmbd.continuum.contract_suite import FormReport
from flexmbd.continuum.contract_suite.cell_spectrum import CellSpectrum
from flexmbd.continuum.contract_suite.convergence import MeshConvergence
from flexmbd.continuum.contract_suite.inf_sup import InfSup
from flexmbd.continuum.contract_suite.locking_study import Locking
from flexmbd.continuum.contract_suite.order import SHORT
from flexmbd.continuum.contract_suite.outcome import Remark, Verdict, verdict
from flexmbd.continuum.contract_suite.studies import study_form
from flexmbd.continuum.contract_suite.trial_mesh import Family
from flexmbd.report import Cell, Content, Line, Listing, Paragraph, Report, ReportSection, ReportTable, diagram
from flexmbd.report.folder import file_digest

_NAN = float("nan")


def form_report(sheet: FormReport, source: str | Path) -> Report:
    """The report of a form that was loaded and checked; runs the studies, on this rank alone.

    Args:
        sheet: of its check.
        source: as `load_form` takes it.
    """
    form = load_form(source)
    studies = study_form(form, tell=print_progress)
    failed = [one.name for one in sheet.results if one.verdict is Verdict.FAIL]
    summary = f"The check of the form {sheet.name} on small meshes, and studies of each cell and degree. "
    summary += f"These checks failed: {', '.join(failed)}." if failed else "No check failed."
    sections = [
        ReportSection("The form", [_described(form)]),
        ReportSection("The check", [Listing(sheet.text()), _check_table(sheet)]),
        ReportSection("Convergence", _convergence_section(studies.convergences)),
        ReportSection("Locking", _locking_section(studies.lockings)),
        ReportSection("Inf-sup number", _inf_sup_section(studies.inf_sups)),
        ReportSection("Eigenvalues of one cell", _spectrum_section(studies.spectra)),
    ]
    return Report(
        f"Form {sheet.name}", "FAIL" if failed else "PASS", summary, sections, _sources(cast(ModuleType, form))
    )


def stopped_report(source: Path, error: Exception) -> Report:
    """The report of a form file that breaks the contract, so that nothing was computed with it."""
    summary = (
        f"The check of {source.name} stopped before anything was computed: the file breaks the contract of a form file "
        "in what is listed, and no mesh was made. Mend this, and check it again."
    )
    sections = [ReportSection("Where it stopped", [Listing(str(error))])]
    return Report(f"Form {source.stem}", "STOPPED", summary, sections, {source.name: file_digest(source)})


def _described(form: Formulation) -> ReportTable:
    title = (cast(ModuleType, form).__doc__ or "").strip().partition("\n")[0]
    given = cast(Any, form.reference().parameters)
    claims = ", ".join(f"{degree}: {order}" for degree, order in form.ORDER.items())
    rows = (
        ("title", title),
        ("cells", ", ".join(form.CELLS)),
        ("orders claimed", claims),
        ("reference configuration", form.REFERENCE),
    )
    values = ((f"parameter {one.name}", _value(getattr(given, one.name))) for one in dataclasses.fields(given))
    caption = "The form, and the parameters of its reference problem, from which all studies begin"
    return ReportTable("form", caption, ("what", "value"), (*rows, *values))


def _value(value: object) -> str:
    """A parameter as it is read: numbers without a tail of zeros."""
    if isinstance(value, float):
        return f"{value:.12g}"
    return f"({', '.join(map(_value, value))})" if isinstance(value, tuple) else str(value)


def _check_table(sheet: FormReport) -> ReportTable:
    rows: list[tuple[Cell, ...]] = []
    for check in sheet.results:
        for (cell, degree), outcome in check.outcomes.items():
            if isinstance(outcome, Remark):
                rows.append((check.name, cell, degree, verdict(outcome).value, "", _NAN, _NAN, outcome.text))
                continue
            for figure in outcome:
                told = "PASS" if figure.passed else "FAIL"
                name, limit = figure.name.rstrip(":, "), figure.limit if np.isfinite(figure.limit) else _NAN
                rows.append((check.name, cell, degree, told, name, figure.value, limit, figure.remark.strip("()")))
    headings = ("check", "cell", "degree", "verdict", "figure", "value", "limit", "remark")
    return ReportTable("checks", "All figures of the check", headings, tuple(rows))


def _convergence_section(found: Sequence[MeshConvergence]) -> list[Content]:
    done = [one for one in found if not one.fault]
    contents: list[Content] = [
        Paragraph(
            "The reference problem of the form on meshes that fill the same interval, square or cube: regular; moved "
            "by a smooth map; trapezoids that are never nearer to parallelograms (Arnold, Boffi and Falk 2002); cells "
            "of degree 2 between curved edges. The error is that of the displacement in L2, over its norm; the order "
            "is fitted to the three finest meshes."
        )
    ]
    short = [one for one in done if one.order < one.claimed - SHORT]
    if short:
        listed = "; ".join(f"{_element(one)}, {one.family.value}: {one.order:.2f} of {one.claimed}" for one in short)
        contents.append(Paragraph(f"The order falls short of the claimed one by more than {SHORT} on: {listed}."))
    rows = [(one.cell, one.degree, one.family.value, _last(one.errors), one.order, one.claimed) for one in done]
    headings = ("cell", "degree", "meshes", "error on the finest", "order", "order claimed")
    contents.append(ReportTable("orders", "Orders of convergence", headings, tuple(rows)))
    errors = [
        (one.cell, one.degree, one.family.value, n, 1.0 / n, error)
        for one in done
        for n, error in zip(one.divisions, one.errors, strict=True)
    ]
    headings = ("cell", "degree", "meshes", "cells an edge", "h [m]", "relative error")
    contents.append(ReportTable("errors", "Errors of the displacement", headings, tuple(errors)))
    families = [family for family in Family if any(one.family is family for one in done)]
    if families:
        lines = [
            Line(_element(one), one.divisions, one.errors, panel=families.index(one.family)) for one in done
        ]
        contents.append(
            diagram(
                "convergence", "Error of the displacement over the number of cells an edge", lines,
                x="cells an edge", y="relative L2 error", titles=[family.value for family in families],
            )
        )  # fmt: skip
    return contents + _faults([(f"{_element(one)}, {one.family.value}", one.fault) for one in found])


def _locking_section(found: Sequence[Locking]) -> list[Content]:
    done = [one for one in found if not one.fault]
    contents: list[Content] = [
        Paragraph(
            "Solids: the error of a field that keeps its volume but for 1 - 2 nu, and its order, as Poisson's ratio nu "
            "approaches 1/2; and a bar of one cell through its thickness and eight along it in pure bending, whose "
            "stiffness is told over the exact one. Surfaces: the error of a plate that is bent without shear, as its "
            "thickness goes to nothing. An element that locks has errors that grow, orders that fall, or a stiffness "
            "far above 1. At a thousandth of the length round-off leaves it some 1e-3."
        )
    ]
    for over, name in (("nu", "nu"), ("thickness [m]", "thickness")):
        measured = [one for one in done if one.over == over]
        if not measured:
            continue
        rows = [
            (one.cell, one.degree, value, one.measure, result)
            for one in measured
            for value, result in zip(one.values, one.results, strict=True)
        ]
        headings = ("cell", "degree", over, "measure", "result")
        contents.append(ReportTable(f"locking_{name}", f"Locking over {name}", headings, tuple(rows)))
        first = [one for one in measured if "order" not in one.measure]
        across = [[1.0 - 2.0 * value for value in one.values] if name == "nu" else one.values for one in first]
        lines = [Line(_element(one), x, one.results) for one, x in zip(first, across, strict=True)]
        label = "1 - 2 nu" if name == "nu" else "thickness in m"
        y = "relative error" if "error" in first[0].measure else first[0].measure
        contents.append(diagram(f"locking_{name}", f"Locking over {name}", lines, x=label, y=y))
    if not found:
        contents.append(Paragraph("Lines have no such study."))
    return contents + _faults([(_element(one), one.fault) for one in found])


def _inf_sup_section(found: Sequence[InfSup]) -> list[Content]:
    if not found:
        return [
            Paragraph("The form has no further unknown that displacements hold, as a pressure: it has no such number.")
        ]
    rows = [
        (one.cell, one.degree, n, number, zeros)
        for one in found
        for n, number, zeros in zip(one.divisions, one.numbers, one.zeros, strict=True)
    ]
    headings = ("cell", "degree", "cells an edge", "inf-sup number", "zero singular values")
    lines = [Line(_element(one), one.divisions, one.numbers) for one in found]
    return [
        Paragraph(
            "The smallest singular value that is not zero, over the largest, of the coupling between displacements (in "
            "H1, held on the boundary) and the further unknown (in L2), on regular meshes (Chapelle and Bathe 1993). "
            "It must not fall as the mesh is refined. One zero value is the constant pressure; further ones are "
            "pressures that no displacement feels."
        ),
        ReportTable("inf_sup", "Inf-sup numbers", headings, tuple(rows)),
        diagram("inf_sup", "Inf-sup number over the number of cells an edge", lines, x="cells an edge", y="number"),
        *_faults([(_element(one), one.fault) for one in found]),
    ]


def _spectrum_section(found: Sequence[CellSpectrum]) -> list[Content]:
    done = [one for one in found if not one.fault]
    shapes = {False: "along the axes", True: "distorted"}
    counts = [
        (one.cell, one.degree, shapes[one.is_distorted], len(one.values), one.zeros, _least(one)) for one in done
    ]
    rows = [
        (one.cell, one.degree, shapes[one.is_distorted], k, value)
        for one in done
        for k, value in enumerate(one.values, start=1)
    ]
    lines = [
        Line(
            _element(one), range(one.zeros + 1, len(one.values) + 1), one.values[one.zeros :],
            panel=int(one.is_distorted),
        )
        for one in done
    ]  # fmt: skip
    contents: list[Content] = [
        Paragraph(
            "Of the stiffness of a free cell at rest, over the largest, its edges of 1 m along the axes or distorted; "
            "what rigid motions do not move, as pressures, is solved for. Six are zero, the rigid motions."
        ),
        ReportTable(
            "cell_motions", "Motions without energy of one cell",
            ("cell", "degree", "shape", "eigenvalues", "zero", "least that is not zero"), tuple(counts),
        ),
        ReportTable(
            "cell_eigenvalues", "Eigenvalues of one cell",
            ("cell", "degree", "shape", "number", "eigenvalue over the largest"), tuple(rows),
        ),
    ]  # fmt: skip
    if lines:
        contents.append(
            diagram(
                "cell_eigenvalues", "Eigenvalues of one cell that are not zero", lines, x="number",
                y="over the largest", scales=("linear", "log"), titles=tuple(shapes.values()),
            )
        )  # fmt: skip
    return contents + _faults([(f"{_element(one)}, {shapes[one.is_distorted]}", one.fault) for one in found])


def _faults(told: Sequence[tuple[str, str]]) -> list[Content]:
    """What was not computed, with the reason; those of one reason as one."""
    reasons: dict[str, list[str]] = {}
    for where, fault in told:
        if fault:
            reasons.setdefault(fault, []).append(where)
    return [Paragraph(f"{'; '.join(dict.fromkeys(where))}: {fault}.") for fault, where in reasons.items()]


def _element(one: MeshConvergence | Locking | InfSup | CellSpectrum) -> str:
    return f"{one.cell} {one.degree}"


def _last(values: Sequence[float]) -> float:
    return values[-1] if values else _NAN


def _least(one: CellSpectrum) -> float:
    return min((value for value in np.abs(one.values)[one.zeros :]), default=_NAN)


def _sources(form: ModuleType) -> dict[str, str]:
    """sha256 of a form's file and of the forms that it imports."""
    found: dict[str, str] = {}

    def add(path: Path) -> None:
        if path.name in found:
            return
        found[path.name] = file_digest(path)
        for node in ast.walk(ast.parse(path.read_bytes())):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("flexmbd.forms."):
                spec = importlib.util.find_spec(cast(str, node.module))
                if spec is not None and spec.origin:
                    add(Path(spec.origin))

    add(Path(cast(str, form.__file__)))
    return found
