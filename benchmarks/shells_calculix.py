"""A problem of shells.py by CalculiX's shells of eight nodes, S8R, in a process of its own; needs ccx on the PATH.

    python benchmarks/shells_calculix.py "pinched hemisphere" 16

CalculiX makes a brick of twenty nodes (C3D20R) of each, and that is written here: where a shell's rotation is held, as
on a plane of symmetry, it ties the nodes of its normal to a rigid body, and the wall locks (a quarter of the pinched
cylinder's displacement on 16 x 16). Without planes of symmetry, of the whole cylinder of as large cells, S8R itself has
0.8692, 0.9720 and 1.0022 of the displacement where the octant's 4, 8 and 16 cells have 0.8683, 0.9704 and 0.9997: there
the force is on the middle node alone. Prints one line of JSON: seconds of processor time of the whole program,
unknowns, how far the watched point moves.
"""

from __future__ import annotations

import json
import os
import re
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from shells_problems import LINEAR, Problem

# (along i, along j, through) of a cell's nodes on a grid of half cells
_CORNERS = ((0, 0), (2, 0), (2, 2), (0, 2))
_MIDDLES = ((1, 0), (2, 1), (1, 2), (0, 1))
_NODES = (
    *((*a, 0) for a in _CORNERS), *((*a, 2) for a in _CORNERS), *((*a, 0) for a in _MIDDLES),
    *((*a, 2) for a in _MIDDLES), *((*a, 1) for a in _CORNERS),
)  # fmt: skip


def written(problem: Problem, n: int) -> tuple[str, int]:
    """The input of n x n cells, and the number of unknowns; the watched nodes are the set W."""
    points, _, number = problem.grid(2 * n)
    normals = problem.normals(points.T).T
    normals = normals / np.linalg.norm(normals, axis=1)[:, None]
    i, j = np.meshgrid(*(np.arange(0, 2 * n, 2),) * 2, indexing="ij")
    place = points.reshape(*number.shape, 3)
    along = np.cross(place[2, 0] - place[0, 0], place[0, 2] - place[0, 0])
    up = 1.0 if along @ normals[0] > 0.0 else -1.0  # so that cells are not turned inside out
    whole = np.concatenate([points + up * share * problem.thickness * normals for share in (-0.5, 0.0, 0.5)])
    cells = np.stack([(number[i + a, j + b] + k * len(points)).ravel() for a, b, k in _NODES], axis=1)
    used = np.unique(cells)

    def through(line: np.ndarray) -> np.ndarray:
        return np.intersect1d(np.concatenate([line + k * len(points) for k in range(3)]), used)

    text = ["*NODE, NSET=ALL", *(f"{k + 1},{','.join(f'{x:.12e}' for x in whole[k])}" for k in used)]
    text += ["*ELEMENT, TYPE=C3D20R, ELSET=WALL"]
    for k, cell in enumerate(cells + 1):
        text += [f"{k + 1}," + ",".join(map(str, cell[:15])) + ",", ",".join(map(str, cell[15:]))]
    text += ["*MATERIAL, NAME=M", "*ELASTIC", f"{problem.E},{problem.nu}", "*DENSITY", "1."]
    text += ["*SOLID SECTION, ELSET=WALL, MATERIAL=M", "*BOUNDARY"]
    held = []
    for line, moved, _ in problem.sides(number):
        nodes = through(line)
        if len(line) == 1:  # a point that is held may turn
            nodes = nodes[:1] if up > 0.0 else nodes[-1:]
        held += [(k + 1, 1 + "xyz".index(axis)) for k in nodes for axis in moved]
    text += [f"{node},{axis}" for node, axis in held]
    text += ["*STEP", "*STATIC"]
    if any(problem.weight):
        size = float(np.linalg.norm(problem.weight))
        way = ",".join(f"{x / size:.10e}" for x in problem.weight)
        text += ["*DLOAD", f"WALL,GRAV,{size / problem.thickness:.10e},{way}"]
    if problem.forces:
        text += ["*CLOAD"]
    for at, force in problem.forces:
        nodes = through(number[-at[0], -at[1]][None])
        text += [f"{k + 1},{1 + a},{f / len(nodes):.10e}" for k in nodes for a, f in enumerate(force) if f]
    watched = through(np.array([problem.at(number)]))
    text += ["*NSET,NSET=W", *(f"{k + 1}," for k in watched), "*NODE PRINT, NSET=W", "U", "*END STEP", ""]
    return "\n".join(text), 3 * len(used) - len(set(held))


def solved(problem: Problem, n: int) -> dict[str, float]:
    """On n x n cells."""
    text, unknowns = written(problem, n)
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "s.inp").write_text(text)
        subprocess.run(
            ["ccx", "s"], cwd=folder, capture_output=True, text=True, check=True,
            env=os.environ | {"OMP_NUM_THREADS": "1", "CCX_NPROC_EQUATION_SOLVER": "1"},
        )  # fmt: skip
        printed = Path(folder, "s.dat").read_text().splitlines()
    rows = [line.split() for line in printed if re.fullmatch(r"\s*\d+(\s+[-+\d.eE]+){3}\s*", line)]
    moved = np.array(rows, dtype=float)[:, 1:] @ problem.watched[1]
    spent = resource.getrusage(resource.RUSAGE_CHILDREN)
    return {"seconds": spent.ru_utime + spent.ru_stime, "unknowns": float(unknowns), "moved": float(moved.mean())}


if __name__ == "__main__":
    name, n = sys.argv[1:]
    print(json.dumps(solved(LINEAR[name], int(n))))
