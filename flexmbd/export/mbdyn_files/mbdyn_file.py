"""Reduced bodies for MBDyn: the data file (.fem) of its modal joint.

MBDyn builds all inertia integrals of a moving body from nodes with masses, so the file holds the few fictitious
points of `flexmbd.record.point_masses`: then the modal mass is that of the nodes to round-off.  Its development version
takes the integrals themselves, and stiffening by loads.  Each interface frame is one more node, without mass, named as
the frame is.  See docs/export/mbdyn.md.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from flexmbd.errors import ExportError
from flexmbd.export.loss import Capabilities, check_losses, checked_writer
from flexmbd.export.mbdyn_files.mbdyn_invariants import invariants as inertia_invariants
from flexmbd.export.mbdyn_files.mbdyn_invariants import shapes, stiffening_loads
from flexmbd.files.whole_file import write_file
from flexmbd.record.groups import FloatArray
from flexmbd.record.point_masses import PointMasses, point_masses
from flexmbd.record.reduced_body import ReducedBody
from flexmbd.round_off import TEN_DIGITS

CAPABILITIES = Capabilities(stiffening=True)

#: Lines of a file that MBDyn passes over and `read_mbdyn` understands.
OURS = "** flexmbd"
#: What the nodes that carry the mass are called, with their numbers from 1 on.
POINT = "point-"
_LABEL = re.compile(r"[A-Za-z_][A-Za-z0-9_.+-]{0,79}")


@checked_writer
def mbdyn(
    body: ReducedBody, path: str | Path, *, invariants: bool = False, lossy: bool = False
) -> tuple[str, ...]:
    """Write the data file of MBDyn's modal joint. Not collective.

    Args:
        body: an elastic body.
        path: destination, as a rule `*.fem`.
        invariants: write the rigid inertia and the inertia invariants (groups 12, 14 to 18) in the place of nodes with
            masses, and the stiffening by loads that the record has (group 19): for MBDyn's development version; that of
            1.7.3 and before knows no groups beyond 13.
        lossy: as of all formats; nothing grave is lost here.

    Returns:
        What is not in the file, a phrase each.

    Raises:
        ExportError: the body has no modes; a frame's name is none for MBDyn; with invariants, it has no interface; the
            destination cannot be written.
    """
    stiffened = invariants and body.geometric is not None
    able = replace(CAPABILITIES, stiffening=stiffened)
    losses = check_losses(body, able, kind="MBDyn's modal joint", lossy=lossy)
    if stiffened and body.stretch is not None:
        losses += ("stiffening by the modes' stretch: that by load is there",)
    check_modes(body)
    for frame in body.interfaces:
        check_label(frame.name)
    if invariants and not body.interfaces:
        raise ExportError("a file without nodal masses has the interfaces as its nodes, and this body has none")
    write_file(path, "\n".join(_lines(body, invariants=invariants)) + "\n")
    return losses


def check_modes(body: ReducedBody) -> None:
    """Raise an ExportError for a rigid body, which MBDyn's modal joint cannot be."""
    if body.n_modes == 0 or not body.mass > 0.0:
        raise ExportError(
            f"MBDyn's modal joints have modes and mass; this body has {body.n_modes} modes and {body.mass:g} kg: make "
            "a `body` element there of its mass, centre and inertia"
        )


def check_label(name: str) -> None:
    """Raise an ExportError for an interface name that is none for MBDyn, or one of our own points."""
    if not _LABEL.fullmatch(name) or name.startswith(POINT):
        raise ExportError(
            f"the interface name {name!r} is not a node label for MBDyn: give it up to 80 letters, digits and _ . + -, "
            f"a letter or _ first, without blanks, and not beginning with {POINT!r}"
        )


def _lines(body: ReducedBody, *, invariants: bool) -> Iterator[str]:
    n, frames = body.n_modes, body.interfaces
    points = None if invariants else point_masses(body)
    yield from _head(body, points)
    yield "** RECORD GROUP 9, MODAL MASS MATRIX"
    yield from _square(_modal_mass(body))
    yield "** RECORD GROUP 10, MODAL STIFFNESS MATRIX"
    yield from _square(np.diag(body.stiffness))
    if points is not None:
        mass = np.zeros((len(points.x) + len(frames), 6))
        mass[: len(points.x), :3] = points.mass[:, None]
        yield "** RECORD GROUP 11, DIAGONAL OF LUMPED MASS MATRIX"
        yield from (_row(node) for node in mass)
    else:
        yield "** RECORD GROUP 12, RIGID BODY INERTIA"
        yield from (number(body.mass), _row(body.com), *map(_row, body.inertia))
    if np.any(body.damping):
        yield "** RECORD GROUP 13, MODAL DAMPING MATRIX"
        yield from _square(0.5 * (body.damping + body.damping.T))
    if points is None:
        found = inertia_invariants(body.gram)
        for group, (attribute, shape) in shapes(n).items():
            yield f"** RECORD GROUP {group}, INVARIANT {attribute[1:]}"
            yield from _square(getattr(found, attribute).reshape(shape[0], -1))
        yield from _stiffening(body)
    yield "** END OF FILE"


def _stiffening(body: ReducedBody) -> Iterator[str]:
    """Group 19: the loads of the record that MBDyn knows, by their numbers there."""
    group = body.geometric
    loads = stiffening_loads([frame.name for frame in body.interfaces if frame.name != body.frame])
    there = [] if group is None else [load for load in loads if load in group.loads]
    if group is None or not there:
        return
    yield "** RECORD GROUP 19, MODAL STRESS STIFFENING MATRIX"
    yield str(len(there))
    for load in there:
        yield str(1 + loads.index(load))
        yield from _square(group.K[group.loads.index(load)])


def _head(body: ReducedBody, points: PointMasses | None) -> Iterator[str]:
    """Groups 1 to 8: nodes and modes."""
    n, frames = body.n_modes, body.interfaces
    count = 0 if points is None else len(points.x)
    x = np.array([*([] if points is None else points.x), *(frame.p_BI_B for frame in frames)])
    # (nodes, 6, n): displacements and small rotations
    moved = np.zeros((len(x), 6, n))
    if points is not None:
        moved[:count, :3] = points.phi
    for row, frame in enumerate(frames, start=count):
        moved[row] = frame.modes
    yield "** MBDyn MODAL DATA FILE"
    yield "** SI units, axes and origin of the modal node; nodes with mass are fictitious, the others are interfaces"
    yield from _our_lines(body)
    yield "** RECORD GROUP 1, HEADER"
    yield "**   REVISION,  NODE,  NORMAL, ATTACHMENT, CONSTRAINT, REJECTED MODES."
    yield f"     REV0 {len(x)} {n} 0 0 0"
    yield "** RECORD GROUP 2, FINITE ELEMENT NODE LIST"
    yield from (f"{POINT}{number}" for number in range(1, count + 1))
    yield from (frame.name for frame in frames)
    yield "** RECORD GROUP 3, INITIAL MODAL DISPLACEMENTS"
    yield from _rows(np.zeros(n))
    yield "** RECORD GROUP 4, INITIAL MODAL VELOCITIES"
    yield from _rows(np.zeros(n))
    for group, axis, column in zip((5, 6, 7), "XYZ", x.T, strict=True):
        yield f"** RECORD GROUP {group}, NODAL {axis} COORDINATES"
        yield from _rows(column)
    yield "** RECORD GROUP 8, MODE SHAPES"
    for mode in range(n):
        yield f"** NORMAL MODE SHAPE # {mode + 1}"
        yield from (_row(node) for node in moved[:, :, mode])


def _our_lines(body: ReducedBody) -> Iterator[str]:
    yield f"{OURS} frame {body.frame or ''}".rstrip()
    yield f"{OURS} mesh position {_row(body.p_MB_M)}"
    yield f"{OURS} mesh axes {_row(body.R_MB.ravel())}"
    for frame in body.interfaces:
        yield f"{OURS} axes {frame.name} {_row(frame.R_BI.ravel())}"


def _modal_mass(body: ReducedBody) -> FloatArray:
    """The unit matrix, as of every record up to round-off: MBDyn warns of whatever is beside the diagonal."""
    mass, unit = body.modal_mass(), np.eye(body.n_modes)
    return unit if np.abs(mass - unit).max() <= TEN_DIGITS else 0.5 * (mass + mass.T)


def _square(matrix: FloatArray) -> Iterator[str]:
    for row in matrix:
        yield from _rows(row)


def _rows(values: FloatArray) -> Iterator[str]:
    """Six numbers a line: MBDyn's scanner stops at a line of 8192 characters."""
    return (_row(values[at : at + 6]) for at in range(0, len(values), 6))


def _row(values: ArrayLike) -> str:
    return " ".join(number(float(value)) for value in np.asarray(values, dtype=np.float64))


def number(value: float) -> str:
    """All digits of a number; a stream in C++ fails at what is below the normal ones, so they are zero."""
    return repr(value) if abs(value) > 1e-300 else "0.0"


def vector(values: Iterable[float]) -> str:
    """A vector of an input deck."""
    return ", ".join(number(float(value)) for value in values)
