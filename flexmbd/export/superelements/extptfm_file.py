"""OpenFAST's superelement file: module ExtPtfm, the text that its input file names as Red_FileName (OpenFAST 5).

One interface frame is the platform reference point: origin and axes of the platform, z up. Then come the modes with
that interface fixed.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from flexmbd.errors import ExportError
from flexmbd.export.loss import Capabilities, check_body, check_losses, checked_writer
from flexmbd.export.superelements.standing_body import Standing, standing_body
from flexmbd.export.superelements.superelement import Superelement, rigid_motion, superelement
from flexmbd.export.superelements.superelement_body import resistance
from flexmbd.export.superelements.superelement_frames import (
    InterfaceNode,
    ReadMatrices,
    body_of,
    checked_rows,
    comment,
    commented_interfaces,
)
from flexmbd.files.whole_file import read_text, write_file
from flexmbd.given import checked
from flexmbd.multibody.bodies.body import RigidBody
from flexmbd.record.groups import FloatArray
from flexmbd.record.reduced_body import ReducedBody

CAPABILITIES = Capabilities(interfaces=1, large_motion=False)

_MATRICES = {"!mass": "M", "!stiffness": "K", "!damping": "D"}


@checked_writer
def openfast(
    body: ReducedBody,
    path: str | Path,
    *,
    interface: str | None = None,
    gravity: float = 9.80665,
    lossy: bool = False,
) -> tuple[str, ...]:
    """Write a body as superelement of OpenFAST's ExtPtfm. Not collective.

    Rows: translations and rotations of the interface along its own axes, then the modes with it fixed, of unit mass.
    The self-weight W0 - K_W x is that in axes that follow the interface, as ExtPtfm asks.

    Args:
        body: with one interface; with more, the others are left free where ``lossy`` says so.
        path: destination.
        interface: the one at the platform reference point; the body frame's by default, else the first.
        gravity: m/s^2, against the interface's z axis.
        lossy: write although interfaces are left free.

    Returns:
        What is not in the file.

    Raises:
        ExportError: the body has none or several interfaces, or the destination cannot be written.
        InterfaceError: the body has no such interface.
    """
    left = check_losses(body, CAPABILITIES, kind="OpenFAST", lossy=lossy)
    if not body.interfaces:
        raise ExportError("OpenFAST takes one interface frame, and the body has none")
    chosen = body.interface(interface or body.frame or body.interfaces[0].name)
    element = _in_own_axes(superelement(body, interfaces=[chosen.name]))
    weight, stiffness = _self_weight(element.M, gravity)
    lines = [
        "! reduced body as superelement for ExtPtfm; SI units, x y z rx ry rz of the interface, then modes",
        "! " + comment(element, 0, node=0),
        f"!Dimension: {len(element.K)}",
    ]
    for title, matrix in {
        "!Mass Matrix (kg, m)": element.M,
        "!Stiffness Matrix (N, m)": element.K,
        "!Damping Matrix (N, m, s)": element.D,
        "!Weight constant (N, m)": weight[None, :],
        "!Weight stiffness matrix (N, m)": stiffness,
    }.items():
        lines += [title, *("".join(f"{float(value):25.16E}" for value in row) for row in matrix), ""]
    write_file(path, "\n".join(lines))
    return left


@checked(error=ExportError)
def openfast_connections(
    body: ReducedBody,
    path: str | Path,
    *,
    interface: str | None = None,
    reference: Sequence[float] = (0.0, 0.0, 0.0),
) -> tuple[str, ...]:
    """Write the other interfaces as connection points of ExtPtfm, its Conn_FileName (OpenFAST 5). Not collective.

    Moorings hold the body there. The columns are those of the superelement that `openfast` writes with the same
    ``interface``: ExtPtfm reads both.

    Args:
        body: with several interfaces.
        path: destination.
        interface: the one at the platform reference point, as of `openfast`.
        reference: (3,) m, the platform reference point in OpenFAST's axes, PtfmRefxt, PtfmRefyt and PtfmRefzt.

    Returns:
        Names of the connection points, in the file's order.

    Raises:
        ExportError: there is no other interface; ``reference`` is no point; the destination cannot be written.
        InterfaceError: the body has no such interface.
    """
    check_body(body)
    chosen = body.interface(interface or body.frame or body.interfaces[0].name) if body.interfaces else None
    points = [frame for frame in body.interfaces if chosen is not None and frame.name != chosen.name]
    if chosen is None or not points:
        raise ExportError("connection points are interfaces beside the one at the platform, and the body has none")
    origin = np.asarray(reference, dtype=np.float64)
    if origin.shape != (3,) or not np.isfinite(origin).all():
        raise ExportError(f"reference is {reference!r}; it is the platform reference point, three finite numbers (m)")
    element = superelement(body, interfaces=[chosen.name])
    R = chosen.R_BI
    motion = element.motion.copy()
    motion[:, :6] = motion[:, :6] @ np.kron(np.eye(2), R)
    places = [origin + R.T @ (frame.p_BI_B - chosen.p_BI_B) for frame in points]
    moved = [R.T @ (np.hstack([rigid_motion(frame.p_BI_B)[:3], frame.modes[:3]]) @ motion) for frame in points]
    names = tuple(frame.name for frame in points)
    lines = [
        f"! connection points of a reduced body for ExtPtfm: {json.dumps(names)}",
        f"!nConn: {len(points)}",
        "",
        "!Connections (m)",
        *("".join(f"{float(value):25.16E}" for value in place) for place in places),
        "",
        "!Displacement (m)",
        *("".join(f"{float(value):25.16E}" for value in row) for row in np.vstack(moved)),
        "",
    ]
    write_file(path, "\n".join(lines))
    return names


def _in_own_axes(element: Superelement) -> Superelement:
    """A superelement of one interface along that interface's axes, from its origin."""
    turn = np.eye(len(element.K))
    turn[:3, :3] = turn[3:6, 3:6] = element.R[0]
    K, M, D = (turn.T @ matrix @ turn for matrix in (element.K, element.M, element.D))
    K[:6] = K[:, :6] = 0.0  # of a free body these are round-off, and ExtPtfm wants zeros
    return Superelement(element.names, np.zeros((1, 3)), np.eye(3)[None], K, M, D, element.frame)


def _self_weight(M: FloatArray, gravity: float) -> tuple[FloatArray, FloatArray]:
    """W0 (N,) and K_W (N, N), from the mass matrix: forces of gravity in axes that turn with the interface.

    Gravity is there -g (e_z - theta x e_z), the arms of the forces are c and the modes' integrals.
    """
    weight = -gravity * M[2]
    stiffness = np.zeros_like(M)
    # force and moment rows: gravity turns; with the arm of the mass the moment about the vertical changes too
    stiffness[:, 3] = gravity * M[1]
    stiffness[:, 4] = -gravity * M[0]
    # moment rows again: the modes move the mass
    stiffness[3, 6:] = gravity * M[1, 6:]
    stiffness[4, 6:] = -gravity * M[0, 6:]
    return weight, stiffness


@checked(error=ExportError)
def read_openfast(
    path: str | Path,
    *,
    interfaces: Mapping[str, InterfaceNode] | None = None,
    frame: str | None = None,
    foundation: str | None = None,
    rigid: RigidBody | None = None,
) -> ReducedBody:
    """Read a body from a superelement file of OpenFAST 5. Not collective.

    A structure on its foundation, as a jacket with the stiffness of its soil, is no free body: it becomes one whose
    frame is the interface ``foundation``, to be fixed to the ground, at the place of the platform at rest.  Gravity
    along z loads it as the file's constant weight says; what changes of that with the platform's motion is left out.

    Args:
        path: the file that Red_FileName names.
        interfaces: name of the one interface; default: as a file of ours says, else "platform", at the origin.
        frame: "" for a body frame that floats; default: as a file of ours says, else on the interface.
        foundation: name of the interface that a structure on its foundation stands on.
        rigid: its mass, centre and inertia, from the platform reference point: the file has no such numbers.

    Raises:
        ExportError: the file is damaged, or holds something else; the structure is held, and ``foundation`` is not
            given, or is free, and it is.
    """
    text = read_text(path)
    lines = text.splitlines()
    try:
        size = next(_dimensions(lines), 0)
        checked_rows(size, path, content=len(text))
        found = {name: _matrix(lines, keyword, size) for keyword, name in _MATRICES.items()}
    except ValueError as error:
        raise ExportError(f"{path}: {error}") from error
    ours = commented_interfaces(lines)
    named = dict(interfaces or ours.interfaces or {"platform": InterfaceNode(np.zeros(3))})
    placed = {
        name: InterfaceNode(np.zeros(3) if one.position is None else one.position, axes=one.axes)
        for name, one in named.items()
    }
    read = ReadMatrices(placed, found["K"], found["M"], found["D"], frame=ours.frame, floating=ours.floating)
    if foundation is None:
        return _free(path, read, frame)
    if rigid is None or len(placed) != 1 or foundation in placed:
        raise ExportError(
            f"{path}: a structure on the foundation {foundation!r} has one other interface, and its mass, centre and "
            "inertia, which the file does not tell, are given by rigid=fm.RigidBody(mass, inertia, com)"
        )
    try:
        weight = _matrix(lines, "!weight constant", size, rows=1)[0]
    except ValueError as error:
        raise ExportError(f"{path}: {error}; without it nobody knows how gravity loads the structure") from error
    standing = Standing(foundation, next(iter(placed)), rigid)
    return standing_body(read, weight, standing, source=str(path))


def _free(path: str | Path, read: ReadMatrices, frame: str | None) -> ReducedBody:
    try:
        return body_of(read, path, interfaces=None, frame=frame)
    except ExportError as error:
        # of a free body the forces of rigid motions are round-off of what cancels
        if len(read.K) >= 6 and np.isfinite(read.K).all() and resistance(read.K, np.eye(len(read.K), 6)) > 0.5:
            raise ExportError(
                f"{error}. Of a structure on its foundation say so: foundation='seabed', rigid=fm.RigidBody(...)"
            ) from error
        raise


def _dimensions(lines: list[str]) -> Iterator[int]:
    for line in lines:
        if line.lower().startswith("!dimension"):
            text = line.partition(":")[2].strip()
            if not (text.isascii() and text.isdigit() and len(text) < 9):
                raise ValueError(f"the dimension {text[:30]!r} is not a whole number")
            yield int(text)


def _matrix(lines: list[str], keyword: str, size: int, *, rows: int | None = None) -> FloatArray:
    starts = [i for i, line in enumerate(lines) if line.lower().startswith(keyword)]
    if len(starts) != 1:
        raise ValueError(f"it holds {len(starts)} matrices {keyword!r}; one is needed")
    at = starts[0] + 1
    # older versions repeat the dimension
    at += at < len(lines) and lines[at].startswith("!")
    count = size if rows is None else rows
    table = [line.split() for line in lines[at : at + count]]
    if len(table) != count or any(len(row) != size for row in table):
        raise ValueError(f"the matrix {keyword!r} is not of {count} rows and {size} columns")
    return np.array([[float(word.replace("D", "E")) for word in row] for row in table]).reshape(count, size)
