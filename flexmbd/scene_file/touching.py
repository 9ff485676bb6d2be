"""Shapes that touch in a scene file, [[touch]]: two of them or lists, the law of their contact, friction.

Kinds and keys are the names of `flexmbd.contact` and of its classes' arguments.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from flexmbd import contact
from flexmbd.errors import SceneError
from flexmbd.multibody.bodies.body import Frame
from flexmbd.multibody.bodies.shape import Shape
from flexmbd.scene_file import values as v
from flexmbd.scene_file.entry_kinds import Key, Kind, read_arguments, read_kind
from flexmbd.scene_file.scene_description import Element, TouchEntry
from flexmbd.scene_file.values import Names
from flexmbd.toml_file import TomlSection

_KEYS = ("name", "one", "other", "law", "friction")
_IMPACT = {"restitution": Key(v.number), "speed": Key(v.number_or_none)}


def _surface(frame: Frame, *, path: str | None = None, scale: float = 1.0, **given: Any) -> contact.TriangleSurface:
    """Of points and triangles, or of those in a file."""
    if path is None:
        return contact.TriangleSurface(frame, **given)
    return contact.TriangleSurface.of_shape(frame, Shape.from_file(path, scale=scale), **given)


def _shape(make: Any, *needed: str, **keys: Any) -> Kind:
    read = {name: key if isinstance(key, Key) else Key(key) for name, key in keys.items()}
    return Kind(make, {"frame": Key(v.frame), **read}, ("frame", *needed))


def _law(make: Any, *needed: str, **keys: Any) -> Kind:
    return Kind(make, {name: key if isinstance(key, Key) else Key(key) for name, key in keys.items()}, needed)


def _hard(*, impact: str = contact.ImpactLaw.NEWTON.value, **given: Any) -> contact.Hard:
    """Its law of impact by name."""
    known = {one.value: one for one in contact.ImpactLaw}
    if impact not in known:
        raise SceneError(f"no law of impact is called {impact!r}; there are {', '.join(map(repr, known))}")
    return contact.Hard(impact=known[impact], **given)


SHAPES: dict[str, Kind] = {
    "sphere": _shape(contact.Sphere, "radius", radius=v.number),
    "vertex": _shape(contact.Vertex),
    "half_space": _shape(contact.HalfSpace, normal=v.axis),
    "hollow_sphere": _shape(contact.HollowSphere, "radius", radius=v.number),
    "hollow_cylinder": _shape(contact.HollowCylinder, "radius", radius=v.number),
    "cylinder": _shape(contact.Cylinder, "radius", radius=v.number),
    "disc": _shape(
        contact.Disc, "radius", radius=v.number, thickness=v.number, rounding=v.number, crown=v.number_or_none
    ),
    "capsule": _shape(contact.Capsule, "radius", "length", radius=v.number, length=v.number),
    "box": _shape(contact.Box, "sides", sides=v.numbers),
    "convex_polytope": _shape(contact.ConvexPolytope, "vertices", vertices=v.rows, faces=v.whole_rows),
    "profile": _shape(contact.Profile, "points", points=v.rows, bulges=v.numbers, spline=v.flag),
    "triangle_surface": _shape(
        _surface, points=v.rows, triangles=v.whole_rows, path=v.text, scale=v.number, crease_angle=v.number, open=v.flag
    ),
}

LAWS: dict[str, Kind] = {
    "power_law": _law(contact.PowerLaw, "k", k=v.number, p=v.number, **_IMPACT),
    "bearing": _law(contact.PowerLaw.bearing, "load", "depth", load=v.number, depth=v.number, **_IMPACT),
    "hertz": _law(contact.Hertz, "E", E=v.number, nu=v.number, E_other=v.number, nu_other=v.number, **_IMPACT),
    "hard": _law(_hard, restitution=v.number, mu=v.number, impact=v.text),
}

_FRICTION = _law(
    contact.Friction, "mu", "stiffness", "damping", "load", mu=v.number, stiffness=v.number, damping=v.number,
    load=v.number, static=v.number, stribeck=v.number, rolling=v.number, spinning=v.number,
)  # fmt: skip


def read_touch(section: TomlSection, names: Names, folder: Path) -> TouchEntry:
    """The shapes of a table [[touch]], their law and their friction.

    Raises:
        FlexmbdError: as all that reads the file.
    """
    section.allow(_KEYS)
    one = _shapes(section, "one", names, folder)
    other = _shapes(section, "other", names, folder) if section.has("other") else None
    if other is None and len(one) == 1:
        section.fail("", "has no 'other', which touches a single shape; a list alone touches within itself")
    law = section.table("law")
    friction = section.table("friction") if section.has("friction") else None
    if friction is not None:
        friction.allow(_FRICTION.keys)
    return TouchEntry(
        section.text("name"),
        section.place,
        one,
        other,
        Element(law.place, *read_kind(law, LAWS, names)),
        None if friction is None else read_arguments(friction, _FRICTION, "friction", names),
    )


def _shapes(section: TomlSection, key: str, names: Names, folder: Path) -> tuple[Element, ...]:
    """The shapes under a key, which is a table or a list of tables."""
    given = section.need(key)
    entries = given if isinstance(given, list) else [given]
    if not entries or not all(isinstance(one, dict) for one in entries):
        section.fail(key, f'must be a table {{ kind = "sphere", ... }} or a list of such tables, got {given!r:.60}')
    several = isinstance(given, list)
    tables = [section.table_of(one, f"{key}[{k}]" if several else key) for k, one in enumerate(entries)]
    return tuple(Element(table.place, *_read_shape(table, names, folder)) for table in tables)


def _read_shape(section: TomlSection, names: Names, folder: Path) -> tuple[str, Mapping[str, object]]:
    kind, arguments = read_kind(section, SHAPES, names)
    if kind == "triangle_surface":
        of_file = "path" in arguments
        if of_file == ("points" in arguments or "triangles" in arguments):
            section.fail("", "needs either a 'path', of a file with triangles, or 'points' and 'triangles'")
        if of_file:
            arguments["path"] = str(folder / str(arguments["path"]))
        elif "scale" in arguments:
            section.fail("scale", "is of a file; give the points in m")
    return kind, arguments
