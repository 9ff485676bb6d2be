"""Reduced bodies from data files (.fem) of MBDyn's modal joint, ours and others'."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from flexmbd.errors import ExportError, RecordError
from flexmbd.export.mbdyn_files.mbdyn_file import OURS
from flexmbd.export.normal_modes import normal_modes
from flexmbd.files.whole_file import finite, read_text
from flexmbd.given import checked
from flexmbd.record.groups import FloatArray, InterfaceFrame, NodalModes
from flexmbd.record.reduced_body import ReducedBody

_HEADING = re.compile(r"\*\* RECORD GROUP +(\d{1,9})")
_NAMES = {
    2: "node labels", 5: "X coordinates", 6: "Y coordinates", 7: "Z coordinates", 8: "mode shapes", 9: "modal mass",
    10: "modal stiffness", 11: "nodal masses", 13: "modal damping",
}  # fmt: skip
_NEEDED = (1, 2, 5, 6, 7, 8, 9, 10, 11)
# No body of ours has more modes, and their squares are allocated.
_MOST_MODES = 5000
# Relative difference between group 9 and the modal mass of the nodes: more is another body.
_AGREE = 1e-6


@checked(error=ExportError)
def read_mbdyn(path: str | Path, *, interfaces: Sequence[str] | None = None) -> ReducedBody:
    """Read a data file of MBDyn's modal joint. Not collective.

    The Gram matrix follows from the nodes' masses, moments of inertia and shapes; groups 3, 4 and 12 are passed over.
    Frames are nodes, with the axes of B where the file does not tell others.  Modes that are not in normal form are
    brought to it; the partition tells how.

    Args:
        path: a .fem file.
        interfaces: labels of the nodes that become frames; by default those without mass.

    Raises:
        ExportError: the file is missing, damaged, or holds something else; it has no nodal masses, or they are not
            those of its modal mass; a label is not known.
    """
    try:
        with np.errstate(all="raise", under="ignore"):
            return _body(path, _Groups.of(path, read_text(path)), interfaces)
    except ExportError:
        raise
    except (LookupError, ValueError, TypeError, ArithmeticError, np.linalg.LinAlgError, RecordError) as error:
        raise ExportError(f"{path} does not hold the modal data of one body: {error}") from error


@dataclass(frozen=True)
class _Groups:
    """The words of each group, without comments, and the lines that are ours.

    Attributes:
        path: of the file.
        words: of each group by its number.
        ours: what follows `OURS`, a line each.
        nodes: number of nodes.
        modes: number of modes.
    """

    path: str | Path
    words: dict[int, list[str]]
    ours: tuple[str, ...]
    nodes: int
    modes: int

    @classmethod
    def of(cls, path: str | Path, text: str) -> _Groups:
        words: dict[int, list[str]] = {}
        ours = []
        found: list[str] = []
        # not splitlines, which breaks lines where C++ does not
        lines = iter(text.replace("\r\n", "\n").split("\n"))
        for line in lines:
            if line.startswith("** END OF FILE"):
                break
            heading = _HEADING.match(line)
            if heading:
                group = int(heading[1])
                if group in words:
                    raise ExportError(f"{path} has record group {group} twice")
                if not words and group != 1:
                    raise ExportError(
                        f"{path} is no modal data file of MBDyn: its first record group is {group}, not 1"
                    )
                found = words[group] = []
                if group == 1:
                    next(lines, None)  # one line of comment, whatever it holds
            elif line.startswith(OURS):
                ours.append(line.removeprefix(OURS).strip())
            elif not line.startswith("**"):
                found += line.split()
        missing = [str(group) for group in _NEEDED if group not in words]
        if missing == ["11"]:
            raise ExportError(
                f"{path} has no group 11, nodal masses: without them the coupling of modes and motion is not known"
            )
        if missing:
            raise ExportError(
                f"{path} is no whole modal data file of MBDyn: it lacks record groups {', '.join(missing)}"
            )
        return cls(path, words, tuple(ours), *_counts(path, words[1]))

    def numbers(self, group: int, *shape: int) -> FloatArray:
        """The numbers of a group."""
        words, count = self.words[group], int(np.prod(shape, dtype=object))
        if len(words) != count:
            raise ExportError(
                f"{self.path}: group {group}, {_NAMES[group]}, has {len(words)} numbers, expected {count}"
            )
        return finite(
            np.array(words, dtype=np.float64).reshape(shape), path=self.path, what=f"group {group}, {_NAMES[group]},"
        )

    def labels(self) -> list[str]:
        """Of all nodes."""
        labels = self.words[2]
        if len(labels) != self.nodes:
            raise ExportError(f"{self.path}: group 2, node labels, has {len(labels)} labels, expected {self.nodes}")
        if len(set(labels)) != len(labels):
            raise ExportError(f"{self.path}: two nodes share a label")
        return labels


def _counts(path: str | Path, header: list[str]) -> tuple[int, int]:
    """Nodes and modes: revision, nodes, normal, attached, constraint and rejected modes."""
    if len(header) != 6 or not all(word.isascii() and word.isdigit() and len(word) < 10 for word in header[1:]):
        raise ExportError(f"{path}: group 1 has {' '.join(header[:8])!r}, expected a revision and five numbers")
    nodes, normal, attached, constraint, rejected = map(int, header[1:])
    modes = normal + attached + constraint
    if rejected:
        raise ExportError(f"{path} has {rejected} rejected modes, which are not read: write it without them")
    if not (nodes > 0 and 0 < modes <= _MOST_MODES):
        raise ExportError(f"{path} claims {nodes} nodes and {modes} modes; from 1 to {_MOST_MODES} modes are read")
    return nodes, modes


def _body(path: str | Path, groups: _Groups, interfaces: Sequence[str] | None) -> ReducedBody:
    k, n = groups.nodes, groups.modes
    labels = groups.labels()
    x = np.column_stack([groups.numbers(group, k) for group in (5, 6, 7)])
    shapes = np.moveaxis(groups.numbers(8, n, k, 6), 0, -1)
    inertia = groups.numbers(11, k, 6)
    if (inertia[:, :1] != inertia[:, 1:3]).any() or (inertia < 0.0).any():
        raise ExportError(f"{path}: group 11 has masses that differ from axis to axis, or negative ones")
    gram = _gram(x, shapes, inertia)
    mass = groups.numbers(9, n, n)
    nodal = np.einsum("iaja->ij", gram[4:, 4:].reshape(n, 3, n, 3))
    apart = np.abs(nodal - mass).max() / np.abs(mass).max()
    if not apart < _AGREE:
        raise ExportError(
            f"{path}: the modal mass of group 9 and that of the nodes' masses in group 11 are {apart:.1e} apart, so "
            "they are of two bodies: lump the mass first and compute the modes from it"
        )
    stiffness, basis = normal_modes(path, groups.numbers(10, n, n), mass=mass)
    damping = groups.numbers(13, n, n) if 13 in groups.words else np.zeros((n, n))
    change = np.eye(4 + 3 * n)
    change[4:, 4:] = np.kron(basis, np.eye(3))
    shapes = shapes @ basis
    massless = [label for label, m in zip(labels, inertia[:, 0], strict=True) if m == 0.0]
    names = massless if interfaces is None else interfaces
    unknown = [name for name in names if name not in labels]
    if unknown:
        raise ExportError(f"{path} has no node {unknown[0]!r}; its nodes begin with {', '.join(labels[:8])}")
    comments = dict(_comments(groups.ours))
    frames = tuple(
        InterfaceFrame(name, x[row], _axes(path, comments.get(f"axes {name}")), shapes[row])
        for name, row in ((name, labels.index(name)) for name in names)
    )
    return ReducedBody(
        gram=change.T @ gram @ change,
        stiffness=stiffness,
        damping=basis.T @ damping @ basis,
        interfaces=frames,
        frame=_frame(frames, comments),
        partition=basis,
        partition_names=tuple(f"mode {number + 1}" for number in range(n)),
        provenance={"read from": "modal data file of MBDyn"},
        p_MB_M=_numbers(path, comments.get("mesh position"), 3, default=np.zeros(3)),
        R_MB=_axes(path, comments.get("mesh axes")),
        modes=None if groups.ours else _nodal_modes(labels, x, shapes),
    )


def _gram(x: FloatArray, shapes: FloatArray, inertia: FloatArray) -> FloatArray:
    """Mass integrals of nodes with mass, and with moments of inertia J about the axes.

    A node's second moment along axis a is s_a = tr(J)/2 - J_a; a particle at e_a from the node has the fields e_a
    and r x e_a, of the rotation r.
    """
    k, _, n = shapes.shape
    fields = np.ones((k, 4 + 3 * n))
    fields[:, 1:4] = x
    fields[:, 4:] = shapes[:, :3].swapaxes(1, 2).reshape(k, 3 * n)
    gram: FloatArray = fields.T @ (inertia[:, :1] * fields)
    turning = np.flatnonzero(inertia[:, 3:].any(axis=1))
    for axis in range(3):
        along = np.zeros((len(turning), 4 + 3 * n))
        along[:, 1 + axis] = 1.0
        turned = np.cross(shapes[turning, 3:], np.eye(3)[axis], axisa=1, axisb=0, axisc=1)
        along[:, 4:] = turned.swapaxes(1, 2).reshape(len(turning), 3 * n)
        second = 0.5 * inertia[turning, 3:].sum(axis=1) - inertia[turning, 3 + axis]
        gram += along.T @ (second[:, None] * along)
    return 0.5 * (gram + gram.T)


def _comments(ours: tuple[str, ...]) -> Iterator[tuple[str, str]]:
    """(what, its words) of our lines."""
    for line in ours:
        what, _, rest = line.partition(" ")
        if what in ("mesh", "axes"):
            second, _, rest = rest.partition(" ")
            what = f"{what} {second}"
        yield what, rest.strip()


def _numbers(path: str | Path, words: str | None, count: int, *, default: FloatArray) -> FloatArray:
    if words is None:
        return default
    values = np.array(words.split(), dtype=np.float64)
    if values.shape != (count,):
        raise ExportError(f"{path}: a line beginning with {OURS!r} has {values.size} numbers, expected {count}")
    return finite(values, path=path, what=f"a line beginning with {OURS!r}")


def _axes(path: str | Path, words: str | None) -> FloatArray:
    axes = _numbers(path, words, 9, default=np.eye(3).ravel()).reshape(3, 3)
    if np.abs(axes.T @ axes - np.eye(3)).max() > 1e-9:
        raise ExportError(f"{path}: axes in a line beginning with {OURS!r} are not at right angles")
    return axes


def _frame(frames: tuple[InterfaceFrame, ...], comments: dict[str, str]) -> str | None:
    """The interface that carries B: as told, else the first node at the origin that no mode moves."""
    if "frame" in comments:
        return comments["frame"] if any(frame.name == comments["frame"] for frame in frames) else None
    return next((frame.name for frame in frames if not (frame.p_BI_B.any() or frame.modes.any())), None)


def _nodal_modes(labels: list[str], x: FloatArray, shapes: FloatArray) -> NodalModes:
    """The nodes by their labels where these are numbers, else in their order."""
    whole = all(label.isascii() and label.isdigit() and len(label) < 10 for label in labels)
    numbers = np.array([int(label) for label in labels] if whole else range(len(labels)), dtype=np.int64)
    order = np.argsort(numbers, kind="stable")
    return NodalModes(numbers[order], x[order], shapes[order, :3])
