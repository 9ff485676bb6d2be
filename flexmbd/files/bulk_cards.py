"""Cards of Nastran's bulk data: fields of 8 and 16 columns or between commas, continuations, files included.

The format is that of MSC Nastran's Quick Reference Guide, "Format of Bulk Data Entries". What a card means is its
reader's.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from flexmbd.files.mesh_text import read_lines

# Files within files; lines over which the name of one goes.
_DEEPEST = 10
_MOST_LINES = 8

# Nastran's numbers: the E of an exponent may be a D, or left out before its sign.
_NUMBER = re.compile(r"([+-]?(?:\d+\.?\d*|\.\d+))(?:[ED]?([+-]\d+)|[ED](\d+))?", re.IGNORECASE | re.ASCII)


@dataclass(frozen=True)
class BulkData:
    """The cards of a deck.

    Attributes:
        cards: by name in capitals, of those wanted, the fields of each card behind its name: eight a line, stripped,
            "" where there is nothing.
        counts: how many there are of every card, wanted or not.
    """

    cards: Mapping[str, list[list[str]]]
    counts: Mapping[str, int]


class _Card:
    """A card, or a piece of one whose beginning is elsewhere in the file."""

    __slots__ = ("fields", "fixed", "name", "tail")

    def __init__(self, name: str, fields: list[str], tail: str, fixed: bool) -> None:
        self.name, self.fields, self.tail, self.fixed = name, fields, tail, fixed


def read_bulk(path: Path, *, wanted: Collection[str]) -> BulkData:
    """The cards of a file of bulk data and of those that it includes; not collective.

    Args:
        path: with or without what stands before BEGIN BULK.
        wanted: names of the cards whose fields are kept, in capitals.

    Raises:
        ValueError: a file that is included is missing or includes itself; a continuation is of no card; a
            tenth field is no name of one; there are several sections of bulk data.
        ExportError: a file cannot be read.
    """
    lines = _bulk_lines(_with_included(path, path, ()))
    every = _joined(lines)
    counts = Counter(card.name for card in every)
    cards: dict[str, list[list[str]]] = {}
    for card in every:
        if card.name in wanted:
            if not card.fixed and card.tail.isdigit():
                raise ValueError(
                    f"{card.name} {card.fields[0]}: its line ends with {card.tail} in the tenth field, where only the "
                    "name of a continuation may stand; begin a new line after nine fields"
                )
            card.fields += [""] * (-len(card.fields) % 8)
            cards.setdefault(card.name, []).append(card.fields)
    return BulkData(cards, counts)


def whole(text: str, default: int = 0) -> int:
    """A whole number, or the default for an empty field.

    Raises:
        ValueError: it is none, or has more than 18 digits.
    """
    if not text:
        return default
    if not re.fullmatch(r"[+-]?\d{1,18}", text, re.ASCII):
        raise ValueError(f"{text[:30]!r} is not a whole number")
    return int(text)


def real(text: str, default: float = 0.0) -> float:
    """A real number, as 1.5, 1.5+3, 1.5D3; or the default for an empty field.

    Raises:
        ValueError: it is none.
    """
    if not text:
        return default
    found = _NUMBER.fullmatch(text)
    if found is None:
        raise ValueError(f"{text[:30]!r} is not a number")
    return float(f"{found[1]}e{found[2] or found[3] or 0}")


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


def _with_included(path: Path, top: Path, within: tuple[Path, ...]) -> list[str]:
    """The lines of a file, those of the files that it includes in their places."""
    here = path.resolve()
    if here in within:
        raise ValueError(f"INCLUDE goes in a circle: {' includes '.join(str(one) for one in (*within, here))}")
    if len(within) >= _DEEPEST:
        raise ValueError(f"{path}: INCLUDE goes more than {_DEEPEST} files deep")
    lines = read_lines(path)
    if not any("INCLUDE" in line.upper() for line in lines):
        return lines
    found: list[str] = []
    at = 0
    while at < len(lines):
        line, at = lines[at], at + 1
        if not re.match(r"\s*INCLUDE[\s'\"]", line, re.IGNORECASE):
            found.append(line)
            continue
        name = line.strip()[len("INCLUDE") :].strip()
        quote = name[:1] if name[:1] in "'\"" else ""
        last = min(at + _MOST_LINES, len(lines))
        while quote and name.count(quote) < 2:
            if at == last:
                raise ValueError(f"{path}: INCLUDE {name[:60]} has no second quote")
            name, at = name + lines[at].strip(), at + 1
        name = name.split(quote)[1] if quote else name.partition("$")[0].strip()
        found += _with_included(_included(name, path, top), top, (*within, here))
    return found


def _included(name: str, path: Path, top: Path) -> Path:
    """The file of an INCLUDE: beside the file that names it, or beside the first one."""
    plain = Path(name.replace("\\", "/"))
    places = [folder / plain for folder in dict.fromkeys((path.parent, top.parent))]
    for place in places:
        if place.is_file():
            return place
    raise ValueError(
        f"{path}: INCLUDE {name!r} is not there: {' nor '.join(str(place) for place in places)} is a file; put it "
        "there, or write its place into the deck"
    )


def _bulk_lines(lines: list[str]) -> list[str]:
    """The lines between BEGIN BULK and ENDDATA, or all where these are not there."""
    begins = [
        i for i, line in enumerate(lines) if line[:40].lstrip()[:5].upper() == "BEGIN" and line.split("$")[0].strip()
    ]
    if len(begins) > 1:
        raise ValueError(
            f"it has {len(begins)} sections of bulk data, the second {lines[begins[1]].strip()[:40]!r}, as parts of "
            "superelements; write the one part to a file of its own"
        )
    first = begins[0] + 1 if begins else 0
    for i in range(first, len(lines)):
        if lines[i][:1] in "Ee \t" and lines[i].strip().upper().startswith("ENDDATA"):
            return lines[first:i]
    return lines[first:]


def _joined(lines: list[str]) -> list[_Card]:
    """The cards, with their continuations: the next line, or wherever in the file the line of that name stands."""
    cards: list[_Card] = []
    current: _Card | None = None
    rule: list[str] = []
    open_cards: dict[str, _Card] = {}  # by the name of the continuation that they wait for
    pieces: dict[str, tuple[_Card, _Card | None]] = {}  # continuations before their card, and the card above them
    for line in lines:
        if "$" in line:
            line = line[: line.index("$")]
        if not line or line.isspace():
            continue
        head, fields, tail, wide, fixed = _split(line)
        if head and head[0] not in "+*":
            if head[0] == "=":
                if head == "=":
                    rule = fields
                made = _replicated(cards, rule, head, line)
                cards += made
                current = cards[-1]
                continue
            current = _Card(head, fields, tail, fixed)
            cards.append(current)
        else:
            label = head[1:]
            target = current
            if label and (current is None or label not in _labels(current.tail)):
                target = open_cards.get(label)
                if target is None:
                    above = current
                    current = target = _Card("", [], tail, fixed)
                    pieces[label] = (target, above)
            if target is None:
                raise ValueError(f"the first card begins with a continuation: {line.strip()[:40]!r}")
            if not wide and len(target.fields) % 8:
                target.fields += [""] * (8 - len(target.fields) % 8)  # a second half that is not there
            for other in _labels(target.tail):
                open_cards.pop(other, None)
            target.fields += fields
            target.tail, target.fixed = tail, fixed
            current = target
        if tail:
            open_cards.update(dict.fromkeys(_labels(tail), current))
    _attach(pieces, open_cards)
    return cards


def _replicated(cards: list[_Card], rule: list[str], head: str, line: str) -> list[_Card]:
    """Cards like the one above: "=" copies a field, "==" all that follow, *(2) adds to it; "=(3)" does so three times.

    Raises:
        ValueError: there is no card of one line above, or no rule; or the cards are too many.
    """
    found = re.fullmatch(r"=(?:\((\d{1,6})\)|(\d{1,6}))?", head, re.ASCII)
    if found is None or not rule or not cards or len(cards[-1].fields) != 8:
        raise ValueError(
            f"replication ({line.strip()[:20]!r}) is read of cards of one line, up to 999999 times; have Nastran punch "
            "the sorted deck"
        )
    made: list[_Card] = []
    above = cards[-1]
    for _ in range(int(found[1] or found[2] or 1)):
        fields = list(above.fields)
        for i, text in enumerate(rule):
            if text == "==":
                break
            if text.startswith("*"):
                fields[i] = _sum(fields[i], text[1:].strip("()"))
            elif text != "=":
                fields[i] = text
        above = _Card(above.name, fields, "", True)
        made.append(above)
    return made


def _sum(text: str, step: str) -> str:
    """A number and what is added to it, whole where both are."""
    try:
        return str(whole(text) + whole(step))
    except ValueError:
        return repr(real(text) + real(step))


def _attach(pieces: dict[str, tuple[_Card, _Card | None]], open_cards: Mapping[str, _Card]) -> None:
    """Put pieces that stand apart behind the cards that name them."""
    for card in [card for card in open_cards.values() if card.name]:
        while label := next((label for label in _labels(card.tail) if label in pieces), ""):
            piece, _ = pieces.pop(label)
            card.fields += piece.fields
            card.tail, card.fixed = piece.tail, piece.fixed
    for label, (piece, above) in pieces.items():
        if above is None or above.tail:
            raise ValueError(f"the continuation +{label} is of no card: none ends with that name")
        above.fields += piece.fields


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
