"""Matrices in the keyword text of Abaqus and CalculiX: triplets, and the lower triangles of *USER ELEMENT."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from flexmbd.record.groups import FloatArray, IntArray

#: (node, degree of freedom) of a row.
Dof = tuple[int, int]
Entries = dict[tuple[Dof, Dof], float]

@dataclass(frozen=True, eq=False)
class Block:
    """A keyword, its parameters (upper case, blanks removed), data lines, and the comments among them."""

    keyword: str
    parameters: dict[str, str]
    lines: list[str]
    comments: list[str]


def blocks(text: str) -> Iterator[Block]:
    """The keyword blocks of a deck, in order; the first one, of no keyword, holds what stands before."""
    current = Block("", {}, [], [])
    for line in text.splitlines():
        line = line.strip()
        if line.startswith("**"):
            current.comments.append(line)
        elif line.startswith("*"):
            yield current
            head, *items = (item.replace("\0", ",") for item in _outside_quotes(line[1:]).split(","))
            pairs = (item.partition("=") for item in items)
            parameters = {key.replace(" ", "").upper(): value.strip().strip('"') for key, _, value in pairs}
            current = Block(head.replace(" ", "").upper(), parameters, [], [])
        elif line:
            current.lines.append(line)
    yield current


def _outside_quotes(line: str) -> str:
    """The line with commas inside quotes hidden."""
    return '"'.join(part.replace(",", "\0") if i % 2 else part for i, part in enumerate(line.split('"')))


def whole(text: str) -> int:
    """A whole number from 0 on, or ValueError."""
    text = text.strip()
    if not (text.isascii() and text.isdigit() and len(text) < 10):
        raise ValueError(f"{text[:30]!r} is not a whole number of a node or component")
    return int(text)


def number(text: str) -> float:
    """A finite number, with the exponents of Fortran too, or ValueError."""
    value = float(text.strip().replace("D", "E").replace("d", "e"))
    if not math.isfinite(value):
        raise ValueError(f"{text.strip()[:30]!r} is not finite")
    return value


def triplets(lines: list[str]) -> Entries:
    """Entries from lines ``row node, row dof, column node, column dof, value``; one triangle or both.

    Raises:
        ValueError: a line is something else, or the triangles differ.
    """
    entries: Entries = {}
    for line in lines:
        words = [word for word in line.split(",") if word.strip()]
        if len(words) != 5:
            raise ValueError(f"{line[:60]!r} is not `node, component, node, component, value`")
        row, column = (whole(words[0]), whole(words[1])), (whole(words[2]), whole(words[3]))
        value = number(words[4])
        if abs(entries.setdefault((column, row), value) - value) > 1e-6 * abs(value):
            raise ValueError(f"the entries of {row} and {column} differ from each other")
        entries[row, column] = value
    return entries


def coordinates(lines: list[str], size: int) -> tuple[IntArray, IntArray, FloatArray]:
    """Rows and columns from 0, and values, of lines ``row column value`` that count from 1; one triangle or both.

    Raises:
        ValueError: a line is something else, or an entry is outside of so many rows, or there twice.
    """
    words = [line.replace(",", " ").split() for line in lines]
    if any(len(line) != 3 for line in words):
        wrong = next(line for line in words if len(line) != 3)
        raise ValueError(f"{' '.join(wrong)[:60]!r} is not `row column value`")
    i, j = (np.array([whole(line[at]) for line in words], dtype=np.int64) - 1 for at in (0, 1))
    values = np.array([number(line[2]) for line in words])
    most = int(max(i.max(), j.max())) + 1
    if min(i.min(), j.min()) < 0 or most > size:
        raise ValueError(
            f"it has rows up to {most}, and the node table asks for {size}, three displacements a node: write it of a "
            "part of solid elements without supports"
        )
    if len(np.unique(i * size + j)) < len(i):
        raise ValueError("an entry is there twice")
    if not ((i > j).any() and (i < j).any()):
        off = i != j
        i, j, values = np.append(i, j[off]), np.append(j, i[off]), np.append(values, values[off])
    return i, j, values


def user_element(found: list[Block]) -> tuple[list[Dof], dict[str, FloatArray]]:
    """Rows and matrices by type of the one *USER ELEMENT of a file.

    Its first data line has the components at the first node, later ones ``position, components``: those from there on.
    Matrices are lower triangles, or with UNSYMM whole; whether a whole one is symmetric is not judged here.

    Raises:
        ValueError: it is damaged, or there are several.
    """
    heads = [block for block in found if block.keyword == "USERELEMENT"]
    if len(heads) != 1:
        raise ValueError(f"it holds {len(heads)} user elements; one is read")
    head = heads[0]
    entries = _all if "UNSYMM" in head.parameters else _lower
    listing = " ".join(line.lstrip("* ") for line in head.comments if re.fullmatch(r"\**[\s\d,]+", line, re.ASCII))
    nodes = [whole(word) for word in re.split(r"[\s,]+", listing) if word]
    if not nodes or not head.lines or len(nodes) != whole(head.parameters.get("NODES", "")):
        raise ValueError(f"it lists {len(nodes)} element nodes; NODES says {head.parameters.get('NODES')!r}")
    components = {0: _components(head.lines[0].split(","))}
    for line in head.lines[1:]:
        place, *words = line.split(",")
        components[whole(place) - 1] = _components(words)
    dofs: list[Dof] = []
    current = components[0]
    for at, node in enumerate(nodes):
        current = components.get(at, current)
        dofs += [(node, component) for component in current]
    if len(set(dofs)) < len(dofs):
        raise ValueError("a node's component is there twice")
    matrices = {}
    for block in found:
        if block.keyword == "MATRIX":
            words = [word for line in block.lines for word in line.split(",") if word.strip()]
            matrices[block.parameters.get("TYPE", "").upper()] = entries(words, len(dofs))
    return dofs, matrices


def _components(words: list[str]) -> list[int]:
    return [whole(word) for word in words if word.strip()]


def _lower(words: list[str], size: int) -> FloatArray:
    if len(words) != size * (size + 1) // 2:
        raise ValueError(f"a matrix has {len(words)} entries, which is not a lower triangle of {size} rows")
    matrix = np.zeros((size, size))
    matrix[np.tril_indices(size)] = [number(word) for word in words]
    whole_matrix: FloatArray = np.tril(matrix) + np.tril(matrix, -1).T
    return whole_matrix


def _all(words: list[str], size: int) -> FloatArray:
    if len(words) != size**2:
        raise ValueError(f"a matrix has {len(words)} entries, which is not a square of {size} rows, as UNSYMM asks for")
    return np.array([number(word) for word in words], dtype=np.float64).reshape(size, size)


def dense(entries: Mapping[tuple[Dof, Dof], float], order: Mapping[Dof, int]) -> FloatArray:
    """The matrix of entries, rows as `order` has them."""
    matrix = np.zeros((len(order), len(order)))
    for (row, column), value in entries.items():
        matrix[order[row], order[column]] = value
    return matrix
