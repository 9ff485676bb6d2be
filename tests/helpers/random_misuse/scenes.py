"""Machines of random parts, of which some are wrong."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache, partial
from typing import Any

import numpy as np

import flexmbd as fm
from flexmbd import beams, force, joint, output
from random_misuse.dice import Dice, Thing
from random_misuse.watching import Session


class UsersFault(Exception):
    """What a user's own function raises."""


def failing(*given: Any) -> Any:
    raise UsersFault("boom")


@fm.compiled
def compiled_ramp(t):
    return 2.0 * t


@cache
def record(modes: int) -> fm.ReducedBody:
    """Of a bar in two elements, by numpy alone."""
    from flexmbd.forms import beam_exact

    section = beam_exact.Parameters.rectangle(7e10, 0.3, 2700.0, width=0.02, height=0.03, orientation=(0.0, 1.0, 0.0))
    points = {"root": (0.0, 0.0, 0.0), "tip": (1.0, 0.0, 0.0)}
    frame = beams.DiscreteFrame(points, {"bar": [("root", "tip")]}, {"bar": section}, 2)
    return beams.discrete_body(frame, interfaces=["root", "tip"], frame="root", modes=modes)


def exact_beam(dice: Dice) -> fm.ExactBeam:
    from flexmbd.forms import beam_exact

    section = beam_exact.Parameters.rectangle(
        dice.size(1e6, 1e11), dice.value(0.3), dice.size(100.0, 8000.0),
        width=dice.size(0.01, 0.1), height=dice.size(0.01, 0.1), orientation=dice.value((0.0, 1.0, 0.0)),
    )  # fmt: skip
    points = {"root": dice.value((0.0, 0.0, 0.0)), "tip": dice.value((1.0, 0.0, 0.0))}
    return fm.ExactBeam(points, {"bar": [("root", "tip")]}, {"bar": section}, dice.value(dice.whole(1, 3)))


@dataclass
class Parts:
    """What a machine has so far."""

    scene: fm.System
    frames: list[fm.Frame] = field(default_factory=list)
    bodies: list[Any] = field(default_factory=list)
    joints: list[joint.Connection] = field(default_factory=list)
    forces: list[Any] = field(default_factory=list)
    signals: list[fm.Signal] = field(default_factory=list)
    states: list[Any] = field(default_factory=list)
    controllers: list[Any] = field(default_factory=list)


def machine(session: Session, dice: Dice) -> Parts | None:
    """A machine: a tree of bodies, sometimes loops, forces, controllers; then things that are set later."""
    scene = session.do("System", lambda: fm.System(gravity=dice.vector(10.0)))
    if scene is None:
        return None
    parts = Parts(scene, [scene.ground.frame()])
    for _ in range(dice.whole(1, 5)):
        _add_body(session, dice, parts)
    for _ in range(dice.one_of([0, 0, 0, 1, 2])):
        _connect(session, dice, parts, dice.one_of(parts.frames), dice.one_of(parts.frames))
    for _ in range(dice.whole(0, 4)):
        _add_force(session, dice, parts)
    if dice.chance(0.15):
        _add_controller(session, dice, parts)
    if dice.chance(0.15):
        _add_states(session, dice, parts)
    if dice.chance(0.1) and len(parts.joints) > 1:
        kind, ratio = dice.one_of([joint.Gear, joint.RackAndPinion]), dice.number(3.0)
        first, second = dice.one_of(parts.joints), dice.one_of(parts.joints)
        session.do(f"couple {kind.__name__} {ratio!r:.60}", lambda: scene.couple(kind(first, second, ratio)))
    for _ in range(dice.one_of([0, 0, 1, 2])):
        _set_later(session, dice, parts)
    return parts


# -------------------------------------------------------------------------------------------------- bodies and joints


def _body(dice: Dice) -> Any:
    match dice.whole(0, 9):
        case 0 | 1:
            return fm.FlexibleBody(dice.value(record(dice.whole(0, 3))))
        case 2:
            sides = dice.vector(1.0) if dice.chance(0.2) else (0.1, 0.2, 0.3)
            solid = fm.Solid.box(sides, density=dice.size(10.0, 1e4))
            material = fm.StVenantKirchhoff(dice.size(1e4, 1e9), dice.value(0.3))
            return fm.PseudoRigidBody(solid, material, damping=dice.value(0.0))
        case 3:
            return exact_beam(dice)
        case _:
            inertia = dice.value(tuple(dice.size(0.1, 0.15) for _ in range(3)))
            return fm.RigidBody(dice.size(0.1, 10.0), inertia, dice.vector(0.3))


def _frames(session: Session, dice: Dice, body: Any) -> list[fm.Frame]:
    if isinstance(body, fm.FlexibleBody | fm.ExactBeam):
        names = [dice.value("root"), dice.value("tip")]
        made = [session.do(f"frame {name!r:.40}", partial(body.frame, name)) for name in names]
    else:
        made = [
            session.do(f"frame {p!r:.60}", partial(body.frame, p, R=R))
            for p, R in [((0.0, 0.0, 0.0), None), (dice.vector(0.5), dice.rotation())]
        ]
    return [frame for frame in made if frame is not None]


def _add_body(session: Session, dice: Dice, parts: Parts) -> None:
    body = session.do("body", lambda: _body(dice))
    if body is None:
        return
    names = {"name": dice.value(f"b{len(parts.bodies)}")} if dice.chance(0.5) else {}
    added = session.do(f"add {type(body).__name__} {names}", lambda: parts.scene.add(body, **names))
    if added is None and not dice.chance(0.1):  # frames of a body that is in no scene are tried as well
        return
    parts.bodies.append(body)
    own = _frames(session, dice, body)
    parent = dice.one_of(parts.frames)
    parts.frames += own
    if own and not dice.chance(0.03):
        _connect(session, dice, parts, parent, own[0])


def _joint(dice: Dice) -> Any:
    axis = dice.value(dice.one_of(["x", "y", "z", (0.0, 0.6, 0.8)]))
    kinds: list[Callable[[], Any]] = [
        lambda: joint.Revolute(axis), lambda: joint.Revolute(axis), lambda: joint.Revolute(axis),
        lambda: joint.Prismatic(axis), lambda: joint.Spherical(), lambda: joint.Free(), lambda: joint.Fixed(),
        lambda: joint.Universal(axis, dice.value("y")), lambda: joint.Cylindrical(axis), lambda: joint.Planar(axis),
        lambda: joint.Screw(dice.number(1.0), axis), lambda: joint.Distance(dice.size(0.1, 2.0)),
        lambda: joint.PointOnLine(axis), lambda: joint.PointOnPlane(axis), lambda: joint.ConstantVelocity(axis),
        lambda: joint.RollingDisc(dice.size(0.1, 1.0)),
    ]  # fmt: skip
    return dice.one_of(kinds)()


def _connect(session: Session, dice: Dice, parts: Parts, parent: Any, child: Any) -> None:
    pair = session.do("joint", lambda: dice.value(_joint(dice)))
    enforcements = [
        fm.Multipliers, lambda: fm.Penalty(dice.size(1e3, 1e8)), lambda: fm.AugmentedLagrangian(dice.size(1.0, 1e8))
    ]  # fmt: skip
    how = dice.options(
        name=lambda: dice.value(f"j{len(parts.joints)}"),
        way=lambda: dice.value(dice.one_of(list(fm.Way))) if dice.chance(0.2) else None,
    )
    if dice.chance(0.05):
        enforce = session.do("enforcement", lambda: dice.value(dice.one_of(enforcements)()))
        how["enforce"] = enforce
    made = session.do(f"connect {pair!r:.80} {how!r:.80}", lambda: parts.scene.connect(pair, parent, child, **how))
    if made is None:
        return
    parts.joints.append(made)
    n = len(made.joint.velocity_names)
    if dice.chance(0.3):
        rate = dice.value([dice.number(3.0) for _ in range(n)]) if n > 1 else dice.number(3.0)
        session.do(f"velocity = {rate!r:.60}", lambda: setattr(made, "velocity", rate))
    if dice.chance(0.2) and n == 1:
        place = dice.number(1.0)
        session.do(f"position = {place!r:.60}", lambda: setattr(made, "position", place))
    if dice.chance(0.1) and n:
        motion = _function(dice, 1.0)
        session.do(f"prescribe {motion!r:.60}", lambda: made.prescribe(motion))


# --------------------------------------------------------------------------------------------------- forces and laws


def _function(dice: Dice, most: float) -> Any:
    """A function of time."""
    choices: list[Callable[[], Any]] = [
        lambda: dice.number(most), lambda: dice.number(most), lambda: fm.Sine(dice.number(most), dice.size(0.1, 50.0)),
        lambda: fm.Table(dice.value([0.0, 0.05, 1.0]), dice.value([0.0, most, 0.0])), lambda: compiled_ramp,
        lambda: (lambda t: 1.0 - t), lambda: failing, lambda: (lambda t: float("nan")), lambda: (lambda t: "text"),
        lambda: (lambda t: np.zeros(3)), lambda: (lambda: 1.0), lambda: (lambda t: 1e300 * (1 + t)),
        lambda: Thing(),
    ]  # fmt: skip
    return dice.one_of(choices if dice.wrong else choices[:6])()


def _force(dice: Dice, parts: Parts) -> Any:
    F, G = dice.value(dice.one_of(parts.frames)), dice.value(dice.one_of(parts.frames))
    c = dice.value(dice.one_of(parts.joints)) if parts.joints else None
    at = dice.options(coordinate=lambda: dice.value(dice.whole(0, 2)))
    bend, pull = dice.value([0.01, 0.03]), dice.value([10.0, 12.0])
    kinds: list[Callable[[], Any]] = [
        lambda: force.SpringDamper(F, G, dice.size(1.0, 1e4), dice.size(0.1, 1.0), dice.value(0.1)),
        lambda: force.Bushing(F, G, dice.value((100.0,) * 6), dice.value((1.0,) * 6)),
        lambda: force.FrameForce(F, dice.vector(10.0), dice.vector(1.0), dice.value(dice.one_of(list(force.Axes)))),
        lambda: force.FrameForce(F, [_function(dice, 5.0), 0.0, 0.0]),
        lambda: force.JointSpring(c, dice.size(1.0, 1e4), dice.number(1.0), dice.value(0.1), **at),
        lambda: force.JointSpring(c, dice.value([(-1.0, -20.0), (0.0, 0.0), (1.0, 10.0)]), **at),
        lambda: force.JointDamper(c, dice.size(0.01, 10.0), **at),
        lambda: force.JointTorque(c, _function(dice, 5.0)),
        lambda: force.JointForce(c, _function(dice, 5.0)),
        lambda: force.JointStop(c, dice.number(0.1), dice.size(0.1, 1.0), dice.size(1e2, 1e6), dice.value(1.0), **at),
        lambda: force.JointFriction(c, dice.size(0.01, 1.0), dice.size(1e-4, 1e-1), **at),
        lambda: force.BearingFriction(c, dice.size(0.01, 0.5), dice.size(1e-3, 1e-1), dice.size(0.01, 0.1)),
        lambda: force.PlasticJointSpring(c, bend, pull, **at),
        lambda: force.PlasticSpring(F, G, bend, pull, dice.size(0.1, 1.0)),
        lambda: force.JointLaw(c, dice.value(lambda t, x, v: -x - v), **at),
        lambda: force.JointLaw(c, dice.one_of([failing, lambda t, x: 1.0, lambda t, x, v: float("nan")]), **at),
        lambda: force.StateForce(dice.value(lambda t, x, v: -0.1 * v)),
        lambda: force.KaneForce(lambda kinematics: []),
        lambda: force.DistributedLoad(dice.one_of(parts.bodies), dice.value("wind"), _function(dice, 1.0)),
        lambda: force.BeamElement(F, G, dice.value(100.0 * np.eye(6)), dice.value((1.0, 0.0, 0.0, 0.0, 0.0, 0.0))),
    ]  # fmt: skip
    return dice.one_of(kinds)()


def _add_force(session: Session, dice: Dice, parts: Parts) -> None:
    if not parts.bodies:
        return
    made = session.do("force", lambda: _force(dice, parts))
    if made is not None and session.do(f"add_force {type(made).__name__}", lambda: parts.scene.add_force(made)):
        parts.forces.append(made)


def _driven(session: Session, dice: Dice, parts: Parts) -> tuple[fm.Signal, Any] | None:
    """A signal that drives a joint, and what is measured of it."""
    signal = session.do("Signal", lambda: fm.Signal(dice.value("u"), dice.value(0.0)))
    single = [one for one in parts.joints if len(one.joint.velocity_names) == 1]
    if signal is None or not single:
        return None
    c = dice.one_of(single)
    kind = force.JointTorque if c.joint.angular[0] else force.JointForce
    session.do("drive", lambda: parts.scene.add_force(kind(c, signal)))
    return signal, output.Position(c)


def _add_controller(session: Session, dice: Dice, parts: Parts) -> None:
    found = _driven(session, dice, parts)
    if found is None:
        return
    signal, seen = found
    laws = [lambda t, y: -y, lambda t, y: -y, lambda t, y: 0.0, failing, lambda t, y: [1.0, 2.0], lambda t, y: "u",
            lambda t, y: float("nan"), lambda t: 1.0]  # fmt: skip
    law, period = dice.one_of(laws if dice.wrong else laws[:3]), dice.value(dice.one_of([0.01, 0.003, 0.1]))
    how = dice.options(offset=lambda: dice.value(0.001), state=lambda: dice.value([0.0]), name=lambda: dice.value("c"))
    made = session.do(
        f"add_controller period={period!r:.40} {how!r:.60}",
        lambda: parts.scene.add_controller(law, period=period, measurements=[seen], inputs=[signal], **how),
    )
    if made is not None:
        parts.controllers.append(made)


def _add_states(session: Session, dice: Dice, parts: Parts) -> None:
    found = _driven(session, dice, parts)
    if found is None:
        return
    signal, seen = found
    laws = [lambda t, z, u: u - z, lambda t, z, u: -z, failing, lambda t, z, u: np.zeros(7), lambda t, z: z,
            lambda t, z, u: float("nan") * z]  # fmt: skip
    law = dice.one_of(laws if dice.wrong else laws[:2])
    made = session.do(
        "add_states",
        lambda: parts.scene.add_states(
            law, scale=dice.value([1.0]), initial=dice.value([0.1]), measurements=[seen], inputs=[signal]
        ),
    )
    if made is not None:
        parts.states.append(made)


# -------------------------------------------------------------------------------------------------------- set later


def _set_later(session: Session, dice: Dice, parts: Parts) -> None:
    things: list[tuple[Any, str, Any]] = [(parts.scene, "gravity", (0.0, 0.0, -9.81))]
    for body in parts.bodies:
        things.append((body, "name", dice.one_of(parts.bodies).name))
        if isinstance(body, fm.RigidBody):
            things += [(body, "mass", 1.0), (body, "inertia", np.eye(3)), (body, "com", np.zeros(3))]
        if isinstance(body, fm.FlexibleBody) and isinstance(body.record, fm.ReducedBody):
            things += [(body, "q", np.zeros(body.record.n_modes)), (body, "q_rate", np.zeros(body.record.n_modes))]
    for connection in parts.joints:
        n = len(connection.joint.velocity_names)
        things += [(connection, name, np.zeros(n)) for name in ("position", "velocity")]
    owner, name, right = dice.one_of(things)
    value = dice.value(right) if dice.chance(0.5) else dice.one_of([None, -1.0, float("nan"), "text", right])
    session.do(f"{type(owner).__name__}.{name} = {value!r:.60}", lambda: setattr(owner, name, value))
