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


CRADLE, ROLLING, CAM = Cradle(), Rolling(), Cam()


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
    end, found = {"cradle": _exudyn_cradle, "rolling": _exudyn_rolling, "cam": _exudyn_cam}[name](system)
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


# -- MuJoCo ------------------------------------------------------------------------------------------------------------


def _in_mujoco(name: str, kind: str, h: float) -> tuple[float, np.ndarray]:
    """Processor time from the model's text to the end, and what is compared."""
    import mujoco
    from mujoco import rollout

    text, end, read = {"cradle": _mujoco_cradle, "rolling": _mujoco_rolling, "cam": _mujoco_cam}[name]()
    steps = max(1, round(end / h))
    head = f'<option timestep="{end / steps}" integrator="{kind}" cone="elliptic"'
    began = time.process_time()
    model = mujoco.MjModel.from_xml_string(text.replace("<option", head))
    data = mujoco.MjData(model)
    speeds = {"cradle": CRADLE.speeds, "rolling": (ROLLING.speed, *[0.0] * 5), "cam": (CAM.rate, CAM.start_rate)}
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
