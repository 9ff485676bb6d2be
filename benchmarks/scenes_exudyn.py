"""The scenes in exudyn, in the form that is fastest there, and its solvers.

Kinematic tree where it has one, planar bodies in plane loops, a joint on the body frame's own node where a reduced
body has one. Two things to know: the gravity of a reduced body (a load by mass) leaves out that the centre of mass
moves as the body bends, and reduced bodies know no geometric stiffening; so errors are taken against exudyn's own
converged solution. Its explicit solvers take no joints, only trees and coordinates that are held.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import reduction_case as case
import scenes
import scipy.sparse

os.environ.setdefault("EXUDYN_MODULE", "fast")  # the build without range checks
import exudyn as exu
import exudyn.itemInterface as item
from exudyn.FEM import FEMinterface, ObjectFFRFreducedOrderInterface
from exudyn.rigidBodyUtilities import HTtranslate, RigidBodyInertia, TreeLink

SOLVER = exu.DynamicSolverType
POSITION = exu.OutputVariableType.Position

#: A system that is ready to be solved, and the position of the point that is compared.
Model = tuple[Any, Callable[[], np.ndarray]]


@dataclass(frozen=True)
class Solver:
    """One of exudyn's solvers; by a fixed step, or by a tolerance if it has error control."""

    label: str
    kind: Any
    by_tolerance: bool = False
    order: int = 2
    sparse: bool = False


ALPHA = Solver("generalized-alpha", SOLVER.GeneralizedAlpha)
ALPHA_SPARSE = Solver("generalized-alpha, sparse", SOLVER.GeneralizedAlpha, sparse=True)
TRAPEZOIDAL = Solver("trapezoidal, index 2", SOLVER.TrapezoidalIndex2)
RK44 = Solver("RK44", SOLVER.RK44, order=4)
RK67 = Solver("RK67", SOLVER.RK67, order=6)
DOPRI5 = Solver("DOPRI5", SOLVER.DOPRI5, by_tolerance=True, order=5)

EXPLICIT = (RK44, RK67, DOPRI5)
SOLVERS = {
    "rigid chain": (ALPHA, *EXPLICIT),
    "heavy top": (ALPHA, *EXPLICIT),
    "four-bars": (ALPHA, ALPHA_SPARSE, TRAPEZOIDAL),
    "load with a jump": (ALPHA, TRAPEZOIDAL, *EXPLICIT),
    "load with a pulse": (ALPHA, TRAPEZOIDAL, *EXPLICIT),
    "flexible chain": (ALPHA, ALPHA_SPARSE, TRAPEZOIDAL),
    "spin-up": (ALPHA, TRAPEZOIDAL),
    "slider-crank": (ALPHA, TRAPEZOIDAL),
}


def solve(model: Model, solver: Solver, t_end: float, *, h: float, rtol: float | None = None) -> tuple[float, Any]:
    """Processor time (s) of SolveDynamic; where the point ends, None where the solver failed."""
    seconds, _, found = assemble_and_solve(model, solver, t_end, h=h, rtol=rtol)
    return seconds, found


def assemble_and_solve(
    model: Model, solver: Solver, t_end: float, *, h: float, rtol: float | None = None
) -> tuple[float, float, Any]:
    """Processor time (s) of SolveDynamic, and with Assemble; where the point ends, None where the solver failed."""
    system, position = model
    settings = exu.SimulationSettings()
    stepping = settings.timeIntegration
    stepping.endTime, stepping.numberOfSteps = t_end, max(1, round(t_end / h))
    stepping.verboseMode = 0
    stepping.newton.useModifiedNewton = True
    stepping.generalizedAlpha.spectralRadius = 0.8
    stepping.explicit.useLieGroupIntegration = True
    stepping.automaticStepSize = rtol is not None
    if rtol is not None:
        stepping.relativeTolerance = stepping.absoluteTolerance = rtol
        stepping.minimumStepSize = 1e-9
    if solver.sparse:
        settings.linearSolver.solverType = exu.LinearSolverType.EigenSparse
    settings.solution.file.write = False
    settings.solution.sensors.writePeriod = t_end
    settings.show.statistics = False
    assembled = time.process_time()
    system.Assemble()
    began = time.process_time()
    try:
        done = system.SolveDynamic(settings, solverType=solver.kind)
    except Exception:  # exudyn has no class of its own that all its builds share
        done = False
    done_at = time.process_time()
    found = np.array(position())
    return done_at - began, done_at - assembled, found if done and np.isfinite(found).all() else None


def build(scene: scenes.Scene) -> Model:
    """The scene, new, to be assembled."""
    system = exu.SystemContainer().AddSystem()
    sensor = BUILDERS[scene.kind](system, scene)
    return system, lambda: np.array(system.GetSensorValues(sensor))


def _rigid_chain(system: Any, scene: scenes.Scene) -> Any:
    links = scene.parameter
    inertia = RigidBodyInertia(
        mass=scenes.LINK_MASS, com=[0.5 * scenes.LINK, 0.0, 0.0],
        inertiaTensor=np.diag(scenes.link_inertia()), inertiaTensorAtCOM=True,
    )
    hinge = exu.JointType.RevoluteZ
    tree = [
        TreeLink(inertia, jointType=hinge, jointHT=HTtranslate([scenes.LINK if i else 0.0, 0, 0]), graphicsDataList=[])
        for i in range(links)
    ]
    body = system.CreateKinematicTree(listOfTreeLinks=tree, gravity=[0.0, -scenes.G, 0.0], baseGraphicsDataList=[])
    return system.AddSensor(
        item.SensorKinematicTree(
            objectNumber=body, linkNumber=links - 1, localPosition=[scenes.LINK, 0, 0], outputVariableType=POSITION,
            writeToFile=False,
        )
    )


def _heavy_top(system: Any, scene: scenes.Scene) -> Any:
    """About the fixed point, whose coordinates are held, so that explicit solvers can run it; rotation vectors."""
    created = system.CreateRigidBody(
        inertia=RigidBodyInertia(mass=15.0, inertiaTensor=np.diag([15.234375, 0.46875, 15.234375])),
        initialAngularVelocity=[0.0, 150.0, -4.61538],
        nodeType=exu.NodeType.RotationRotationVector,
        returnDict=True,
    )
    body = created["bodyNumber"]
    weight = system.AddMarker(item.MarkerBodyPosition(bodyNumber=body, localPosition=[0.0, 1.0, 0.0]))
    system.AddLoad(item.Force(markerNumber=weight, loadVector=[0.0, 0.0, -15.0 * scenes.G]))
    fixed = system.AddNode(item.NodePointGround())
    ground = system.AddMarker(item.MarkerNodeCoordinate(nodeNumber=fixed, coordinate=0))
    for k in range(3):
        held = system.AddMarker(item.MarkerNodeCoordinate(nodeNumber=created["nodeNumber"], coordinate=k))
        system.AddObject(item.CoordinateConstraint(markerNumbers=[ground, held]))
    return _point(system, body, [0.0, 1.0, 0.0])


def _point(system: Any, body: Any, place: list[float]) -> Any:
    return system.AddSensor(
        item.SensorBody(bodyNumber=body, localPosition=place, outputVariableType=POSITION, writeToFile=False)
    )


def _four_bars(system: Any, scene: scenes.Scene) -> Any:
    """Planar bodies, index 3."""
    ground = system.AddObject(item.ObjectGround())

    def bar(place: list[float], angle: float, speed: list[float]) -> Any:
        node = item.NodeRigidBody2D(referenceCoordinates=[*place, angle], initialVelocities=speed)
        body = system.AddObject(item.ObjectRigidBody2D(mass=1.0, inertia=1.0 / 12.0, nodeNumber=system.AddNode(node)))
        system.AddLoad(item.Force(markerNumber=marker(body, 0.0), loadVector=[0.0, -scenes.G, 0.0]))
        return body

    def marker(body: Any, along: float) -> Any:
        return system.AddMarker(item.MarkerBodyPosition(bodyNumber=body, localPosition=[along, 0.0, 0.0]))

    def hinge(first: Any, second: Any) -> None:
        system.AddObject(item.RevoluteJoint2D(markerNumbers=[first, second]))

    uprights = [bar([i, 0.5], 0.5 * np.pi, [0.5, 0.0, -1.0]) for i in range(scene.parameter + 1)]
    for i, upright in enumerate(uprights):
        hinge(marker(ground, float(i)), marker(upright, -0.5))
    for i in range(scene.parameter):
        beam = bar([i + 0.5, 1.0], 0.0, [1.0, 0.0, 0.0])
        hinge(marker(uprights[i], 0.5), marker(beam, -0.5))
        hinge(marker(beam, 0.5), marker(uprights[i + 1], 0.5))
    return _point(system, uprights[0], [0.5, 0.0, 0.0])


@cache
def _reduced(path: Path) -> tuple[ObjectFFRFreducedOrderInterface, list[int]]:
    """Its reduced body in our modes, and the corners of the end, whose mean tells how the rigid end moves."""
    with np.load(path) as file:
        x, rows, phi = file["x"], file["rows"].ravel(), file["phi"]
        mass = scipy.sparse.csr_matrix((file["values"], file["indices"], file["indptr"]))[rows][:, rows]
        stiffness = np.diag(file["stiffness"])
    mesh = FEMinterface()
    mesh.nodes = {"Position": x}
    mesh.massMatrix, mesh.stiffnessMatrix = mass, scipy.sparse.csr_matrix(mass.shape)
    mesh.modeBasis = {"matrix": phi.reshape(3 * len(x), -1), "type": "HCBmodes"}
    body = ObjectFFRFreducedOrderInterface(mesh)
    body.stiffnessMatrixReduced = stiffness
    corners = (np.abs(np.abs(x[:, 1:]) - 0.5 * case.WIDTH) < 1e-9).all(axis=1) & (np.abs(x[:, 0] - case.LENGTH) < 1e-9)
    return body, np.flatnonzero(corners).tolist()  # type: ignore[return-value]


def _beam(
    system: Any, scene: scenes.Scene, place: list[float], *, gravity: float = 0.0, turned: float = 0.0
) -> tuple[Any, Any]:
    """Markers of its start and end; the body frame's node is the start."""
    if scene.beam is None:
        raise ValueError(f"{scene.name} has no beam")
    body, nodes = _reduced(scene.beam.peer)
    added = body.AddObjectFFRFreducedOrder(
        system, positionRef=place, rotationMatrixRef=_about_z(turned), gravity=[0.0, 0.0, -gravity]
    )
    start = system.AddMarker(item.MarkerNodeRigid(nodeNumber=added["nRigidBody"]))
    return start, _mean(system, added["oFFRFreducedOrder"], nodes)


def _free_of(system: Any, first: Any, second: Any, free: int) -> None:
    """A joint of one freedom: 0, 1, 2 along and 3, 4, 5 about x, y, z."""
    axes = [int(k != free) for k in range(6)]
    system.AddObject(item.GenericJoint(markerNumbers=[first, second], constrainedAxes=axes))


def _ground(system: Any) -> Any:
    return system.AddMarker(item.MarkerBodyRigid(bodyNumber=system.AddObject(item.ObjectGround())))


def _marker_sensor(system: Any, marker: Any) -> Any:
    return system.AddSensor(item.SensorMarker(markerNumber=marker, outputVariableType=POSITION, writeToFile=False))


def _flexible_chain(system: Any, scene: scenes.Scene) -> Any:
    end = _ground(system)
    for i in range(scene.parameter):
        start, tip = _beam(system, scene, [float(i), 0.0, 0.0], gravity=scenes.G)
        _free_of(system, end, start, 4)
        end = tip
    return _marker_sensor(system, end)


def _averaged_chain(system: Any, scene: scenes.Scene) -> Any:
    """The chain with its joints on the mean of all nodes of the rigid faces, as its users write it."""
    if scene.beam is None:
        raise ValueError(f"{scene.name} has no beam")
    body, _ = _reduced(scene.beam.peer)
    along = body.xRef[::3]
    end = _ground(system)
    for i in range(scene.parameter):
        added = body.AddObjectFFRFreducedOrder(system, positionRef=[float(i), 0.0, 0.0], gravity=[0.0, 0.0, -scenes.G])
        faces = (np.flatnonzero(np.abs(along - x) < 1e-9).tolist() for x in (0.0, case.LENGTH))
        start, tip = (_mean(system, added["oFFRFreducedOrder"], nodes) for nodes in faces)  # type: ignore[arg-type]
        _free_of(system, end, start, 4)
        end = tip
    return _marker_sensor(system, end)


def _mean(system: Any, body: Any, nodes: list[int]) -> Any:
    weights = [1.0 / len(nodes)] * len(nodes)
    marker = item.MarkerSuperElementRigid(bodyNumber=body, meshNodeNumbers=nodes, weightingFactors=weights)
    return system.AddMarker(marker)


def _spin_up(system: Any, scene: scenes.Scene) -> Any:
    start, end = _beam(system, scene, [0.0, 0.0, 0.0])
    _free_of(system, _ground(system), start, 5)
    system.AddLoad(item.LoadTorqueVector(markerNumber=start, loadVector=[0.0, 0.0, scenes.TORQUE]))
    return _marker_sensor(system, end)


def _slider_crank(system: Any, scene: scenes.Scene) -> Any:
    angle = 0.5
    rise = float(np.arcsin(scenes.CRANK * np.sin(angle)))  # of the rod, 1 m long, towards the slide
    crank_end = scenes.CRANK * np.array([np.cos(angle), np.sin(angle), 0.0])
    slide = [float(crank_end[0] + np.cos(rise)), 0.0, 0.0]
    ground = system.AddObject(item.ObjectGround())

    def rigid(mass: float, inertia: tuple[float, ...], com: list[float], place: list[float], turned: float) -> Any:
        tensor = RigidBodyInertia(mass=mass, com=com, inertiaTensor=np.diag(inertia), inertiaTensorAtCOM=True)
        return system.CreateRigidBody(inertia=tensor, referencePosition=place, referenceRotationMatrix=_about_z(turned))

    def marker(body: Any, place: list[float]) -> Any:
        return system.AddMarker(item.MarkerBodyRigid(bodyNumber=body, localPosition=place))

    half = [0.5 * scenes.CRANK, 0.0, 0.0]
    crank = rigid(scenes.CRANK_MASS, scenes.CRANK_INERTIA, half, [0.0, 0.0, 0.0], angle)
    slider = rigid(scenes.SLIDER_MASS, (0.01, 0.01, 0.01), [0.0, 0.0, 0.0], slide, 0.0)
    start, end = _beam(system, scene, crank_end.tolist(), turned=-rise)  # type: ignore[arg-type]
    first = marker(crank, [0.0, 0.0, 0.0])
    _free_of(system, marker(ground, [0.0, 0.0, 0.0]), first, 5)
    _free_of(system, marker(crank, [scenes.CRANK, 0.0, 0.0]), start, 5)
    # the guide carries what is redundant: the slider's hinge holds its place in the plane alone
    system.AddObject(
        item.GenericJoint(markerNumbers=[end, marker(slider, [0.0, 0.0, 0.0])], constrainedAxes=[1, 1, 0, 0, 0, 0])
    )
    _free_of(system, marker(ground, [0.0, 0.0, 0.0]), marker(slider, [0.0, 0.0, 0.0]), 0)
    system.AddLoad(item.LoadTorqueVector(markerNumber=first, loadVector=[0.0, 0.0, scenes.TORQUE]))
    return _point(system, slider, [0.0, 0.0, 0.0])


def _about_z(angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _loaded_spring(load: str, system: Any, _: scenes.Scene) -> Any:
    """The load by a function of time, which is all there is for it."""
    pieces = scenes.LOADS[load]
    body = system.CreateMassPoint(physicsMass=1.0)
    system.CreateCartesianSpringDamper(bodyNumbers=[system.CreateGround(), body], stiffness=[scenes.STIFFNESS] * 3)
    marker = system.AddMarker(item.MarkerBodyPosition(bodyNumber=body))

    def force(_system: Any, t: float, _load: Any) -> list[float]:
        return [float(pieces(t)), 0.0, 0.0]

    push = {"markerNumber": marker, "loadVector": [0.0, 0.0, 0.0], "loadVectorUserFunction": force}
    system.AddLoad(item.Force(**push))
    return _point(system, body, [0.0, 0.0, 0.0])


BUILDERS: dict[str, Callable[[Any, scenes.Scene], Any]] = {
    "rigid chain": _rigid_chain,
    "heavy top": _heavy_top,
    "four-bars": _four_bars,
    "load with a jump": partial(_loaded_spring, "jump"),
    "load with a pulse": partial(_loaded_spring, "pulse"),
    "flexible chain": _flexible_chain,
    "averaged flexible chain": _averaged_chain,
    "spin-up": _spin_up,
    "slider-crank": _slider_crank,
}
