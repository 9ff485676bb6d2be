"""From force elements to the rows of the plan that the kernels read."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import groupby
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmbd.errors import SceneError
from flexmbd.multibody.bodies.body import Body, Frame
from flexmbd.multibody.bodies.continuum_body import PlacedInterior
from flexmbd.multibody.bodies.point_mass import is_point, refuse_turn
from flexmbd.multibody.bodies.port import Port
from flexmbd.multibody.force.alike import AlikeElements
from flexmbd.multibody.force.protocol import BetweenFrames, Force, SwitchValue, WithStates
from flexmbd.multibody.force.shared_numbers import SharedNumbers
from flexmbd.multibody.force.spring_damper import SPRINGS, SpringDamper
from flexmbd.multibody.force.states import States
from flexmbd.multibody.functions.callback import Law, StateFunction
from flexmbd.multibody.functions.compiled_function import Compiled, Signature, checked_breaks
from flexmbd.multibody.functions.switched import Switch, Switched
from flexmbd.multibody.functions.time_function import Piecewise, TimeFunction, load_row
from flexmbd.multibody.joint.connection import Connection
from flexmbd.multibody.joint.coordinate_coupling import coordinate_place
from flexmbd.multibody.joint.kinematic_pair import REVOLUTE
from flexmbd.multibody.kane.bearing import Bearing, Bearings
from flexmbd.multibody.kane.inertia import KaneInertia, UserBody
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.elements.bushing_wrench import BUSHING
from flexmbd.multibody.kernels.elements.contact_wrench import CONTACT, ROUGH_CONTACT
from flexmbd.multibody.kernels.elements.distance_spring import DISTANCE_SPRING
from flexmbd.multibody.kernels.elements.element import ElementKind, PairsElement
from flexmbd.multibody.kernels.elements.frame_law import FRAME_LAW, STORING_FRAME_LAW
from flexmbd.multibody.kernels.elements.given_on_line import GIVEN_ON_LINE
from flexmbd.multibody.kernels.elements.given_wrench import GIVEN_IN_F, GIVEN_IN_G
from flexmbd.multibody.kernels.elements.hard_element import HARD_CONTACT
from flexmbd.multibody.kernels.elements.memory_law import ELASTOPLASTIC_LINE, MEMORY_LAW, MEMORY_LINE
from flexmbd.multibody.kernels.elements.pairs import PAIRS_LAW, STORING_PAIRS_LAW
from flexmbd.multibody.kernels.elements.penalty import PENALTY
from flexmbd.multibody.kernels.elements.table import kind_of
from flexmbd.multibody.kernels.elements.user_state_force import SOLVED_TOGETHER, STATE_FORCE
from flexmbd.multibody.motion.machine import Machine, WrenchSource
from flexmbd.multibody.plan.common_numbers import place_common_numbers
from flexmbd.multibody.plan.force_places import AlikeRows, AlikeSpans, ForceSpan
from flexmbd.multibody.plan.numbering import UNTURNED, Numbering
from flexmbd.multibody.plan.state_table import StateTable, checked_law, flat
from flexmbd.multibody.scene_index import ForceRows, IdentityMap, JoinedPlace, RunMap

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

#: What may act on a point mass; where it could turn the point the force's own ``check`` has seen to it.
_AT_POINTS = (
    DISTANCE_SPRING, GIVEN_ON_LINE, ELASTOPLASTIC_LINE, MEMORY_LINE, GIVEN_IN_F, GIVEN_IN_G, BUSHING, PENALTY,
    CONTACT, ROUGH_CONTACT, HARD_CONTACT,
)  # fmt: skip
#: Classes of which many enter the plan together; what is derived from them may do it in its own way.
_ALIKE: dict[type, AlikeElements] = {SpringDamper: SPRINGS}
_VARIED = "data, d, R, rate, spin, dd, dtheta, drate, dspin"


class ForceTable(StateTable):
    """Growing rows of ``Plan.forces`` and ``Plan.elements``, to which force elements add theirs.

    Attributes:
        forces: functions of time on coordinates: index in v, row of ``Plan.times``.
        shafts: one-dimensional inertias on coordinates: index in v, inertia.
        elements: rows of ``Plan.elements``.
        alike: of these the arrays of elements alike, each with where it begins.
        names: of each element, in messages, or the element alike to others that has one.
        wrench_sources: what acts on frames by generalised forces.
        interiors: what bodies with history act on.
        idle: names of elements that never exert anything, and have no rows: 20 springs of zero stiffness on ten links
            would make forward dynamics 6.5 times slower (benchmarks/skipping.py).
        switches: of laws that jump with the state.
    """

    def __init__(self, numbering: Numbering, ground: Body, varied: Iterable[object] = ()) -> None:
        super().__init__()
        self.forces: list[list[int]] = []
        self.shafts: list[list[float]] = []
        self.elements: list[list[int]] = []
        self.alike: list[tuple[int, IntArray]] = []
        self.names: list[str | BetweenFrames] = []
        self.wrench_sources: list[WrenchSource] = []
        self.interiors: list[PlacedInterior] = []
        self.idle: list[str] = []
        self._varied = IdentityMap((one, None) for one in varied)
        self._may_vary = False
        self._numbering = numbering
        self._ground = ground
        self._bearings: list[Bearing] = []
        self._given_bodies: list[UserBody] = []
        self._frames: IdentityMap[Frame, int] = IdentityMap()
        self._at_points: dict[int, Frame] = {}
        self._origin: int | None = None
        self.switches: list[Switch] = []
        self._waiting: list[Callable[[Machine], None]] = []
        self._asked: list[int] = []
        self._memories: list[tuple[int, tuple[str, ...]]] = []
        self._late: list[tuple[int, Force, tuple[str, ...]]] = []
        self.spans: RunMap[Force, ForceSpan] = RunMap()

    def assemble(self, force: Force) -> None:
        """Let a force element add its rows, and keep their places."""
        if isinstance(force, WithStates):
            self._prepare_links()
        first_number, first_time = self._numbering.data_size, len(self._numbering.times)
        self._asked, self._memories, self._links = [], [], []
        self._force = force
        self._may_vary = force in self._varied
        force.assemble(self)
        data, times = range(first_number, self._numbering.data_size), range(first_time, len(self._numbering.times))
        places = tuple(place for place, _ in self._memories)
        self.spans[force] = ForceSpan(data, times, tuple(self._asked), places, tuple(self._links))
        self._name_memories(force, self._memories)

    def may_vary(self, forces: Sequence[Force]) -> bool:
        """Whether other values are to be given to any of these forces."""
        return len(self._varied) > 0 and any(force in self._varied for force in forces)

    def assemble_alike(self, alike: AlikeElements, forces: Sequence[BetweenFrames]) -> AlikeRows:
        """Let elements of one class add their rows at once, to the same arrays as one after the other."""
        element, numbers = alike.element, alike.numbers(forces)
        first, time = self.numbers(numbers), len(self._numbering.times)
        ends = [frame for force in forces for frame in (force.frame_F, force.frame_G)]
        rows_of = {number: self._row_of(frame) for number, frame in {id(frame): frame for frame in ends}.items()}
        frames = np.array([rows_of[id(frame)] for frame in ends], np.int64).reshape(-1, 2)
        if element not in _AT_POINTS and not self._at_points.keys().isdisjoint(frames.ravel().tolist()):
            turned = next(k for k, row in enumerate(frames.ravel().tolist()) if row in self._at_points)
            refuse_turn(ends[turned], forces[turned // 2].what)
        acting = alike.acting(numbers)
        row, acts = len(self.elements), np.flatnonzero(acting)
        rows = np.full((len(acts), at.N_ELEMENT), -1, np.int64)
        rows[:, at.EL_KIND] = kind_of(element)
        rows[:, [at.EL_F, at.EL_G]] = frames[acts]
        rows[:, at.EL_DATA] = first + numbers.shape[1] * acts
        rows[:, at.EL_COUNT : at.EL_NUMBER] = 0
        rows[:, at.EL_NUMBER] = np.arange(row, row + len(acts))
        rows[:, at.EL_SCRATCH] = 0
        self.alike.append((row, rows))
        self.elements.extend(rows.tolist())
        self.names.extend([force for force, acts_at_all in zip(forces, acting, strict=True) if acts_at_all])
        self.idle.extend([force.what for force, acts_at_all in zip(forces, acting, strict=True) if not acts_at_all])
        self.spans.add_run(cast(Sequence[Force], forces), AlikeSpans(first, numbers.shape[1], time, frames))
        return AlikeRows(len(self.forces), row + np.concatenate([[0], np.cumsum(acting)]))

    def _name_memories(self, force: Force, memories: Iterable[tuple[int, tuple[str, ...]]]) -> None:
        """Keep where in x what a force remembers stands, by name."""
        remembered = [(first, names) for first, names in memories if names]
        if remembered:
            self._numbering.index.memories[force] = {
                name: place for first, names in remembered for name, place in memory_places(first, names).items()
            }

    def _prepare_links(self) -> None:
        """Enter what links of states share, before the numbers of the force at hand begin."""
        self._numbering.add_pair(REVOLUTE)

    def coordinate(self, connection: Connection, index: int) -> tuple[int, int]:
        """Places in x and v of a joint's coordinate."""
        slots = self._numbering.index.joints.get(connection)
        if slots is None:
            raise SceneError(
                f"joint {connection.name!r} closes a loop and has no coordinate for a force to act on; "
                "ask for Way.COORDINATES, so that another joint closes the loop"
            )
        return slots.x.start + index, slots.v.start + index

    def inertia(self, connection: Connection, index: int, value: float, what: str) -> None:
        """Add a one-dimensional inertia to a joint's coordinate."""
        _, v = self.coordinate(connection, index)
        step, _ = coordinate_place(connection.joint, index)
        if len(connection.joint.steps[step].pair.angular) > 1:
            raise SceneError(
                f"{what}: joint {connection.name!r} moves by one pair of several coordinates, which carry no inertia "
                "of their own; make it of several steps"
            )
        if self._may_vary:
            raise SceneError(f"{what}: an inertia on a coordinate cannot vary from run to run; build the scene anew")
        if not np.isfinite(value):
            raise SceneError(f"{what}: inertia times the square of the ratio is no number; are its units right?")
        self.shafts.append([v, value])

    def modes(self, body: Body) -> tuple[int, int]:
        """Places in x and v of a flexible body's first mode."""
        slots = self._numbering.index.modes.get(body)
        if slots is None:
            raise SceneError(f"body {body.name!r} has no modes in this scene")
        return slots.x.start, slots.v.start

    def frame(self, frame: Frame) -> int:
        """Row of ``Plan.frames``; a frame that several elements share has one."""
        row = self._row_of(frame)
        self._asked.append(row)
        return row

    def _row_of(self, frame: Frame) -> int:
        if frame not in self._frames:
            if is_point(frame.body):
                self._at_points[len(self._numbering.frames)] = frame
            self._frames[frame] = self._numbering.add_frame(frame, self._numbering.index.row_of(frame), UNTURNED)
        return self._frames[frame]

    def ground(self) -> int:
        """Row of ``Plan.frames`` of the inertial frame."""
        if self._origin is None:
            origin = Frame(self._ground, np.zeros(3), np.eye(3), None, "ground")
            self._origin = self._numbering.add_frame(origin, -1, UNTURNED)
        self._asked.append(self._origin)
        return self._origin

    def numbers(self, values: ArrayLike) -> int:
        """Offset in ``Plan.data`` of the values, appended."""
        return self._numbering.add_data(np.asarray(values, dtype=np.float64))

    def shared(self, numbers: SharedNumbers) -> int:
        """Offset in ``Plan.data`` of numbers that forces share."""
        place = self._numbering.index.shared.get(numbers)
        if place is None:
            raise SceneError("a contact cannot vary to a shape with another table; build the scene anew")
        return place

    def joined(self) -> JoinedPlace:
        """Where the group of the force at hand stands."""
        return self._numbering.index.joined.get(self._force, JoinedPlace())

    def time(self, function: TimeFunction, what: str, *, rate: bool = False) -> int:
        """Row of ``Plan.times``."""
        return self._numbering.add_time(load_row(function, what, rate=rate), what, motion=rate)

    def effort(self, port: Port, time: int) -> None:
        """Note in which row of ``Plan.times`` the effort of a port stands."""
        if port not in self._numbering.index.efforts:
            self._numbering.index.efforts[port] = time

    def law(self, law: Compiled | Law, what: str) -> int:
        """Address of f(t, beta, rate of beta) -> N or N m."""
        law = self._note_breaks(law, what)
        if isinstance(law, Compiled):
            return self._numbering.add_compiled(law)
        return self._numbering.add_law(law, what)

    def state_function(self, function: Compiled | StateFunction, what: str) -> int:
        """Address of a force of the whole state."""
        function = self._note_breaks(function, what)
        if isinstance(function, Compiled):
            return self._numbering.add_compiled(function)
        return self._numbering.add_state_function(function, what)

    def frame_law(
        self,
        wrench: Compiled,
        what: str,
        frame_F: Frame,
        frame_G: Frame,
        *,
        numbers: ArrayLike = (),
        derivative: Compiled | None = None,
    ) -> None:
        """Let a law of one's own act between two frames."""
        law = checked_law(self._note_breaks(wrench, what), what, Signature.WRENCH, "data, d, R, rate, spin, out")
        slope = 0
        if derivative is not None:
            varied = checked_law(derivative, what, Signature.WRENCH_VARIATION, f"{_VARIED}, out")
            slope = self._numbering.add_compiled(varied.as_it_is_now())
        values = np.asarray(numbers, dtype=np.float64).ravel()
        element = STORING_FRAME_LAW if law.returns_number else FRAME_LAW
        self.element(
            element, what, f=self.frame(frame_F), g=self.frame(frame_G), data=self.numbers([1.0, *values]),
            count=values.size, address=self._numbering.add_compiled(law), derivative=slope,
        )  # fmt: skip

    def pairs(
        self,
        law: Compiled | PairsElement,
        what: str,
        group: Sequence[Frame],
        *,
        own: ArrayLike = ((),),
        numbers: ArrayLike = (),
    ) -> None:
        """Let a law act along the lines between all pairs of a group of frames."""
        address, share = 0, 0.0
        if isinstance(law, PairsElement):
            element = law
        else:
            user = checked_law(self._note_breaks(law, what), what, Signature.PAIR, "t, data, a, b, r, rate, out")
            element = STORING_PAIRS_LAW if user.returns_number else PAIRS_LAW
            address, share = self._numbering.add_compiled(user), 1.0
        values, rows = flat(numbers), [float(self.frame(one)) for one in group]
        each = np.asarray(own, dtype=np.float64)
        head = [share, float(len(values)), float(each.shape[1])]
        data = self.numbers([*head, *values, *each.ravel(), *rows])
        self.element(element, what, data=data, count=len(rows), address=address)

    def side(self, switched: Switched, value: SwitchValue, what: str) -> int:
        """Place in x of a switch's side."""
        self._numbering.callbacks.codes.append(switched.code)
        place = self._numbering.add_side()
        self._memories.append((place, ()))
        self.switches.append(Switch(what, place, value, f"switch {what} {switched.code}"))
        return place

    def memory(self, names: Mapping[str, float]) -> int:
        """Place in x of a memory that begins with these values."""
        place = self._numbering.add_memory(names)
        self._memories.append((place, tuple(names)))
        return place

    def late_memory(self, names: Sequence[str]) -> int:
        """-1: it gets its place when all states have theirs."""
        if names and self._force is not None:
            self._late.append((len(self.elements), self._force, tuple(names)))
        return -1

    def _place_late_memories(self) -> None:
        """Give the memories of forces with states their places."""
        for row, force, names in self._late:
            place = self._numbering.add_memory(dict.fromkeys(names, 0.0))
            self.elements[row][at.EL_MEMORY] = place
            self.spans[force] = replace(self.spans[force], memories=(place,))
            self._name_memories(force, [(place, names)])

    def memory_law(
        self,
        law: Compiled,
        what: str,
        connection: Connection,
        index: int,
        *,
        memory: Mapping[str, float],
        numbers: ArrayLike = (),
        rest: float = 0.0,
    ) -> None:
        """Let a law with memory of one's own act on a joint's coordinate."""
        x, v = self.coordinate(connection, index)
        self._remember(MEMORY_LAW, law, what, memory, [rest, *flat(numbers)], x=x, v=v)

    def memory_line(
        self,
        law: Compiled,
        what: str,
        frame_F: Frame,
        frame_G: Frame,
        *,
        memory: Mapping[str, float],
        numbers: ArrayLike = (),
        length: float = 0.0,
    ) -> None:
        """Let a law with memory of one's own act along the line between two frames."""
        f, g = self.frame(frame_F), self.frame(frame_G)
        self._remember(MEMORY_LINE, law, what, memory, [length, *flat(numbers)], f=f, g=g)

    def _remember(
        self,
        element: ElementKind,
        law: Compiled,
        what: str,
        memory: Mapping[str, float],
        numbers: list[float],
        *,
        f: int = -1,
        g: int = -1,
        x: int = -1,
        v: int = -1,
    ) -> None:
        """A row of a law with memory; the first of the numbers is where the deformation is zero."""
        law = checked_law(self._note_breaks(law, what), what, Signature.MEMORY, "data, memory, begin, end, out")
        if not memory:
            raise SceneError(f"{what}: name what the law remembers, memory={{name: first value}}; else use JointLaw")
        data = self.numbers([numbers[0], len(numbers) - 1, *numbers[1:]])
        self.element(
            element, what, f=f, g=g, x=x, v=v, data=data, count=len(memory),
            address=self._numbering.add_compiled(law), memory=self.memory(memory),
        )  # fmt: skip

    def _note_breaks(self, function: Any, what: str) -> Any:
        """The function itself, its breaks declared; a compiled one with the values that it reads as they are now."""
        while isinstance(function, Piecewise):
            self._numbering.breaks.append(checked_breaks(function.breaks, what))
            function = function.function
        if isinstance(function, Compiled):
            function = function.as_it_is_now()
            self._numbering.breaks.append(function.breaks)
        return function

    def when_built(self, hook: Callable[[Machine], None]) -> None:
        """Call ``hook`` with the compiled scene once it is there."""
        self._waiting.append(hook)

    @property
    def is_awaited(self) -> bool:
        """Whether functions of the state keep the compiled scene, so that no variant can take its place."""
        return bool(self._waiting)

    def call_hooks(self, scene: Machine) -> None:
        """Call the hooks of ``when_built`` with the compiled scene."""
        for hook in self._waiting:
            hook(scene)

    def drive(self, connection: Connection, function: TimeFunction, what: str) -> None:
        """Let a function of time act on a joint's only coordinate, or on its frames where constraints hold it."""
        frames = self._numbering.index.closures.get(connection)
        if frames is None:
            _, v = self.coordinate(connection, 0)
            self.forces.append([v, self.time(function, what)])
            return
        along_z = np.zeros(6)
        along_z[5 if connection.joint.angular[0] else 2] = 1.0
        data = self.numbers(along_z)
        time = self.time(function, what)
        self.element(GIVEN_IN_F, what, f=frames[0], g=frames[1], data=data, time=time)

    def add_wrench_source(self, source: WrenchSource) -> None:
        """Add a source of wrenches on frames that the plan has as generalised forces alone, for reactions."""
        self.wrench_sources.append(source)

    def add_bearing(self, bearing: Bearing) -> None:
        """Add a joint whose friction follows its reaction; all are solved together."""
        self._bearings.append(bearing)

    def add_user_body(self, body: UserBody) -> None:
        """Add a body that the user gives in Kane's form; all are solved together."""
        self._given_bodies.append(body)

    def add_interior(self, placed: PlacedInterior) -> int:
        """Add a body with history; return the row of ``Plan.wrenches`` of its first frame, the others follow."""
        first = sum(len(other.rows) for other in self.interiors)
        self.interiors.append(placed)
        return first

    def finish(self) -> None:
        """Append the elements of friction and of users' bodies, which are solved together.

        Raises:
            SceneError: friction that follows reactions, together with forces whose effect on reactions is unknown.
        """
        self._finish_states()
        self._place_late_memories()
        if self._given_bodies:
            inertia = KaneInertia(self._given_bodies)
            self._solve_together(inertia, "; ".join(body.what for body in self._given_bodies), ())
            self.add_wrench_source(inertia)
        if self._bearings:
            of_state = kind_of(STATE_FORCE)
            unknown = [n for n, row in zip(self.names, self.elements, strict=True) if row[at.EL_KIND] == of_state]
            what = "; ".join(f"BearingFriction on joint {b.connection.name!r}" for b in self._bearings)
            if unknown:
                raise SceneError(
                    f"{what}: the effect of {unknown[0]} on the joints' reactions is unknown; give it as a FrameForce "
                    "or a JointLaw, or take JointFriction of a given size"
                )
            speeds = [(self.coordinate(b.connection, 0)[1], b.regularisation) for b in self._bearings]
            self._solve_together(Bearings(self._bearings), what, speeds)

    def _solve_together(self, function: Bearings | KaneInertia, what: str, speeds: Sequence[tuple[int, float]]) -> None:
        """``speeds``: velocities by their places, and over how much of each the forces change as they do at rest."""
        address = self._numbering.add_state_function(function, what)
        self.when_built(lambda scene: function.build(scene, address))
        self.element(SOLVED_TOGETHER, what, data=self.numbers(flat(speeds)), count=len(speeds), address=address)

    def element(
        self,
        element: ElementKind,
        what: str,
        *,
        f: int = -1,
        g: int = -1,
        x: int = -1,
        v: int = -1,
        time: int = -1,
        data: int = 0,
        count: int = 0,
        address: int = 0,
        derivative: int = 0,
        memory: int = -1,
        side: int = -1,
        scratch: int = 0,
        acts: bool = True,
    ) -> None:
        """Append a row of ``Plan.elements``, or a name to ``idle``.

        Raises:
            SceneError: it may turn a point mass, or follows its orientation.
        """
        if element not in _AT_POINTS and (f in self._at_points or g in self._at_points):
            refuse_turn(self._at_points.get(f) or self._at_points[g], what)
        if not (acts or self._may_vary):
            self.idle.append(what)
            return
        row = [kind_of(element), f, g, x, v, time, data, count, address, derivative]
        row += [len(self.elements), memory, side, scratch]
        self.elements.append(row)
        self.names.append(what)


def memory_places(first: int, names: Iterable[str]) -> dict[str, int]:
    """Where in x a memory's values stand that users may ask for, by name; it begins at ``first``."""
    values = {name: first + at.N_MEMORY_HEAD + k for k, name in enumerate(names) if not name.startswith("_")}
    return {"deformation": first + at.MEMORY_DEFORMATION, **values}


def assemble_forces(
    numbering: Numbering, ground: Body, forces: Sequence[Force], varied: Iterable[object]
) -> ForceTable:
    """Let every force element add its rows, in the order in which they were added to the scene, but states first.

    Their states, and those of forces, are coordinates, and what elements remember lies behind all of those
    (`Numbering.add_memory`).  Forces whose numbers are to vary, among ``varied``, add them whatever these are now.
    """
    table = ForceTable(numbering, ground, varied)
    place_common_numbers(numbering, forces)
    with_states = [force for force in forces if isinstance(force, (States, WithStates))]
    others = [force for force in forces if not isinstance(force, (States, WithStates))]
    for kind, run in groupby([*with_states, *others], key=type):
        several = list(run)
        alike = _ALIKE.get(kind)
        if alike is not None and not table.may_vary(several):
            rows_of = table.assemble_alike(alike, cast(list[BetweenFrames], several))
            numbering.index.forces.add_run(several, rows_of)
            continue
        for force in several:
            first, first_element = len(table.forces), len(table.elements)
            table.assemble(force)
            rows = ForceRows(range(first, len(table.forces)), range(first_element, len(table.elements)))
            numbering.index.forces[force] = rows
    table.finish()
    return table
