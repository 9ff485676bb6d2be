"""Columns of results that a scene file asks for: planned before the machine runs, so that no run is in vain."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import SceneError
from flexmbd.files.result_table import ResultTable
from flexmbd.force import PlasticJointSpring, PlasticSpring
from flexmbd.multibody.bodies.body import FlexibleBody
from flexmbd.multibody.contact.hard_group import HardGroup
from flexmbd.multibody.contact.touch import AnyContact
from flexmbd.multibody.results.surface_series import SurfaceSeries
from flexmbd.run.series import columns as table
from flexmbd.run.series import table_rows
from flexmbd.run.series.columns import Answers, ResultColumns
from flexmbd.run.trajectory import Trajectory
from flexmbd.scene_file.scene_builder import Built
from flexmbd.scene_file.scene_description import OutputEntry

FloatArray = NDArray[np.float64]


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
        *(table.reaction_columns(built.joints[name.name]) for name in output.reactions),
        *_of_contacts(built, output),
        *(table.port_columns(built.port(place)) for place in output.ports),
        *_of_memories(built),
        *_of_states(built),
        *([table.energy_columns()] if output.energies else []),
    )
    table.refuse_equal_names(columns)
    return columns


def tabulate(run: Trajectory, columns: tuple[ResultColumns, ...], *, every: float | None) -> ResultTable:
    """The table of a trajectory, at the ends of its steps or each ``every`` s."""
    t = None if every is None else table_rows.equal_times(float(run.t[0]), float(run.t[-1]), every)
    return table_rows.tabulate(run, columns, t=t)


def _of_states(built: Built) -> Iterator[ResultColumns]:
    """Of state equations."""
    if built.states:
        scene = built.system.compile().scene
        for states in built.states.values():
            yield table.state_columns(states, scene)


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
                f"joint {joint.name!r} closes a loop and has no coordinates; ask for frames' positions instead"
            )
        yield from table.joint_columns(joint)


def _of_frames(built: Built, output: OutputEntry) -> Iterator[ResultColumns]:
    for key, places in output.frames.items():
        series = table.FRAME_SERIES[key]
        for place in places:
            yield table.frame_columns(place.label, built.frame(place), series)


def _of_modes(built: Built, output: OutputEntry) -> Iterator[ResultColumns]:
    for name in output.modal:
        body = built.bodies[name.name]
        if isinstance(body, FlexibleBody):
            yield table.modal_columns(body)


def _of_contacts(built: Built, output: OutputEntry) -> Iterator[ResultColumns]:
    """Of the contacts of tables [[touch]]; of several each has its number."""
    for name in output.contacts:
        contacts = built.touches[name]
        for k, contact in enumerate(contacts):
            yield _contact_columns(name if len(contacts) == 1 else f"{name} {k + 1}", contact)


def _contact_columns(label: str, contact: AnyContact) -> ResultColumns:
    """Gap, normal force and the force on the sphere, or on the point.

    Raises:
        SceneError: a group of hard contacts.
    """
    if isinstance(contact, HardGroup):
        raise SceneError(f"{contact.what}: its points come and go, and fill no columns; ask run.contacts for them")

    def values(run: Answers, t: FloatArray | None) -> FloatArray:
        (found,) = run.contacts(contact, t=t)
        if isinstance(found, SurfaceSeries):  # of all patches together
            return np.column_stack([found.gap.min(axis=1), found.normal_force.sum(axis=1), found.force.sum(axis=1)])
        return np.column_stack([found.gap, found.normal_force, found.force])

    names = tuple(f"{label}.{ending}" for ending in ("gap", "normal_force", "fx", "fy", "fz"))
    return ResultColumns(names, ("m", "N", "N", "N", "N"), values)


def _of_memories(built: Built) -> Iterator[ResultColumns]:
    """What elasto-plastic springs remember."""
    memories = built.system.compile().scene.index.memories
    for place, force in built.forces.items():
        if isinstance(force, PlasticJointSpring | PlasticSpring) and force in memories:
            turns = isinstance(force, PlasticJointSpring) and force.connection.joint.angular[force.coordinate]
            units = ["J" if name == "dissipated" else "rad" if turns else "m" for name in memories[force]]
            yield table.memory_columns(place, force, list(memories[force]), units)
