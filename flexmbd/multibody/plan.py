"""From a scene to flat arrays: numbering, frames, mass integrals, loop rows, functions of time."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import SceneError
from flexmbd.multibody.body import Body, Frame
from flexmbd.multibody.callback import Callbacks, Law, StateFunction
from flexmbd.multibody.connection import Connection
from flexmbd.multibody.force.protocol import Force
from flexmbd.multibody.joint.coupling import Coupling
from flexmbd.multibody.joint.free import Free
from flexmbd.multibody.joint.protocol import Joint, Step
from flexmbd.multibody.kernels import layout as at
from flexmbd.multibody.kernels.layout import Plan, Work
from flexmbd.multibody.kernels.native import lapack_addresses
from flexmbd.multibody.plan_forces import lay_forces
from flexmbd.multibody.plan_rows import lay_penalties, lay_rows
from flexmbd.multibody.probe import with_probe
from flexmbd.multibody.team import Team
from flexmbd.multibody.time_function import TimeRow, as_row
from flexmbd.multibody.topology import Branch, Topology
from flexmbd.reduced import ReducedBody
from flexmbd.rotation import z_onto

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

#: Swaps a joint's ends without changing its coordinate: turns both frames about x by pi.
_FLIP = np.diag([1.0, -1.0, -1.0])


#: Deformations below this share of the machine's extent are resolved no more finely than it.
_MODAL_SHARE = 1e-3


@dataclass(frozen=True)
class Slots:
    """Where something lies in the configuration x and the velocity v."""

    x: slice
    v: slice


@dataclass(frozen=True, eq=False)
class CompiledScene:
    """A scene as the kernels see it, and the way back from numbers to names.

    Attributes:
        plan: the flat arrays.
        topology: tree and closures.
        body_row: body id to row of ``plan.tree``; -1 for the ground.
        joint_slots: connection id to its coordinates; tree joints only.
        coordinate_rows: connection id to the row of ``plan.tree`` of each of its steps; tree joints only.
        closure_frames: connection id to rows of F and G in ``plan.frames``; joints held by constraints only.
        modal_slots: body id to its modal coordinates.
        velocity_names: (nv,) name of each velocity.
        row_names: name of each row of ``plan.rows``.
        row_owners: the joint or coupling of each row.
        start: (nx,) configuration with every joint at its own zero.
        time_rows: functions of time, row by row of ``plan.times``.
        time_names: what each is for.
        callbacks: the Python callables among them.
        element_names: name of each row of ``plan.elements``.
        extent: the machine's size (m).
        group_of, group_kind, group_full, group_floor: error-norm groups (see integrate.state.Groups).
        redundant: names of constraint rows left out as redundant.
    """

    plan: Plan
    topology: Topology
    body_row: Mapping[int, int]
    joint_slots: Mapping[int, Slots]
    coordinate_rows: Mapping[int, tuple[int, ...]]
    closure_frames: Mapping[int, tuple[int, int]]
    modal_slots: Mapping[int, Slots]
    velocity_names: tuple[str, ...]
    row_names: tuple[str, ...]
    row_owners: tuple[Connection | Coupling, ...]
    start: FloatArray
    time_rows: tuple[TimeRow, ...]
    time_names: tuple[str, ...]
    callbacks: Callbacks
    element_names: tuple[str, ...]
    extent: float
    group_of: IntArray
    group_kind: IntArray
    group_full: FloatArray
    group_floor: FloatArray
    redundant: tuple[str, ...] = ()

    @property
    def nx(self) -> int:
        """Size of the configuration."""
        return len(self.start)

    @property
    def nv(self) -> int:
        """Number of generalised velocities, prescribed ones included."""
        return len(self.velocity_names)

    def refuse_failed(self, work: Work) -> None:
        """Raise the error of a user's function that failed in an evaluation, if one did.

        Raises:
            SceneError: names the function and the time; its cause is the user's own error.
        """
        failure = self.failure(work)
        if failure is not None:
            message, error = failure
            if not isinstance(error, Exception):
                raise error
            raise SceneError(message) from error

    def failure(self, work: Work) -> tuple[str, BaseException] | None:
        """What a user's function did wrong in an evaluation, and its error; None if nothing."""
        return self.callbacks.failure(float(work.time[-1, 0]), self.element_names, self.time_names)

    def digest(self) -> str:
        """Tells compiled scenes of other numbers or other structure apart."""
        plan = self.plan
        places = {"lapack", "flag", "times", "elements"}  # addresses differ from process to process
        digest = hashlib.sha256(plan.times[:, : at.TIME_ADDRESS].tobytes())
        digest.update(plan.elements[:, : at.EL_ADDRESS].tobytes())
        for name, part in zip(plan._fields, plan, strict=True):
            if name not in places:
                digest.update(f"{name} {part.shape}".encode() + part.tobytes())
        return digest.hexdigest()

    def keep_rows(self, kept: Sequence[int]) -> CompiledScene:
        """Return the scene with only these constraint rows; the others are redundant."""
        chosen = sorted(kept)
        left = [k for k in range(len(self.row_names)) if k not in set(chosen)]
        return replace(
            self,
            plan=self.plan._replace(rows=np.ascontiguousarray(self.plan.rows[chosen])),
            row_names=tuple(self.row_names[k] for k in chosen),
            row_owners=tuple(self.row_owners[k] for k in chosen),
            redundant=tuple(self.row_names[k] for k in left),
        )


def step_turn(step: Step, reverse: bool) -> FloatArray:
    """(3, 3) rotation that lays the z axis of a step's own frames in those of its joint."""
    return z_onto(step.axis) @ (_FLIP if reverse else np.eye(3))


class _Builder:
    """Growing lists of the plan's arrays."""

    def __init__(self, ground: Body, extent: float, callbacks: Callbacks) -> None:
        self.extent = extent
        self.row_of: dict[int, int] = {id(ground): -1}
        self.tree: list[list[int]] = []
        self.rigid: list[list[float]] = []
        self.start: list[float] = []
        self.names: list[str] = []
        self.joint_slots: dict[int, Slots] = {}
        self.coordinate_rows: dict[int, tuple[int, ...]] = {}
        self.closure_frames: dict[int, tuple[int, int]] = {}
        self.modal_slots: dict[int, Slots] = {}
        self.groups: list[tuple[int, float, float]] = []  # kind, full size, floor
        self.group_of: list[int] = []
        self.frames: list[FloatArray] = []
        self.frame_of: list[tuple[int, int]] = []
        self.modal: list[FloatArray] = []
        self.modal_size = 0
        self.flex: list[list[int]] = []
        self.times: list[TimeRow] = []
        self.time_names: list[str] = []
        self.callbacks = callbacks
        self.data: list[FloatArray] = [np.zeros(1)]  # the zero at 0 is what those without parameters point to
        self.data_size = 1

    def add_branch(self, branch: Branch) -> None:
        """Append a body with its inboard joint; steps but the last lead to massless links."""
        connection, body = branch.connection, branch.outer.body
        joint: Joint = Free() if connection is None else connection.joint
        label = f"{body.name} (flying)" if connection is None else connection.name
        slots = self.add_joint(joint, label)
        order = list(range(len(joint.steps)))[:: -1 if branch.reversed else 1]
        turns = [step_turn(step, branch.reversed) for step in joint.steps]
        rows: dict[int, int] = {}
        inner_row = self.row_of[id(branch.inner.body)]
        f = self.add_frame(branch.inner, inner_row, joint.turn @ turns[order[0]])
        for k, after in zip(order, [*order[1:], None], strict=True):
            row = rows[k] = len(self.tree)
            if after is None:
                g = self.add_frame(branch.outer, row, joint.turn @ turns[k])
            else:
                g = self.lay_frame(row, np.zeros(3), turns[k])
            step = joint.steps[k]
            pitch = self.add_data(np.array([step.pitch])) if step.kind == at.SCREW else 0
            ends = [inner_row, step.kind, f, g, slots.x.start + k, slots.v.start + k]
            self.tree.append([*ends, -1, -1, -1, pitch])
            self.rigid.append([0.0] * at.N_RIGID)
            inner_row = row
            if after is not None:
                f = self.lay_frame(row, np.zeros(3), turns[after])
        self.row_of[id(body)] = inner_row
        if connection is not None:
            self.joint_slots[id(connection)] = slots
            self.coordinate_rows[id(connection)] = tuple(rows[k] for k in sorted(rows))
        first, second = body.moments()
        self.rigid[-1] = [body.mass, *first, *second[np.triu_indices(3)]]
        record = body.reduced()
        if record is not None:
            self.tree[-1][at.FLEX : at.MODAL_V + 1] = self.add_modes(record, body)

    def add_joint(self, joint: Joint, label: str) -> Slots:
        """Number the joint's coordinates; one error-norm group of lengths, one of angles."""
        slots = Slots(
            slice(len(self.start), len(self.start) + len(joint.start)),
            slice(len(self.names), len(self.names) + len(joint.velocity_names)),
        )
        self.start.extend(joint.start)
        self.names.extend(f"{label}.{part}" for part in joint.velocity_names)
        group_at: dict[bool, int] = {}
        for angular in joint.angular:
            if angular not in group_at:
                group_at[angular] = len(self.groups)
                size = 1.0 if angular else self.extent
                kind = at.GROUP_ANGLE if angular else at.GROUP_LENGTH
                self.groups.append((kind, size, size))
            self.group_of.append(group_at[angular])
        return slots

    def add_modes(self, record: ReducedBody, body: Body) -> list[int]:
        """Number the modal coordinates; return the body's flex row, x and v offsets."""
        n = record.n_modes
        x, v = len(self.start), len(self.names)
        self.modal_slots[id(body)] = Slots(slice(x, x + n), slice(v, v + n))
        self.start.extend([0.0] * n)
        self.names.extend(f"{body.name}.q[{k}]" for k in range(n))
        full = self.extent * float(np.sqrt(record.mass))
        self.groups.append((at.GROUP_MODAL, full, _MODAL_SHARE * full))
        self.group_of.extend([len(self.groups) - 1] * n)
        return [self.add_flex(record), x, v]

    def find_slots(self, connection: Connection) -> Slots | None:
        """Where a joint's coordinates lie; None if it has none in the tree."""
        return self.joint_slots.get(id(connection))

    def add_law(self, law: Law, what: str) -> int:
        """Address of a Python law on a coordinate."""
        return self.callbacks.of_law(law, what)

    def add_state_function(self, function: StateFunction, what: str) -> int:
        """Address of a Python force of the whole state."""
        return self.callbacks.of_state(function, what)

    def find_modes(self, body: Body) -> Slots | None:
        """Where a body's modal coordinates lie; None if it has none."""
        return self.modal_slots.get(id(body))

    def find_closure(self, connection: Connection) -> tuple[int, int] | None:
        """Rows of F and G of a joint held by constraints; None for others."""
        return self.closure_frames.get(id(connection))

    def find_body(self, body: Body) -> int | None:
        """The body's row, -1 for the ground; None if it is not in the scene."""
        return self.row_of.get(id(body))

    def add_data(self, values: FloatArray) -> int:
        """Append parameters of joints, rows or elements; return their offset."""
        offset = self.data_size
        self.data.append(np.ravel(values))
        self.data_size += values.size
        return offset

    def add_modal(self, values: FloatArray) -> int:
        """Append numbers to the modal store; return their offset."""
        offset = self.modal_size
        self.modal.append(np.ravel(values))
        self.modal_size += values.size
        return offset

    def add_frame(self, frame: Frame, row: int, turn: FloatArray) -> int:
        """Append a frame, its axes turned by ``turn``; return its row."""
        modes = -1 if frame.modes is None else self.add_modal(frame.modes)
        return self.lay_frame(row, frame.p_BF_B, frame.R_BF @ turn, modes)

    def lay_frame(self, row: int, p: FloatArray, R: FloatArray, modes: int = -1) -> int:
        """Append a frame of the body in ``row``; return its row."""
        self.frames.append(np.concatenate([p, R.ravel()]))
        self.frame_of.append((row, modes))
        return len(self.frames) - 1

    def add_flex(self, record: ReducedBody) -> int:
        """Append the mass integrals of a reduced body; return its row."""
        n = record.n_modes
        gram = record.gram
        pair = gram[4:, 4:].reshape(n, 3, n, 3).transpose(0, 1, 3, 2).reshape(n, 9, n)
        damped = bool(record.damping.any())
        self.flex.append(
            [
                n,
                self.add_modal(gram[0, 4:]),
                self.add_modal(gram[4:, 1:4]),
                self.add_modal(pair),
                self.add_modal(record.stiffness),
                self.add_modal(record.damping) if damped else -1,
                *self.add_stretch(record),
            ]
        )
        return len(self.flex) - 1

    def add_stretch(self, record: ReducedBody) -> tuple[int, int]:
        """Append what the modes stretch each other; return its offset and the number of its rows."""
        group = record.stretch
        if group is None or len(group.mode) == 0:
            return -1, 0
        row, column = np.tril_indices(record.n_modes)
        share = group.P / record.stiffness[group.mode][:, None, None]
        return self.add_modal(np.column_stack([group.mode, share[:, row, column]])), len(group.mode)

    def add_time(self, row: TimeRow, name: str, *, motion: bool) -> int:
        """Append a function of time; return its row."""
        if row.call is not None:
            row = replace(row, addresses=(self.callbacks.of_time(row, name, motion=motion), 0, 0))
        self.times.append(row)
        self.time_names.append(name)
        return len(self.times) - 1


def build(
    topology: Topology,
    ground: Body,
    forces: Sequence[Force],
    couplings: Sequence[Coupling],
    gravity: FloatArray,
    team: Team,
) -> CompiledScene:
    """Number the coordinates and fill the plan.

    Raises:
        SceneError: a force on a joint that has no coordinate in the tree, or a prescribed joint
            that closes a loop.
    """
    b = _Builder(ground, _extent(topology), Callbacks(team))
    for branch in topology.branches:
        b.add_branch(branch)
    rows = lay_rows(b, topology, couplings)
    driven = _driven(b, topology)
    table = lay_forces(b, ground, forces)
    lay_penalties(b, rows, table)
    driven_v = {row[at.DRIVEN_V] for row in driven}
    free = [k for k in range(len(b.names)) if k not in driven_v]
    times, time_data = _time_table(b.times)
    plan = Plan(
        tree=_int_table(b.tree, at.N_TREE),
        frames=np.array(b.frames, float).reshape(-1, at.N_FRAME),
        frame_of=_int_table(b.frame_of, at.N_FRAME_OF),
        rigid=np.array(b.rigid, float).reshape(-1, at.N_RIGID),
        flex=_int_table(b.flex, at.N_FLEX),
        modal=np.concatenate([*b.modal, np.zeros(1)]),
        rows=_int_table(rows.table, at.N_ROW),
        forces=_int_table(table.forces, at.N_FORCE),
        times=times,
        time_data=time_data,
        driven=_int_table(driven, at.N_DRIVEN),
        free=np.array(free, np.int64),
        gravity=gravity,
        lapack=lapack_addresses(),
        flag=b.callbacks.flag,
        elements=_int_table(table.elements, at.N_ELEMENT),
        penalties=_int_table(rows.penalties, at.N_ROW),
        data=np.concatenate(b.data),
    )
    scene = CompiledScene(
        plan=plan,
        topology=topology,
        body_row=b.row_of,
        joint_slots=b.joint_slots,
        coordinate_rows=b.coordinate_rows,
        closure_frames=b.closure_frames,
        modal_slots=b.modal_slots,
        velocity_names=tuple(b.names),
        row_names=tuple(rows.names),
        row_owners=tuple(rows.owners),
        start=np.array(b.start, float),
        time_rows=tuple(b.times),
        time_names=tuple(b.time_names),
        callbacks=b.callbacks,
        element_names=tuple(table.names),
        extent=b.extent,
        group_of=np.array(b.group_of, np.int64),
        group_kind=np.array([kind for kind, _, _ in b.groups], np.int64),
        group_full=np.array([full for _, full, _ in b.groups], float),
        group_floor=np.array([floor for _, _, floor in b.groups], float),
    )
    table.tell_built(scene)
    return scene


def _extent(topology: Topology) -> float:
    """The machine's size (m): the farthest reach of any frame or centre of mass in its body."""
    reach = [0.0]
    frames = [f for b in topology.branches for f in (b.inner, b.outer)]
    frames += [f for c in topology.closures for f in (c.parent, c.child)]
    reach.extend(float(np.linalg.norm(f.p_BF_B)) for f in frames)
    for branch in topology.branches:
        body = branch.outer.body
        first, second = body.moments()
        reach.append(float(np.linalg.norm(first)) / body.mass)
        reach.append(float(np.sqrt(np.trace(second) / body.mass)))
    return max(reach) or 1.0


def _driven(b: _Builder, topology: Topology) -> list[list[int]]:
    rows: list[list[int]] = []
    for branch in topology.branches:
        connection = branch.connection
        if connection is not None and connection.motion is not None:
            what = f"motion of joint {connection.name!r}"
            slots = b.joint_slots[id(connection)]
            time = b.add_time(as_row(connection.motion, what, motion=True), what, motion=True)
            rows.append([slots.v.start, slots.x.start, time])
    return rows


def _int_table(rows: Sequence[Sequence[int]], columns: int) -> IntArray:
    return np.array(rows, dtype=np.int64).reshape(-1, columns)


def _time_table(rows: Sequence[TimeRow]) -> tuple[IntArray, FloatArray]:
    """Plan.times and Plan.time_data."""
    table, data, offset = [], [], 0
    for row in rows:
        table.append([row.kind, offset, row.count, *row.addresses])
        data.append(row.data)
        offset += row.data.size
    return _int_table(table, at.N_TIME), np.concatenate([*data, np.zeros(1)])


def add_probe(scene: CompiledScene, frame: Frame) -> Plan:
    """Return the plan with one more frame, its last, for asking where ``frame`` is."""
    return with_probe(scene.plan, scene.body_row, frame)
