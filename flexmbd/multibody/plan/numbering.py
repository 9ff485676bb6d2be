"""Numbering what the plan holds: bodies of the tree, their joints, frames and modes, parameters, functions of time."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from math import isfinite
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmbd.errors import SceneError
from flexmbd.multibody.bodies.body import Body, Frame, RigidBody
from flexmbd.multibody.bodies.point_mass import PointMass, is_point
from flexmbd.multibody.functions.callback import Callbacks, Law, StateFunction
from flexmbd.multibody.functions.compiled_function import Compiled
from flexmbd.multibody.functions.time_function import TimeRow
from flexmbd.multibody.joint.free import Free
from flexmbd.multibody.joint.joint_layout import AlikeJoints, JointLayout
from flexmbd.multibody.joint.kinematic_pair import REVOLUTE, KinematicPair
from flexmbd.multibody.joint.protocol import Joint
from flexmbd.multibody.joint.translation_joint import Translation
from flexmbd.multibody.kernels.base import kinds
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.physics.modal_moments import modal_moments
from flexmbd.multibody.kernels.reading.tree import mode_places
from flexmbd.multibody.scene_index import SceneIndex, Slots
from flexmbd.multibody.topology import Branch
from flexmbd.record.reduced_body import ReducedBody

FloatArray = NDArray[np.float64]

#: Deformations below this share of the machine's extent are resolved no more finely than it.
_MODAL_SHARE = 1e-3


class Marker(NamedTuple):
    """Where a row of ``Plan.frames`` comes from.

    Attributes:
        frame: the marker.
        turn: (3, 3) by which its axes are turned, so that a joint's own axes lie in them.
    """

    frame: Frame
    turn: FloatArray


def free_joint(body: Body) -> Joint:
    """The joint of a body that nothing carries: a point mass does not turn."""
    return Translation() if is_point(body) else Free()


def rigid_row(body: Body) -> list[float]:
    """(N_RIGID,) mass, first and second moments of a body about its frame (kg, kg m, kg m^2).

    Raises:
        SceneError: they are no finite numbers.
    """
    first, second = body.moments()
    nine = second.ravel()
    row = [*map(float, (body.mass, *first, *(nine[k] for k in _UPPER)))]
    if not all(map(isfinite, row)):
        raise SceneError(
            f"body {body.name!r}: its mass times the square of its centre's distance from the body frame is no number "
            "any more; are its units right?"
        )
    return row


def alike_rows(bodies: Iterable[Body]) -> list[list[float]]:
    """The ``rigid_row`` of each body, found once for those of the same numbers.

    Raises:
        SceneError: as ``rigid_row``.
    """
    known: dict[object, list[float]] = {}
    found = []
    for body in bodies:
        try:
            numbers = _numbers_of(body)
            row = None if numbers is None else known.get(numbers)
        except TypeError:  # an array or a list among them
            numbers, row = None, None
        if row is None:
            row = rigid_row(body)
            if numbers is not None:
                known[numbers] = row
        found.append(row)
    return found


def _numbers_of(body: Body) -> object:
    """What the row of a body without modes follows from, None of others; types count, for not all are numbers."""
    if type(body) is PointMass:
        return type(body.mass), body.mass
    if type(body) is RigidBody and isinstance(body.inertia, tuple):
        com, inertia = tuple(body.com), tuple(body.inertia)
        return type(body.mass), body.mass, com, inertia, body.as_measured, *map(type, com + inertia)
    return None


def rigid_rows(mass: ArrayLike, first: FloatArray, second: FloatArray) -> FloatArray:
    """(..., N_RIGID) of masses (...,), first (..., 3) and second moments (..., 3, 3)."""
    rows = np.empty((*np.shape(mass), at.N_RIGID))
    rows[..., at.MASS] = mass
    rows[..., at.FIRST_MOMENT : at.SECOND_MOMENT] = first
    rows[..., at.SECOND_MOMENT :] = second.reshape(*second.shape[:-2], 9)[..., _UPPER]
    return rows


_UPPER = [0, 1, 2, 4, 5, 8]  # xx xy xz yy yz zz among nine
_MASSLESS = [0.0] * at.N_RIGID
_NO_PLACE = np.zeros(3)
UNTURNED = np.eye(3)
_ANGLES = (kinds.GROUP_ANGLE, 1.0, 1.0)


def modal_sizes(extent: float, record: ReducedBody) -> tuple[float, float]:
    """Full size and floor of a body's modal coordinates (m kg^(1/2)) in a machine of this extent (m)."""
    full = extent * float(np.sqrt(record.mass))
    return full, _MODAL_SHARE * full


class Numbering:
    """Numbers frames, bodies, joints, modes and functions of time: growing lists of the plan's arrays."""

    def __init__(self, ground: Body, extent: float, callbacks: Callbacks, joints: AlikeJoints | None = None) -> None:
        self.extent = extent
        self.index = SceneIndex()
        self.index.bodies[ground] = -1
        self.tree: list[list[int]] = []
        self.rigid: list[list[float]] = []
        self.start: list[float] = []
        self.names: list[str] = []
        self.groups: list[tuple[int, float, float]] = []  # kind, full size, floor
        self._lengths = (kinds.GROUP_LENGTH, extent, extent)
        self.group_of: list[int] = []
        self.frames: list[FloatArray] = []  # places; likewise axes, and what turns these
        self._axes: list[FloatArray] = []
        self._turns: list[FloatArray] = []
        self.frame_of: list[tuple[int, int, int]] = []
        self.markers: list[Marker | None] = []  # of each frame; None of what no marker gives
        self.modal: list[FloatArray] = []
        self.modal_size = 0
        self.flex: list[list[int]] = []
        self.times: list[TimeRow] = []
        self.time_names: list[str] = []
        self.breaks: list[NDArray[np.float64]] = []
        self.callbacks = callbacks
        self.data: list[FloatArray] = [np.zeros(1)]  # the zero at 0 is what those without parameters point to
        self.data_size = 1
        self.pairs: dict[KinematicPair, int] = {}
        self._remembers = False
        self._joints = joints or AlikeJoints()

    def add_branch(self, branch: Branch, mass: list[float]) -> None:
        """Append a body with its inboard joint; steps but the last lead to massless links.

        ``mass`` (N_RIGID,) is the body's ``rigid_row``.
        """
        connection, body = branch.connection, branch.outer.body
        layout = self._joints.of(free_joint(body) if connection is None else connection.joint)
        label = f"{body.name} (flying)" if connection is None else connection.name
        slots = self.add_joint(layout, label)
        turn, steps = layout.way(reverse=branch.reversed)
        first, inner_row = len(self.tree), self.index.bodies[branch.inner.body]
        f = self.add_frame(branch.inner, inner_row, turn)
        for step in steps:
            row, pair = len(self.tree), step.pair
            if step.begin is None:
                g = self.add_frame(branch.outer, row, step.end)
            else:
                g = self.add_body_frame(row, _NO_PLACE, step.end)
            ends = (inner_row, pair.turning, f, g, slots.x.start + step.x, slots.v.start + step.v)
            sizes = (len(pair.columns), len(pair.angular))
            self.tree.append([*ends, -1, -1, -1, self.add_pair(pair), kinds.ROTATING, *sizes])
            self.rigid.append(_MASSLESS)
            inner_row = row
            if step.begin is not None:
                f = self.add_body_frame(row, _NO_PLACE, step.begin)
        self.index.bodies[body] = inner_row
        if connection is not None:
            self.index.joints[connection] = slots
            rows = range(first, len(self.tree))
            self.index.links[connection] = tuple(rows[::-1] if branch.reversed else rows)
        self.rigid[-1] = mass
        record = body.reduced()
        if record is not None:
            self.tree[-1][at.FLEX : at.MODAL_V + 1] = self.add_modes(record, body)

    def add_joint(self, layout: JointLayout, label: str) -> Slots:
        """Number a joint's coordinates; one error-norm group of lengths, one of angles."""
        x, v, names = len(self.start), len(self.names), layout.velocity_names
        slots = Slots(slice(x, x + len(layout.start)), slice(v, v + len(names)))
        self.start.extend(layout.start)
        self.names.extend([f"{label}.{part}" for part in names])
        first, (are_angles, group_of) = len(self.groups), layout.groups
        self.groups.extend([_ANGLES if angular else self._lengths for angular in are_angles])
        self.group_of.extend([first + k for k in group_of])
        return slots

    def add_modes(self, record: ReducedBody, body: Body) -> list[int]:
        """Number the modal coordinates; return the body's flex row, x and v offsets."""
        n = record.n_modes
        x, v = len(self.start), len(self.names)
        self.index.modes[body] = Slots(slice(x, x + n), slice(v, v + n))
        self.start.extend([0.0] * n)
        self.names.extend(f"{body.name}.q[{k}]" for k in range(n))
        self.groups.append((kinds.GROUP_MODAL, *modal_sizes(self.extent, record)))
        self.group_of.extend([len(self.groups) - 1] * n)
        return [self.add_flex(record), x, v]

    def add_states(self, names: Sequence[str]) -> slice:
        """Append a link for each state: a unit of inertia without mass, on a hinge of its own.  Their places in v.

        Its velocity is the state over its scale, its acceleration what the state equations give.  It counts neither in
        energies nor in momenta (``CompiledScene.bodies_alone``).

        Raises:
            SceneError: elements remember already, which lies behind all coordinates.
        """
        if self._remembers:
            raise SceneError(
                f"states {', '.join(names)} are coordinates, which come before what force elements remember: add your "
                "force with states to the scene before those"
            )
        first = len(self.names)
        for name in names:
            row = len(self.tree)
            f, g = (self.add_body_frame(owner, np.zeros(3), np.eye(3)) for owner in (-1, row))
            ends = [-1, REVOLUTE.turning, f, g, len(self.start), len(self.names)]
            self.tree.append([*ends, -1, -1, -1, self.add_pair(REVOLUTE), kinds.ROTATING, 1, 1])
            unit = np.zeros(at.N_RIGID)
            unit[[at.SECOND_MOMENT, at.SECOND_MOMENT + 3]] = 0.5  # xx and yy, of which the inertia about z is the sum
            self.rigid.append(unit.tolist())
            self.start.append(0.0)
            self.names.append(name)
            self.groups.append((kinds.GROUP_STATE, 1.0, 1.0))
            self.group_of.append(len(self.groups) - 1)
        return slice(first, len(self.names))

    def add_law(self, law: Law, what: str) -> int:
        """Address of a Python law on a coordinate."""
        return self.callbacks.of_law(law, what)

    def add_compiled(self, function: Compiled) -> int:
        """Address of a compiled law or force, which enters the scene's digest."""
        self.callbacks.codes.append(function.code)
        return function.address

    def add_state_function(self, function: StateFunction, what: str) -> int:
        """Address of a Python force of the whole state."""
        return self.callbacks.of_state(function, what)

    def add_data(self, values: FloatArray) -> int:
        """Append parameters of joints, rows or elements; return their offset."""
        offset = self.data_size
        self.data.append(np.asarray(values, dtype=np.float64).ravel())  # numpy has integers above 64 bits as objects
        self.data_size += values.size
        return offset

    def add_memory(self, values: Mapping[str, float]) -> int:
        """Append what an element remembers to the configuration, behind all coordinates; return its place.

        Until a start writes it, it is of the end of time: whatever comes first is led straight to where it is.
        """
        self._remembers = True
        place = len(self.start)
        head = [0.0] * at.N_MEMORY_HEAD
        head[at.MEMORY_TIME] = float(np.finfo(float).max)
        self.start.extend([*head, *values.values()])
        return place

    def add_side(self) -> int:
        """Append the side of a switch to the configuration, behind all coordinates; return its place."""
        self._remembers = True
        self.start.append(1.0)
        return len(self.start) - 1

    def add_pair(self, pair: KinematicPair) -> int:
        """Offset of a pair's columns among the parameters; joints alike share them."""
        if pair not in self.pairs:
            self.pairs[pair] = self.add_data(pair.numbers) if pair.columns else 0
        return self.pairs[pair]

    def add_modal(self, values: FloatArray) -> int:
        """Append numbers to the modal store; return their offset."""
        offset = self.modal_size
        self.modal.append(np.ravel(values))
        self.modal_size += values.size
        return offset

    def add_frame(self, frame: Frame, row: int, turn: FloatArray) -> int:
        """Append a frame, its axes turned by ``turn``; return its row."""
        modes = (-1, -1) if frame.modes is None else mode_places(self.add_modal(frame.modes), frame.modes)
        self.frames.append(frame.p_BF_B)
        self._axes.append(frame.R_BF)
        self._turns.append(turn)
        self.frame_of.append((row, *modes))
        self.markers.append(Marker(frame, turn))
        return len(self.frames) - 1

    def add_body_frame(self, row: int, p: FloatArray, R: FloatArray, modes: tuple[int, int] = (-1, -1)) -> int:
        """Append a frame of the body in ``row``, its modes at two `mode_places`; return its row."""
        self.frames.append(p)
        self._axes.append(R)
        self._turns.append(UNTURNED)
        self.frame_of.append((row, *modes))
        self.markers.append(None)
        return len(self.frames) - 1

    def frame_rows(self) -> FloatArray:
        """(frames, N_FRAME) the places and turned axes of all frames."""
        rows = np.empty((len(self.frames), at.N_FRAME))
        if len(rows):
            axes, turns = (np.concatenate(several).reshape(-1, 3, 3) for several in (self._axes, self._turns))
            rows[:, at.FRAME_P : at.FRAME_R] = np.concatenate(self.frames).reshape(-1, 3)
            rows[:, at.FRAME_R :] = (axes @ turns).reshape(-1, 9)
        return rows

    def add_flex(self, record: ReducedBody) -> int:
        """Append the mass integrals of a reduced body; return its row."""
        n = record.n_modes
        rotors, energy = record.gyroscopic, record.nonlinear
        by_rates = record.damping if rotors is None else record.damping + rotors.G
        self.flex.append(
            [
                n,
                self.add_modal(record.gram[0, 4:].reshape(n, 3).T),
                self.add_modal(modal_moments(record.gram, n)),
                self.add_modal(record.stiffness),
                self.add_modal(by_rates) if by_rates.any() else -1,
                *self.add_stretch(record),
                -1 if rotors is None else self.add_modal(np.concatenate([rotors.momentum, rotors.slope.ravel()])),
                -1 if energy is None else self.add_modal(np.concatenate([energy.cubic, energy.quartic])),
            ]
        )
        return len(self.flex) - 1

    def add_stretch(self, record: ReducedBody) -> tuple[int, int]:
        """Append the membrane strains; return their offset and number."""
        group = record.stretch
        if group is None or len(group.strain) == 0:
            return -1, 0
        row, column = np.tril_indices(record.n_modes)
        return self.add_modal(np.hstack([group.strain, group.P[:, row, column]])), len(group.strain)

    def add_time(self, row: TimeRow, name: str, *, motion: bool) -> int:
        """Append a function of time; return its row."""
        if row.call is not None:
            row = replace(row, addresses=(self.callbacks.of_time(row, name, motion=motion), 0, 0))
        self.times.append(row)
        self.time_names.append(name)
        return len(self.times) - 1
