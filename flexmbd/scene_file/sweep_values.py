"""Values that a sweep gives to keys of a scene file: grids, lists, random numbers; and their units."""

from __future__ import annotations

import itertools
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from flexmbd.errors import SceneError
from flexmbd.toml_file import toml_path, toml_value

_FORMS = "START:STOP:COUNT (with :log at equal ratios), A,B,C, uniform(LEAST,MOST) or normal(MEAN,DEVIATION)"
_RANDOM = re.compile(r"(uniform|normal)\((.*),(.*)\)")
_MOST = 10**7  # variants
_UNITS = {
    "mass": "kg", "inertia": "kg m^2", "density": "kg/m^3", "com": "m", "p": "m", "length": "m", "radius": "m",
    "pitch": "m/rad", "gravity": "m/s^2", "t_end": "s", "h": "s", "every": "s", "omega": "rad/s", "phase": "rad",
    "ratio": "1", "rtol": "1", "coefficient": "1", "kinematic": "1", "t": "s", "restitution": "1", "mu": "1",
}  # fmt: skip


@dataclass(frozen=True)
class Variation:
    """The values of one key.

    Attributes:
        key: its dotted path.
        values: one after the other; empty where they are random.
        draw: "uniform" or "normal", or empty.
        bounds: the two numbers of a random one.
    """

    key: str
    values: tuple[Any, ...] = ()
    draw: str = ""
    bounds: tuple[float, float] = (0.0, 0.0)

    @property
    def is_numeric(self) -> bool:
        """Whether all values are numbers."""
        return all(isinstance(one, int | float) and not isinstance(one, bool) for one in self.values)


def read_variation(word: str) -> Variation:
    """Of KEY=VALUES.

    Raises:
        SceneError: it has another form.
    """
    key, equals, text = (part.strip() for part in word.partition("="))
    if not (toml_path(key) and equals and text):
        raise SceneError(f"--vary takes KEY=VALUES, VALUES as {_FORMS}, got {word!r}")
    random = _RANDOM.fullmatch(text)
    if random is not None:
        first, second = (_number(part, word) for part in random.groups()[1:])
        if not (first < second if random[1] == "uniform" else second > 0.0):
            wanted = "LEAST below MOST" if random[1] == "uniform" else "a DEVIATION above 0"
            raise SceneError(f"--vary {word}: {random[1]} needs {wanted}")
        return Variation(key, draw=random[1], bounds=(first, second))
    parts = text.split(":")
    if len(parts) in (3, 4) and parts[3:] in ([], ["log"]):
        return Variation(key, values=_grid(parts, word))
    listed = toml_value(f"[{text}]")
    values = tuple(listed) if isinstance(listed, list) else tuple(toml_value(part.strip()) for part in text.split(","))
    if not all(str(one) for one in values):
        raise SceneError(f"--vary {word}: a value is empty")
    return Variation(key, values=values)


def _number(text: str, word: str) -> float:
    try:
        found = float(text)
    except ValueError:
        found = np.nan
    if not np.isfinite(found):
        raise SceneError(f"--vary {word}: {text.strip()!r} is no finite number; VALUES are {_FORMS}")
    return found


def _grid(parts: Sequence[str], word: str) -> tuple[float, ...]:
    start, stop = _number(parts[0], word), _number(parts[1], word)
    count = int(parts[2]) if parts[2].strip().isdecimal() else 0
    if not 1 <= count <= _MOST:
        raise SceneError(f"--vary {word}: the COUNT must be a whole number from 1 to {_MOST}, got {parts[2]!r}")
    if len(parts) == 3:
        return tuple(float(x) for x in np.linspace(start, stop, count))
    if not start * stop > 0.0:
        raise SceneError(f"--vary {word}: equal ratios lead from {start:g} to no {stop:g}; both must have one sign")
    return tuple(float(x) for x in np.geomspace(start, stop, count))


def variants(variations: Sequence[Variation], *, samples: int | None, seed: int) -> list[dict[str, Any]]:
    """The values of each variant: all combinations of grids and lists, each with ``samples`` draws of what is random.

    The same seed gives the same numbers, whoever runs the variants.

    Raises:
        SceneError: a key is there twice; ``samples`` is missing, not positive, or nothing is random; too many.
    """
    keys = [toml_path(one.key) for one in variations]
    twice = [one.key for one in variations if keys.count(toml_path(one.key)) > 1]
    if twice:
        raise SceneError(f"--vary {twice[0]} is given twice")
    random = [one for one in variations if one.draw]
    if (samples is not None) != bool(random):
        needs = "needs --samples, how many draws there are" if random else "is for uniform(...) and normal(...) alone"
        raise SceneError(f"--vary {random[0].key} {needs}" if random else f"--samples {needs}")
    draws = 1 if samples is None else samples
    if draws < 1:
        raise SceneError(f"--samples must be 1 or more, got {draws}")
    fixed = [one for one in variations if not one.draw]
    count = draws * int(np.prod([float(len(one.values)) for one in fixed], initial=1.0))
    if count > _MOST:
        raise SceneError(f"{count} variants are too many; {_MOST} are the most")
    rng = np.random.default_rng(seed)
    drawn = {one.key: _draw(rng, one, count) for one in random}
    rows = itertools.product(*(one.values for one in fixed), range(draws))
    found = []
    for k, row in enumerate(rows):
        values: dict[str, Any] = dict(zip((one.key for one in fixed), row, strict=False))
        values |= {key: float(numbers[k]) for key, numbers in drawn.items()}
        found.append({one.key: values[one.key] for one in variations})
    return found


def _draw(rng: np.random.Generator, one: Variation, count: int) -> np.ndarray[Any, np.dtype[np.float64]]:
    return rng.uniform(*one.bounds, count) if one.draw == "uniform" else rng.normal(*one.bounds, count)


def unit_of(key: str) -> str:
    """The unit of a key; "SI" where it depends on the joint or on the kind of force."""
    words = [word for word in toml_path(key) if not word.isdecimal()]
    return _UNITS.get(words[-1], "SI") if words else "SI"


def numeric_columns(variations: Sequence[Variation], rows: Sequence[Mapping[str, Any]]) -> dict[str, list[float]]:
    """Numbers of each variant by key: the values, or where these are no numbers which of the list it is, from 0."""
    return {
        one.key: [
            float(row[one.key]) if one.is_numeric else float(one.values.index(row[one.key])) for row in rows
        ]
        for one in variations
    }
