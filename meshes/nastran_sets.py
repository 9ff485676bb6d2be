"""Sets of nodes and of faces that Nastran's constraints, sets, rigid elements and pressures name."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import numpy.typing as npt

from flexmbd.files.bulk_cards import Card, Cards, listed, whole
from flexmbd.meshes.cell_faces import CORNERS, FACES
from flexmbd.meshes.foreign_mesh import ElementBlock, members

IntArray = npt.NDArray[np.int64]

#: The cards that `node_sets` and `load_faces` take.
SET_CARDS = ("SPC", "SPC1", "SET1", "SET3", "RBE2", "RBE3", "PLOAD", "PLOAD2", "PLOAD4")


def node_sets(cards: Cards, numbers: IntArray) -> dict[str, IntArray]:
    """Numbers of the nodes of each set, those that are there, by name.

    Args:
        cards: fields behind the names of the cards.
        numbers: of all nodes.

    Raises:
        ValueError: a card cannot be understood.
    """
    ranges: dict[str, list[range]] = {}
    for name, fields, held in _each_set(cards):
        try:
            ranges.setdefault(name, []).extend(listed(held))
        except ValueError as error:
            raise fields.error(f"{name}, card {fields[0]}: {error}") from error
    ascending = np.sort(numbers)
    found = {name: members(ascending, parts) for name, parts in ranges.items()}
    return {name: held for name, held in found.items() if len(held) > 0}


def _each_set(cards: Cards) -> Iterator[tuple[str, Card, list[str]]]:
    """Name of the set, the card, and the fields that list nodes."""
    for fields in cards.get("SPC1", []):
        yield f"SPC {fields[0]}", fields, fields[2:]
    for fields in cards.get("SPC", []):
        yield f"SPC {fields[0]}", fields, [fields[1], fields[4]]
    for fields in cards.get("SET1", []):
        yield f"SET1 {fields[0]}", fields, [field for field in fields[1:] if field.upper() != "SKIN"]
    for fields in cards.get("SET3", []):
        if fields[1].upper() in ("GRID", "POINT"):
            yield f"SET3 {fields[0]}", fields, fields[2:]
    for fields in cards.get("RBE2", []):
        # a coefficient of thermal expansion may be last
        yield f"RBE2 {fields[0]}", fields, [field for field in fields[3:] if "." not in field]
    for fields in cards.get("RBE3", []):
        yield f"RBE3 {fields[0]}", fields, _averaged(fields[4:])


def _averaged(fields: Sequence[str]) -> list[str]:
    """The nodes of RBE3's groups: weight (a real number), components, nodes."""
    held: list[str] = []
    components = False
    for field in fields:
        if field.upper() in ("UM", "ALPHA", "TREF"):
            break
        if "." in field:
            components = True
        elif field and components:
            components = False
        elif field:
            held.append(field)
    return held


def load_faces(cards: Cards, elements: Sequence[ElementBlock]) -> dict[str, IntArray]:
    """The faces of each set of pressures, (n, 4) numbers of their vertices, -1 for the fourth of a triangle.

    Raises:
        ValueError: a card names an element that is not there, or nodes that are on no face of it.
    """
    if not any(name in cards for name in ("PLOAD", "PLOAD2", "PLOAD4")):
        return {}
    elements_by_number = _Elements(elements)
    found: dict[str, list[list[int]]] = {}
    for name in ("PLOAD4", "PLOAD2", "PLOAD"):
        for card in cards.get(name, []):
            try:
                found.setdefault(f"{name} {card[0]}", []).extend(_loaded(card, elements_by_number))
            except ValueError as error:
                raise card.error(str(error)) from error
    return {name: np.array(faces, dtype=np.int64) for name, faces in found.items() if faces}


def _loaded(card: Card, elements: _Elements) -> list[list[int]]:
    """The faces that a card of pressures names."""
    if card.name == "PLOAD4":
        number, first, third = whole(card[1]), card[6], card[7]
        if first.upper() == "THRU":
            return elements.shells(range(number, whole(third) + 1))
        if first:
            return [elements.face(number, whole(first), whole(third), card.title)]
        return elements.shells(range(number, number + 1))
    if card.name == "PLOAD2":
        return [face for numbers in listed(card[2:]) for face in elements.shells(numbers)]
    corners = [whole(field) for field in card[2:6] if field]
    if len(corners) < 3:
        raise ValueError(f"{card.title} names {len(corners)} nodes; a face has three or four")
    return [[*corners, -1][:4]]


class _Elements:
    """Elements by their numbers."""

    def __init__(self, elements: Sequence[ElementBlock]) -> None:
        self._blocks = elements
        self._at = [{int(number): i for i, number in enumerate(one.numbers)} for one in elements]

    def shells(self, numbers: range) -> list[list[int]]:
        """The vertices of the shells among some elements."""
        found = []
        for block, at in zip(self._blocks, self._at, strict=True):
            if block.dim == 2:
                corners = CORNERS[block.cell]
                few = numbers if len(numbers) <= len(at) else [number for number in at if number in numbers]
                rows = [at[number] for number in few if number in at]
                found += [[*map(int, block.nodes[row, :corners]), -1][:4] for row in rows]
        return found

    def face(self, number: int, first: int, other: int, where: str) -> list[int]:
        """The face of a solid that two of its vertices name; a shell's own.

        Of a tetrahedron the other vertex is the one that is not on the face. Of a wedge's triangle there is none.
        Of quadrilaterals both are opposite, and of a pyramid's triangle the other is on its base too.
        """
        for block, at in zip(self._blocks, self._at, strict=True):
            if number not in at:
                continue
            corners: list[int] = list(map(int, block.nodes[at[number]]))
            if block.dim == 2:
                return [*corners[: CORNERS[block.cell]], -1][:4]
            for face in FACES[block.cell]:
                names = [corners[i] for i in face]
                if _is_meant(block.cell, names, first, other):
                    return [*names, -1][:4]
            raise ValueError(f"{where} names the nodes {first} and {other or 'none'}, on no face of element {number}")
        raise ValueError(f"{where} names element {number}, which is no solid or shell of the deck")


def _is_meant(cell: str, names: list[int], first: int, other: int) -> bool:
    if first not in names:
        return False
    if cell == "tetrahedron":
        return other not in names
    if len(names) == 4:
        return other in names and abs(names.index(other) - names.index(first)) == 2
    if cell == "prism":
        return other == 0
    return {first, other} == set(names[:2])  # of a pyramid, whose apex is last
