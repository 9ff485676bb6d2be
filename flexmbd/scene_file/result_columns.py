"""What a scene file asks of a trajectory, as a table: planned before the machine runs, so that no run is in vain."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import SceneError
from flexmbd.files.result_table import ResultTable
from flexmbd.multibody.bodies.body import FlexibleBody, Frame
from flexmbd.multibody.joint.connection import Connection
from flexmbd.rotation import to_quaternion
from flexmbd.run.trajectory import Trajectory
from flexmbd.scene_file.scene_builder import Built
from flexmbd.scene_file.scene_description import OutputEntry

FloatArray = NDArray[np.float64]
#: Of a trajectory, at given times or at the ends of its steps.
ColumnValues = Callable[[Trajectory, FloatArray | None], FloatArray]

_XYZ = ("x", "y", "z")
_ENERGIES = ("kinetic", "elastic", "gravitational", "spring", "total")


def _quaternions(run: Trajectory, frame: Frame, t: FloatArray | None) -> FloatArray:
    return np.array([to_quaternion(R) for R in run.rotation(frame, t=t)])


@dataclass(frozen=True)
class _Series:
    """What a key of [output] asks of frames."""

    endings: tuple[str, ...]
    unit: str
    values: Callable[[Trajectory, Frame, FloatArray | None], FloatArray]


_SERIES = {
    "positions": _Series(_XYZ, "m", lambda run, frame, t: run.position(frame, t=t)),
    "velocities": _Series(("vx", "vy", "vz"), "m/s", lambda run, frame, t: run.velocity(frame, t=t)),
    "accelerations": _Series(("ax", "ay", "az"), "m/s^2", lambda run, frame, t: run.acceleration(frame, t=t)),
    "rotations": _Series(("q0", "q1", "q2", "q3"), "1", _quaternions),
    "angular_velocities": _Series(("wx", "wy", "wz"), "rad/s", lambda run, frame, t: run.angular_velocity(frame, t=t)),
}


@dataclass(frozen=True)
class ResultColumns:
    """Columns that come together.

    Attributes:
        names, units: of each.
        values: gives (nt, k) or, of one column, (nt,).
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    values: ColumnValues


def plan_columns(built: Built, output: OutputEntry) -> tuple[ResultColumns, ...]:
    """The columns that ``output`` asks for.

    Raises:
        SceneError, InterfaceError: a joint held by constraints alone is asked for its coordinates, a body has no such
            interface, or two columns have one name.
    """
    columns = (
        *_of_joints(built, output),
        *_of_frames(built, output),
        *_of_modes(built, output),
        *_of_reactions(built, output),
        *([_of_energies()] if output.energies else []),
    )
    names = ["t", *(name for part in columns for name in part.names)]
    for name in names:
        if names.count(name) > 1:
            raise SceneError(f"two columns would be called {name!r}; give a frame a name of its own")
    return columns


def tabulate(run: Trajectory, columns: tuple[ResultColumns, ...], *, every: float | None) -> ResultTable:
    """The table of a trajectory, at the ends of its steps or each ``every`` s."""
    t = run.t if every is None else _times(run, every)
    at = None if every is None else t
    parts = [np.asarray(one.values(run, at)).reshape(len(t), len(one.names)) for one in columns]
    names = ("t", *(name for one in columns for name in one.names))
    units = ("s", *(unit for one in columns for unit in one.units))
    return ResultTable(names, units, np.hstack([t[:, None], *parts]))


def _times(run: Trajectory, every: float) -> FloatArray:
    """Equal steps from the start, and the end."""
    begin, end = float(run.t[0]), float(run.t[-1])
    t = begin + every * np.arange(math.floor((end - begin) / every * (1 + 1e-12)) + 1)
    t[-1] = min(t[-1], end)
    return t if end - t[-1] <= 1e-9 * every else np.append(t, end)


def _of_joints(built: Built, output: OutputEntry) -> Iterator[ResultColumns]:
    """Coordinates and their rates."""
    slots = built.system.compile().scene.index.joints
    if output.joints is None:
        joints = [one for one in built.joints.values() if one in slots]
    else:
        joints = [built.joints[one.name] for one in output.joints]
    for joint in joints:
        if joint not in slots:
            raise SceneError(
                f"joint {joint.name!r} closes a loop and has no coordinates to tell; ask for frames' positions instead"
            )
        yield from _of_joint(joint)


def _of_joint(connection: Connection) -> Iterator[ResultColumns]:
    joint = connection.joint
    rates = [name.replace(" ", "_") for name in joint.velocity_names]
    turns = ["rad" if angular else "m" for angular in joint.angular]
    if len(joint.start) == len(rates):
        names, units, rates = rates, turns, [f"{name}_rate" for name in rates]
    else:  # a quaternion, after the displacements of a free joint
        places = len(joint.start) - 4
        names, units = [*_XYZ[:places], "q0", "q1", "q2", "q3"], ["m"] * places + ["1"] * 4
    if names:
        yield _named(connection.name, names, units, lambda run, t: run.beta(connection, t=t))
        per_second = [f"{unit}/s" for unit in turns]
        yield _named(connection.name, rates, per_second, lambda run, t: run.beta_rate(connection, t=t))


def _of_frames(built: Built, output: OutputEntry) -> Iterator[ResultColumns]:
    for key, places in output.frames.items():
        series = _SERIES[key]
        for place in places:
            yield _of_frame(place.label, built.frame(place), series)


def _of_frame(label: str, frame: Frame, series: _Series) -> ResultColumns:
    units = [series.unit] * len(series.endings)
    return _named(label, series.endings, units, lambda run, t: series.values(run, frame, t))


def _of_modes(built: Built, output: OutputEntry) -> Iterator[ResultColumns]:
    for name in output.modal:
        body = built.bodies[name.name]
        if isinstance(body, FlexibleBody):
            yield _of_body(body)


def _of_body(body: FlexibleBody) -> ResultColumns:
    endings = [f"q{i + 1}" for i in range(body.record.n_modes)]
    return _named(body.name, endings, ["kg^(1/2) m"] * len(endings), lambda run, t: run.q(body, t=t))


def _of_reactions(built: Built, output: OutputEntry) -> Iterator[ResultColumns]:
    for name in output.reactions:
        yield _of_reaction(built.joints[name.name])


def _of_reaction(joint: Connection) -> ResultColumns:
    endings = ("fx", "fy", "fz", "mx", "my", "mz")
    units = ["N"] * 3 + ["N m"] * 3
    return _named(f"{joint.name}.reaction", endings, units, lambda run, _: run.reaction(joint))


def _of_energies() -> ResultColumns:
    def values(run: Trajectory, t: FloatArray | None) -> FloatArray:
        energy = run.energy(t=t)
        return np.column_stack([getattr(energy, name) for name in _ENERGIES])

    return _named("energy", _ENERGIES, ["J"] * len(_ENERGIES), values)


def _named(owner: str, endings: tuple[str, ...] | list[str], units: list[str], values: ColumnValues) -> ResultColumns:
    return ResultColumns(tuple(f"{owner}.{ending}" for ending in endings), tuple(units), values)
