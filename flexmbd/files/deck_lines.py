"""The lines of a deck of Nastran, those of the files that it includes in their places."""

from __future__ import annotations

import re
from bisect import bisect
from dataclasses import dataclass
from pathlib import Path

from flexmbd.files.mesh_text import read_lines

# Files within files; lines over which the name of one goes.
_DEEPEST = 10
_MOST_LINES = 8

# Of a run of lines of one file: the first one's index among all, the file, the line's number there from 1 on.
_Piece = tuple[int, Path, int]


@dataclass(frozen=True)
class DeckPlaces:
    """Where lines stand, of a deck with the files that it includes.

    Attributes:
        path: of the deck.
        pieces: runs of lines of one file.
    """

    path: Path
    pieces: list[_Piece]

    def place(self, index: int) -> str:
        """Where a line stands, as "line 12"."""
        begin, path, number = self.pieces[bisect(self.pieces, index, key=lambda piece: piece[0]) - 1]
        line = f"line {number + index - begin}"
        return line if path == self.path else f"{path}, {line}"


def deck_lines(path: Path) -> tuple[list[str], DeckPlaces]:
    """The lines of a deck, and where they stand; not collective.

    Raises:
        ValueError: a file that is included is missing or includes itself.
        ExportError: a file cannot be read.
    """
    lines, pieces = _with_included(path, path, ())
    return lines, DeckPlaces(path, pieces)


def _with_included(path: Path, top: Path, within: tuple[Path, ...]) -> tuple[list[str], list[_Piece]]:
    here = path.resolve()
    if here in within:
        raise ValueError(f"INCLUDE goes in a circle: {' includes '.join(str(one) for one in (*within, here))}")
    if len(within) >= _DEEPEST:
        raise ValueError(f"{path}: INCLUDE goes more than {_DEEPEST} files deep")
    lines = read_lines(path)
    if not any("INCLUDE" in line.upper() for line in lines):
        return lines, [(0, path, 1)]
    found: list[str] = []
    pieces = [(0, path, 1)]
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
        inner, inner_pieces = _with_included(_included(name, path, top), top, (*within, here))
        pieces += [(len(found) + begin, file, number) for begin, file, number in inner_pieces]
        found += inner
        pieces.append((len(found), path, at + 1))
    return found, pieces


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
