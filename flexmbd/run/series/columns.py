"""Columns of a table of results: their names, units and values, from a trajectory."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmbd.errors import SceneError
from flexmbd.given import refuse_other, shown
from flexmbd.multibody.bodies.body import Body, FlexibleBody, Frame
from flexmbd.multibody.bodies.port import Port
from flexmbd.multibody.exact_beam import ExactBeam
from flexmbd.multibody.force.protocol import Force, WithStates
from flexmbd.multibody.force.states import States
from flexmbd.multibody.joint.connection import Connection
from flexmbd.multibody.plan.compiled_scene import CompiledScene
from flexmbd.multibody.results.energy import Energy
from flexmbd.multibody.results.port_series import PortSeries
from flexmbd.rotation import to_quaternion

FloatArray = NDArray[np.float64]

_XYZ = ("x", "y", "z")
_RESULTANTS = ("ft", "fy", "fz", "mt", "my", "mz")  # of a section: along and about its tangent, y and z
_ENERGIES = ("kinetic", "elastic", "gravitational", "spring", "total")


class Answers(Protocol):
    """The questions that a trajectory answers for tables."""

    @property
    def t(self) -> FloatArray:
        """(nt,) s."""

    @property
    def scene(self) -> CompiledScene:
        """The machine."""

    @property
    def bodies(self) -> Mapping[str, Body]:
        """By name."""

    def port(self, port: Port, *, t: ArrayLike | None = None) -> PortSeries:
        """Effort and flow over time."""

    def position(self, frame: Frame, *, t: ArrayLike | None = None) -> FloatArray:
        """(nt, 3) m."""

    def rotation(self, frame: Frame, *, t: ArrayLike | None = None) -> FloatArray:
        """(nt, 3, 3)."""

    def velocity(self, frame: Frame, *, t: ArrayLike | None = None) -> FloatArray:
        """(nt, 3) m/s."""

    def angular_velocity(self, frame: Frame, *, t: ArrayLike | None = None) -> FloatArray:
        """(nt, 3) rad/s."""

    def acceleration(self, frame: Frame, *, t: ArrayLike | None = None) -> FloatArray:
        """(nt, 3) m/s^2."""

    def beta(self, connection: Connection, *, t: ArrayLike | None = None) -> FloatArray:
        """Joint coordinates."""

    def beta_rate(self, connection: Connection, *, t: ArrayLike | None = None) -> FloatArray:
        """Joint velocities."""

    def body_motion(self, *, t: ArrayLike | None = None) -> FloatArray:
        """(nt, links, 21) of the axes of all bodies."""

    def q(self, body: Body, *, t: ArrayLike | None = None) -> FloatArray:
        """Modal coordinates."""

    def energy(self, *, t: ArrayLike | None = None) -> Energy:
        """Energies."""

    def reaction(self, connection: Connection) -> FloatArray:
        """(nt, 6) N, N m."""

    def resultants(self, beam: ExactBeam, *, t: ArrayLike | None = None) -> FloatArray:
        """(nt, elements, 6) N, N m."""

    def states(self, states: States | WithStates, *, t: ArrayLike | None = None) -> FloatArray:
        """(nt, n) values of state equations."""

    def remembered(self, force: Force, *, t: ArrayLike | None = None) -> dict[str, FloatArray]:
        """The memory of a force element, by name."""

    def contacts(self, touching: Any, *, t: ArrayLike | None = None) -> tuple[Any, ...]:
        """The series of contacts."""


@dataclass(frozen=True)
class ResultColumns:
    """Columns that come together.

    Attributes:
        names, units: of each.
        values: of a trajectory, at given times or at the ends of its steps: (nt, k) or, of one column, (nt,).
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    values: Callable[[Answers, FloatArray | None], FloatArray]


@dataclass(frozen=True)
class FrameSeries:
    """The series of a frame."""

    endings: tuple[str, ...]
    unit: str
    values: Callable[[Answers, Frame, FloatArray | None], FloatArray]


def _quaternions(run: Answers, frame: Frame, t: FloatArray | None) -> FloatArray:
    return to_quaternion(run.rotation(frame, t=t))


FRAME_SERIES = {
    "positions": FrameSeries(_XYZ, "m", lambda run, frame, t: run.position(frame, t=t)),
    "rotations": FrameSeries(("e0", "e1", "e2", "e3"), "1", _quaternions),
    "velocities": FrameSeries(("vx", "vy", "vz"), "m/s", lambda run, frame, t: run.velocity(frame, t=t)),
    "angular_velocities": FrameSeries(
        ("wx", "wy", "wz"), "rad/s", lambda run, frame, t: run.angular_velocity(frame, t=t)
    ),
    "accelerations": FrameSeries(("ax", "ay", "az"), "m/s^2", lambda run, frame, t: run.acceleration(frame, t=t)),
}


def table_columns(
    run: Answers,
    things: Sequence[Connection | Frame | Body | ExactBeam | States | WithStates],
    reactions: Sequence[Connection],
    *,
    energies: bool | None,
) -> tuple[ResultColumns, ...]:
    """The columns of ``Trajectory.table``.

    Raises:
        SceneError: a thing of another machine, or two columns of one name.
    """
    bodies = tuple(run.bodies.values())
    index = run.scene.index
    things_given = bool(things)
    if not things:
        things = tuple(joint for joint in index.joints if joint.joint.velocity_names)
        placed = [body for body in bodies if body in index.bodies]
        energies = energies is not False
    else:
        placed = []
    known = {id(body) for body in bodies}
    columns: list[ResultColumns] = []
    for thing in things:
        if isinstance(thing, ExactBeam):
            columns += beam_columns(run.scene, thing)
        elif isinstance(thing, (States, WithStates)):
            columns.append(state_columns(thing, run.scene))
        else:
            columns += columns_of(thing, known)
    if placed:
        columns = _apart(columns, [*bodies_columns(run.scene, placed)])
    for joint in reactions:
        refuse_other(joint, Connection, "reactions", wanted="joints, as connect() gives them")
    columns += [reaction_columns(joint) for joint in reactions]
    if not things_given:
        columns += [state_columns(one, run.scene) for one in index.states if isinstance(one, (States, WithStates))]
    columns += [energy_columns()] if energies else []
    refuse_equal_names(columns)
    return tuple(columns)


def columns_of(thing: Connection | Frame | Body, bodies: Collection[int]) -> Iterator[ResultColumns]:
    """All that a joint, a frame or one of a trajectory's bodies (by their ids) tells.

    Of a joint coordinates and rates; of a frame position, quaternion, velocity, angular velocity and acceleration; of
    a body that of its own frame and, of a flexible one, the modal coordinates.

    Raises:
        SceneError: it is something else, or a body with history, which has no frame of its own.
    """
    if isinstance(thing, Connection):
        yield from joint_columns(thing)
    elif isinstance(thing, Frame):
        yield from (frame_columns(thing.label, thing, series) for series in FRAME_SERIES.values())
    elif id(thing) in bodies:
        own = Frame(thing, np.zeros(3), np.eye(3), None, thing.name)
        yield from (frame_columns(thing.name, own, series) for series in FRAME_SERIES.values())
        if isinstance(thing, FlexibleBody):
            yield modal_columns(thing)
    else:
        raise SceneError(
            f"a table is of this machine's joints, frames, bodies of one frame, beams and states, not of {shown(thing)}"
        )


def state_columns(states: States | WithStates, scene: CompiledScene) -> ResultColumns:
    """Values of state equations, or of a force's states, each in its own unit, which only the user knows.

    Raises:
        SceneError: they are not in the scene.
    """
    names = tuple(scene.velocity_names[scene.index.state_places(states).v])
    return ResultColumns(names, tuple("own unit" for _ in names), lambda run, t: run.states(states, t=t))


def bodies_columns(scene: CompiledScene, bodies: Sequence[Body]) -> Iterator[ResultColumns]:
    """As ``columns_of`` each of these bodies, in one pass over the machine."""
    rows = [scene.index.bodies[body] for body in bodies]
    endings = [ending for series in FRAME_SERIES.values() for ending in series.endings]
    units = [series.unit for series in FRAME_SERIES.values() for _ in series.endings]

    def values(run: Answers, t: FloatArray | None) -> FloatArray:
        motion = run.body_motion(t=t)[:, rows]
        turned = to_quaternion(motion[..., 3:12].reshape(*motion.shape[:2], 3, 3))
        parts = (motion[..., :3], turned, motion[..., 12:15], motion[..., 15:18], motion[..., 18:21])
        return np.concatenate(parts, axis=2).reshape(len(motion), len(names))

    names = tuple(f"{body.name}.{ending}" for body in bodies for ending in endings)
    yield ResultColumns(names, tuple(units * len(bodies)), values)
    yield from (modal_columns(body) for body in bodies if isinstance(body, FlexibleBody))


def beam_columns(scene: CompiledScene, beam: ExactBeam) -> Iterator[ResultColumns]:
    """The motion of a beam's sections, and of each element, "name.element 1", what ``Trajectory.resultants`` gives.

    Raises:
        SceneError: the beam is of another scene.
    """
    if beam.parts[0] not in scene.index.bodies:
        raise SceneError(f"beam {beam.name!r} is not in this trajectory's scene")
    yield from bodies_columns(scene, beam.parts)
    count = len(beam.elements)
    endings = [f"element {k + 1}.{ending}" for k in range(count) for ending in _RESULTANTS]
    units = (["N"] * 3 + ["N m"] * 3) * count
    yield _named(beam.name, endings, units, lambda run, t: run.resultants(beam, t=t))


def _apart(joints: Sequence[ResultColumns], bodies: Sequence[ResultColumns]) -> list[ResultColumns]:
    """Columns of joints and of bodies; those of a joint that bears a body's name say that they are a joint's."""
    taken = {name for part in bodies for name in part.names}
    renamed = [
        replace(part, names=tuple(f"joint {name}" for name in part.names)) if taken.intersection(part.names) else part
        for part in joints
    ]
    return [*renamed, *bodies]


def joint_columns(connection: Connection) -> Iterator[ResultColumns]:
    """Coordinates of a joint and their rates; nothing of one that has none."""
    joint = connection.joint
    rates = [name.replace(" ", "_") for name in joint.velocity_names]
    turns = ["rad" if angular else "m" for angular in joint.angular]
    if len(joint.start) == len(rates):
        names, units, rates = rates, turns, [f"{name}_rate" for name in rates]
    else:  # a quaternion, after the displacements of a free joint
        places = len(joint.start) - 4
        names, units = [*_XYZ[:places], "e0", "e1", "e2", "e3"], ["m"] * places + ["1"] * 4
    if names:
        yield _named(connection.name, names, units, lambda run, t: run.beta(connection, t=t))
        per_second = [f"{unit}/s" for unit in turns]
        yield _named(connection.name, rates, per_second, lambda run, t: run.beta_rate(connection, t=t))


def frame_columns(label: str, frame: Frame, series: FrameSeries) -> ResultColumns:
    """One of ``FRAME_SERIES`` of a frame."""
    units = [series.unit] * len(series.endings)
    return _named(label, series.endings, units, lambda run, t: series.values(run, frame, t))


def modal_columns(body: FlexibleBody) -> ResultColumns:
    """Modal coordinates."""
    endings = [f"q{i + 1}" for i in range(body.record.n_modes)]
    return _named(body.name, endings, ["kg^(1/2) m"] * len(endings), lambda run, t: run.q(body, t=t))


def port_columns(port: Port) -> ResultColumns:
    """Effort and flow of a port, as the voltage and the charge of an electrode."""

    def values(run: Answers, t: FloatArray | None) -> FloatArray:
        found = run.port(port, t=t)
        return np.column_stack([found.effort, found.flow])

    ports = port.body.record.ports
    names = tuple(f"{port.label}.{ending}" for ending in (port.effort_name, port.flow_name))
    return ResultColumns(names, (ports.effort_units[port.number], ports.flow_units[port.number]), values)


def reaction_columns(joint: Connection) -> ResultColumns:
    """The reaction of a joint, as ``Trajectory.reaction``, at the ends of steps alone."""

    def values(run: Answers, t: FloatArray | None) -> FloatArray:
        if t is not None:
            raise SceneError(f"reactions of joint {joint.name!r} are told at the ends of steps; leave out the times")
        return run.reaction(joint)

    endings = ("fx", "fy", "fz", "mx", "my", "mz")
    return _named(f"{joint.name}.reaction", endings, ["N"] * 3 + ["N m"] * 3, values)


def memory_columns(label: str, force: Force, names: Sequence[str], units: Sequence[str]) -> ResultColumns:
    """The memory of a force element under these names."""

    def values(run: Answers, t: FloatArray | None) -> FloatArray:
        found = run.remembered(force, t=t)
        return np.column_stack([found[name] for name in names])

    return _named(label, names, units, values)


def energy_columns() -> ResultColumns:
    """The machine's energies."""

    def values(run: Answers, t: FloatArray | None) -> FloatArray:
        energy = run.energy(t=t)
        return np.column_stack([getattr(energy, name) for name in _ENERGIES])

    return _named("energy", _ENERGIES, ["J"] * len(_ENERGIES), values)


def refuse_equal_names(columns: Iterable[ResultColumns]) -> None:
    """Raise SceneError where two columns have one name."""
    names = Counter(["t", *(name for part in columns for name in part.names)])
    for name, times in names.items():
        if times > 1:
            raise SceneError(f"two columns would be called {name!r}; give a frame a name of its own")


def _named(
    owner: str,
    endings: Sequence[str],
    units: Sequence[str],
    values: Callable[[Answers, FloatArray | None], FloatArray],
) -> ResultColumns:
    return ResultColumns(tuple(f"{owner}.{ending}" for ending in endings), tuple(units), values)
