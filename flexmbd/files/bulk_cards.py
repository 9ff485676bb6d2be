"""Cards of Nastran's bulk data: fields of 8 and 16 columns or between commas, continuations.

The format is that of MSC Nastran's Quick Reference Guide, "Format of Bulk Data Entries". What a card means is its
reader's.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from flexmbd.files.deck_lines import DeckPlaces, deck_lines

# Nastran's numbers: the E of an exponent may be a D, or left out before its sign.
_NUMBER = re.compile(r"([+-]?(?:\d+\.?\d*|\.\d+))(?:[ED]?([+-]\d+)|[ED](\d+))?", re.IGNORECASE | re.ASCII)
_WHOLE = re.compile(r"[+-]?\d{1,18}", re.ASCII)


class Card(list[str]):
    """The fields of a card behind its name: eight a line, stripped, "" where there is nothing.

    Attributes:
        name: in capitals; "" of a piece of a card whose beginning is elsewhere in the file.
        tail: the name of the continuation that it waits for.
        fixed: whether its fields stand in columns.
        line: where it begins, among the lines of all files.
        places: where these stand.
    """

    __slots__ = ("fixed", "line", "name", "places", "tail")

    def __init__(self, name: str, fields: Iterable[str], tail: str, fixed: bool, line: int, places: DeckPlaces) -> None:
        list.__init__(self, fields)  # not by super(): decks have a million cards
        self.name = name
        self.tail = tail
        self.fixed = fixed
        self.line = line
        self.places = places

    @property
    def title(self) -> str:
        """Its name and first field, as "GRID 7"."""
        return f"{self.name} {self[0]}".rstrip()

    def whole(self, at: int) -> int:
        """The whole number in a field, 0 where there is nothing; or ValueError."""
        try:
            return whole(self[at] if at < len(self) else "")
        except ValueError as error:
            raise self.error(f"{self.title}: {error}") from error

    def real(self, at: int) -> float:
        """The real number in a field, 0 where there is nothing; or ValueError."""
        try:
            return real(self[at] if at < len(self) else "")
        except ValueError as error:
            raise self.error(f"{self.title}: {error}") from error

    def error(self, message: str) -> ValueError:
        """An error that says the line, and the file where it is an included one."""
        return ValueError(f"{self.places.place(self.line)}: {message}")


# Of a continuation before its card: its name, itself, the card above it.
_Piece = tuple[str, Card, Card | None]

#: Cards by their names, in capitals.
Cards = Mapping[str, list[Card]]


@dataclass(frozen=True)
class BulkData:
    """The cards of a deck.

    Attributes:
        cards: of those wanted.
        counts: how many there are of every card, wanted or not.
    """

    cards: Cards
    counts: Mapping[str, int]


def read_bulk(path: Path, *, wanted: Collection[str], punched: bool = False) -> BulkData:
    """The cards of a file of bulk data and of those that it includes; not collective.

    Args:
        path: with or without what stands before BEGIN BULK.
        wanted: names of the cards whose fields are kept, in capitals.
        punched: whether it is what Nastran punches of a superelement, alone or within a deck: several sections are read
            as one, and results that stand above the cards are passed over.

    Raises:
        ValueError: a file that is included is missing or includes itself; a continuation is of no card; a
            tenth field is no name of one; there are several sections of bulk data.
        ExportError: a file cannot be read.
    """
    lines, places = deck_lines(path)
    first, end = (0, len(lines)) if punched else _section(lines, places)
    every = _joined(lines[first:end], places, first=first, punched=punched)
    del lines  # which take as much as the cards
    counts = Counter(card.name for card in every)
    cards: dict[str, list[Card]] = {}
    for card in every:
        if card.name in wanted:
            if not card.fixed and card.tail.isdigit():
                raise card.error(
                    f"{card.title}: its line ends with {card.tail} in the tenth field, where only the name of a "
                    "continuation may stand; begin a new line after nine fields"
                )
            card += [""] * (-len(card) % 8)
            cards.setdefault(card.name, []).append(card)
    return BulkData(cards, counts)


def whole(text: str, default: int = 0) -> int:
    """A whole number, or the default for an empty field.

    Raises:
        ValueError: it is none, or has more than 18 digits.
    """
    if not text:
        return default
    if not _WHOLE.fullmatch(text):
        raise ValueError(f"{text[:30]!r} is not a whole number")
    return int(text)


def real(text: str, default: float = 0.0) -> float:
    """A real number, as 1.5, 1.5+3, 1.5D3; or the default for an empty field.

    Raises:
        ValueError: it is none, or too large for one of eight bytes.
    """
    if not text:
        return default
    found = _NUMBER.fullmatch(text)
    if found is None:
        raise ValueError(f"{text[:30]!r} is not a number")
    value = float(f"{found[1]}e{found[2] or found[3] or 0}")
    if math.isinf(value):
        raise ValueError(f"{text[:30]!r} is too large a number")
    return value


def listed(fields: Sequence[str]) -> list[range]:
    """Whole numbers of a list, in which 3, THRU, 9 and 3, THRU, 9, BY, 2 are ranges; empty fields are left out.

    Raises:
        ValueError: something else stands in it.
    """
    words = [field.upper() for field in fields if field]
    found: list[range] = []
    at = 0
    while at < len(words):
        if words[at] in ("EXCEPT", "ALL", "THRU", "BY"):
            raise ValueError(f"{words[at]} is not read here; list the numbers")
        first = last = whole(words[at])
        step, at = 1, at + 1
        if at + 1 < len(words) and words[at] == "THRU":
            last, at = whole(words[at + 1]), at + 2
            if at + 1 < len(words) and words[at] == "BY":
                step, at = whole(words[at + 1]), at + 2
        if last < first or step < 1:
            raise ValueError(f"{first} THRU {last} BY {step} is no range")
        found.append(range(first, last + 1, step))
    return found


def _section(lines: list[str], places: DeckPlaces) -> tuple[int, int]:
    """First and behind-last of the lines between BEGIN BULK and ENDDATA, or of all where these are not there."""
    begins = [
        i for i, line in enumerate(lines) if line[:40].lstrip()[:5].upper() == "BEGIN" and line.split("$")[0].strip()
    ]
    if len(begins) > 1:
        raise ValueError(
            f"it has {len(begins)} sections of bulk data, the second {lines[begins[1]].strip()[:40]!r} "
            f"({places.place(begins[1])}), as parts of superelements; write the one part to a file of its own"
        )
    first = begins[0] + 1 if begins else 0
    for i in range(first, len(lines)):
        if lines[i][:1] in "Ee \t" and lines[i].strip().upper().startswith("ENDDATA"):
            return first, i
    return first, len(lines)


def _joined(lines: list[str], places: DeckPlaces, *, first: int, punched: bool) -> list[Card]:
    """The cards, with their continuations: the next line, or wherever in the file the line of that name stands."""
    cards: list[Card] = []
    current: Card | None = None
    rule: list[str] = []
    open_cards: dict[str, Card] = {}  # by the name of the continuation that they wait for
    pieces: list[_Piece] = []  # continuations before their card
    for at, line in enumerate(lines, start=first):
        if "$" in line:
            line = line[: line.index("$")]
        if not line or line.isspace():
            continue
        head, fields, tail, wide, fixed = _split(line)
        if head and head[0] not in "+*":
            if head[0] == "=":
                if head == "=":
                    rule = fields
                cards += _replicated(cards, rule, Card(head, fields, tail, fixed, at, places))
                current = cards[-1]
                continue
            current = Card(head, fields, tail, fixed, at, places)
            cards.append(current)
        else:
            label = head[1:]
            target = current
            if label and (current is None or label not in _labels(current.tail)):
                target = open_cards.get(label)
                if target is None:
                    above = current
                    current = target = Card("", (), tail, fixed, at, places)
                    pieces.append((label, target, above))
            if target is None and punched:
                continue
            if target is None:
                where = places.place(at)
                raise ValueError(f"{where}: the first card begins with a continuation: {line.strip()[:40]!r}")
            if not wide and len(target) % 8:
                target += [""] * (8 - len(target) % 8)  # a second half that is not there
            for other in _labels(target.tail):
                open_cards.pop(other, None)
            target += fields
            target.tail, target.fixed = tail, fixed
            current = target
        if tail:
            open_cards.update(dict.fromkeys(_labels(tail), current))
    _attach(pieces, open_cards)
    return cards


def _replicated(cards: list[Card], rule: list[str], repeat: Card) -> list[Card]:
    """Cards like the one above: "=" copies a field, "==" all that follow, *(2) adds to it; "=(3)" does so three times.

    Raises:
        ValueError: there is no card of one line above, or no rule; or the cards are too many.
    """
    found = re.fullmatch(r"=(?:\((\d{1,6})\)|(\d{1,6}))?", repeat.name, re.ASCII)
    if found is None or not rule or not cards or len(cards[-1]) != 8:
        raise repeat.error(
            f"replication ({repeat.name[:20]!r}) is read of cards of one line, up to 999999 times; have Nastran punch "
            "the sorted deck"
        )
    made: list[Card] = []
    above = cards[-1]
    for _ in range(int(found[1] or found[2] or 1)):
        fields = list(above)
        for i, text in enumerate(rule):
            if text == "==":
                break
            if text.startswith("*"):
                fields[i] = _sum(fields[i], text[1:].strip("()"))
            elif text != "=":
                fields[i] = text
        above = Card(above.name, fields, "", True, repeat.line, repeat.places)
        made.append(above)
    return made


def _sum(text: str, step: str) -> str:
    """A number and what is added to it, whole where both are."""
    try:
        return str(whole(text) + whole(step))
    except ValueError:
        return repr(real(text) + real(step))


def _attach(pieces: Sequence[_Piece], open_cards: Mapping[str, Card]) -> None:
    """Put pieces that stand apart behind the cards that name them, and those that none names behind the line above."""
    waited = {label for card in open_cards.values() for label in _labels(card.tail)}
    apart: dict[str, Card] = {}
    for label, piece, above in reversed(pieces):
        if label in apart:
            raise apart[label].error(f"the continuation +{label} is there twice")
        if label in waited:
            apart[label] = piece
        elif above is None or above.tail:
            raise piece.error(f"the continuation +{label} is of no card: none ends with that name")
        else:
            above += piece
    for card in [card for card in open_cards.values() if card.name]:
        while label := next((label for label in _labels(card.tail) if label in apart), ""):
            piece = apart.pop(label)
            card += piece
            card.tail, card.fixed = piece.tail, piece.fixed
    for label, piece in apart.items():
        raise piece.error(f"the continuation +{label} is of no card: none ends with that name")


def _labels(tail: str) -> tuple[str, ...]:
    """What the continuation may be called behind its + or *: its first column is of no account to Nastran."""
    return (tail.lstrip("+*"), tail[1:]) if tail else ()


def _split(line: str) -> tuple[str, list[str], str, bool, bool]:
    """Name in capitals, four or eight fields, name of the continuation; whether fields are wide, and in columns."""
    if "," in line:
        head, *items = (item.strip() for item in line.split(","))
        head = head.upper()
        wide = head.endswith("*") if head[:1] != "*" else True
        count = 4 if wide else 8
        if any(items[count + 1 :]):  # a line that goes on beyond its tenth field, which is no name then
            count = len(items)
        fields = items[:count] + [""] * (count - len(items))
        tail = items[count] if len(items) > count else ""
    else:
        if "\t" in line:
            line = line.expandtabs(8)
        head = line[:8].strip().upper() if line[0] != "=" else line.split()[0]
        wide = "*" in head
        if wide:
            fields = [line[8:24].strip(), line[24:40].strip(), line[40:56].strip(), line[56:72].strip()]
        else:
            fields = [
                line[8:16].strip(), line[16:24].strip(), line[24:32].strip(), line[32:40].strip(),
                line[40:48].strip(), line[48:56].strip(), line[56:64].strip(), line[64:72].strip(),
            ]  # fmt: skip
        tail = line[72:80].strip() if len(line) > 72 else ""
    if wide and head[0] != "*":
        head = head.rstrip("* ")
    return head, fields, tail.upper(), wide, "," not in line
