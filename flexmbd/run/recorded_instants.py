"""The file of a recording: a log of blocks, each whole and checksummed (`files.tree_log`).

The first tree is about the bodies, each of the others holds further instants:

bodies      by number: name; node, x, triangle: undeformed, in body axes (`InteriorMesh`)

t           (k,) s
bodies      by number: fields by name, (k, nodes) or (k, nodes, m), position, velocity and acceleration as doubles, the
            others in single precision; body_position (k, 3), body_rotation (k, 3, 3); largest, largest_row (k,)

A run that is killed leaves the blocks that were written, and another process may read them while the machine runs.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import RecordError
from flexmbd.files.tree_file import FileKind, Tree
from flexmbd.files.tree_log import TreeLog, read_at, read_log
from flexmbd.multibody.interiors.observed import InteriorMesh

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

RECORDING = FileKind("flexmbd recording", 2, "simulate(..., recording=)")

#: What is recorded of a body beside its fields.
ONCE = ("body_position", "body_rotation", "largest", "largest_row")


@dataclass(frozen=True)
class _Block:
    """Where a block is in the file, and the rows of its instants."""

    begin: int
    end: int
    first: int
    rows: int


@dataclass(frozen=True, eq=False)
class RecordedInstants:
    """The instants of a recording; its blocks are read when they are asked for.

    Attributes:
        path: of the file.
        names: of the bodies.
        meshes: theirs.
        t: (nt,) s.
        fields: names of each body's fields; none where there are no instants yet.
    """

    path: Path
    names: tuple[str, ...]
    meshes: tuple[InteriorMesh, ...]
    t: FloatArray
    fields: tuple[tuple[str, ...], ...]
    _blocks: tuple[_Block, ...]

    def body(self, name: str) -> int:
        """The number of a body.

        Raises:
            RecordError: there is none of that name.
        """
        if name not in self.names:
            raise RecordError(f"{self.path} holds no body {name!r}")
        return self.names.index(name)

    def series(self, body: int, pick: Callable[[Tree], NDArray[Any]]) -> NDArray[Any]:
        """(nt, ...) the field that ``pick`` selects from a body's entry, block by block.

        Raises:
            RecordError: the file is damaged.
        """
        found = [pick(self._tree(k)["bodies"][str(body)]) for k in range(len(self._blocks))]
        if not found:
            raise RecordError(f"{self.path} holds no instants yet")
        return np.concatenate(found)

    def row(self, body: int, row: int, pick: Callable[[Tree], NDArray[Any]]) -> NDArray[Any]:
        """The field that ``pick`` selects from a body's entry, at one instant.

        Raises:
            RecordError: the file is damaged.
        """
        k = next(k for k, block in enumerate(self._blocks) if row < block.first + block.rows)
        found: NDArray[Any] = pick(self._tree(k)["bodies"][str(body)])[row - self._blocks[k].first]
        return found

    def _tree(self, k: int) -> Tree:
        return _tree_at(self.path, self._blocks[k].begin, self._blocks[k].end, _stamp(self.path))


def recorded_instants(path: Path) -> RecordedInstants:
    """The instants recorded by now.

    All of it is read and checked where the file has changed since the last call.

    Raises:
        RecordError: it cannot be read, is no recording, or is damaged; the message says where.
    """
    return _instants(path, _stamp(path))


def resumed_recording(path: Path, meshes: dict[str, InteriorMesh], t: float) -> tuple[TreeLog, float]:
    """The log of an earlier run to go on with from t (s), and its last instant by then (s), or NaN.

    What is damaged behind that time is written again.

    Raises:
        RecordError: it cannot be read or written, is damaged before that time, or is of other bodies.
    """
    last, end, part = float("nan"), 0, None
    try:
        for tree, after in read_log(path, kind=RECORDING):
            if not end:
                _refuse_other_bodies(path, _meshes(tree), meshes)
            else:
                kept = int((tree["t"] <= t).sum())
                if kept:
                    last = float(tree["t"][kept - 1])
                if kept < len(tree["t"]):
                    part = _first_rows(tree, kept) if kept else None
                    break
            end = after
    except (KeyError, ValueError, TypeError, AttributeError, IndexError) as reason:
        raise _other_content(path, reason) from reason
    except RecordError:
        if not last >= t:
            raise
    log = TreeLog.resume(path, size=end, kind=RECORDING)
    if part is not None:
        log.append(part)
    return log, last


def head_tree(meshes: dict[str, InteriorMesh]) -> Tree:
    """The first tree of a recording of these bodies."""
    return {
        "bodies": {
            str(k): {
                "name": name,
                "node": np.asarray(mesh.node, np.int64),
                "x": np.asarray(mesh.x, np.float64),
                "triangle": np.asarray(mesh.triangle, np.int64),
            }
            for k, (name, mesh) in enumerate(meshes.items())
        }
    }


def _stamp(path: Path) -> tuple[int, ...]:
    """Tells a file from another, and from itself once it has grown."""
    try:
        found = path.stat()
    except OSError as reason:
        raise RecordError(f"cannot read {path}: {reason.strerror or reason}") from reason
    return found.st_dev, found.st_ino, found.st_size, found.st_mtime_ns


@lru_cache(maxsize=8)
def _instants(path: Path, stamp: tuple[int, ...]) -> RecordedInstants:
    try:
        head: dict[str, InteriorMesh] = {}
        shapes: tuple[dict[str, tuple[int, ...]], ...] = ()
        blocks, times, begin = list[_Block](), [np.zeros(0)], 0
        for tree, end in read_log(path, kind=RECORDING):
            if not begin:
                head = _meshes(tree)
                shapes = ({},) * len(head)
            else:
                now = _checked(tree, head)
                if blocks and now != shapes:
                    raise ValueError(f"a block with the fields {now} after one with {shapes}")
                shapes = now
                times.append(tree["t"])
                blocks.append(_Block(begin, end, sum(map(len, times[:-1])), len(tree["t"])))
            begin = end
        fields = tuple(map(tuple, shapes))
        return RecordedInstants(path, tuple(head), tuple(head.values()), np.concatenate(times), fields, tuple(blocks))
    except (KeyError, ValueError, TypeError, AttributeError, IndexError) as reason:
        raise _other_content(path, reason) from reason


@lru_cache(maxsize=2)
def _tree_at(path: Path, begin: int, end: int, stamp: tuple[int, ...]) -> Tree:
    return read_at(path, begin, end, kind=RECORDING)


def _meshes(tree: Tree) -> dict[str, InteriorMesh]:
    found = [tree["bodies"][str(k)] for k in range(len(tree["bodies"]))]
    for one in found:
        nodes, triangle = len(one["node"]), one["triangle"]
        if one["x"].shape != (nodes, 3) or one["node"].shape != (nodes,) or triangle.shape[1:] != (3,):
            raise ValueError("a mesh of other shapes")
        if triangle.dtype != np.int64 or not ((triangle >= 0) & (triangle < nodes)).all():
            raise ValueError("triangles with unknown node numbers")
    return {str(one["name"]): InteriorMesh(one["node"], one["x"], one["triangle"]) for one in found}


def _checked(tree: Tree, meshes: dict[str, InteriorMesh]) -> tuple[dict[str, tuple[int, ...]], ...]:
    """The fields of each body and their shapes at a node; raises where arrays do not fit the meshes and instants."""
    rows, found = len(tree["t"]), list[dict[str, tuple[int, ...]]]()
    if tree["t"].shape != (rows,) or not np.isfinite(tree["t"]).all():
        raise ValueError("instants that are not finite ascending times")
    for k, mesh in enumerate(meshes.values()):
        body = tree["bodies"][str(k)]
        shapes = {"body_position": (rows, 3), "body_rotation": (rows, 3, 3), "largest": (rows,), "largest_row": (rows,)}
        for name, values in {**{name: body[name] for name in ONCE}, **body["fields"]}.items():
            if values.shape != shapes.get(name, (rows, len(mesh.node), *values.shape[2:])):
                raise ValueError(f"{name} of the shape {values.shape}")
            if not np.isfinite(values).all():
                raise ValueError(f"{name} that is not finite")
        nearest = body["largest_row"]
        if nearest.dtype != np.int64 or not ((nearest >= 0) & (nearest < len(mesh.node))).all():
            raise ValueError("the largest stress at an unknown node")
        found.append({name: values.shape[2:] for name, values in body["fields"].items()})
    return tuple(found)


def _first_rows(tree: Tree, count: int) -> Tree:
    return {name: _first_rows(part, count) if isinstance(part, dict) else part[:count] for name, part in tree.items()}


def _refuse_other_bodies(path: Path, found: dict[str, InteriorMesh], wanted: dict[str, InteriorMesh]) -> None:
    if [*found] != [*wanted] or any(not np.array_equal(found[name].node, wanted[name].node) for name in wanted):
        raise RecordError(f"{path} is a recording of other bodies; give the restart a file of its own")


def _other_content(path: Path, reason: Exception) -> RecordError:
    return RecordError(f"{path} is not a valid {RECORDING.format}: {reason}")
