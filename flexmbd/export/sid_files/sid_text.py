"""The text of a SID_FEM file: nested keywords, numbers with Fortran's exponent D.

    <nodes> <modes> : free text
    part
      new modal =
        refmod .. end refmod            mass, number and names of the modes
        frame .. end frame              per node: new node = <number>, rframe, origin, phi, psi, AP, end node
        mdCM, J, Ct, Cr, Me, Gr, Ge, Oe, ksigma, Ke, De
      end modal
    end part

Each matrix is a block: its name, six numbers, its entries that are not zero, `end` and its name.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from enum import IntEnum
from pathlib import Path

import numpy as np

from flexmbd.errors import ExportError
from flexmbd.export.sid_files.taylor_blocks import BLOCKS, Taylor
from flexmbd.files.whole_file import read_text
from flexmbd.record.groups import FloatArray

#: More modes or numbers than a reduced body has; a short file could claim any.
MOST_MODES = 2000
MOST_NUMBERS = 2**26

#: Blocks of a node.
NODE_BLOCKS = ("origin", "phi", "psi", "AP")


class Structure(IntEnum):
    """The head of a block, before the entries of its matrix."""

    ZERO = 0
    DIAGONAL = 1
    SYMMETRIC = 2
    FULL = 3
    UNIT = 4


@dataclass(frozen=True, eq=False)
class SidNode:
    """A node.

    Attributes:
        number: as the file calls it.
        blocks: origin, phi, psi, AP by name, those that the file has.
    """

    number: int
    blocks: dict[str, Taylor]


@dataclass(frozen=True, eq=False)
class SidModal:
    """The contents of a SID file.

    Attributes:
        title: the free text of its first line.
        mass: kg.
        frequencies: (n,) Hz of the modes, for their names; nothing of a file that is read.
        nodes: in the file's order.
        blocks: of the body by name, those that the file has.
        n_modes: n.
    """

    title: str
    mass: float
    nodes: tuple[SidNode, ...]
    blocks: dict[str, Taylor]
    n_modes: int
    frequencies: FloatArray = field(default_factory=lambda: np.zeros(0))


def sid_text(modal: SidModal) -> str:
    """The file's text."""
    lines = [
        f"{len(modal.nodes):5d} {modal.n_modes:5d}    : {modal.title}",
        "part",
        "  new modal =",
        "    refmod",
        f"      mass = {_real(modal.mass)}",
        f"      nelastq = {modal.n_modes:5d}",
        *(f"      ielastq ({i:4d}) = Mode {i:5d} : {hz:14.6f} Hz" for i, hz in enumerate(modal.frequencies, start=1)),
        "    end refmod",
        "    frame",
    ]
    for node in modal.nodes:
        lines += [f"      new node = {node.number:5d}", "        rframe = body ref"]
        for name, block in node.blocks.items():
            lines += _block(name, block, modal.n_modes, " " * 8)
        lines.append("      end node")
    lines.append("    end frame")
    for name, block in modal.blocks.items():
        lines += _block(name, block, modal.n_modes, " " * 4)
    lines += ["  end modal", "end part", ""]
    return "\n".join(lines)


def _block(name: str, block: Taylor, n: int, margin: str) -> Iterator[str]:
    rows, columns = block.m0.shape
    structure = _structure(block)
    numbers = {
        "order": 0 if block.m1 is None else 1,
        "nrow": rows,
        "ncol": columns,
        "nq": n,
        "nqn": 0,
        "structure": int(structure),
    }
    yield margin + name
    for key, number in numbers.items():
        yield f"{margin}  {key:<10}= {number:5d}"
    if structure is not Structure.UNIT:
        for r, c in np.argwhere(block.m0):
            yield f"{margin}  m0({r + 1:3d},{c + 1:3d}) = {_real(block.m0[r, c])}"
    if block.m1 is not None:
        for r, q, c in np.argwhere(block.m1):
            yield f"{margin}  m1({r + 1:3d},{q + 1:3d},{c + 1:3d}) = {_real(block.m1[r, q, c])}"
    yield f"{margin}end {name}"


def _structure(block: Taylor) -> Structure:
    m0 = block.m0
    if block.m1 is not None:
        return Structure.FULL
    if not m0.any():
        return Structure.ZERO
    if len(m0) == m0.shape[1] and not (m0 - np.diag(np.diag(m0))).any():
        return Structure.UNIT if (np.diag(m0) == 1.0).all() else Structure.DIAGONAL
    return Structure.FULL


def _real(value: float) -> str:
    return f"{value: .16E}".replace("E", "D")


# ------------------------------------------------------------------------------------------------------------ reading

_SIZE = re.compile(r"(order|nrow|ncol|nq|nqn|structure)\s*=\s*(\d{1,9})$")
_NUMBER = r"([+-]?(?:\d+\.?\d*|\.\d+)(?:[dDeE][+-]?\d{1,4}|[+-]\d{3})?)"
_ENTRY = re.compile(r"m([01n])\s*\(\s*(\d{1,9})\s*,\s*(\d{1,9})\s*(?:,\s*(\d{1,9})\s*)?\)\s*=\s*" + _NUMBER + "$")
_MASS = re.compile(r"mass\s*=\s*" + _NUMBER + "$")
_COUNT = re.compile(r"nelastq\s*=\s*(\d{1,9})$")
_NODE = re.compile(r"new\s+node\s*=\s*(\d{1,9})$")
_HEAD = re.compile(r"\s*(\d{1,9})\s+(\d{1,9})(?:[\s:](.*))?$")


def parse_sid(path: str | Path) -> SidModal:
    """Read a file's text.

    Raises:
        ExportError: it is no such file, is cut short, or its counts and sizes do not fit together.
    """
    return _Parser(path, read_text(path)).modal()


class _Parser:
    """Goes through the lines once; every refusal names the line."""

    def __init__(self, path: str | Path, text: str) -> None:
        self.path = path
        self.lines = [line.strip() for line in text.splitlines()]
        self.at = 0
        self.n = 0
        self.left = MOST_NUMBERS

    def refuse(self, reason: str) -> ExportError:
        return ExportError(f"{self.path}, line {self.at}: {reason}")

    def next(self, inside: str) -> str:
        """The next line that is not empty."""
        while self.at < len(self.lines):
            self.at += 1
            if self.lines[self.at - 1]:
                return self.lines[self.at - 1]
        raise self.refuse(f"the file ends inside {inside}; it was cut short or is no SID_FEM file")

    def modal(self) -> SidModal:
        head = _HEAD.match(self.next("its first line"))
        if head is None:
            raise self.refuse("a SID_FEM file begins with its numbers of nodes and of modes")
        n_nodes, self.n = int(head[1]), int(head[2])
        if self.n > MOST_MODES:
            raise self.refuse(f"it claims {self.n} modes, and {MOST_MODES} are the most that are read")
        for keyword in ("part", "new modal"):
            line = self.next("the heading")
            if line.rstrip("= ") != keyword:
                raise self.refuse(f"expected {keyword!r}, found {line[:40]!r}; only objects of the kind modal are read")
        mass: float | None = None
        nodes: tuple[SidNode, ...] = ()
        blocks: dict[str, Taylor] = {}
        while (line := self.next("modal")) != "end modal":
            word = line.removeprefix("new ").rstrip("= ")
            if word == "refmod":
                mass = self.refmod()
            elif word == "frame":
                nodes = self.nodes()
            elif word in BLOCKS and word not in blocks:
                blocks[word] = self.block(word)
            else:
                raise self.refuse(
                    f"{line[:40]!r} is not a block of a body, or comes twice; those are {', '.join(BLOCKS)}"
                )
        if mass is None:
            raise self.refuse("the body has no refmod with its mass and its number of modes")
        if len(nodes) != n_nodes:
            raise self.refuse(f"the first line says {n_nodes} nodes, and there are {len(nodes)}")
        return SidModal((head[3] or "").lstrip(": ").strip(), mass, nodes, blocks, self.n)

    def refmod(self) -> float:
        mass: float | None = None
        while (line := self.next("refmod")) != "end refmod":
            if found := _MASS.match(line):
                mass = self.real(found[1])
            elif (found := _COUNT.match(line)) and int(found[1]) != self.n:
                raise self.refuse(f"refmod says {found[1]} modes, and the first line {self.n}")
        if mass is None or not mass > 0.0:
            raise self.refuse(f"the mass must be positive, found {mass}")
        return mass

    def nodes(self) -> tuple[SidNode, ...]:
        nodes = []
        while (line := self.next("frame")) != "end frame":
            found = _NODE.match(line)
            if found is None:
                raise self.refuse(f"expected 'new node = <number>', found {line[:40]!r}")
            nodes.append(SidNode(int(found[1]), self.node()))
        return tuple(nodes)

    def node(self) -> dict[str, Taylor]:
        blocks: dict[str, Taylor] = {}
        while (line := self.next("node")) != "end node":
            if line in NODE_BLOCKS and line not in blocks:
                blocks[line] = self.block(line)
            elif line == "sigma":  # stress at the node: the record's own is over the whole mesh
                self.skip(line)
            elif not line.startswith("rframe"):
                raise self.refuse(f"{line[:40]!r} is not a block of a node, or comes twice; those are {NODE_BLOCKS}")
        return blocks

    def skip(self, name: str) -> None:
        while self.next(name) != f"end {name}":
            pass

    def block(self, name: str) -> Taylor:
        sizes: dict[str, int] = {}
        while len(sizes) < 6:
            found = _SIZE.match(self.next(name))
            if found is None or found[1] in sizes:
                raise self.refuse(f"block {name} must begin with order, nrow, ncol, nq, nqn and structure")
            sizes[found[1]] = int(found[2])
        order, rows, columns = sizes["order"], sizes["nrow"], sizes["ncol"]
        if order > 1 or sizes["nqn"] > 0:
            raise self.refuse(f"block {name} has terms above the first order in q, which are not read")
        if order == 1 and sizes["nq"] != self.n:
            raise self.refuse(f"block {name} says {sizes['nq']} modes, and the first line {self.n}")
        if sizes["structure"] not in Structure.__members__.values():
            raise self.refuse(f"block {name} has structure {sizes['structure']}, and 0 to 4 are known")
        self.left -= rows * columns * (1 + order * self.n)
        if self.left < 0:
            raise self.refuse(f"block {name} is {rows} x {columns}; {MOST_NUMBERS} numbers are the most in all")
        return self.entries(name, Structure(sizes["structure"]), rows, columns, first=order == 1)

    def entries(self, name: str, structure: Structure, rows: int, columns: int, *, first: bool) -> Taylor:
        m0: FloatArray = np.eye(rows, columns) if structure is Structure.UNIT else np.zeros((rows, columns))
        m1: FloatArray | None = np.zeros((rows, self.n, columns)) if first else None
        while (line := self.next(name)) != f"end {name}":
            found = _ENTRY.match(line)
            if found is None or (found[1] == "0") != (found[4] is None):
                raise self.refuse(f"expected m0(row, column) or m1(row, mode, column) of {name}, found {line[:60]!r}")
            place = tuple(int(index) - 1 for index in found.group(2, 3, 4) if index is not None)
            matrix: FloatArray | None = {"0": m0, "1": m1}.get(found[1])
            if matrix is None or not all(0 <= i < size for i, size in zip(place, matrix.shape, strict=True)):
                raise self.refuse(f"block {name} of {rows} x {columns} has no place for {line[:60]!r}")
            matrix[place] = self.real(found[5])
        if structure is Structure.SYMMETRIC and rows == columns:
            m0 = _mirrored(m0)
            m1 = None if m1 is None else _mirrored(m1.swapaxes(0, 1)).swapaxes(0, 1)
        return Taylor(m0, m1)

    def real(self, text: str) -> float:
        """A number with the exponent letter D or E, or with none before three digits."""
        plain = re.sub(r"[dDE]", "e", text)
        value = float(plain if "e" in plain else re.sub(r"(?<=[\d.])([+-]\d{3})$", r"e\1", plain))
        if not np.isfinite(value):
            raise self.refuse(f"{text} is not finite")
        return value


def _mirrored(matrix: FloatArray) -> FloatArray:
    """Symmetric matrices (..., k, k) of which one triangle, or both, are given."""
    lower, upper = np.tril(matrix, -1), np.triu(matrix, 1)
    other = upper.swapaxes(-1, -2)
    filled = np.where(lower != 0.0, lower, other)
    return filled + filled.swapaxes(-1, -2) + matrix * np.eye(matrix.shape[-1])
