"""TOML files that people write: read whole, and asked key by key, so that each fault is named by its place.

A `TomlSection` is one table of the file. Whoever reads it says which keys it may have, so that a slip of the pen is
answered with the key that was meant; a value of another type is named with its path and what was expected.
"""

from __future__ import annotations

import difflib
import math
import re
import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

from flexmbd.errors import FlexmbdError

_INDEX = re.compile(r"\[(\d+)\]")
# Bytes; a scene with a long table has some hundred thousand.
_LARGEST = 2**24


@dataclass(frozen=True)
class TomlSection:
    """A table of a TOML file.

    Attributes:
        values: what it holds.
        place: its path in the file, as "joint[2].parent"; empty at the top.
        file: the file's name.
        kind: of the errors raised.
    """

    values: Mapping[str, Any]
    place: str
    file: Path
    kind: type[FlexmbdError]

    def fail(self, key: str, fault: str) -> NoReturn:
        """Raise the file's error for a key; "" stands for the table itself."""
        raise self.kind(f"{self.file}: {self.path(key) or 'the file'}: {fault}")

    def path(self, key: str) -> str:
        """Where a key stands in the file, as "joint[2].parent"; of "" the table's own path."""
        return f"{self.place}.{key}" if self.place and key else self.place or key

    def allow(self, keys: Iterable[str]) -> None:
        """Refuse keys other than these, each with the nearest of these."""
        known = list(keys)
        for key in self.values:
            if key not in known:
                near = difflib.get_close_matches(key, known, n=1)
                meant = f"did you mean {near[0]!r}? There may be" if near else "there may be"
                self.fail(key, f"is not known; {meant} {', '.join(known)}")

    def has(self, key: str) -> bool:
        """Whether the key is there."""
        return key in self.values

    def need(self, key: str) -> Any:
        """The value of a key that must be there."""
        if key not in self.values:
            self.fail("", f"has no {key!r}, which is needed")
        return self.values[key]

    def number(self, key: str) -> float:
        """A finite number."""
        return self.number_of(self.need(key), key)

    def number_of(self, value: object, key: str) -> float:
        """A value, which stands at a key, as a finite number."""
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            self.fail(key, f"must be a number, got {_shown(value)}")
        try:
            number = float(value)
        except OverflowError:
            number = math.inf
        if not math.isfinite(number):
            self.fail(key, f"must be a finite number, got {_shown(value)}")
        return number

    def whole(self, key: str) -> int:
        """A whole number."""
        value = self.need(key)
        if isinstance(value, bool) or not isinstance(value, int):
            self.fail(key, f"must be a whole number, got {_shown(value)}")
        return value

    def flag(self, key: str) -> bool:
        """True or false."""
        value = self.need(key)
        if not isinstance(value, bool):
            self.fail(key, f"must be true or false, got {_shown(value)}")
        return value

    def text(self, key: str) -> str:
        """A text that is not empty."""
        value = self.need(key)
        if not isinstance(value, str) or not value or "\0" in value:
            self.fail(key, f"must be a text in quotes, got {_shown(value)}")
        return value

    def texts(self, key: str) -> tuple[str, ...]:
        """A list of texts."""
        value = self.need(key)
        if not isinstance(value, list) or not all(isinstance(one, str) and one for one in value):
            self.fail(key, f'must be a list of texts, as ["a", "b"], got {_shown(value)}')
        return tuple(value)

    def numbers(self, key: str, *, count: int | None = None) -> tuple[float, ...]:
        """A list of finite numbers, of a given length if there is one."""
        value = self.need(key)
        if not isinstance(value, list) or (count is not None and len(value) != count):
            wanted = "numbers" if count is None else f"{count} numbers"
            self.fail(key, f"must be a list of {wanted}, got {_shown(value)}")
        return tuple(self.number_of(one, f"{key}[{i}]") for i, one in enumerate(value))

    def matrix(self, key: str, *, size: int) -> tuple[tuple[float, ...], ...]:
        """A square matrix as a list of rows."""
        value = self.need(key)
        if not isinstance(value, list) or len(value) != size or not all(isinstance(row, list) for row in value):
            self.fail(key, f"must be a list of {size} rows of {size} numbers, got {_shown(value)}")
        rows = TomlSection({f"{key}[{i}]": row for i, row in enumerate(value)}, self.place, self.file, self.kind)
        return tuple(rows.numbers(row, count=size) for row in rows.values)

    def table(self, key: str) -> TomlSection:
        """A table below this one."""
        return self.table_of(self.need(key), key)

    def table_of(self, value: object, key: str) -> TomlSection:
        """A value, which stands at a key, as a table."""
        if not isinstance(value, dict):
            self.fail(key, f"must be a table, got {_shown(value)}")
        return TomlSection(value, self.path(key), self.file, self.kind)

    def tables(self, key: str) -> tuple[TomlSection, ...]:
        """The tables [[key]]; none where the key is not there."""
        value = self.values.get(key, [])
        if not isinstance(value, list):
            self.fail(key, f"must be tables headed [[{key}]], got {_shown(value)}")
        return tuple(self.table_of(one, f"{key}[{i}]") for i, one in enumerate(value))


def read_toml(path: str | Path, *, kind: type[FlexmbdError]) -> TomlSection:
    """A TOML file, as the section at its top. Not collective.

    Args:
        path: of the file.
        kind: of the errors to raise.

    Raises:
        FlexmbdError: of that kind; the file cannot be read, or is no TOML, with line and column.
    """
    file = Path(path)
    try:
        if file.exists() and not file.is_file():
            raise kind(f"cannot read {file}: it is not a regular file")
        with file.open("rb") as stream:
            data = stream.read(_LARGEST + 1)
    except OSError as error:
        raise kind(f"cannot read {file}: {error.strerror or error}") from error
    if len(data) > _LARGEST:
        raise kind(f"cannot read {file}: it has more than {_LARGEST} bytes")
    try:
        return TomlSection(tomllib.loads(data.decode("utf-8")), "", file, kind)
    except UnicodeDecodeError as error:
        raise kind(f"{file} is no TOML: it is not UTF-8 at byte {error.start}") from error
    except (ValueError, RecursionError) as error:
        raise kind(f"{file} is no TOML: {error}") from error


def toml_value(text: str) -> Any:
    """A value as TOML has it, as 2.3, true, "a" or [1, 2]; a text without quotes where it is none of these."""
    try:
        found = tomllib.loads(f"value = {text}")
    except (ValueError, RecursionError):
        return text
    return found["value"] if list(found) == ["value"] else text


def toml_path(text: str) -> tuple[str, ...]:
    """The words of a dotted path, as body.crank.com[0] or body."a.b".mass; none where it is no path."""
    found: Any
    try:
        found = tomllib.loads(re.sub(_INDEX, r".\1", text) + " = 0")
    except (ValueError, RecursionError):
        return ()
    words: list[str] = []
    while isinstance(found, dict) and len(found) == 1:
        (word,) = found
        words.append(word)
        found = found[word]
    return tuple(words) if found == 0 else ()


def _shown(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
