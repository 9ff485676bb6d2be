"""The layout of the block of a structure of arrays (`array_struct`): 64-bit words."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import cached_property
from typing import Any


@dataclass(frozen=True)
class Layout:
    """The layout of a structure's block of 64-bit words.

    Attributes:
        qualified: the structure's name, with its module.
        fields: names and kinds: of an array dtype's letter and number of dimensions, of a structure its layout, of a
            number "d" or "q".
    """

    qualified: str
    fields: tuple[tuple[str, Any], ...]

    @cached_property
    def places(self) -> dict[str, int]:
        """The first word of each field."""
        found, at = {}, 0
        for name, kind in self.fields:
            found[name] = at
            at += 1 + (kind[1] if isinstance(kind, tuple) else 0)
        return found

    @cached_property
    def text(self) -> str:
        """Tells it from others; the same in any process."""
        return f"{self.qualified} {hashlib.sha256(repr(self.fields).encode()).hexdigest()[:16]}"
