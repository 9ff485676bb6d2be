"""The order of the rows of a Nastran superelement's matrices, as EXTSEOUT says it.

Its .pch tells the rows by EXTRN, with components; its .asm by SECONCT, all six of a GRID and the one of an SPOINT.
"""

from __future__ import annotations

from collections.abc import Sequence

from flexmbd.export.superelements.matrix_text import Dof
from flexmbd.export.superelements.superelement_frames import MOST_ROWS
from flexmbd.files.bulk_cards import Card, Cards, listed

#: Cards that `matrix_rows` takes.
ROW_CARDS = ("SPOINT", "EXTRN", "SECONCT")


def matrix_rows(cards: Cards) -> list[Dof]:
    """Node and component (0 of SPOINTs) of each row, by EXTRN, else by SECONCT; empty where there is neither.

    Raises:
        ValueError: a card is damaged, or names a row twice.
    """
    rows: dict[Dof, None] = {}
    points: set[int] = set()
    for name in ROW_CARDS:
        if name == "SECONCT" and rows:
            break
        for card in cards.get(name, []):
            try:
                found = _rows(card, points)
            except ValueError as error:
                raise card.error(f"{name}: {error}") from error
            for node, component in found:
                if (node, component) in rows:
                    raise card.error(f"{name} names component {component} of node {node} twice")
                rows[node, component] = None
    return list(rows)


def _rows(card: Card, points: set[int]) -> list[Dof]:
    """The rows that a card names; an SPOINT, which names none, is put among the points."""
    if card.name == "SPOINT":
        points.update(_numbers(card))
        return []
    if card.name == "EXTRN":
        return _components(card)
    # after the first line pairs of nodes, of the part and of the assembly
    return [(node, c) for node in _of_part(card[8:]) for c in ((0,) if node in points else range(1, 7))]


def _numbers(fields: Sequence[str]) -> list[int]:
    """Numbers of a list, and all from one to another by THRU."""
    ranges = listed(fields)
    if any(numbers.start < 0 for numbers in ranges):
        raise ValueError(
            f"{next(numbers.start for numbers in ranges if numbers.start < 0)} is not the number of a point"
        )
    if sum(map(len, ranges)) > MOST_ROWS:
        raise ValueError(f"more than {MOST_ROWS} points up to number {ranges[-1][-1]} are no superelement's")
    return [number for numbers in ranges for number in numbers]


def _of_part(fields: Sequence[str]) -> list[int]:
    """The first of each pair of numbers; pairs of ranges by THRU."""
    found: list[int] = []
    there = [field for field in fields if field]
    at = 0
    while at < len(there):
        length = _length(there, at)
        found += _numbers(there[at : at + length])
        at += 2 * length
    return found


def _components(fields: Sequence[str]) -> list[Dof]:
    """Nodes and components of EXTRN: pairs ``node, components``, or ``first, THRU, last, components``."""
    there = [field for field in fields if field]
    rows: list[Dof] = []
    at = 0
    while at < len(there):
        length = _length(there, at)
        if at + length >= len(there):
            raise ValueError(f"node {there[at][:20]!r} has no components")
        nodes, components = _numbers(there[at : at + length]), there[at + length]
        if components != "0" and (not set(components) <= set("123456") or len(set(components)) < len(components)):
            raise ValueError(f"{components[:20]!r} are no components of node {there[at][:20]}")
        rows += [(node, int(c)) for node in nodes for c in sorted(components)]
        at += length + 1
    return rows


def _length(there: Sequence[str], at: int) -> int:
    """Fields of a number, or of ``first, THRU, last``."""
    return 3 if at + 1 < len(there) and there[at + 1].upper() == "THRU" else 1
