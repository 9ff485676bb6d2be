"""The record groups of a data file (.fem) of MBDyn's modal joint, as words, and their sizes."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from flexmbd.errors import ExportError
from flexmbd.export.mbdyn_files.mbdyn_file import OURS
from flexmbd.files.whole_file import finite
from flexmbd.record.groups import FloatArray

_HEADING = re.compile(r"\*\* RECORD GROUP +(\d{1,9})")
_NAMES = {
    2: "node labels", 5: "X coordinates", 6: "Y coordinates", 7: "Z coordinates", 8: "mode shapes", 9: "modal mass",
    10: "modal stiffness", 11: "nodal masses", 12: "rigid inertia", 13: "modal damping", 14: "invariant 3",
    15: "invariant 4", 16: "invariant 8", 17: "invariant 5", 18: "invariant 9", 19: "stress stiffening",
}  # fmt: skip
_NEEDED = (1, 2, 5, 6, 7, 8, 9, 10)
# No body of ours has more modes, and their squares are allocated.
_MOST_MODES = 5000


@dataclass(frozen=True)
class RecordGroups:
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
    def of(cls, path: str | Path, text: str) -> RecordGroups:
        """The groups of a file's text.

        Raises:
            ExportError: it is none, or a group is missing or there twice.
        """
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
        if missing:
            raise ExportError(
                f"{path} is no whole modal data file of MBDyn: it lacks record groups {', '.join(missing)}"
            )
        unknown = [str(group) for group in words if not 1 <= group <= max(_NAMES)]
        if unknown:
            raise ExportError(f"{path} has record groups {', '.join(unknown)}, which are not known: 1 to {max(_NAMES)}")
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

    def nodal_inertia(self) -> FloatArray:
        """(nodes, 6) masses along and moments of inertia about the axes; rows of zeros behind the nodes are left out.

        MBDyn's own NASTRAN bridge writes such rows; MBDyn reads no further than the nodes.
        """
        words, count = self.words[11], 6 * self.nodes
        if len(words) > count and len(words) % 6 == 0:
            rows = np.array(words, dtype=np.float64).reshape(-1, 6)
            if rows[self.nodes :].any():
                raise ExportError(
                    f"{self.path}: group 11, nodal masses, has {len(rows)} nodes, of which those after the "
                    f"{self.nodes} of the file have mass: the group belongs to another set of nodes"
                )
            words = words[:count]
        inertia = RecordGroups(self.path, {11: words}, (), self.nodes, self.modes).numbers(11, self.nodes, 6)
        if (inertia[:, :1] != inertia[:, 1:3]).any() or (inertia < 0.0).any():
            raise ExportError(f"{self.path}: group 11 has masses that differ from axis to axis, or negative ones")
        return inertia

    def stiffening(self, frames: int) -> dict[int, FloatArray]:
        """Matrices (n, n) of group 19 by the number of their load, from 0.

        Args:
            frames: how many interfaces there are beside the one that carries B.
        """
        words, square = self.words.get(19, ["0"]), self.modes**2
        count = int(words[0]) if words and words[0].isascii() and words[0].isdigit() and len(words[0]) < 10 else -1
        if count < 0 or len(words) != 1 + count * (1 + square):
            raise ExportError(f"{self.path}: group 19, stress stiffening, has not {words[:1]} matrices of numbers")
        found: dict[int, FloatArray] = {}
        for at in range(1, len(words), 1 + square):
            load = int(words[at])
            if load - 1 in found or not 0 < load <= 12 + 6 * frames:
                raise ExportError(
                    f"{self.path}: group 19, stress stiffening, has load {load}, twice or beyond the "
                    f"{12 + 6 * frames} of {frames} interfaces: name them by interfaces=, in the order in which the "
                    "file numbers them"
                )
            matrix = np.array(words[at + 1 : at + 1 + square], dtype=np.float64).reshape(self.modes, self.modes)
            found[load - 1] = finite(matrix, path=self.path, what=f"load {load} of group 19")
        return found

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
