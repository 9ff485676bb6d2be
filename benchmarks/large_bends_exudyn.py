"""The planar scenes of `large_bends.py` by exudyn's geometrically exact beam and by its ANCF cable."""

from __future__ import annotations

import os
import time
from itertools import pairwise
from typing import Any

import large_bends_scenes as scenes
import numpy as np

os.environ.setdefault("EXUDYN_MODULE", "fast")  # the build without range checks
import exudyn as exu
import exudyn.itemInterface as item


def _beam(mbs: Any, bar: scenes.Bar, start: np.ndarray, end: np.ndarray, n: int, *, cable: bool) -> list[Any]:
    """The nodes of a straight beam of n elements."""
    length = float(np.linalg.norm(end - start)) / n
    along = (end - start) / (n * length)
    angle = float(np.arctan2(along[1], along[0]))
    nodes = []
    for k in range(n + 1):
        place = list(start + k * length * along)
        nodes.append(
            mbs.AddNode(item.NodePoint2DSlope1(referenceCoordinates=[*place, *along]))
            if cable
            else mbs.AddNode(item.NodeRigidBody2D(referenceCoordinates=[*place, angle]))
        )
    for pair in pairwise(nodes):
        if cable:
            element = item.ObjectANCFCable2D(
                nodeNumbers=list(pair), length=length, massPerLength=bar.rho_A, bendingStiffness=bar.EI,
                axialStiffness=bar.EA, useReducedOrderIntegration=1,
            )  # fmt: skip
        else:
            element = item.ObjectBeamGeometricallyExact2D(
                nodeNumbers=list(pair), physicsLength=length, physicsMassPerLength=bar.rho_A,
                physicsCrossSectionInertia=bar.rho_I, physicsBendingStiffness=bar.EI, physicsAxialStiffness=bar.EA,
                physicsShearStiffness=bar.GA,
            )  # fmt: skip
        mbs.AddObject(element)
    return nodes


def _clamp(mbs: Any, node: Any, count: int) -> None:
    ground = mbs.AddNode(item.NodePointGround(referenceCoordinates=[0.0, 0.0, 0.0]))
    fixed = mbs.AddMarker(item.MarkerNodeCoordinate(nodeNumber=ground, coordinate=0))
    for k in range(count):
        one = mbs.AddMarker(item.MarkerNodeCoordinate(nodeNumber=node, coordinate=k))
        mbs.AddObject(item.ObjectConnectorCoordinate(markerNumbers=[fixed, one]))


#: Solvers that move a machine: those of ordinary differential equations take no constraints.
IMPLICIT = exu.DynamicSolverType.GeneralizedAlpha
EXPLICIT = exu.DynamicSolverType.RK44


def _settings(end: float, h: float) -> Any:
    settings = exu.SimulationSettings()
    stepping = settings.timeIntegration
    stepping.endTime, stepping.numberOfSteps = end, round(end / h)
    stepping.verboseMode = settings.staticSolver.verboseMode = 0
    stepping.newton.useModifiedNewton = True
    stepping.generalizedAlpha.spectralRadius = 0.9
    settings.solution.file.write = False
    settings.linearSolver.solverType = exu.LinearSolverType.EigenSparse
    return settings


def _rolled(n: int, *, cable: bool) -> tuple[Any, Any, Any]:
    mbs = exu.SystemContainer().AddSystem()
    ends = np.zeros(2), np.array([scenes.ROLLED_LENGTH, 0.0])
    nodes = _beam(mbs, scenes.ROLLED, *ends, n, cable=cable)
    _clamp(mbs, nodes[0], 4 if cable else 3)
    return mbs, nodes[-1], mbs.AddMarker(item.MarkerNodeRigid(nodeNumber=nodes[-1]))


def rolled_up(n: int, *, cable: bool) -> tuple[np.ndarray, float]:
    """(2,) m, the tip of the cantilever rolled up, at rest; processor time (s)."""
    mbs, tip, marker = _rolled(n, cable=cable)
    moment = 2.0 * np.pi * scenes.ROLLED.EI / scenes.ROLLED_LENGTH
    mbs.AddLoad(item.LoadTorqueVector(markerNumber=marker, loadVector=[0.0, 0.0, moment]))
    settings = _settings(1.0, 1.0)
    settings.staticSolver.numberOfLoadSteps = 16
    mbs.Assemble()
    began = time.process_time()
    mbs.SolveStatic(settings)
    return _place(mbs, tip), time.process_time() - began


def rolled(n: int, h: float, solver: Any = IMPLICIT, *, cable: bool = False) -> tuple[np.ndarray, float]:
    """(k, 2) m, the tip of the cantilever that is rolled up, at ``scenes.instants``; processor time (s)."""
    mbs, tip, marker = _rolled(n, cable=cable)
    mbs.AddLoad(
        item.LoadTorqueVector(
            markerNumber=marker, loadVector=[0.0, 0.0, 0.0],
            loadVectorUserFunction=lambda mbs, t, vector: [0.0, 0.0, float(scenes.rolling(t))],
        )
    )  # fmt: skip
    return _run(mbs, tip, scenes.ROLLED_END, h, solver)


def flying(n: int, h: float, solver: Any = IMPLICIT) -> tuple[np.ndarray, float]:
    """(k, 2) m, the upper end of the flying beam at ``scenes.instants``; processor time (s)."""
    mbs = exu.SystemContainer().AddSystem()
    ends = np.array(scenes.FLYING_LOWER[:2]), np.array(scenes.FLYING_UPPER[:2])
    nodes = _beam(mbs, scenes.FLYING, *ends, n, cable=False)
    marker = mbs.AddMarker(item.MarkerNodeRigid(nodeNumber=nodes[0]))
    mbs.AddLoad(
        item.LoadForceVector(
            markerNumber=marker, loadVector=[0.0, 0.0, 0.0],
            loadVectorUserFunction=lambda mbs, t, vector: [float(scenes.flung(t)), 0.0, 0.0],
        )
    )  # fmt: skip
    mbs.AddLoad(
        item.LoadTorqueVector(
            markerNumber=marker, loadVector=[0.0, 0.0, 0.0],
            loadVectorUserFunction=lambda mbs, t, vector: [0.0, 0.0, float(scenes.spun(t))],
        )
    )  # fmt: skip
    return _run(mbs, nodes[-1], scenes.FLYING_END, h, solver)


def _run(mbs: Any, node: Any, end: float, h: float, solver: Any) -> tuple[np.ndarray, float]:
    """(k, 2) m at ``scenes.instants``, which steps of h meet."""
    position = exu.OutputVariableType.Position
    sensor = mbs.AddSensor(item.SensorNode(nodeNumber=node, storeInternal=True, outputVariableType=position))
    settings, times = _settings(end, h), scenes.instants(end)
    settings.solutionSettings.sensorsWritePeriod = times[0]
    mbs.Assemble()
    began = time.process_time()
    mbs.SolveDynamic(settings, solverType=solver)
    spent = time.process_time() - began
    rows = mbs.GetSensorStoredData(sensor)
    near = np.abs(rows[:, 0] - times[:, None])
    if near.min(axis=1).max() > 1e-6:
        return np.full((len(times), 2), np.nan), spent
    return rows[near.argmin(axis=1), 1:3], spent


def _place(mbs: Any, node: Any) -> np.ndarray:
    return np.array(mbs.GetNodeOutput(node, exu.OutputVariableType.Position))[:2]
