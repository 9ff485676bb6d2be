"""Controllers and state equations of a scene file: functions in Python files, measurements, signals that they set."""

from __future__ import annotations

from flexmbd.scene_file import values as v
from flexmbd.scene_file.scene_description import (
    ControllerEntry,
    FollowedEntry,
    FunctionPlace,
    Measured,
    SignalName,
    StatesEntry,
)
from flexmbd.scene_file.values import Names, nearest
from flexmbd.toml_file import TomlSection

_CONTROLLER = ("name", "step", "period", "offset", "state", "measurements", "inputs")
_STATES = ("name", "rates", "outputs", "initial", "scale", "names", "measurements", "inputs")
_QUANTITIES = ("position", "velocity", "acceleration")
_THINGS = ("joint", "frame", "body")


def read_controller(section: TomlSection, names: Names) -> ControllerEntry:
    """The controller of a table [[controller]].

    Raises:
        FlexmbdError: as all that reads the file.
    """
    section.allow(_CONTROLLER)
    return ControllerEntry(
        section.text("name"),
        section.place,
        v.function(section, "step", names),
        section.number("period"),
        tuple(_measured(section.table_of(value, key), names) for key, value in _measurements(section)),
        tuple(SignalName(name) for name in section.texts("inputs")),
        section.number("offset") if section.has("offset") else 0.0,
        section.numbers("state") if section.has("state") else None,
    )


def read_states(section: TomlSection, names: Names) -> StatesEntry:
    """The state equations of a table [[states]].

    Raises:
        FlexmbdError: as all that reads the file.
    """
    section.allow(_STATES)
    scale = section.need("scale")
    return StatesEntry(
        section.text("name"),
        section.place,
        v.function(section, "rates", names),
        v.function(section, "outputs", names) if section.has("outputs") else None,
        section.numbers("initial") if section.has("initial") else None,
        section.numbers("scale") if isinstance(scale, list) else section.number("scale"),
        tuple(_followed(section, value, key, names) for key, value in _measurements(section)),
        tuple(SignalName(name) for name in section.texts("inputs")) if section.has("inputs") else (),
        section.texts("names") if section.has("names") else (),
    )


def _measurements(section: TomlSection) -> list[tuple[str, object]]:
    """The entries of the list ``measurements``, each with its key."""
    given = section.need("measurements") if section.has("measurements") else []
    if not isinstance(given, list):
        section.fail("measurements", f"must be a list, got {given!r}")
    return [(f"measurements[{i}]", one) for i, one in enumerate(given)]


def _followed(section: TomlSection, value: object, key: str, names: Names) -> FollowedEntry:
    """What states follow: as controllers measure, or a function of time as data."""
    if isinstance(value, dict) and not {"t", "y", "amplitude", "omega"}.intersection(value):
        inner = section.table_of(value, key)
        if inner.has("quantity") and inner.text("quantity") == "acceleration":
            inner.fail("quantity", "states cannot follow accelerations, which follow from the states")
        return _measured(inner, names)
    return v.time_function_of(section, value, key)


def _measured(inner: TomlSection, names: Names) -> Measured | SignalName | FunctionPlace:
    if inner.has("signal"):
        inner.allow(("signal",))
        return SignalName(inner.text("signal"))
    if inner.has("law"):
        inner.allow(("law",))
        return v.function_of_scene(inner, "law", names)
    inner.allow((*_THINGS, "quantity", "signal", "law"))
    quantity = inner.text("quantity")
    if quantity not in _QUANTITIES:
        inner.fail("quantity", f"{quantity!r} is not known; {nearest(quantity, _QUANTITIES)}")
    given = [key for key in _THINGS if inner.has(key)]
    if len(given) != 1:
        inner.fail("", "needs a 'joint', a 'frame' or a flexible 'body', or else a 'signal' or a 'law'")
    order = _QUANTITIES.index(quantity)
    if given == ["joint"]:
        return Measured(v.joint(inner, "joint", names), order)
    if given == ["frame"]:
        return Measured(v.frame(inner, "frame", names), order)
    return Measured(v.flexible(inner, "body", names), order)
