"""Events of a scene file: a joint's or a frame's coordinate that passes a level, or a function of the user's."""

from __future__ import annotations

from flexmbd.run.event import Direction
from flexmbd.scene_file import values as v
from flexmbd.scene_file.scene_description import Crossing, EventEntry, FunctionPlace
from flexmbd.scene_file.values import Names, nearest
from flexmbd.toml_file import TomlSection

_COMMON = ("name", "direction", "stop", "action")
_LEVELS = ("position", "velocity")
_COMPONENTS = ("x", "y", "z")


def read_event(section: TomlSection, names: Names) -> EventEntry:
    """The event of a table [[event]].

    Raises:
        FlexmbdError: as all that reads the file.
    """
    directions = {one.name.lower(): one for one in Direction}
    direction = section.text("direction") if section.has("direction") else "either"
    if direction not in directions:
        section.fail("direction", f"{direction!r} is not known; {nearest(direction, directions)}")
    return EventEntry(
        section.text("name"),
        section.place,
        _function(section, names),
        directions[direction],
        section.flag("stop") if section.has("stop") else False,
        v.function_of_scene(section, "action", names) if section.has("action") else None,
    )


def _function(section: TomlSection, names: Names) -> FunctionPlace | Crossing:
    if section.has("law"):
        section.allow(("law", *_COMMON))
        return v.function_of_scene(section, "law", names)
    if section.has("frame"):
        section.allow(("frame", "component", *_LEVELS, *_COMMON))
        component = section.text("component")
        if component not in _COMPONENTS:
            section.fail("component", f"must be one of {', '.join(_COMPONENTS)}, got {component!r}")
        return Crossing(v.frame(section, "frame", names), _COMPONENTS.index(component), *_level(section))
    section.allow(("joint", "coordinate", *_LEVELS, "frame", "law", *_COMMON))
    if not section.has("joint"):
        section.fail("", "needs a 'joint' or a 'frame' to watch, or a 'law'")
    index = section.whole("coordinate") if section.has("coordinate") else 0
    if index < 0:
        section.fail("coordinate", f"counts from 0, got {index}")
    return Crossing(v.joint(section, "joint", names), index, *_level(section))


def _level(section: TomlSection) -> tuple[bool, float]:
    """Whether a rate is watched, and the level that it passes."""
    given = [key for key in _LEVELS if section.has(key)]
    if len(given) != 1:
        section.fail("", "needs either 'position' or 'velocity', the value at which it takes place")
    return given[0] == "velocity", section.number(given[0])
