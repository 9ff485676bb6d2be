"""Shapes in a scene file: `shape = { kind = "box", sides = [...] }`, or a list of such tables."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from flexmbd.errors import SceneError
from flexmbd.multibody.bodies.shape import Shape
from flexmbd.scene_file import values as v
from flexmbd.scene_file.scene_description import ShapeEntry
from flexmbd.scene_file.values import Names, nearest
from flexmbd.toml_file import TomlSection

_Reader = Callable[[TomlSection, str, Names], object]


@dataclass(frozen=True)
class _ShapeKind:
    """What makes a shape, the keys that it needs, and those that it may have."""

    make: Callable[..., Shape]
    needs: Mapping[str, _Reader]
    may: Mapping[str, _Reader]


_AT: Mapping[str, _Reader] = {"at": v.numbers, "colour": v.text}
_KINDS = {
    "box": _ShapeKind(Shape.box, {"sides": v.numbers}, {**_AT, "R": v.three_rows}),
    "sphere": _ShapeKind(Shape.sphere, {"radius": v.number}, _AT),
    "cylinder": _ShapeKind(
        Shape.cylinder, {"radius": v.number, "length": v.number}, {**_AT, "axis": v.axis, "bore": v.number}
    ),
    "rod": _ShapeKind(Shape.rod, {"start": v.numbers, "end": v.numbers, "radius": v.number}, {"colour": v.text}),
    "wheel": _ShapeKind(Shape.wheel, {"radius": v.number, "width": v.number}, {**_AT, "axis": v.axis}),
    "floor": _ShapeKind(Shape.floor, {"size": v.numbers}, {**_AT, "normal": v.axis}),
    "file": _ShapeKind(Shape.from_file, {"path": v.text}, {**_AT, "scale": v.number, "R": v.three_rows}),
}


def read_shapes(section: TomlSection, folder: Path) -> tuple[ShapeEntry, ...]:
    """The shapes under the key "shape" of a body's table, () without that key."""
    if not section.has("shape"):
        return ()
    given = section.need("shape")
    entries = given if isinstance(given, list) else [given]
    if not entries or not all(isinstance(one, dict) for one in entries):
        section.fail("shape", f'must be a table {{ kind = "box", ... }} or a list of such tables, got {given!r}')
    several = isinstance(given, list)
    return tuple(
        _entry(section.table_of(one, f"shape[{k}]" if several else "shape"), folder) for k, one in enumerate(entries)
    )


def make_shape(entries: tuple[ShapeEntry, ...]) -> Shape | None:
    """All of them together, files read now; None for none.

    Raises:
        SceneError: a value that does not fit; the message has the place in the scene's file.
    """
    made = [_make(entry) for entry in entries]
    return sum(made[1:], start=made[0]) if made else None


def _make(entry: ShapeEntry) -> Shape:
    try:
        return _KINDS[entry.kind].make(**entry.arguments)
    except SceneError as reason:
        raise SceneError(f"{entry.place}: {reason}") from reason


def _entry(section: TomlSection, folder: Path) -> ShapeEntry:
    name = section.text("kind")
    if name not in _KINDS:
        section.fail("kind", f"{name!r} is not known; {nearest(name, _KINDS)}")
    kind = _KINDS[name]
    readers = {**kind.needs, **kind.may}
    section.allow(("kind", *readers))
    for key in kind.needs:
        if not section.has(key):
            section.fail("", f"has no {key!r}, which a {name} needs")
    arguments = {key: read(section, key, Names({})) for key, read in readers.items() if section.has(key)}
    if "path" in arguments:
        arguments["path"] = folder / str(arguments["path"])
    return ShapeEntry(section.place, name, arguments)
