"""Text between two marks of a page that is else written by hand: what is generated there cannot grow old."""

from __future__ import annotations

import textwrap
from pathlib import Path


def marked(page: Path, name: str, text: str) -> str:
    """The page with this text between its marks ``<!-- name -->`` and ``<!-- end -->``.

    Raises:
        LookupError: the page has not both marks.
    """
    begin, finish = f"<!-- {name} -->", "<!-- end -->"
    before, mark, rest = page.read_text(encoding="utf-8").partition(begin)
    _, end, after = rest.partition(finish)
    if not (mark and end):
        raise LookupError(f"{page.name} lacks the marks {begin} and {finish}")
    return f"{before}{mark}\n{text}\n{end}{after}"


def paragraph(text: str) -> str:
    """Sentences in the lines of a page."""
    return "\n".join(textwrap.wrap(text, 128, break_long_words=False, break_on_hyphens=False))
