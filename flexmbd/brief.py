"""Short texts of objects that hold arrays: what a prompt or a notebook shows of one that a call returns.

Every room may import it; it imports nothing of flexmbd.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

# An array of more numbers is told by its shape, another text by its type; longer texts are cut.
_NUMBERS, _LETTERS, _LONGEST = 6, 60, 400


def brief(self: Any) -> str:
    """A dataclass's fields in one line, for ``__repr__``: large arrays by their shapes, what is None left out."""
    fields = [(field.name, getattr(self, field.name)) for field in dataclasses.fields(self) if field.repr]
    words = ", ".join(f"{name}={_value(value)}" for name, value in fields if value is not None)
    return f"{type(self).__name__}({words if len(words) <= _LONGEST else words[:_LONGEST] + ' ...'})"


def _value(value: Any) -> str:
    if isinstance(value, np.ndarray):
        if value.size > _NUMBERS:
            return f"<array {value.shape}>"
        return " ".join(np.array2string(value, precision=6, separator=", ").split())
    if isinstance(value, list | tuple) and len(value) > _NUMBERS:
        return f"<{len(value)} of {type(value).__name__}>"
    text = " ".join(repr(value).split())
    return text if len(text) <= _LETTERS else f"<{type(value).__name__}>"
