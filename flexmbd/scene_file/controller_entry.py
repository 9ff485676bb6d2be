"""Sampled controllers of a scene file: a law in a Python file, what it measures and the signals that it sets."""

from __future__ import annotations

from flexmbd.scene_file import values as v
from flexmbd.scene_file.scene_description import ControllerEntry, FunctionPlace, Measured, SignalName
from flexmbd.scene_file.values import Names, nearest
from flexmbd.toml_file import TomlSection

_KEYS = ("name", "step", "period", "offset", "state", "measurements", "inputs")
_QUANTITIES = ("position", "velocity", "acceleration")


def read_controller(section: TomlSection, names: Names) -> ControllerEntry:
    """The controller of a table [[controller]].

    Raises:
        FlexmbdError: as all that reads the file.
    """
    section.allow(_KEYS)
    given = section.need("measurements") if section.has("measurements") else []
    if not isinstance(given, list):
        section.fail("measurements", f"must be a list, got {given!r}")
    return ControllerEntry(
        section.text("name"),
        section.place,
        v.function(section, "step", names),
        section.number("period"),
        tuple(_measured(section, one, f"measurements[{i}]", names) for i, one in enumerate(given)),
        tuple(SignalName(name) for name in section.texts("inputs")),
        section.number("offset") if section.has("offset") else 0.0,
        section.numbers("state") if section.has("state") else None,
    )


def _measured(section: TomlSection, value: object, key: str, names: Names) -> Measured | SignalName | FunctionPlace:
    inner = section.table_of(value, key)
    if inner.has("signal"):
        inner.allow(("signal",))
        return SignalName(inner.text("signal"))
    if inner.has("law"):
        inner.allow(("law",))
        return v.function_of_scene(inner, "law", names)
    inner.allow(("joint", "frame", "quantity", "signal", "law"))
    quantity = inner.text("quantity")
    if quantity not in _QUANTITIES:
        inner.fail("quantity", f"{quantity!r} is not known; {nearest(quantity, _QUANTITIES)}")
    if inner.has("joint") == inner.has("frame"):
        inner.fail("", "needs a 'joint' or a 'frame', or else a 'signal' or a 'law'")
    of = v.joint(inner, "joint", names) if inner.has("joint") else v.frame(inner, "frame", names)
    return Measured(of, _QUANTITIES.index(quantity))
