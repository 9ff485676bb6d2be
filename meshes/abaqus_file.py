"""Meshes in Abaqus's and CalculiX's input files (.inp).

Read here rather than by meshio, whose reader (5.3.5) leaves out surfaces, takes the sets of *ELEMENT
for those of other blocks where some have none, and keeps only the last of several *NODE.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from flexmbd.errors import ExportError, MeshError
from flexmbd.files.mesh_text import read_lines
from flexmbd.meshes.foreign_mesh import ElementBlock, ForeignMesh, members

IntArray = npt.NDArray[np.int64]

# Types of elements: meshio's name of the kind, and the number of nodes.
_TYPES: tuple[tuple[re.Pattern[str], str, int], ...] = (
    (re.compile(r"C3D4[A-Z]*"), "tetra", 4),
    (re.compile(r"C3D10[A-Z]*"), "tetra10", 10),
    (re.compile(r"C3D8[A-Z]*"), "hexahedron", 8),
    (re.compile(r"C3D20[A-Z]*"), "hexahedron20", 20),
    (re.compile(r"C3D5[A-Z]*"), "pyramid", 5),
    (re.compile(r"C3D6[A-Z]*"), "wedge", 6),
    (re.compile(r"C3D15[A-Z]*"), "wedge15", 15),
    (re.compile(r"(S|DS|STRI|CPS|CPE|M3D|SFM3D|R3D)3[A-Z]*"), "triangle", 3),
    (re.compile(r"(STRI65|(DS|CPS|CPE|M3D|SFM3D)6[A-Z]*)"), "triangle6", 6),
    (re.compile(r"(S|DS|CPS|CPE|M3D|SFM3D|R3D)4(R5|[A-Z]*)"), "quad", 4),
    (re.compile(r"(S|DS|CPS|CPE|M3D|SFM3D)8(R5|[A-Z]*)"), "quad8", 8),
    (re.compile(r"(S9R5|M3D9[A-Z]*)"), "quad9", 9),
)

# What bears or weighs and is no part of a solid; and what only couples.
_BESIDE = re.compile(r"(T[23]D[23]|B[23][123]|MASS|ROTARYI|SPRING|DASHPOT).*")
_LEFT_OUT = re.compile(r"(CONN|DCOUP|GAP).*")

# gmsh's own sets, of all elements of one volume, surface or curve.
_OF_GMSH = re.compile(r"(Volume|Surface|Line)\d+", re.IGNORECASE)

# What makes nodes and elements, or moves them, by rules that are not read.
_REFUSED = ("NGEN", "NFILL", "NCOPY", "NMAP", "ELGEN", "ELCOPY", "SYSTEM")

# Files within files.
_DEEPEST = 10


@dataclass(frozen=True)
class Block:
    """A keyword, its options by their names in capitals, and the lines below it."""

    keyword: str
    options: Mapping[str, str]
    lines: list[str]


def read_abaqus(path: Path) -> ForeignMesh:
    """What an input file lists: one part, or one instance of one part in its place; not collective.

    Raises:
        MeshError: the file cannot be read or understood, or holds several parts.
    """
    return _Reader(path).foreign()


class _Reader:
    def __init__(self, path: Path) -> None:
        self._path = path
        self._blocks = list(_of_one_part(path, list(blocks(path, depth=0))))
        self._elements: list[ElementBlock] = []
        # by the name in capitals: as the file first has it, and the parts of the set
        self._element_sets: dict[str, tuple[str, list[IntArray]]] = {}
        self._node_sets: dict[str, tuple[str, list[IntArray]]] = {}
        self._surfaces: dict[str, tuple[str, list[tuple[IntArray, str]]]] = {}
        self._pieces: set[str] = set()  # sets that surfaces are made of
        self._beside: dict[str, int] = {}
        self._known: IntArray = np.empty(0, dtype=np.int64)

    def foreign(self) -> ForeignMesh:
        numbers: list[IntArray] = []
        points: list[npt.NDArray[np.float64]] = []
        for block in self._blocks:
            if block.keyword == "NODE":
                more, x = self._nodes(block)
                numbers.append(more)
                points.append(x)
            elif block.keyword == "ELEMENT":
                self._add_elements(block)
        self._known = _ascending([one.numbers for one in self._elements])
        for block in self._blocks:
            if block.keyword == "ELSET":
                self._add_set(block, "ELSET", self._element_sets)
        self._known = _ascending(numbers)
        for block in self._blocks:
            if block.keyword == "NSET":
                self._add_set(block, "NSET", self._node_sets)
        for block in self._blocks:
            if block.keyword == "SURFACE":
                self._add_surface(block)
        helpers = [
            name for key, (name, _) in self._element_sets.items() if key in self._pieces or _OF_GMSH.fullmatch(name)
        ]
        return ForeignMesh(
            self._path,
            np.concatenate(numbers),
            np.concatenate(points),
            self._elements,
            _public(self._element_sets),
            _public(self._node_sets),
            dict(self._surfaces.values()),
            helpers=helpers,
            beside=self._beside,
        )

    def _nodes(self, block: Block) -> tuple[IntArray, npt.NDArray[np.float64]]:
        if block.options.get("SYSTEM", "R").upper() != "R":
            raise MeshError(f"{self._path}: *NODE with SYSTEM is not read; write cartesian coordinates")
        rows = [_fields(line) for line in block.lines]
        if any(len(row) < 4 or not all(row[:4]) for row in rows):
            raise MeshError(f"{self._path}: a node needs a number and three coordinates under *NODE")
        numbers = self._whole([row[0] for row in rows], "*NODE")
        try:
            points = np.array([[float(_exponent(x)) for x in row[1:4]] for row in rows])
        except ValueError as error:
            raise MeshError(f"{self._path}: under *NODE: {error}") from error
        if "NSET" in block.options:
            _append(self._node_sets, block.options["NSET"], numbers)
        return numbers, points.reshape(-1, 3)

    def _add_elements(self, block: Block) -> None:
        kind = block.options.get("TYPE", "").upper()
        found = [(name, columns) for pattern, name, columns in _TYPES if pattern.fullmatch(kind)]
        if not found:
            if _BESIDE.fullmatch(kind):
                self._beside[kind] = self._beside.get(kind, 0) + len(block.lines)
                return
            if _LEFT_OUT.fullmatch(kind):
                return
            raise MeshError(
                f"{self._path}: elements of type {kind or 'none'} are not known; write C3D4, C3D10, C3D8 "
                "or C3D20 for the part"
            )
        ((name, columns),) = found
        every = [field for line in block.lines for field in _fields(line) if field]
        if len(every) % (columns + 1) != 0:
            raise MeshError(f"{self._path}: an element of type {kind} needs {columns} nodes")
        rows = self._whole(every, "*ELEMENT").reshape(-1, columns + 1)
        self._elements.append(ElementBlock(name, rows[:, 0], rows[:, 1:]))
        if "ELSET" in block.options:
            _append(self._element_sets, block.options["ELSET"], rows[:, 0])

    def _add_set(
        self, block: Block, option: str, sets: dict[str, tuple[str, list[IntArray]]]
    ) -> None:
        if option not in block.options:
            raise MeshError(f"{self._path}: *{option} without a name; write *{option}, {option}=name")
        name = block.options[option]
        if option == "NSET" and "ELSET" in block.options:
            held = self._held(block.options["ELSET"], self._element_sets, f"*NSET {name!r}")
            for one in self._elements:
                _append(sets, name, one.nodes[np.isin(one.numbers, held)].reshape(-1))
            return
        if "GENERATE" in block.options:
            for line in block.lines:
                bounds = [int(x) for x in self._whole([f for f in _fields(line) if f], f"*{option}")]
                if len(bounds) not in (2, 3) or bounds[2:] == [0]:
                    raise MeshError(
                        f"{self._path}: *{option} {name!r}: GENERATE needs first, last and step, got {line!r}"
                    )
                first, last, step = [*bounds, 1][:3]
                if step < 0:
                    first, last, step = last, first, -step
                _append(sets, name, members(self._known, [range(first, last + 1, step)]))
            return
        fields = [field for line in block.lines for field in _fields(line) if field]
        _append(sets, name, self._whole([field for field in fields if field.isdigit()], f"*{option}"))
        for field in (field for field in fields if not field.isdigit()):
            _append(sets, name, self._held(field, sets, f"*{option} {name!r}"))

    def _held(
        self, field: str, sets: Mapping[str, tuple[str, list[IntArray]]], where: str
    ) -> IntArray:
        """A number, or what the set of a name holds."""
        if field.isdigit():
            return self._whole([field], where)
        # a set of an instance is written instance.set
        known = sets.get(_key(field)) or sets.get(_key(field.rpartition(".")[2]))
        if known is None:
            raise MeshError(f"{self._path}: {where} names {field!r}, which is not a set before it")
        return np.concatenate(known[1])

    def _add_surface(self, block: Block) -> None:
        if "NAME" not in block.options:
            raise MeshError(f"{self._path}: *SURFACE without a name; write *SURFACE, NAME=name")
        name = block.options["NAME"]
        kind = block.options.get("TYPE", "ELEMENT").upper()
        for line in block.lines:
            what, label, *_ = [*_fields(line), ""]
            where = f"*SURFACE {name!r}"
            if kind == "NODE":
                _append(self._node_sets, name, self._held(what, self._node_sets, where))
            elif kind == "ELEMENT":
                held = self._held(what, self._element_sets, where)
                self._pieces.update(_key(one) for one in (what, what.rpartition(".")[2]))
                self._surfaces.setdefault(_key(name), (name, []))[1].append((held, label.upper()))

    def _whole(self, fields: Sequence[str], where: str) -> IntArray:
        try:
            return np.array(fields, dtype=str).astype(np.int64)
        except (ValueError, OverflowError) as error:
            raise MeshError(f"{self._path}: under {where}: {error}") from error


def _ascending(numbers: Sequence[IntArray]) -> IntArray:
    return np.unique(np.concatenate([np.empty(0, dtype=np.int64), *numbers]))


def _append(sets: dict[str, tuple[str, list[IntArray]]], name: str, held: IntArray) -> None:
    sets.setdefault(_key(name), (name, []))[1].append(held)


def _public(sets: Mapping[str, tuple[str, list[IntArray]]]) -> dict[str, IntArray]:
    """All sets but those that begin with _, which Abaqus makes for itself, as for surfaces."""
    return {
        name: np.concatenate(held) for name, held in sets.values() if held and name[:1] != "_"
    }


def _key(name: str) -> str:
    """Names are the same in capitals and small letters."""
    return name.strip('"').upper()


def _fields(line: str) -> list[str]:
    return [field.strip() for field in line.split(",")]


def _exponent(number: str) -> str:
    """Fortran's exponents too, as 1.0D-3."""
    return number.upper().replace("D", "E")


def blocks(path: Path, *, depth: int) -> Iterator[Block]:
    """The keywords of a file and of those it includes; not collective.

    Raises:
        MeshError: a file cannot be read, or goes more than ten files deep.
    """
    if depth > _DEEPEST:
        raise MeshError(f"{path}: *INCLUDE goes more than {_DEEPEST} files deep")
    if not path.is_file():
        raise MeshError(f"{path}: cannot be opened: No such file")
    try:
        lines = [line.strip() for line in read_lines(path)]
    except ExportError as error:
        raise MeshError(str(error)) from error
    lines = [line for line in lines if line and not line.startswith("**")]
    block: Block | None = None
    at = 0
    while at < len(lines):
        line, at = lines[at], at + 1
        if not line.startswith("*"):
            if block is not None:
                block.lines.append(line)
            continue
        if block is not None:
            yield block
        while line.endswith(",") and at < len(lines) and not lines[at].startswith("*"):
            line, at = line + lines[at], at + 1  # goes on in the next line
        keyword, *options = line[1:].split(",")
        pairs = (option.partition("=") for option in options)
        named = {key.strip().upper(): value.strip().strip('"') for key, _, value in pairs}
        block = Block(" ".join(keyword.upper().split()), named, [])
        if block.keyword == "INCLUDE":
            yield from blocks(path.parent / named.get("INPUT", ""), depth=depth + 1)
            block = None
    if block is not None:
        yield block


def _of_one_part(path: Path, blocks: Sequence[Block]) -> Iterator[Block]:
    """The blocks of the one part, and the assembly's sets of its instance."""
    parts = [block for block in blocks if block.keyword == "PART"]
    instances = [block for block in blocks if block.keyword == "INSTANCE"]
    if len(parts) > 1 or len(instances) > 1:
        raise MeshError(
            f"{path}: there are {len(parts)} parts and {len(instances)} instances in it; write one part to "
            "a file of its own"
        )
    if instances and instances[0].lines:
        raise MeshError(f"{path}: the instance is moved from where its part is; write the part alone")
    for keyword in (block.keyword for block in blocks if block.keyword in _REFUSED):
        raise MeshError(f"{path}: *{keyword} is not read; write out all nodes and elements")
    if not any(block.keyword == "NODE" for block in blocks):
        raise MeshError(f"{path}: not an Abaqus input file: it has no *NODE")
    in_assembly = False
    for block in blocks:
        if block.keyword in ("ASSEMBLY", "END INSTANCE"):
            in_assembly = True
        elif block.keyword in ("END ASSEMBLY", "INSTANCE"):
            in_assembly = False
        # an assembly's own nodes, as reference points, have numbers that those of the part have too
        elif not in_assembly or block.keyword == "SURFACE" or "INSTANCE" in block.options:
            yield block
