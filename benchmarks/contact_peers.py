"""The scenes of `contact.py` in numbers, and in exudyn and MuJoCo."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Cradle:
    """Steel balls of 0.1 m, by Hertz (SI units)."""

    radius: float = 0.05
    mass: float = 4.0 / 3.0 * np.pi * 0.05**3 * 7850.0
    stiffness: float = 4.0 / 3.0 * 2.1e11 / (2.0 * (1.0 - 0.3**2)) * np.sqrt(0.025)  # N/m^1.5
    places: tuple[float, ...] = (-0.02, *(0.1 * (i + 1) + 1e-3 * i for i in range(4)))
    speeds: tuple[float, ...] = (1.0, 0.0, 0.0, 0.0, 0.0)
    end: float = 0.05


@dataclass(frozen=True)
class Rolling:
    """A billiard ball, pressed by its weight (SI units)."""

    radius: float = 0.0286
    mass: float = 0.17
    gravity: float = 9.81
    mu: float = 0.2
    speed: float = 2.0
    depth: float = 1e-6
    end: float = 0.5

    @property
    def stiffness(self) -> float:
        """Of the floor, N/m."""
        return self.mass * self.gravity / self.depth

    @property
    def height(self) -> float:
        """Of its centre, m."""
        return self.radius - self.depth

    @property
    def exact(self) -> float:
        """Where it is at the end: it rolls after 2 v / (7 mu g), and has gone 12 v^2 / (49 mu g) by then."""
        mug = self.mu * self.gravity
        rolls = 2.0 * self.speed / (7.0 * mug)
        return 12.0 * self.speed**2 / (49.0 * mug) + 5.0 / 7.0 * self.speed * (self.end - rolls)


@dataclass(frozen=True)
class Cam:
    """An eccentric disc and a roller above it, which it loses (SI units)."""

    disc: float = 0.04
    eccentricity: float = 0.005
    roller: float = 0.01
    inertia: float = 1.0  # kg m^2
    rate: float = 180.0  # rad/s
    mass: float = 0.4
    spring: float = 4e3
    press: float = 20.0  # N of the spring where the follower starts
    gravity: float = 9.81
    stiffness: float = 1e7
    end: float = 0.045

    @property
    def start(self) -> float:
        """Pressed as deep as the spring and the weight press it."""
        high = np.sqrt((self.disc + self.roller) ** 2 - self.eccentricity**2)
        return float(high - (self.press + self.mass * self.gravity) / self.stiffness)

    @property
    def start_rate(self) -> float:
        """The disc's middle goes up."""
        return self.eccentricity * self.rate

    @property
    def rest(self) -> float:
        """The spring's length without force, along the slide."""
        return self.start - self.press / self.spring


@dataclass(frozen=True)
class Geneva:
    """A flywheel whose pin indexes a wheel of four slots, which a damper holds back (SI units).

    Angles are those of the pin from the line of centres, and of the wheel.
    """

    centre: float = 0.1  # m between the axes
    pin: float = 0.004
    play: float = 2e-5  # m on each side of the pin
    inertia: float = 1.0  # kg m^2 of the flywheel
    wheel: float = 2e-4
    damping: float = 0.02  # N m s
    rate: float = 10.0  # rad/s
    stiffness: float = 1e7
    first: float = -40.0 / 180.0 * np.pi  # rad, where it begins
    end: float = 65.0 / 180.0 * np.pi / 10.0

    @property
    def crank(self) -> float:
        """m."""
        return float(self.centre * np.sin(0.25 * np.pi))

    @property
    def half(self) -> float:
        """m, half the width of a slot."""
        return self.pin + self.play

    def along(self, angle: float) -> float:
        """How far the pin is from the wheel's axis (m)."""
        c, r = self.centre, self.crank
        return float(np.sqrt(c * c + r * r - 2.0 * c * r * np.cos(angle)))

    def turned(self, angle: float, depth: float = 0.0) -> float:
        """The wheel's angle: the ideal one, and behind it by play and depth."""
        ideal = -np.arctan2(np.sin(angle), np.sqrt(2.0) - np.cos(angle)) - 0.25 * np.pi
        return float(ideal + np.arcsin((self.play + depth) / self.along(angle)))

    @property
    def start_rate(self) -> float:
        """The wheel's, rad/s."""
        h = 1e-5
        return self.rate * (self.turned(self.first + h) - self.turned(self.first - h)) / (2.0 * h)

    @property
    def start(self) -> float:
        """The wheel's angle, pressed as deep as damper and inertia press it."""
        h = 1e-4
        slopes = [self.turned(self.first + k * h) for k in (-1.0, 0.0, 1.0)]
        bend = self.rate**2 * (slopes[0] - 2.0 * slopes[1] + slopes[2]) / h**2
        torque = abs(self.damping * self.start_rate + self.wheel * bend)
        return self.turned(self.first, torque / self.along(self.first) / self.stiffness)


CRADLE, ROLLING, CAM, GENEVA = Cradle(), Rolling(), Cam(), Geneva()


def runs(name: str) -> Iterator[tuple[str, str, Callable[[float], tuple[float, np.ndarray]]]]:
    """Distribution, label and run (by the step in s) of the others."""
    for label, kind in (("generalized-alpha", "GeneralizedAlpha"), ("RK44", "RK44"), ("Verlet", "VelocityVerlet")):
        yield "exudyn", f"exudyn, {label}", partial(_in_exudyn, name, kind)
    for label, kind in (("MuJoCo, RK4", "RK4"), ("MuJoCo, implicit", "implicitfast")):
        yield "mujoco", label, partial(_in_mujoco, name, kind)


# -- exudyn ------------------------------------------------------------------------------------------------------------


def _in_exudyn(name: str, kind: str, h: float) -> tuple[float, np.ndarray]:
    """Processor time of assembling and solving, and what is compared; not numbers where it fails.

    Steps are as given: those that its contacts recommend let most of these runs fail.
    """
    import scenes_exudyn  # noqa: F401  first, for it says which build is loaded
    import exudyn as exu  # isort: skip

    system = exu.SystemContainer().AddSystem()
    scenes = {"cradle": _exudyn_cradle, "rolling": _exudyn_rolling, "cam": _exudyn_cam, "geneva": _exudyn_geneva}
    end, found = scenes[name](system)
    settings = exu.SimulationSettings()
    stepping = settings.timeIntegration
    stepping.endTime, stepping.numberOfSteps = end, max(1, round(end / h))
    stepping.verboseMode = 0
    stepping.newton.useModifiedNewton = True
    stepping.generalizedAlpha.spectralRadius = 0.8
    stepping.discontinuous.useRecommendedStepSize = False
    settings.solution.file.write = False
    settings.solution.sensors.writePeriod = end
    settings.show.statistics = False
    began = time.process_time()
    system.Assemble()
    try:
        done = system.SolveDynamic(settings, solverType=getattr(exu.DynamicSolverType, kind))
    except Exception:  # exudyn has no class of its own that all its builds share
        done = False
    seconds = time.process_time() - began
    values = found()
    return seconds, values if done else np.full(len(values), np.nan)


def _exudyn_ball(system: Any, place: tuple[float, float, float], speed: float, radius: float, mass: float) -> Any:
    import exudyn as exu
    from exudyn.rigidBodyUtilities import RigidBodyInertia

    return system.CreateRigidBody(
        inertia=RigidBodyInertia(mass=mass, inertiaTensor=0.4 * mass * radius**2 * np.eye(3)),
        referencePosition=list(place), initialVelocity=[speed, 0.0, 0.0],
        nodeType=exu.NodeType.RotationRotationVector,
    )  # fmt: skip


def _exudyn_marker(system: Any, body: Any, place: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Any:
    import exudyn.itemInterface as item

    return system.AddMarker(item.MarkerBodyRigid(bodyNumber=body, localPosition=list(place)))


def _exudyn_memory(system: Any, gap: float) -> Any:
    import exudyn.itemInterface as item

    return system.AddNode(item.NodeGenericData(initialCoordinates=[gap, 0.0, 0.0, 0.0], numberOfDataCoordinates=4))


def _exudyn_output(system: Any, body: Any, kind: str) -> np.ndarray:
    import exudyn as exu

    return np.array(system.GetObjectOutputBody(body, getattr(exu.OutputVariableType, kind)))


def _exudyn_cradle(system: Any) -> tuple[float, Callable[[], np.ndarray]]:
    import exudyn.itemInterface as item

    balls = [
        _exudyn_ball(system, (x, 0.0, 0.0), v, CRADLE.radius, CRADLE.mass)
        for x, v in zip(CRADLE.places, CRADLE.speeds, strict=True)
    ]
    markers = [_exudyn_marker(system, body) for body in balls]
    for pair in pairwise(markers):
        system.AddObject(
            item.ObjectContactSphereSphere(
                markerNumbers=list(pair), nodeNumber=_exudyn_memory(system, 1e-3), spheresRadii=[CRADLE.radius] * 2,
                contactStiffness=CRADLE.stiffness, contactStiffnessExponent=1.5,
            )
        )  # fmt: skip
    return CRADLE.end, lambda: np.array([_exudyn_output(system, body, "Velocity")[0] for body in balls])


def _exudyn_rolling(system: Any) -> tuple[float, Callable[[], np.ndarray]]:
    import exudyn as exu
    import exudyn.itemInterface as item

    body = _exudyn_ball(system, (0.0, 0.0, ROLLING.height), ROLLING.speed, ROLLING.radius, ROLLING.mass)
    system.AddLoad(
        item.Force(markerNumber=_exudyn_marker(system, body), loadVector=[0.0, 0.0, -ROLLING.mass * ROLLING.gravity])
    )
    ground = system.AddObject(item.ObjectGround())
    system.AddObject(
        item.ObjectContactSphereTriangle(
            markerNumbers=[_exudyn_marker(system, body), _exudyn_marker(system, ground)],
            nodeNumber=_exudyn_memory(system, -ROLLING.depth), sphereRadius=ROLLING.radius,
            trianglePoints=exu.Vector3DList([[-10.0, -10.0, 0.0], [10.0, -10.0, 0.0], [0.0, 10.0, 0.0]]),  # type: ignore[call-arg]
            contactStiffness=ROLLING.stiffness, dynamicFriction=ROLLING.mu, frictionProportionalZone=1e-3,
        )
    )  # fmt: skip
    return ROLLING.end, lambda: _exudyn_output(system, body, "Position")[:1]


def _exudyn_cam(system: Any) -> tuple[float, Callable[[], np.ndarray]]:
    import exudyn.itemInterface as item

    turns = system.AddNode(item.Node1D(referenceCoordinates=[0.0], initialVelocities=[CAM.rate]))
    wheel = system.AddObject(item.ObjectRotationalMass1D(physicsInertia=CAM.inertia, nodeNumber=turns))
    slides = system.AddNode(item.Node1D(referenceCoordinates=[CAM.start], initialVelocities=[CAM.start_rate]))
    upright = [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
    follower = system.AddObject(item.ObjectMass1D(physicsMass=CAM.mass, nodeNumber=slides, referenceRotation=upright))
    place = system.AddMarker(item.MarkerNodeCoordinate(nodeNumber=slides, coordinate=0))
    ground = system.AddNode(item.NodePointGround())
    held = system.AddMarker(item.MarkerNodeCoordinate(nodeNumber=ground, coordinate=0))
    system.AddObject(  # its coordinate begins at the start
        item.ObjectConnectorCoordinateSpringDamper(
            markerNumbers=[held, place], stiffness=CAM.spring, offset=CAM.rest - CAM.start
        )
    )
    system.AddLoad(item.LoadCoordinate(markerNumber=place, load=-CAM.mass * CAM.gravity))
    system.AddObject(
        item.ObjectContactSphereSphere(
            markerNumbers=[
                _exudyn_marker(system, wheel, (CAM.eccentricity, 0.0, 0.0)), _exudyn_marker(system, follower),
            ],
            nodeNumber=_exudyn_memory(system, 0.0), spheresRadii=[CAM.disc, CAM.roller],
            contactStiffness=CAM.stiffness,
        )
    )  # fmt: skip
    return CAM.end, lambda: _exudyn_output(system, follower, "Position")[1:2]


def _exudyn_geneva(system: Any) -> tuple[float, Callable[[], np.ndarray]]:
    import exudyn as exu
    import exudyn.itemInterface as item

    nodes, bodies = [], []
    for inertia, start, rate, x in (
        (GENEVA.inertia, GENEVA.first, GENEVA.rate, 0.0),
        (GENEVA.wheel, GENEVA.start, GENEVA.start_rate, GENEVA.centre),
    ):
        nodes.append(system.AddNode(item.Node1D(referenceCoordinates=[start], initialVelocities=[rate])))
        turning = item.ObjectRotationalMass1D(
            physicsInertia=inertia, nodeNumber=nodes[-1], referencePosition=[x, 0.0, 0.0]
        )
        bodies.append(system.AddObject(turning))
    ground = system.AddNode(item.NodePointGround())
    held = system.AddMarker(item.MarkerNodeCoordinate(nodeNumber=ground, coordinate=0))
    turns = system.AddMarker(item.MarkerNodeCoordinate(nodeNumber=nodes[1], coordinate=0))
    system.AddObject(item.ObjectConnectorCoordinateSpringDamper(markerNumbers=[held, turns], damping=GENEVA.damping))
    along = -np.array([1.0, 1.0, 0.0]) / np.sqrt(2.0)  # of the slot in the wheel
    aside = np.array([along[1], -along[0], 0.0])
    for side in (-1.0, 1.0):
        near, far = 0.01 * along + side * GENEVA.half * aside, 0.2 * along + side * GENEVA.half * aside
        up = np.array([0.0, 0.0, 0.05])
        corners = [near - up, far - up, near + up] if side > 0.0 else [near - up, near + up, far - up]
        system.AddObject(
            item.ObjectContactSphereTriangle(
                markerNumbers=[
                    _exudyn_marker(system, bodies[0], (GENEVA.crank, 0.0, 0.0)), _exudyn_marker(system, bodies[1]),
                ],
                nodeNumber=_exudyn_memory(system, 0.0), sphereRadius=GENEVA.pin,
                trianglePoints=exu.Vector3DList([list(corner) for corner in corners]),  # type: ignore[call-arg]
                contactStiffness=GENEVA.stiffness,
            )
        )  # fmt: skip

    def angle() -> np.ndarray:
        kind = exu.OutputVariableType.Coordinates
        return GENEVA.start + np.atleast_1d(system.GetNodeOutput(nodes[1], kind))[:1]

    return GENEVA.end, angle


# -- MuJoCo ------------------------------------------------------------------------------------------------------------


def _in_mujoco(name: str, kind: str, h: float) -> tuple[float, np.ndarray]:
    """Processor time from the model's text to the end, and what is compared."""
    import mujoco
    from mujoco import rollout

    scenes = {"cradle": _mujoco_cradle, "rolling": _mujoco_rolling, "cam": _mujoco_cam, "geneva": _mujoco_geneva}
    text, end, read = scenes[name]()
    steps = max(1, round(end / h))
    head = f'<option timestep="{end / steps}" integrator="{kind}" cone="elliptic"'
    began = time.process_time()
    model = mujoco.MjModel.from_xml_string(text.replace("<option", head))
    data = mujoco.MjData(model)
    speeds = {
        "cradle": CRADLE.speeds, "rolling": (ROLLING.speed, *[0.0] * 5), "cam": (CAM.rate, CAM.start_rate),
        "geneva": (GENEVA.rate, GENEVA.start_rate),
    }  # fmt: skip
    data.qvel[:] = speeds[name]
    state = np.zeros(mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS))
    mujoco.mj_getState(model, data, state, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    states, _ = rollout.rollout(model, data, state[None], nstep=steps)
    mujoco.mj_setState(model, data, states[0, -1], mujoco.mjtState.mjSTATE_FULLPHYSICS)
    seconds = time.process_time() - began
    return seconds, np.array(read(data))


def _spring(rate: float, damping: float = 0.0) -> str:
    """A contact whose depth swings at a rate (rad/s), damped by a share of critical damping: friction needs some."""
    return f'solref="-{rate**2:.9g} -{2.0 * damping * rate:.9g}" solimp="0.9999 0.9999 0.001"'


def _mujoco_cradle() -> tuple[str, float, Callable[[Any], Any]]:
    law = _spring(np.pi / 3.0e-4)  # a collision as long as Hertz'
    bodies = "".join(
        f'<body pos="{x} 0 0"><joint type="slide" axis="1 0 0"/>'
        f'<geom type="sphere" size="{CRADLE.radius}" mass="{CRADLE.mass}" condim="1" {law}/></body>'
        for x in CRADLE.places
    )
    return f'<mujoco><option gravity="0 0 0"/><worldbody>{bodies}</worldbody></mujoco>', CRADLE.end, lambda d: d.qvel


def _mujoco_rolling() -> tuple[str, float, Callable[[Any], Any]]:
    law = _spring(np.sqrt(ROLLING.stiffness / ROLLING.mass), 1.0)
    rough = f'condim="3" friction="{ROLLING.mu} 0 0" {law}'
    text = (
        f'<mujoco><option gravity="0 0 -{ROLLING.gravity}"/><worldbody><geom type="plane" size="5 5 1" {rough}/>'
        f'<body pos="0 0 {ROLLING.height}"><freejoint/><geom type="sphere" size="{ROLLING.radius}" '
        f'mass="{ROLLING.mass}" {rough}/></body></worldbody></mujoco>'
    )
    return text, ROLLING.end, lambda d: d.qpos[:1]


def _mujoco_cam() -> tuple[str, float, Callable[[Any], Any]]:
    law = f'condim="1" {_spring(np.sqrt(CAM.stiffness / CAM.mass))}'
    size = f'<inertial pos="0 0 0" mass="1" diaginertia="{" ".join([str(CAM.inertia)] * 3)}"/>'
    text = (
        f'<mujoco><option gravity="0 -{CAM.gravity} 0"/><worldbody><body><joint type="hinge" axis="0 0 1"/>{size}'
        f'<geom type="sphere" pos="{CAM.eccentricity} 0 0" size="{CAM.disc}" {law}/></body><body pos="0 {CAM.start} 0">'
        f'<joint type="slide" axis="0 1 0" stiffness="{CAM.spring}" springref="{CAM.rest - CAM.start}"/>'
        f'<inertial pos="0 0 0" mass="{CAM.mass}" diaginertia="1e-4 1e-4 1e-4"/>'
        f'<geom type="sphere" size="{CAM.roller}" {law}/></body></worldbody></mujoco>'
    )
    return text, CAM.end, lambda d: CAM.start + d.qpos[1:2]


def _mujoco_geneva() -> tuple[str, float, Callable[[Any], Any]]:
    law = f'condim="1" {_spring(np.sqrt(GENEVA.stiffness * GENEVA.along(0.0) ** 2 / GENEVA.wheel))}'
    along, aside = np.array([-1.0, -1.0]) / np.sqrt(2.0), np.array([1.0, -1.0]) / np.sqrt(2.0)
    middles = [0.05 * along + side * (GENEVA.half + 0.005) * aside for side in (-1.0, 1.0)]
    walls = "".join(
        f'<geom type="box" size="0.04 0.005 0.05" pos="{x} {y} 0" euler="0 0 225" contype="2" conaffinity="1" {law}/>'
        for x, y in middles
    )
    inertias = GENEVA.inertia, GENEVA.wheel
    sizes = [f'<inertial pos="0 0 0" mass="1" diaginertia="{one} {one} {one}"/>' for one in inertias]
    first, start = (np.degrees(one) for one in (GENEVA.first, GENEVA.start))
    text = (
        f'<mujoco><option gravity="0 0 0"/><worldbody><body euler="0 0 {first}"><joint type="hinge" axis="0 0 1"/>'
        f'{sizes[0]}<geom type="sphere" pos="{GENEVA.crank} 0 0" size="{GENEVA.pin}" '
        f'contype="1" conaffinity="2" {law}/></body><body pos="{GENEVA.centre} 0 0" euler="0 0 {start}">'
        f'<joint type="hinge" axis="0 0 1" damping="{GENEVA.damping}"/>{sizes[1]}{walls}</body></worldbody></mujoco>'
    )
    return text, GENEVA.end, lambda d: GENEVA.start + d.qpos[1:2]
