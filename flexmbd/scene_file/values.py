"""Values of a scene file that are more than a number: frames, axes, functions of time, names of bodies and joints."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from flexmbd.multibody.functions.spline_table import Beyond, Table
from flexmbd.multibody.functions.time_function import Sine, TimeFunction
from flexmbd.scene_file.scene_description import (
    GROUND,
    BodyName,
    FramePlace,
    FunctionPlace,
    JointName,
    PortPlace,
    SignalName,
)
from flexmbd.toml_file import TomlSection

_FORMS = '"body", "body:interface", or { body = "name", p = [x, y, z] }'


@dataclass(frozen=True)
class Names:
    """The names of a scene file: bodies by name, whether they are flexible; and joints."""

    bodies: Mapping[str, bool]
    joints: tuple[str, ...] = ()


def nearest(name: str, known: Iterable[str]) -> str:
    """Of a name that is not known: the one that was meant, or all."""
    names = list(known)
    near = difflib.get_close_matches(name, names, n=1)
    return f"did you mean {near[0]!r}?" if near else f"there are {', '.join(names) or 'none'}"


def number(section: TomlSection, key: str, names: Names) -> float:
    """A finite number."""
    return section.number(key)


def numbers(section: TomlSection, key: str, names: Names) -> tuple[float, ...]:
    """A list of finite numbers."""
    return section.numbers(key)


def three_rows(section: TomlSection, key: str, names: Names) -> tuple[tuple[float, ...], ...]:
    """Three rows of three numbers."""
    return section.matrix(key, size=3)


def rows(section: TomlSection, key: str, names: Names) -> tuple[object, ...]:
    """A list of numbers, or of rows of as many each."""
    value = section.need(key)
    if not (isinstance(value, list) and value and isinstance(value[0], list)):
        return section.numbers(key)
    inner = TomlSection({f"{key}[{i}]": one for i, one in enumerate(value)}, section.place, section.file, section.kind)
    return tuple(inner.numbers(one, count=len(value[0])) for one in inner.values)


def whole_rows(section: TomlSection, key: str, names: Names) -> tuple[tuple[int, ...], ...]:
    """A list of lists of whole numbers."""
    value = section.need(key)
    if not (isinstance(value, list) and value and all(isinstance(row, list) for row in value)):
        section.fail(key, f"must be a list of lists of whole numbers, got {value!r:.60}")
    for i, row in enumerate(value):
        for one in row:
            if isinstance(one, bool) or not isinstance(one, int):
                section.fail(f"{key}[{i}]", f"must be a list of whole numbers, got {row!r:.60}")
    return tuple(tuple(row) for row in value)


def number_or_none(section: TomlSection, key: str, names: Names) -> float | None:
    """A finite number, or "none"."""
    return None if section.need(key) == "none" else section.number(key)


def whole(section: TomlSection, key: str, names: Names) -> int:
    """A whole number."""
    return section.whole(key)


def flag(section: TomlSection, key: str, names: Names) -> bool:
    """True or false."""
    return section.flag(key)


def text(section: TomlSection, key: str, names: Names) -> str:
    """A text."""
    return section.text(key)


def axis(section: TomlSection, key: str, names: Names) -> str | tuple[float, ...]:
    """x, y, z, or a direction."""
    value = section.need(key)
    if value in ("x", "y", "z"):
        return str(value)
    if not isinstance(value, list):
        section.fail(key, f'must be "x", "y", "z" or a direction [x, y, z], got {value!r}')
    return section.numbers(key, count=3)


def function(section: TomlSection, key: str, names: Names) -> FunctionPlace:
    """A function in a Python file beside the scene, "file.py:function"."""
    return _function(section, key, takes_scene=False)


def function_of_scene(section: TomlSection, key: str, names: Names) -> FunctionPlace:
    """The same, whose last argument is the machine."""
    return _function(section, key, takes_scene=True)


def _function(section: TomlSection, key: str, *, takes_scene: bool) -> FunctionPlace:
    given = section.text(key)
    file, colon, name = given.rpartition(":")
    if not (colon and file.endswith(".py") and name.isidentifier()):
        section.fail(key, f'must be a Python file and a function in it, "file.py:function", got {given!r}')
    return FunctionPlace(section.file.parent / file, name, section.path(key), takes_scene)


def time_function(section: TomlSection, key: str, names: Names) -> TimeFunction | FunctionPlace | SignalName:
    """A number, a sine, a table or a user's function over time."""
    return time_function_of(section, section.need(key), key)


def time_function_of(section: TomlSection, value: object, key: str) -> TimeFunction | FunctionPlace | SignalName:
    """A value, which stands at a key, as a function of time."""
    if not isinstance(value, dict):
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            section.fail(
                key,
                "must be a number, a table { t = [...], y = [...] }, a sine { amplitude = ..., omega = ... } or a "
                f'function {{ law = "file.py:function" }}, got {value!r}',
            )
        return section.number_of(value, key)
    inner = section.table_of(value, key)
    if inner.has("t") or inner.has("y"):
        return _points(inner, "t", "y")
    if inner.has("signal"):
        inner.allow(("signal", "initial"))
        return SignalName(inner.text("signal"), inner.number("initial") if inner.has("initial") else 0.0)
    if inner.has("law"):
        inner.allow(("law", "breaks"))
        law = _function(inner, "law", takes_scene=False)
        return replace(law, breaks=inner.numbers("breaks")) if inner.has("breaks") else law
    inner.allow(("amplitude", "omega", "phase", "offset", "t", "y", "law", "signal"))
    more = {name: inner.number(name) for name in ("phase", "offset") if inner.has(name)}
    return Sine(inner.number("amplitude"), inner.number("omega"), **more)


def stiffness(section: TomlSection, key: str, names: Names) -> float | Table:
    """A number, or a table of the resisting force over the deflection."""
    if isinstance(section.need(key), dict):
        return _points(section.table(key), "deflection", "force")
    return section.number(key)


def _points(inner: TomlSection, across: str, up: str) -> Table:
    inner.allow((across, up, "monotone", "beyond"))
    monotone = inner.flag("monotone") if inner.has("monotone") else False
    table = Table(inner.numbers(across), inner.numbers(up), monotone=monotone, beyond=_beyond(inner))
    x, y = np.asarray(table.t), np.asarray(table.y)
    if len(x) != len(y) or len(x) < 2 or not (np.diff(x) > 0.0).all():
        inner.fail("", f"needs at least two points, as many {across} as {up}, with ascending {across}")
    return table


def _beyond(inner: TomlSection) -> Beyond:
    """How a table goes on, held where nothing is said."""
    if not inner.has("beyond"):
        return Beyond.HOLD
    name, known = inner.text("beyond"), {one.value: one for one in Beyond}
    if name not in known:
        inner.fail("beyond", f"{name!r} is not known; {nearest(name, known)}")
    return known[name]


def three_time_functions(
    section: TomlSection, key: str, names: Names
) -> tuple[TimeFunction | FunctionPlace | SignalName, ...]:
    """Three components, each a function of time."""
    value = section.need(key)
    if not isinstance(value, list) or len(value) != 3:
        section.fail(key, f"must be a list of three components, got {value!r}")
    return tuple(time_function_of(section, one, f"{key}[{i}]") for i, one in enumerate(value))


def six(section: TomlSection, key: str, names: Names) -> object:
    """Six numbers, or six rows of six."""
    value = section.need(key)
    if isinstance(value, list) and value and isinstance(value[0], list):
        return section.matrix(key, size=6)
    return section.numbers(key, count=6)


def joint(section: TomlSection, key: str, names: Names) -> JointName:
    """The name of a joint."""
    return _joint(section, section.text(key), key, names)


def joints(section: TomlSection, key: str, names: Names) -> tuple[JointName, ...]:
    """A list of names of joints."""
    return tuple(_joint(section, name, key, names) for name in section.texts(key))


def _joint(section: TomlSection, name: str, key: str, names: Names) -> JointName:
    if name not in names.joints:
        section.fail(key, f"there is no joint {name!r}; {nearest(name, names.joints)}")
    return JointName(name)


def flexible(section: TomlSection, key: str, names: Names) -> BodyName:
    """The name of a flexible body."""
    return _flexible(section, section.text(key), key, names)


def port(section: TomlSection, key: str, names: Names) -> PortPlace:
    """A port of a flexible body, as "arm:z_max"."""
    return _port(section, section.text(key), key, names)


def ports(section: TomlSection, key: str, names: Names) -> tuple[PortPlace, ...]:
    """A list of ports."""
    return tuple(_port(section, name, key, names) for name in section.texts(key))


def _port(section: TomlSection, text: str, key: str, names: Names) -> PortPlace:
    body, colon, name = text.rpartition(":")
    if not colon:
        section.fail(key, f'must be a port of a flexible body, as "arm:z_max", got {text!r}')
    return PortPlace(_flexible(section, body, key, names).name, name)


def flexibles(section: TomlSection, key: str, names: Names) -> tuple[BodyName, ...]:
    """A list of names of flexible bodies."""
    return tuple(_flexible(section, name, key, names) for name in section.texts(key))


def solids(section: TomlSection, key: str, names: Names) -> tuple[BodyName, ...]:
    """A list of names of rigid bodies and point masses."""
    known = [body for body, is_flexible in names.bodies.items() if not is_flexible]
    for name in section.texts(key):
        if name not in known:
            section.fail(key, f"there is no rigid body {name!r}; {nearest(name, known)}")
    return tuple(map(BodyName, section.texts(key)))


def _flexible(section: TomlSection, name: str, key: str, names: Names) -> BodyName:
    soft = [body for body, is_flexible in names.bodies.items() if is_flexible]
    if name not in soft:
        section.fail(key, f"there is no flexible body {name!r}; {nearest(name, soft)}")
    return BodyName(name)


def frame(section: TomlSection, key: str, names: Names) -> FramePlace:
    """A frame on a body or on the ground."""
    return _frame(section, section.need(key), key, names)


def frames(section: TomlSection, key: str, names: Names) -> tuple[FramePlace, ...]:
    """A list of frames."""
    value = section.need(key)
    if not isinstance(value, list):
        section.fail(key, f"must be a list of frames, each {_FORMS}, got {value!r}")
    return tuple(_frame(section, one, f"{key}[{i}]", names) for i, one in enumerate(value))


def _frame(section: TomlSection, value: object, key: str, names: Names) -> FramePlace:
    if isinstance(value, str) and value:
        body, colon, interface = value.partition(":")
        if value in names.bodies:  # a colon may be part of the name
            body, colon = value, ""
        _check_body(section, body, key, names, wants_interface=bool(colon))
        return FramePlace(body, interface if colon else None, None, None, value)
    if not isinstance(value, dict):
        section.fail(key, f"must be a frame, {_FORMS}, got {value!r}")
    inner = section.table_of(value, key)
    inner.allow(("body", "interface", "p", "R", "name"))
    body = inner.text("body")
    surface = inner.text("interface") if inner.has("interface") else None
    _check_body(inner, body, "body", names, wants_interface=surface is not None)
    if names.bodies.get(body, False) and (inner.has("p") or inner.has("R")):
        inner.fail("", f"{body!r} is flexible: its frames are its interfaces, and cannot be placed by p and R")
    p = inner.numbers("p", count=3) if inner.has("p") else None
    R = inner.matrix("R", size=3) if inner.has("R") else None
    return FramePlace(body, surface, p, R, inner.text("name") if inner.has("name") else _label(body, surface, p))


def _label(body: str, interface: str | None, p: tuple[float, ...] | None) -> str:
    if interface is not None:
        return f"{body}:{interface}"
    return body if p is None else f"{body}({', '.join(f'{x:g}' for x in p)})"


def _check_body(section: TomlSection, body: str, key: str, names: Names, *, wants_interface: bool) -> None:
    if body != GROUND and body not in names.bodies:
        section.fail(key, f"there is no body {body!r}; {nearest(body, [GROUND, *names.bodies])}")
    if wants_interface and not names.bodies.get(body, False):
        section.fail(key, f'{body!r} is rigid and has no interfaces; place a frame by {{ body = "{body}", p = [...] }}')
