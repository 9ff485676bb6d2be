"""Meshes in Nastran's bulk data (.bdf, .nas, .dat, .blk, .fem): nodes, elements, sets from loads and constraints.

Cards are read by `flexmbd.files.bulk_cards`, places of nodes by its neighbour `nastran_grids`, sets by `nastran_sets`.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import numpy.typing as npt

from flexmbd.errors import ExportError, MeshError
from flexmbd.files.bulk_cards import BulkData, Card, read_bulk, whole
from flexmbd.files.nastran_grids import GRID_CARDS, read_grids
from flexmbd.meshes.foreign_mesh import ElementBlock, ForeignMesh
from flexmbd.meshes.nastran_sets import SET_CARDS, load_faces, node_sets

IntArray = npt.NDArray[np.int64]

# By card: kind by the number of nodes, meshio's names; dimension; and where VTK's nodes stand in Nastran's order.
_EDGES_UP = {  # Nastran lists the middles of the uprights before those of the top
    "hexahedron20": [*range(12), *range(16, 20), *range(12, 16)],
    "wedge15": [*range(9), *range(12, 15), *range(9, 12)],
}
_SOLIDS: Mapping[str, Mapping[int, str]] = {
    "CTETRA": {4: "tetra", 10: "tetra10"},
    "CHEXA": {8: "hexahedron", 20: "hexahedron20"},
    "CPENTA": {6: "wedge", 15: "wedge15"},
    "CPYRAM": {5: "pyramid", 13: "pyramid13"},
    "CPYRA": {5: "pyramid", 13: "pyramid13"},
}
_SHELLS: Mapping[str, Mapping[int, str]] = {
    "CTRIA3": {3: "triangle"},
    "CTRIAR": {3: "triangle"},
    "CTRIA6": {3: "triangle", 6: "triangle6"},
    "CQUAD4": {4: "quad"},
    "CQUADR": {4: "quad"},
    "CSHEAR": {4: "quad"},
    "CQUAD8": {4: "quad", 8: "quad8"},
}

# What stands beside solids and bears or weighs.
_BESIDE = (
    "CBAR", "CBEAM", "CBEAM3", "CBEND", "CROD", "CONROD", "CTUBE", "CBUSH", "CBUSH1D", "CELAS1", "CELAS2", "CELAS3",
    "CELAS4", "CONM1", "CONM2", "CMASS1", "CMASS2", "CMASS3", "CMASS4", "CWELD", "CFAST", "CSEAM",
)  # fmt: skip


def read_nastran(path: Path) -> ForeignMesh:
    """What the bulk data list; not collective.

    Each property is a set of elements "property 7"; sets of nodes are "SPC 1" (of SPC and SPC1), "SET1 4", "RBE2 50",
    "RBE3 51", and of faces "PLOAD4 3".

    Raises:
        MeshError: the deck cannot be read or understood.
    """
    try:
        data = read_bulk(path, wanted=(*GRID_CARDS, *_SOLIDS, *_SHELLS, *SET_CARDS))
        return _foreign(path, data)
    except ExportError as error:
        raise MeshError(str(error)) from error
    except ValueError as error:
        raise MeshError(f"{path}: {error}") from error


def _foreign(path: Path, data: BulkData) -> ForeignMesh:
    grids = read_grids(data.cards)
    numbers = grids.numbers
    if len(numbers) == 0:
        others = ", ".join(list(data.counts)[:5])
        raise ValueError(f"not Nastran bulk data: it has no GRID{f', but {others}' if others else ''}")
    elements: list[ElementBlock] = []
    owners: dict[str, list[IntArray]] = {}
    for card, kinds in {**_SOLIDS, **_SHELLS}.items():
        for block, properties in _elements(card, data.cards.get(card, []), kinds, solid=card in _SOLIDS):
            elements.append(block)
            for owner in np.unique(properties):
                owners.setdefault(f"property {owner}", []).append(block.numbers[properties == owner])
    return ForeignMesh(
        path,
        numbers,
        grids.points,
        elements,
        {name: np.concatenate(parts) for name, parts in owners.items()},
        node_sets=node_sets(data.cards, numbers),
        faces=load_faces(data.cards, elements),
        beside={card: data.counts[card] for card in _BESIDE if card in data.counts},
    )


def _elements(
    card: str, cards: list[Card], kinds: Mapping[int, str], *, solid: bool
) -> list[tuple[ElementBlock, IntArray]]:
    """Blocks of one kind each and the properties of their elements; middles that are left out have the node 0."""
    most, least = max(kinds), min(kinds)
    rows: dict[int, list[tuple[Card, list[str]]]] = {count: [] for count in kinds}
    for fields in cards:
        nodes = (fields[2 : 2 + most] + [""] * most)[:most]
        if not all(nodes[:least]):
            there = sum(map(bool, nodes))
            raise fields.error(f"{card} {fields[0]} has {there} nodes; it needs {' or '.join(map(str, kinds))}")
        if not fields[1] and solid:
            raise fields.error(f"{card} {fields[0]} has no property; give its number in the third field")
        count = most if most > least and any(nodes[least:]) else least
        rows[count].append((fields, [fields[0], fields[1] or fields[0], *nodes[:count]]))
    found = []
    for count, texts in rows.items():
        if texts:
            table = _whole_numbers(texts)
            kind = kinds[count]
            order = _EDGES_UP.get(kind, list(range(count)))
            found.append((ElementBlock(kind, table[:, 0], table[:, 2:][:, order]), table[:, 1]))
    return found


def _whole_numbers(rows: list[tuple[Card, list[str]]]) -> IntArray:
    """A table of texts as numbers, 0 where there is nothing."""
    try:
        return np.array([texts for _, texts in rows], dtype=np.str_).astype(np.int64)
    except (ValueError, OverflowError):  # blanks, or what is no number, which is named
        table = []
        for card, texts in rows:
            try:
                table.append([whole(text) for text in texts])
            except ValueError as error:
                raise card.error(f"{card.title}: {error}") from error
        return np.array(table, dtype=np.int64)
