"""Interfaces in the files of superelements: their names, positions and axes, and comments about them.

Programs know numbers of nodes and positions. Names, axes and the body frame stand in comments, one JSON object an
interface, so that a file of ours comes back with them and other programs pass over them.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from flexmbd.errors import ExportError
from flexmbd.export.superelements.superelement import Superelement
from flexmbd.export.superelements.superelement_body import reduced_body
from flexmbd.export.superelements.unit_system import SI, to_si, unit_system
from flexmbd.files.whole_file import LARGEST
from flexmbd.given import checked
from flexmbd.record.groups import FloatArray
from flexmbd.record.reduced_body import ReducedBody
from flexmbd.rotation import from_quaternion, to_quaternion

#: Rows of the matrices of a superelement that is read; 200 MB a matrix.
MOST_ROWS = 5_000
_MARK = "flexmbd interface "
_NODE_MARK = "flexmbd nodal interface "


@checked(error=ExportError)
@dataclass(frozen=True, eq=False)
class InterfaceNode:
    """An interface of a file that another program wrote.

    Attributes:
        position: (3,) in the file's axes and units, m as a rule; None: as the file says.
        node: its number in the file, where nodes have numbers there.
        axes: (3, 3) rotation from the interface's axes to the file's.
    """

    position: ArrayLike | None = None
    node: int | None = None
    axes: ArrayLike = field(default_factory=lambda: np.eye(3))


@dataclass(frozen=True, eq=False)
class ReadMatrices:
    """The matrices of a superelement in a file: rows of `interfaces` in order, then of the modes.

    `units` is what the file itself says of them, None where it says nothing.
    """

    interfaces: dict[str, InterfaceNode]
    K: FloatArray
    M: FloatArray
    D: FloatArray | None = None
    frame: str | None = None
    floating: bool = False
    units: str | None = None


@dataclass(frozen=True, eq=False)
class FileComments:
    """The contents of flexmbd's own comments; empty of other programs' files.

    Attributes:
        interfaces: by name, in the file's units.
        frame: the interface that carries the body frame.
        floating: whether the body frame is on none.
        units: length-mass-time.
    """

    interfaces: dict[str, InterfaceNode]
    frame: str | None
    floating: bool
    units: str | None


def comment(element: Superelement, number: int, *, node: int, units: str = SI) -> str:
    """One line, ASCII whatever the name, that says what the file's numbers do not."""
    name = element.names[number]
    content = {
        "name": name,
        "node": node,
        "position": element.p[number].tolist(),
        "quaternion": to_quaternion(element.R[number]).tolist(),
        "frame": "floating" if element.frame is None else element.frame == name,
        "units": units,
    }
    return _MARK + json.dumps(content)


def node_comment(element: Superelement, number: int, *, node: int) -> str:
    """One line that says which node of the mesh a node of the file is."""
    content = {"interface": element.node_interface[number], "mesh node": int(element.node[number]), "node": node}
    return _NODE_MARK + json.dumps(content)


def commented_interfaces(lines: Iterable[str], *, bound: bool = False) -> FileComments:
    """The comments about interfaces of a file of ours; older ones do not name their units, which are SI.

    Args:
        lines: of the file.
        bound: whether its nodes of three components will be bound to frames.

    Raises:
        ExportError: a comment of ours is damaged, or the file holds nodal interfaces that nobody binds.
    """
    interfaces: dict[str, InterfaceNode] = {}
    frame, floating, units = None, False, None
    for line in lines:
        if _NODE_MARK in line and not bound:
            raise ExportError(
                "the file holds nodal interfaces, nodes of three components, which are not read back as such: bind "
                "them to frames, interfaces={name: NodeSet(nodes)}, or keep the record (body.save)"
            )
        before, mark, content = line.partition(_MARK)
        if not mark or before.strip(" !$*%"):
            continue
        try:
            item = json.loads(content)
            name, node = str(item["name"]), int(item["node"])
            if name in interfaces:
                raise ValueError("named twice")
            axes = from_quaternion(unit_quaternion(item["quaternion"]))
            interfaces[name] = InterfaceNode(position(item["position"]), node, axes)
            floating = floating or item["frame"] == "floating"
            frame = name if item["frame"] is True else frame
            units = str(item.get("units", SI))
            unit_system(units)
        except (KeyError, TypeError, ValueError, OverflowError, RecursionError, ExportError) as error:
            raise ExportError(f"the comment about an interface is damaged: {line.strip()[:80]!r} ({error})") from error
    return FileComments(interfaces, frame, floating, units)


def position(value: Any) -> FloatArray:
    """(3,) finite numbers, or ValueError."""
    array = np.asarray(value, dtype=np.float64)
    if array.shape != (3,) or not np.isfinite(array).all():
        raise ValueError(f"a position is three finite numbers, not {value!r}")
    return array


def unit_quaternion(value: Any) -> FloatArray:
    """(4,) of length one, or ValueError."""
    array = np.asarray(value, dtype=np.float64)
    if array.shape != (4,) or not abs(np.linalg.norm(array) - 1.0) < 1e-6:
        raise ValueError(f"a unit quaternion is four numbers, not {value!r}")
    unit: FloatArray = array / np.linalg.norm(array)
    return unit


def body_of(
    read: ReadMatrices,
    path: str | Path,
    *,
    interfaces: Mapping[str, InterfaceNode] | None,
    frame: str | None,
    units: str | None = None,
) -> ReducedBody:
    """The body of a file's matrices.

    Args:
        read: what the file holds.
        path: of the file.
        interfaces: as the caller named them, in the order of the rows; None: as the file says.
        frame: the interface that shall carry the body frame, "" for the floating one; None: as the file says, or the
            first.
        units: of the file's numbers, as "mm-t-s"; None: as the file says, or SI.

    Raises:
        ExportError: there are no such units, or the file says others; positions are missing, the sizes do not fit, or
            the matrices are those of no free body.
    """
    system = unit_system((read.units or SI) if units is None else units)
    if read.units is not None and system != unit_system(read.units):
        raise ExportError(
            f"{path} says that its units are {read.units}, and is read with units={units!r}: leave that argument out"
        )
    named = dict(read.interfaces if interfaces is None else interfaces)
    if not named:
        raise ExportError(
            f"{path} does not say which interfaces its rows belong to: give interfaces={{name: InterfaceNode(...)}}"
        )
    places, axes = [], []
    for name, one in named.items():
        try:
            if one.position is None:
                raise ValueError("it has no position: give InterfaceNode(position=(x, y, z))")
            places.append(position(one.position))
            axes.append(_rotation(one.axes))
        except (TypeError, ValueError) as error:
            raise ExportError(f"{path}: interface {name!r}: {error}") from error
    size = len(read.K)
    D = np.zeros_like(read.K) if read.D is None else read.D
    if size < 6 * len(named) or any(matrix.shape != (size, size) for matrix in (read.K, read.M, D)):
        raise ExportError(
            f"{path}: K {read.K.shape}, M {read.M.shape} and D {D.shape} are not the square matrices of "
            f"{len(named)} interfaces of six rows each, and modes"
        )
    for matrix, what in ((read.K, "K"), (read.M, "M"), (D, "D")):
        if not np.isfinite(matrix).all():
            raise ExportError(f"{path}: matrix {what} holds values that are not finite")
    chosen: str | None = frame
    if frame is None:
        chosen = None if read.floating else read.frame or next(iter(named))
    elif frame == "":
        chosen = None
    if chosen is not None and chosen not in named:
        raise ExportError(f"{path} has no interface {chosen!r} for the body frame; it has {', '.join(named)}")
    element = Superelement(tuple(named), np.array(places), np.array(axes), read.K, read.M, D, chosen)
    return reduced_body(to_si(element, system), source=str(path))


def checked_size(rows: int, path: str | Path) -> int:
    """The number of rows of a matrix, when it is not absurd."""
    if not 0 < rows <= MOST_ROWS:
        raise ExportError(f"{path} claims matrices of {rows} rows; superelements have 1 to {MOST_ROWS}")
    return rows


def checked_rows(rows: int, path: str | Path, *, content: int) -> int:
    """The rows of a dense matrix that stands in a file of so many characters, two at least a number."""
    checked_size(rows, path)
    if rows * rows * 2 > min(content, LARGEST):
        raise ExportError(f"{path} claims matrices of {rows} rows, and is too short to hold them")
    return rows


def _rotation(axes: ArrayLike) -> FloatArray:
    R = np.asarray(axes, dtype=np.float64)
    if R.shape != (3, 3) or not abs(R.T @ R - np.eye(3)).max() < 1e-6 or np.linalg.det(R) < 0.0:
        raise ValueError("its axes are no rotation (3, 3)")
    return R
