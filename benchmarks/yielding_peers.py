"""The thick cylinder of yielding.py by CalculiX and by Kratos, each in a process of its own.

    python benchmarks/yielding_peers.py kratos 40,50,10 0        # by any python that has Kratos
    python benchmarks/yielding_peers.py calculix 40,50,10 700    # needs ccx on the PATH

Prints one line of JSON: seconds of processor time, iterations, and the displacements at the end. Needs numpy alone.
"""

from __future__ import annotations

import json
import os
import re
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

# m and Pa; a quarter in plane strain, to this part of the limit pressure in equal steps
INNER, OUTER, HEIGHT = 1.0, 2.0, 0.2
YOUNG, POISSON, YIELD = 70e9, 0.3, 250e6
SHARE, STEPS = 0.98, 20
LIMIT = 2 / np.sqrt(3) * YIELD * np.log(OUTER / INNER)


def grid(divisions):
    """Nodes (n, 3) and cells (m, 8) of the ring: along the radius, around, along z; number of a node by its place."""
    n_r, n_t, n_z = divisions
    k, j, i = np.meshgrid(*(np.arange(n + 1) for n in (n_z, n_t, n_r)), indexing="ij")
    r, angle = INNER + (OUTER - INNER) * i / n_r, np.pi / 2 * j / n_t
    x = np.stack([r * np.cos(angle), r * np.sin(angle), HEIGHT * k / n_z], axis=-1).reshape(-1, 3)
    number = np.arange(len(x)).reshape(i.shape)
    corner = number[:-1, :-1, :-1]
    around = [(0, 0, 0), (0, 0, 1), (0, 1, 1), (0, 1, 0), (1, 0, 0), (1, 0, 1), (1, 1, 1), (1, 1, 0)]
    cells = np.stack([number[c : c + n_z, b : b + n_t, a : a + n_r] for c, b, a in around], axis=-1)
    return x, cells.reshape(-1, 8), number, corner


def results(u, number, *, seconds, iterations):
    """What is printed; `u` is (nodes, 3)."""
    size = np.hypot(u[:, 0], u[:, 1])
    return {
        "seconds": seconds,
        "iterations": iterations,
        "u_a": float(size[number[:, :, 0]].mean()),
        "u_b": float(size[number[:, :, -1]].mean()),
    }


def calculix(divisions, hardening):
    """Time of ccx as a whole: reading and writing take a second of it."""
    x, cells, number, corner = grid(divisions)
    sets = {"Y": number[:, 0, :], "X": number[:, -1, :], "Z": np.stack([number[0], number[-1]]), "ALL": number}
    text = ["*NODE,NSET=NALL"]
    text += [f"{i + 1},{p[0]:.12e},{p[1]:.12e},{p[2]:.12e}" for i, p in enumerate(x)]
    text += ["*ELEMENT,TYPE=C3D8,ELSET=EALL"]
    text += [",".join(str(n) for n in (i + 1, *(cell + 1))) for i, cell in enumerate(cells)]
    for name in "XYZ":
        text += [f"*NSET,NSET={name}", *(f"{n + 1}," for n in sets[name].ravel())]
    inner = np.arange(corner.size).reshape(corner.shape)[:, :, 0].ravel()
    text += ["*ELSET,ELSET=INNER", *(f"{n + 1}," for n in inner)]
    text += ["*MATERIAL,NAME=M", "*ELASTIC", f"{YOUNG},{POISSON}", "*PLASTIC"]
    text += [f"{YIELD},0.", *([f"{YIELD + hardening},1."] if hardening else [])]
    text += ["*SOLID SECTION,ELSET=EALL,MATERIAL=M", "*BOUNDARY", "X,1,1", "Y,2,2", "Z,3,3"]
    text += [f"*STEP,INC={10 * STEPS}", "*STATIC,DIRECT", f"{1 / STEPS},1.", "*DLOAD"]
    text += [f"INNER,P6,{SHARE * LIMIT:.12e}", f"*NODE PRINT,NSET=NALL,FREQUENCY={STEPS}", "U", "*END STEP", ""]
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "c.inp").write_text("\n".join(text))
        said = subprocess.run(
            ["ccx", "c"], cwd=folder, capture_output=True, text=True, check=True,
            env=os.environ | {"OMP_NUM_THREADS": "1", "CCX_NPROC_EQUATION_SOLVER": "1"},
        ).stdout
        printed = Path(folder, "c.dat").read_text().splitlines()
    rows = [line.split() for line in printed if re.fullmatch(r"\s*\d+(\s+[-+\d.eE]+){3}\s*", line)]
    u = np.array(rows, dtype=float)[-len(x) :, 1:]
    spent = resource.getrusage(resource.RUSAGE_CHILDREN)
    return results(u, number, seconds=spent.ru_utime + spent.ru_stime, iterations=said.count(" iteration "))


def kratos(divisions, hardening):
    """Time of the steps alone. Perfect plasticity only; B-bar bricks, which are the mean dilatation of flexmbd."""
    if hardening:
        raise SystemExit("kratos: perfect plasticity only")
    import KratosMultiphysics as km
    import KratosMultiphysics.ConstitutiveLawsApplication
    import KratosMultiphysics.LinearSolversApplication
    import KratosMultiphysics.StructuralMechanicsApplication
    from KratosMultiphysics import python_linear_solver_factory

    x, cells, number, _ = grid(divisions)
    model = km.Model()
    part = model.CreateModelPart("cylinder", 2)
    part.ProcessInfo[km.DOMAIN_SIZE] = 3
    for variable in (km.DISPLACEMENT, km.REACTION, km.POSITIVE_FACE_PRESSURE, km.VOLUME_ACCELERATION):
        part.AddNodalSolutionStepVariable(variable)
    for i, p in enumerate(x):
        part.CreateNewNode(i + 1, *map(float, p))
    material = part.CreateNewProperties(1)
    values = {
        km.YOUNG_MODULUS: YOUNG, km.POISSON_RATIO: POISSON, km.DENSITY: 2700.0, km.YIELD_STRESS: YIELD,
        km.FRACTURE_ENERGY: 1e16,
    }
    for variable, value in values.items():
        material.SetValue(variable, value)
    # the number of the curve of perfect plasticity
    material.SetValue(km.KratosGlobals.GetVariable("HARDENING_CURVE"), 3)
    law = km.KratosGlobals.GetConstitutiveLaw("SmallStrainIsotropicPlasticity3DVonMisesVonMises")
    material.SetValue(km.CONSTITUTIVE_LAW, law.Clone())
    for i, cell in enumerate(cells):
        part.CreateNewElement("SmallDisplacementBbarElement3D8N", i + 1, [int(n) + 1 for n in cell], material)
    face = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
    _, n_t, n_z = divisions
    quads = np.stack([number[c : c + n_z, b : b + n_t, 0] for c, b, _ in face], axis=-1).reshape(-1, 4)
    for i, quad in enumerate(quads):
        part.CreateNewCondition("SurfaceLoadCondition3D4N", i + 1, [int(n) + 1 for n in quad], material)
    utility = km.VariableUtils()
    for axis in "XYZ":
        utility.AddDof(getattr(km, f"DISPLACEMENT_{axis}"), getattr(km, f"REACTION_{axis}"), part)
    for axis, nodes in (("Y", number[:, 0]), ("X", number[:, -1]), ("Z", number[[0, -1]])):
        for n in nodes.ravel():
            part.GetNode(int(n) + 1).Fix(getattr(km, f"DISPLACEMENT_{axis}"))
    settings = {
        "solver_type": "amgcl", "tolerance": 1e-9, "max_iteration": 500, "block_size": 3,
        "use_block_matrices_if_possible": True, "verbosity": 0,
    }
    solver = python_linear_solver_factory.ConstructSolver(km.Parameters(json.dumps(settings)))
    criterion = km.ResidualCriteria(1e-9, 1e-3)
    criterion.SetEchoLevel(0)
    scheme = km.ResidualBasedIncrementalUpdateStaticScheme()
    builder = km.ResidualBasedBlockBuilderAndSolver(solver)
    strategy = km.ResidualBasedNewtonRaphsonStrategy(part, scheme, criterion, builder, 40, True, False, False)
    strategy.SetEchoLevel(0)
    strategy.Check()
    strategy.Initialize()
    begin, iterations = time.process_time(), 0
    for step in range(1, STEPS + 1):
        part.CloneTimeStep(step / STEPS)
        part.ProcessInfo[km.STEP] = step
        for n in np.unique(quads):
            part.GetNode(int(n) + 1).SetSolutionStepValue(km.POSITIVE_FACE_PRESSURE, SHARE * LIMIT * step / STEPS)
        strategy.InitializeSolutionStep()
        strategy.Predict()
        converged = strategy.SolveSolutionStep()
        strategy.FinalizeSolutionStep()
        iterations += part.ProcessInfo[km.NL_ITERATION_NUMBER]
        if not converged:
            print(f"step {step} did not converge", file=sys.stderr)
    seconds = time.process_time() - begin
    u = np.array([list(node.GetSolutionStepValue(km.DISPLACEMENT)) for node in part.Nodes])
    return results(u, number, seconds=seconds, iterations=iterations)


if __name__ == "__main__":
    code = {"calculix": calculix, "kratos": kratos}[sys.argv[1]]
    found = code(tuple(map(int, sys.argv[2].split(","))), 1e6 * float(sys.argv[3]))
    print(json.dumps(found))
