"""MachineAssembly: bodies, joints, forces and couplings as a user puts them together, each checked as it comes in.

Used by ``System`` alone.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeVar, cast, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmbd.errors import SceneError
from flexmbd.given import checked, numbers, refuse_no_name, refuse_other
from flexmbd.multibody.bodies.body import Body, FlexibleBody, Frame, Ground, RigidBody
from flexmbd.multibody.bodies.continuum_body import ContinuumBody
from flexmbd.multibody.bodies.pseudo_rigid_body import PseudoRigidBody
from flexmbd.multibody.contact.contact import Contact
from flexmbd.multibody.contact.contact_laws import Friction, NormalLaw
from flexmbd.multibody.contact.elastic_surface import ElasticSurface
from flexmbd.multibody.contact.hard_contact import Hard, HardContact
from flexmbd.multibody.contact.hard_group import HardGroup
from flexmbd.multibody.contact.nodes import NodalContact, Nodes, nodal_contacts
from flexmbd.multibody.contact.shapes import Sphere
from flexmbd.multibody.contact.surface_contact import Elastic, SurfaceContact, surface_contacts
from flexmbd.multibody.contact.surface_facets import SurfaceFacets
from flexmbd.multibody.contact.touch import AnyContact, Touching, contacts, shapes_of
from flexmbd.multibody.contact.touched_pairs import TouchedPairs
from flexmbd.multibody.exact_beam import ExactBeam
from flexmbd.multibody.force.port_effort import PortEffort
from flexmbd.multibody.force.protocol import Force
from flexmbd.multibody.force.states import Followed, StateEquation, States, linear_equations
from flexmbd.multibody.functions.linear_system import as_linear_system
from flexmbd.multibody.functions.signal import Signal
from flexmbd.multibody.joint.connection import Connection
from flexmbd.multibody.joint.coordinate_coupling import CoordinateCoupling
from flexmbd.multibody.joint.enforcement import Enforcement, Way
from flexmbd.multibody.joint.free import Free
from flexmbd.multibody.joint.protocol import Joint
from flexmbd.multibody.scene_index import IdentityMap
from flexmbd.multibody.start.drawing import DRAWN_BODIES, BodyPose, DrawnBody, drawn_frames, drawn_pose
from flexmbd.multibody.team import Alone, Team
from flexmbd.rotation import Axis
from flexmbd.run.controller import Controller, Measurement, linear_law

FloatArray = NDArray[np.float64]

AnyBodyT = TypeVar("AnyBodyT", RigidBody, FlexibleBody, PseudoRigidBody, ContinuumBody, ExactBeam)
AnyForceT = TypeVar("AnyForceT", bound=Force)
CouplingT = TypeVar("CouplingT", bound=CoordinateCoupling)


@dataclass(eq=False)
class MachineAssembly:
    """The parts of a machine.

    Attributes:
        gravity: (3,) m/s^2, in inertial axes.
        team: the processes that run the machine side by side.
    """

    gravity: Sequence[float] = (0.0, 0.0, 0.0)
    team: Team = field(default_factory=Alone)

    def __post_init__(self) -> None:
        self._weight()
        refuse_other(self.team, Team, "team", wanted="as flexmbd.continuum.MpiTeam(comm)")
        self.ground = Ground()
        self._bodies: list[Body] = []
        self._continua: list[ContinuumBody] = []
        self._connections: list[Connection] = []
        self._forces: list[Force] = []
        self._touched = TouchedPairs()
        self._nodal: list[NodalContact] = []
        self._couplings: list[CoordinateCoupling] = []
        self._controllers: list[Controller] = []
        # what is in this scene, and by which names: scenes of ten thousand bodies are built in proportion
        self._members: IdentityMap[object, None] = IdentityMap([(self.ground, None)])
        self._body_names: dict[str, Body | ContinuumBody | ExactBeam] = {self.ground.name: self.ground}
        self._joint_names: dict[str, Connection] = {}
        self._poses: IdentityMap[object, BodyPose] = IdentityMap([(self.ground, BodyPose(np.zeros(3), np.eye(3)))])

    def __repr__(self) -> str:
        """How many parts, and of which kind."""
        bodies = len(self._bodies) + len(self._continua)
        return (
            f"<{type(self).__name__}: {bodies} bodies, {len(self._connections)} joints, "
            f"{len(self._forces)} forces, {len(self._couplings)} couplings>"
        )

    def add(
        self, body: AnyBodyT, *, name: str | None = None, p: ArrayLike | None = None, R: ArrayLike | None = None
    ) -> AnyBodyT:
        """Put a body into the scene and return it.

        Args:
            body: a RigidBody, FlexibleBody, PseudoRigidBody, ContinuumBody or ExactBeam not yet in a scene.
            name: unique name; by default "body 1", "body 2", ...
            p: (3,) m, where the assembled drawing has the body frame, in the ground's axes, for joints that are
                connected by ``at``, and for nothing else; by default on the ground's origin, of a flexible body where
                its mesh has it.
            R: (3, 3) rotation from the body's axes to the ground's there; the default is alike.

        Raises:
            SceneError: the name is taken, or the body is already in a scene; or p or R are none.
        """
        bodies = (RigidBody, FlexibleBody, PseudoRigidBody, ContinuumBody, ExactBeam)
        wanted = "a RigidBody, FlexibleBody, PseudoRigidBody, ContinuumBody or ExactBeam"
        refuse_other(body, bodies, "a body", wanted=wanted)
        own = body.name or _free_name("body", self._body_names, number=len(self._bodies) + 1)
        chosen = own if name is None else name
        refuse_no_name(chosen, "a body's name")
        if body in self._members:
            raise SceneError(f"body {body.name!r} is already in this scene")
        if chosen in self._body_names and self._body_names[chosen].name == chosen:
            raise SceneError(f"the name {chosen!r} is taken; names of bodies must differ")
        known, body.name = body.name, chosen
        try:
            self._poses[body] = drawn_pose(body, p, R)
        except SceneError:
            body.name = known
            raise
        self._members[body], self._body_names[chosen] = None, body
        if isinstance(body, ContinuumBody):
            self._continua.append(body)
            for frame, part in zip(body.interior.frames, body.parts, strict=True):
                self.add(part, name=f"{chosen}.{frame.name}")
        elif isinstance(body, ExactBeam):
            self._add_beam(body)
        else:
            self._bodies.append(body)
            if isinstance(body, FlexibleBody) and body.record.ports is not None:
                self._forces += [PortEffort(body.port(port)) for port in body.record.ports.names]
        return body

    def _add_beam(self, beam: ExactBeam) -> None:
        for node, part in zip(beam.mesh.names, beam.parts, strict=True):
            self.add(part, name=f"{beam.name}.{node}")
        for parent, child, position in beam.neighbours():
            self.connect(Free(), parent, child, name=child.label).position = position
        for element in beam.forces():
            self.add_force(element)

    def connect(
        self,
        joint: Joint,
        parent: Frame | DrawnBody,
        child: Frame | DrawnBody,
        *,
        at: ArrayLike | None = None,
        axis: Axis | None = None,
        name: str | None = None,
        way: Way | None = None,
        enforce: Enforcement | None = None,
    ) -> Connection:
        """Join two frames, or two bodies at a place of the drawing; the joint's coordinates move child against parent.

        Args:
            joint: fm.joint.Revolute(axis="z") and the like.
            parent: a frame on a body or on the ground; with ``at`` the body itself, or the ground.
            child: a frame on another body; with ``at`` that body.
            at: (3,) m, where the assembled drawing has the joint, in the ground's axes; the frames on both bodies
                follow from where it has these (``add``), and the joint's coordinates are zero there.  A body that has
                frames of its own must have one there, to a thousandth of its size; this frame's place is then taken.
            axis: with ``at``, of a joint along or about one axis: "x", "y", "z" or a vector (3,) in the ground's axes.
                Without it the joint's own axes are those of the ground in the drawing.
            name: unique name; by default made of the joint's kind and the bodies, as "revolute crank-rod", and of the
                second of a kind between them "revolute crank-rod 2".
            way: fm.Way.COORDINATES or CONSTRAINTS; by default coordinates along the tree, in the
                order of the joints, and constraints where a joint closes a loop.
            enforce: what enforces a joint's constraints: fm.Multipliers(), fm.Penalty(...) or
                fm.AugmentedLagrangian(...); where given, the joint goes by constraints.

        Raises:
            SceneError: both frames lie on one body, a frame is of another scene, the name is
                taken, or the joint cannot go the way asked for; or, with ``at``, a body has no frame there, or the
                joint no such axis.
        """
        refuse_other(joint, Joint, "a joint", wanted="a joint as fm.joint.Revolute(\"z\")")
        if at is not None:
            parent, child = self._drawn_frames(joint, parent, child, at, axis)
        elif axis is not None:
            raise SceneError(
                f"`axis` goes with `at`, the joint's place in the drawing; between frames give it to the joint, "
                f"fm.joint.{type(joint).__name__}(axis)"
            )
        for end in (parent, child):
            refuse_other(end, Frame, "what a joint connects", wanted="a frame as body.frame(), or bodies with at=")
            self._refuse_foreign(cast(Frame, end))
        parent, child = cast(Frame, parent), cast(Frame, child)
        kind = type(joint).__name__.lower()
        own = f"{kind} {parent.body.name}-{child.body.name}"
        if own in self._joint_names:
            own = _free_name(own, self._joint_names, number=2)
        chosen = own if name is None else name
        refuse_no_name(chosen, "a joint's name")
        if parent.body is child.body:
            raise SceneError(
                f"joint {chosen!r} connects body {parent.body.name!r} to itself; a joint needs "
                "two bodies"
            )
        if chosen in self._joint_names:
            raise SceneError(f"the name {chosen!r} is taken; give the joint a name of its own")
        connection = Connection(joint, parent, child, chosen, way, enforce)
        self._members[connection], self._joint_names[chosen] = None, connection
        self._connections.append(connection)
        return connection

    def _drawn_frames(
        self, joint: Joint, parent: Frame | DrawnBody, child: Frame | DrawnBody, at: ArrayLike, axis: Axis | None
    ) -> list[Frame]:
        """The frames of a joint at a place of the drawing."""
        ends = []
        for body in (parent, child):
            if isinstance(body, Frame):
                raise SceneError(
                    f"with `at` a joint connects bodies, on which its frames follow, and {body.label} is a frame: give "
                    "the body, or leave `at` out"
                )
            refuse_other(body, DRAWN_BODIES, "what a joint connects", wanted="a body of the scene, or scene.ground")
            if body not in self._members:
                raise SceneError(f"body {body.name!r} is not in this scene; add it first")
            ends.append((body, self._poses[body]))
        what = f"{type(joint).__name__} {ends[0][0].name}-{ends[1][0].name}"
        return drawn_frames(joint, ends, at=at, axis=axis, what=what)

    def add_force(self, force: AnyForceT) -> AnyForceT:
        """Put a force element into the scene and return it.

        Raises:
            SceneError: it acts on a joint or frame of another scene, or one that cannot take it.
        """
        self._check_force(force)
        if isinstance(force, PortEffort):
            raise SceneError(
                f"{force.what}: the scene has it already, as each port has one effort; set it by "
                f"body.port({force.port.name!r}).effort = ..."
            )
        self._forces.append(force)
        return force

    @overload
    def touch(
        self, one: Touching, other: Touching, law: NormalLaw, *, friction: Friction | None = None
    ) -> tuple[Contact, ...]: ...

    @overload
    def touch(self, one: ElasticSurface, other: Sphere, law: NormalLaw) -> tuple[SurfaceContact, ...]: ...

    @overload
    def touch(
        self, one: Elastic | Touching, other: Elastic | Touching, law: Hard
    ) -> tuple[HardContact | HardGroup | SurfaceContact, ...]: ...

    @overload
    def touch(self, one: Nodes, other: Touching | SurfaceFacets, law: Hard) -> tuple[NodalContact, ...]: ...

    def touch(
        self,
        one: Elastic | Nodes | Touching,
        other: Elastic | Nodes | SurfaceFacets | Touching,
        law: NormalLaw | Hard,
        *,
        friction: Friction | None = None,
    ) -> tuple[AnyContact | NodalContact, ...]:
        """Let two shapes touch, or each shape of a group another one, or each of another group.

        Call it when the joints are there: of groups, pairs on one body and bodies that a joint joins do not touch; the
        ground touches what a joint holds on it.  A list given as both touches within itself.

        Args:
            one: a shape of ``flexmbd.contact``, or a list of them; an ElasticSurface touches shapes by its patches,
                fm.contact.Nodes(body, surface) of a body with history by its nodes (docs/bodies_with_history.md).
            other: likewise.
            law: of the normal force: fm.contact.Hertz(...) or fm.contact.PowerLaw(...); or fm.contact.Hard(...), which
                nothing enters, with friction and impacts of its own.
            friction: fm.contact.Friction(...); None: smooth.

        Returns:
            The contacts, force elements of the scene: one for each sphere or point that may touch a shape.

        Raises:
            SceneError: shapes of another scene, on one body, or a pair that is not known, or touches already; a law
                that is none.
        """
        if isinstance(one, Nodes):
            return self._touch_nodes(one, other, law, friction)
        if isinstance(other, Nodes):
            return self._touch_nodes(other, one, law, friction)
        if isinstance(other, SurfaceFacets):
            raise SceneError("contact.SurfaceFacets are touched by contact.Nodes of another body with history alone")
        held = (c for c in self._connections if not isinstance(c.joint, Free))
        pairs = [(c.parent.body, c.child.body) for c in held]
        pairs = [(a, b) for a, b in pairs if self.ground is not a and self.ground is not b]
        joined = {frozenset((id(a), id(b))) for a, b in pairs}

        def are_joined(a: Body, b: Body) -> bool:
            return frozenset((id(a), id(b))) in joined

        surfaces = surface_contacts(one, other, law, friction=friction)
        if surfaces is not None:
            for touched in surfaces:
                self._check_force(touched)
            for touched in surfaces:
                self._touched.add(*touched.touching, joined=())
            self._forces.extend(surfaces)
            return tuple(surfaces)
        first, second = shapes_of(cast(Touching, one)), shapes_of(cast(Touching, other))
        found = contacts(first, second, law, friction, are_joined=are_joined, joined=pairs)
        for contact in found:
            self._check_force(contact)
        self._touched.add(first, second, joined=pairs)
        self._forces.extend(found)
        return tuple(found)

    def _touch_nodes(self, nodes: Nodes, shapes: object, law: object, friction: object) -> tuple[NodalContact, ...]:
        """As ``touch``, of nodes of a body with history."""
        if nodes.body not in self._members:
            raise SceneError(f"{nodes.what}: the body is not in this scene; add it first")
        found = nodal_contacts(nodes, shapes, law, friction=friction, known=self._nodal)
        for contact in found:
            if not isinstance(contact.shape, SurfaceFacets):
                self._refuse_foreign(contact.shape.frame)
            elif contact.shape.body not in self._members:
                raise SceneError(f"{contact.shape.what}: the body is not in this scene; add it first")
        self._nodal.extend(found)
        return tuple(found)

    @checked("name")
    def add_controller(
        self,
        step: Callable[..., Any] | Any,
        *,
        period: float | None = None,
        measurements: Sequence[Measurement] | Mapping[str, Measurement] = (),
        inputs: Sequence[Signal],
        offset: float = 0.0,
        state: ArrayLike | None = None,
        name: str | None = None,
    ) -> Controller:
        """Let a control law set signals at equal times; between these they are held (zero-order hold).

        Steps of all integrators end on its instants, offset + k period after the start, k = 0, 1, ..., exactly.  The
        instant at which a run ends belongs to the run that goes on from there.  At instants that controllers share,
        all measure before any signal is set.

        Args:
            step: the law, step(t, y) -> u; with a ``state``, step(t, y, state) -> (u, next state).  It must not
                remember anything elsewhere: a step that is taken again, as an event makes it, asks again.  Or a
                sampled linear system of scipy.signal or python-control, which begins at rest without a ``state``.
            period: s between two samples; of a linear system by default its own.
            measurements: y, what the law gets: an array (ny,) of a list of quantities; of a mapping a dictionary of
                their values by its names, each a number or an array.  A quantity is fm.output.Position, Velocity or
                Acceleration of a joint (its coordinates: rad, m), a frame (inertial axes: m) or a flexible body (its
                modal coordinates), a signal, or a function of the machine's fm.Instant.
            inputs: u, the signals that it sets, (nu,); one alone may be a number.
            offset: s from the start of the simulation to the first sample.
            state: the law's first state, an array of any shape; it goes to checkpoints.
            name: unique; by default "controller 1", "controller 2", ...

        Raises:
            SceneError: a period that is not positive and finite, what cannot be measured, a signal that another
                controller sets, or a name that is taken.
        """
        taken = [other.name for other in self._controllers]
        chosen = name or _free_name("controller", taken, number=len(taken) + 1)
        system = as_linear_system(step, f"controller {chosen!r}")
        if system is not None:
            step, period = linear_law(system, period, f"controller {chosen!r}")
            state = np.zeros(len(system.A)) if state is None else state
        if period is None:
            raise SceneError(f"controller {chosen!r}: give the time between two samples, period= (s)")
        controller = Controller(step, period, measurements, inputs, offset=offset, state=state, name=chosen)
        for other in self._controllers:
            if other.name == chosen:
                raise SceneError(f"the name {chosen!r} is taken; give the controller a name of its own")
            for signal in controller.inputs:
                if any(signal is one for one in other.inputs):
                    raise SceneError(f"{controller.what}: {other.what} sets the signal {signal.name!r} already")
        self._controllers.append(controller)
        return controller

    @checked("name", "names")
    def add_states(
        self,
        rates: StateEquation | Any,
        *,
        scale: ArrayLike,
        initial: ArrayLike | None = None,
        measurements: Sequence[Followed] = (),
        outputs: StateEquation | None = None,
        inputs: Sequence[Signal] = (),
        name: str | None = None,
        names: Sequence[str] = (),
    ) -> States:
        """Solve first-order differential equations together with the machine: z' = f(t, z, u), y = g(t, z, u).

        All integrators take them, with their own order and control of the error; linearised machines and equilibria
        have them, checkpoints keep them.  ``run.states(states)`` tells their values.

        Args:
            rates: f(t, z, u) -> (n,) in Python, or ``flexmbd.compiled`` f(t, z, u, out), which writes into ``out`` and
                costs no Python in a step; or a continuous linear system of scipy.signal or python-control.
            scale: sizes of the states in their own units, (n,) or one for all; rtol is relative to them.
            initial: z at the start, (n,); of a linear system zeros by default.
            measurements: u (m,), a list of fm.output.Position or Velocity of a joint (its coordinates: rad, m) or a
                flexible body (its modal coordinates), signals that controllers set, numbers, tables, sines and
                compiled functions of time.  Of frames (inertial axes: m), and functions of the machine's fm.Instant,
                which is at rest in its accelerations, alone or together: these are asked in Python.
            outputs: g, alike; without it y = z.
            inputs: the signals that y sets, each the value of a JointTorque or JointForce.
            name: by default "states 1", "states 2", ...
            names: of the states, in messages and linearised machines.

        Raises:
            SceneError: an argument is not of its kind, a linear system is sampled or has no states, or a name is taken.
        """
        taken = [force.name for force in self._forces if isinstance(force, States)]
        chosen = name or _free_name("states", taken, number=len(taken) + 1)
        what = f"states {chosen!r}"
        if chosen in taken:
            raise SceneError(f"the name {chosen!r} is taken; give the states a name of their own")
        system = as_linear_system(rates, what)
        if system is not None:
            if system.period is not None or not len(system.A) or outputs is not None:
                raise SceneError(
                    f"{what}: a linear system must be continuous, have states, and come without outputs=; one that is "
                    "sampled is for add_controller"
                )
            rates, outputs = linear_equations(system)
            initial = np.zeros(len(system.A)) if initial is None else initial
            sizes = len(inputs), len(system.C)
            if sizes[0] != sizes[1]:
                raise SceneError(f"{what}: the linear system has {sizes[1]} outputs, and there are {sizes[0]} inputs")
        if initial is None:
            raise SceneError(f"{what}: give their values at the start, initial=[...]")
        return self.add_force(States(rates, initial, scale, measurements, outputs, inputs, chosen, names))

    def _check_force(self, force: Force) -> None:
        refuse_other(force, Force, "a force", wanted="a force element as fm.force.JointTorque(joint, 1.0)")
        for connection in force.connections:
            self._refuse_foreign_joint(connection)
        for frame in force.frames:
            self._refuse_foreign(frame)
        force.check()

    def _refuse_renamed(self) -> None:
        """Raise SceneError where names that were set later are no texts, or not a body's or joint's own."""
        for what, all_of in (("body", [self.ground, *self._bodies]), ("joint", self._connections)):
            names: set[str] = set()
            for one in all_of:
                refuse_no_name(one.name, f"a {what}'s name")
                if one.name in names:
                    raise SceneError(f"two {what} names are {one.name!r} since one was changed; give each its own")
                names.add(one.name)

    def _refuse_foreign_joint(self, connection: Connection) -> None:
        refuse_other(connection, Connection, "what a force acts on", wanted="a joint, as scene.connect(...) gives it")
        if connection not in self._members:
            raise SceneError(f"joint {connection.name!r} is not in this scene")

    def _refuse_foreign(self, frame: Frame) -> None:
        refuse_other(frame, Frame, "what a force acts on", wanted="a frame, as body.frame()")
        if frame.body not in self._members:
            raise SceneError(
                f"frame {frame.label} is on a body that is not in this scene; add the body first"
            )

    def couple(self, coupling: CouplingT) -> CouplingT:
        """Put a coupling of joint coordinates into the scene and return it.

        Args:
            coupling: fm.joint.Gear(j1, j2, ratio) or fm.joint.RackAndPinion(j1, j2, radius).

        Raises:
            SceneError: it couples a joint of another scene, or is there already.
        """
        wanted = "fm.joint.Gear(...) or fm.joint.RackAndPinion(...)"
        refuse_other(coupling, CoordinateCoupling, "a coupling", wanted=wanted)
        for term in coupling.terms:
            if term.connection not in self._members:
                raise SceneError(f"{coupling.name}: joint {term.connection.name!r} is not in this scene")
        if any(coupling.name == other.name for other in self._couplings):
            raise SceneError(f"{coupling.name}: is in this scene already")
        self._couplings.append(coupling)
        return coupling

    def _weight(self) -> FloatArray:
        """Gravity (3,), m/s^2, as it is now."""
        gravity = numbers(self.gravity)
        if gravity.shape != (3,) or not np.isfinite(gravity).all():
            raise SceneError(f"gravity must be three finite numbers (m/s^2), got {self.gravity!r}")
        return gravity.copy()


def _free_name(kind: str, taken: Container[str], *, number: int) -> str:
    """The first of "kind 3", "kind 4", ... from a number on that is not taken."""
    while (name := f"{kind} {number}") in taken:
        number += 1
    return name
