"""A problem of shells.py by Kratos' shells of four nodes, in a process of its own.

    python benchmarks/shells_kratos.py "pinched hemisphere" thin 16        # by any python that has Kratos

Prints one line of JSON: seconds of processor time (of the step alone), unknowns, how far the watched point moves.
"""

from __future__ import annotations

import json
import sys
import time

import KratosMultiphysics as km
import KratosMultiphysics.LinearSolversApplication
import KratosMultiphysics.StructuralMechanicsApplication
import numpy as np
from KratosMultiphysics import python_linear_solver_factory
from shells_problems import LINEAR, Problem


def solved(problem: Problem, kind: str, n: int) -> dict[str, float]:
    """By a kind of its shells; of version 10.4.4 the thin one alone runs."""
    points, cells, number = problem.grid(n)
    model = km.Model()
    part = model.CreateModelPart("wall", 2)
    part.ProcessInfo[km.DOMAIN_SIZE] = 3
    load = km.KratosGlobals.GetVariable("POINT_LOAD")
    for variable in (km.DISPLACEMENT, km.ROTATION, km.REACTION, km.REACTION_MOMENT, km.VOLUME_ACCELERATION, load):
        part.AddNodalSolutionStepVariable(variable)
    for i, p in enumerate(points):
        part.CreateNewNode(i + 1, *map(float, p))
    material = part.CreateNewProperties(1)
    for variable, value in {
        km.YOUNG_MODULUS: problem.E, km.POISSON_RATIO: problem.nu, km.DENSITY: 1.0, km.THICKNESS: problem.thickness
    }.items():
        material.SetValue(variable, value)
    law = km.KratosGlobals.GetConstitutiveLaw("LinearElasticPlaneStress2DLaw")
    material.SetValue(km.CONSTITUTIVE_LAW, law.Clone())
    element = f"Shell{kind.capitalize()}ElementCorotational3D4N"
    for i, cell in enumerate(cells):
        part.CreateNewElement(element, i + 1, [int(k) + 1 for k in cell], material)
    forces = problem.loads(points, cells, number)
    for i in np.flatnonzero(forces.any(axis=1)):
        part.CreateNewCondition("PointLoadCondition3D1N", int(i) + 1, [int(i) + 1], material)
    utility = km.VariableUtils()
    for axis in "XYZ":
        utility.AddDof(getattr(km, f"DISPLACEMENT_{axis}"), getattr(km, f"REACTION_{axis}"), part)
        utility.AddDof(getattr(km, f"ROTATION_{axis}"), getattr(km, f"REACTION_MOMENT_{axis}"), part)
    for nodes, moved, turned in problem.sides(number):
        for k in nodes:
            for name, axes in (("DISPLACEMENT", moved), ("ROTATION", turned)):
                for axis in axes.upper():
                    part.GetNode(int(k) + 1).Fix(getattr(km, f"{name}_{axis}"))
    settings = km.Parameters(json.dumps({"solver_type": "LinearSolversApplication.sparse_lu"}))
    solver = python_linear_solver_factory.ConstructSolver(settings)
    scheme = km.ResidualBasedIncrementalUpdateStaticScheme()
    builder = km.ResidualBasedBlockBuilderAndSolver(solver)
    strategy = km.ResidualBasedLinearStrategy(part, scheme, builder, True, False, False, False)
    strategy.SetEchoLevel(0)
    strategy.Initialize()
    begin = time.process_time()
    part.CloneTimeStep(1.0)
    part.ProcessInfo[km.STEP] = 1
    for i in np.flatnonzero(forces.any(axis=1)):
        part.GetNode(int(i) + 1).SetSolutionStepValue(load, list(forces[i]))
    strategy.InitializeSolutionStep()
    strategy.Predict()
    strategy.SolveSolutionStep()
    strategy.FinalizeSolutionStep()
    seconds = time.process_time() - begin
    node = part.GetNode(problem.at(number) + 1)
    moved = float(np.dot(list(node.GetSolutionStepValue(km.DISPLACEMENT)), problem.watched[1]))
    return {"seconds": seconds, "unknowns": 6.0 * len(points), "moved": moved}


if __name__ == "__main__":
    name, kind, n = sys.argv[1:]
    print(json.dumps(solved(LINEAR[name], kind, int(n))))
