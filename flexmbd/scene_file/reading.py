"""From a TOML file to the description of a scene; each fault is named by its place in the file."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from flexmbd.errors import SceneError
from flexmbd.files.result_table import SUFFIXES
from flexmbd.scene_file import values as v
from flexmbd.scene_file.changes import changed
from flexmbd.scene_file.controllers_and_states import read_controller, read_states
from flexmbd.scene_file.entry_kinds import COUPLINGS, FORCES, INTEGRATORS, JOINTS, read_kind
from flexmbd.scene_file.event_entry import read_event
from flexmbd.scene_file.scene_description import (
    GROUND,
    DrawnPose,
    Element,
    JointEntry,
    OutputEntry,
    PointEntry,
    RecordEntry,
    RigidEntry,
    RunEntry,
    SceneFile,
    ShapedEntry,
    ShapeEntry,
)
from flexmbd.scene_file.shapes import read_shapes
from flexmbd.scene_file.touching import read_touch
from flexmbd.scene_file.values import Names, nearest
from flexmbd.toml_file import TomlSection, read_toml

_TABLES = (
    "gravity", "ground", "body", "joint", "force", "coupling", "touch", "event", "controller", "states", "simulate",
    "output",
)  # fmt: skip
_JOINT_KEYS = ("name", "parent", "child", "at", "position", "velocity", "motion")
_POSE_KEYS = ("p", "R")
FRAME_SERIES = ("positions", "velocities", "accelerations", "rotations", "angular_velocities")
_FORMATS = tuple(suffix.removeprefix(".") for suffix in SUFFIXES)
# Of a table.
_MOST_ROWS = 1e7
_MOST_STEPS = 10_000_000  # each leaves a row in memory
_FILMS = (".mp4", ".gif")


def read_scene(path: str | Path, *, changes: Mapping[str, object] | None = None) -> SceneFile:
    """Read a scene file; records and Python files that it names are not opened yet. Not collective.

    Args:
        path: of the file.
        changes: other values than those in the file, by dotted paths, as {"body.crank.mass": 2.3}.

    Raises:
        SceneError: it cannot be read, is no TOML, or holds something else than a scene: the message has the key's path,
            what was expected, and for a key or name that is not known the nearest one.
    """
    top = changed(read_toml(path, kind=SceneError), changes or {})
    top.allow(_TABLES)
    sections = top.tables("body")
    if not sections:
        top.fail("body", "a scene needs at least one, headed [[body]]")
    folder = Path(path).parent
    bodies = tuple(_body(section, folder) for section in sections)
    for section, body in zip(sections, bodies, strict=True):
        if body.name == GROUND or [one.name for one in bodies].count(body.name) > 1:
            section.fail("name", f"{body.name!r} is {'the inertial frame' if body.name == GROUND else 'taken'}")
    names = Names({body.name: isinstance(body, RecordEntry) for body in bodies})
    joints = tuple(_joint(section, names) for section in top.tables("joint"))
    for section, joint in zip(top.tables("joint"), joints, strict=True):
        if [one.name for one in joints].count(joint.name) > 1:
            section.fail("name", f"{joint.name!r} is taken; give the joint a name of its own")
    names = Names(names.bodies, tuple(joint.name for joint in joints))
    touches = tuple(read_touch(one, names, folder) for one in top.tables("touch"))
    called = tuple(touch.name for touch in touches)
    for section, touch in zip(top.tables("touch"), touches, strict=True):
        if called.count(touch.name) > 1:
            section.fail("name", f"{touch.name!r} is taken; give the contact a name of its own")
    run = _run(top.table("simulate"))
    output = top.table("output") if top.has("output") else TomlSection({}, "output", top.file, top.kind)
    return SceneFile(
        Path(path),
        top.numbers("gravity", count=3) if top.has("gravity") else (0.0, 0.0, 0.0),
        bodies,
        joints,
        tuple(Element(one.place, *read_kind(one, FORCES, names)) for one in top.tables("force")),
        tuple(Element(one.place, *read_kind(one, COUPLINGS, names)) for one in top.tables("coupling")),
        tuple(read_event(one, names) for one in top.tables("event")),
        run,
        _output(output, names, run, called),
        _ground(top, folder),
        tuple(read_controller(one, names) for one in top.tables("controller")),
        tuple(read_states(one, names) for one in top.tables("states")),
        touches,
    )


def _ground(top: TomlSection, folder: Path) -> tuple[ShapeEntry, ...]:
    if not top.has("ground"):
        return ()
    section = top.table("ground")
    section.allow(("shape",))
    return read_shapes(section, folder)


def _body(section: TomlSection, folder: Path) -> RigidEntry | ShapedEntry | RecordEntry | PointEntry:
    shapes = read_shapes(section, folder)
    if section.has("record"):
        section.allow(("name", "record", "shape", "voltages", *_POSE_KEYS))
        path, voltages = folder / section.text("record"), {}
        if section.has("voltages"):
            inner = section.table("voltages")
            voltages = {name: v.time_function_of(inner, inner.need(name), name) for name in inner.values}
        return RecordEntry(section.text("name"), section.place, path, shapes, _drawn(section), voltages)
    if section.has("density"):
        section.allow(("name", "shape", "density", *_POSE_KEYS))
        if not shapes:
            section.fail("", "has no 'shape', which a body by its density needs")
        return ShapedEntry(section.text("name"), section.place, shapes, section.number("density"), _drawn(section))
    if section.has("point") and section.flag("point"):
        section.allow(("name", "point", "mass", "shape", *_POSE_KEYS))
        return PointEntry(section.text("name"), section.place, section.number("mass"), shapes, _drawn(section))
    section.allow(("name", "mass", "inertia", "com", "shape", "density", "record", "as_measured", "point", *_POSE_KEYS))
    name, mass = section.text("name"), section.number("mass")
    inertia = section.need("inertia")
    whole = isinstance(inertia, list) and bool(inertia) and isinstance(inertia[0], list)
    return RigidEntry(
        name,
        section.place,
        mass,
        section.matrix("inertia", size=3) if whole else section.numbers("inertia", count=3),
        section.numbers("com", count=3) if section.has("com") else (0.0, 0.0, 0.0),
        shapes,
        section.has("as_measured") and section.flag("as_measured"),
        _drawn(section),
    )


def _drawn(section: TomlSection) -> DrawnPose:
    return DrawnPose(
        section.numbers("p", count=3) if section.has("p") else None,
        section.matrix("R", size=3) if section.has("R") else None,
    )


def _joint(section: TomlSection, names: Names) -> JointEntry:
    kind, arguments = read_kind(section, JOINTS, names, also=_JOINT_KEYS)
    for key in ("parent", "child"):
        if section.has("at") and section.has(key) and section.need(key) not in (GROUND, *names.bodies):
            section.fail(key, "must be the name of a body, or \"ground\", where 'at' places the joint in the drawing")
    return JointEntry(
        section.text("name"),
        section.place,
        kind,
        arguments,
        v.frame(section, "parent", names) if section.has("parent") else v.frame(_from_ground(section), "parent", names),
        v.frame(section, "child", names),
        _coordinates(section, "position"),
        _coordinates(section, "velocity"),
        v.time_function(section, "motion", names) if section.has("motion") else None,
        section.numbers("at", count=3) if section.has("at") else None,
    )


def _from_ground(section: TomlSection) -> TomlSection:
    return TomlSection({**section.values, "parent": GROUND}, section.place, section.file, section.kind)


def _coordinates(section: TomlSection, key: str) -> tuple[float, ...] | None:
    if not section.has(key):
        return None
    if isinstance(section.need(key), list):
        return section.numbers(key)
    return (section.number(key),)


def _run(section: TomlSection) -> RunEntry:
    section.allow(("t_end", "rtol", "h", "integrator", "max_step", "max_steps", "max_seconds"))
    integrator = section.text("integrator") if section.has("integrator") else None
    if integrator is not None and integrator not in INTEGRATORS:
        section.fail("integrator", f"{integrator!r} is not known; {nearest(integrator, INTEGRATORS)}")
    t_end, h = section.number("t_end"), section.number("h") if section.has("h") else None
    max_steps = section.whole("max_steps") if section.has("max_steps") else _MOST_STEPS
    if h is not None and h > 0.0 and t_end / h > max_steps:
        section.fail("h", f"would take {t_end / h:.3g} steps; max_steps = {max_steps} are the most")
    return RunEntry(
        t_end,
        section.number("rtol") if section.has("rtol") else 1e-6,
        h,
        integrator,
        section.number("max_step") if section.has("max_step") else None,
        max_steps,
        section.number("max_seconds") if section.has("max_seconds") else None,
    )


def _output(section: TomlSection, names: Names, run: RunEntry, touches: tuple[str, ...]) -> OutputEntry:
    things = ("joints", *FRAME_SERIES, "modal", "reactions", "contacts", "ports", "energies")
    section.allow(("every", *things, "formats", "film"))
    every = section.number("every") if section.has("every") else None
    if every is not None and every <= 0.0:
        section.fail("every", f"must be above 0 s, got {every:g}")
    if every is not None and run.t_end / every > _MOST_ROWS:
        section.fail("every", f"would make {run.t_end / every:.3g} rows; {_MOST_ROWS:.0e} are the most")
    reactions = v.joints(section, "reactions", names) if section.has("reactions") else ()
    if reactions and every is not None:
        section.fail("reactions", "are known at the ends of the steps alone; leave out 'every'")
    contacts = section.texts("contacts") if section.has("contacts") else ()
    for one in contacts:
        if one not in touches:
            section.fail("contacts", f"there is no [[touch]] named {one!r}; {nearest(one, touches)}")
    formats = section.texts("formats") if section.has("formats") else ("csv",)
    for one in formats:
        if one not in _FORMATS:
            section.fail("formats", f"{one!r} is not known; {nearest(one, _FORMATS)}")
    film = section.text("film") if section.has("film") else None
    if film is not None and (Path(film).suffix not in _FILMS or Path(film).name != film):
        section.fail("film", f"must be a file name that ends in {' or '.join(_FILMS)}, got {film!r}")
    return OutputEntry(
        every,
        v.joints(section, "joints", names) if section.has("joints") else None,
        {series: v.frames(section, series, names) for series in FRAME_SERIES if section.has(series)},
        v.flexibles(section, "modal", names) if section.has("modal") else (),
        reactions,
        section.flag("energies") if section.has("energies") else True,
        formats,
        film,
        contacts,
        v.ports(section, "ports", names) if section.has("ports") else (),
    )
