"""Nastran's bulk data as fields: small, large and comma-separated ones, continuations joined."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence

_NUMBER = re.compile(r"([+-]?(?:\d+\.?\d*|\.\d+))(?:[edED]?([+-]?\d+))?")


def cards(text: str) -> Iterator[list[str]]:
    """Fields of one card after another, continuations joined; the first is the card's name without the star."""
    card: list[str] = []
    for line in text.splitlines():
        line = line.partition("$")[0].expandtabs().rstrip()
        if not line:
            continue
        head, fields = _fields(line)
        if head == "" or head[0] in "*+":
            if card:
                card += fields
            continue
        if card:
            yield card
        card = [head.rstrip("*").rstrip().upper(), *fields]
    if card:
        yield card


def _fields(line: str) -> tuple[str, list[str]]:
    """Name and data fields of a line: four wide ones or eight small ones, those that are not there empty."""
    if "," in line:
        head, *fields = (item.strip() for item in line.split(","))
        return head, (fields + [""] * 8)[: 4 if "*" in head else 8]
    head = line[:8].strip()
    width = 16 if "*" in head else 8
    return head, [line[8 + i * width : 8 + (i + 1) * width].strip() for i in range(64 // width)]


def whole(fields: Sequence[str], at: int) -> int:
    """A whole number from 0 on, of an empty field 0, or ValueError."""
    text = fields[at] if at < len(fields) else ""
    if not re.fullmatch(r"\d{0,9}", text, re.ASCII):
        raise ValueError(f"{fields[0]} {fields[1]}: {text[:30]!r} is not a whole number")
    return int(text or 0)


def number(fields: Sequence[str], at: int) -> float:
    """A finite number, of an empty field 0, or ValueError."""
    text = fields[at] if at < len(fields) else ""
    found = _NUMBER.fullmatch(text or "0.")
    value = math.nan if found is None else float(f"{found[1]}e{found[2] or 0}")
    if not math.isfinite(value):
        raise ValueError(f"{fields[0]} {fields[1]}: {text[:30]!r} is not a finite number")
    return value
