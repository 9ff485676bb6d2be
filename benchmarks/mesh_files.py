"""How long meshes of other programs take to read: bulk data and an input file of a million lines, parts from STEP.

    ./run python benchmarks/mesh_files.py [LINES]

Processor time of this process and of its children. The decks are a lattice of hexahedra in fields of eight columns
and between commas; the part is a plate with a hub and a fillet, at sizes at which cells are bent or straightened.
"""

import os
import sys
import tempfile
import time
import warnings
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent.parent / "tests" / "helpers"))

import gmsh
import numpy as np
import step_shapes

from flexmbd import meshes
from flexmbd.errors import MeshWarning
from flexmbd.meshes import session
from flexmbd.meshes.untangle import untangle


def lattice(lines):
    """Points and hexahedra, some `lines` lines of bulk data together: one a node, two a cell."""
    n = max(2, round((lines / 3.0) ** (1 / 3)))
    grid = np.stack(np.meshgrid(*[np.arange(n + 1)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    number = np.arange(len(grid)).reshape([n + 1] * 3) + 1
    around = [(i, j, k) for k in (0, 1) for i, j in ((0, 0), (1, 0), (1, 1), (0, 1))]
    near = [number[i : n + i, j : n + j, k : n + k].reshape(-1) for i, j, k in around]
    return 0.01 * grid, np.stack(near, axis=1)


def fixed(points, cells):
    text = ["BEGIN BULK\n"]
    for i, (x, y, z) in enumerate(points.tolist(), start=1):
        text.append(f"GRID    {i:8d}        {x:8.4f}{y:8.4f}{z:8.4f}\n")
    for i, c in enumerate(cells.tolist(), start=1):
        text.append(f"CHEXA   {i:8d}       1{''.join(f'{v:8d}' for v in c[:6])}+\n+       {c[6]:8d}{c[7]:8d}\n")
    return "".join([*text, "SPC1,1,123,1,THRU,100\nENDDATA\n"])


def free(points, cells):
    text = [f"GRID,{i},,{x:.5f},{y:.5f},{z:.5f}\n" for i, (x, y, z) in enumerate(points.tolist(), start=1)]
    for i, c in enumerate(cells.tolist(), start=1):
        text.append(f"CHEXA,{i},1,{','.join(map(str, c[:6]))}\n,{c[6]},{c[7]}\n")
    return "".join([*text, "SPC1,1,123,1,THRU,100\n"])


def abaqus(points, cells):
    text = ["*NODE\n", *(f"{i},{x:.5f},{y:.5f},{z:.5f}\n" for i, (x, y, z) in enumerate(points.tolist(), start=1))]
    text += ["*ELEMENT,TYPE=C3D8\n", *(f"{i},{','.join(map(str, c))}\n" for i, c in enumerate(cells.tolist(), start=1))]
    return "".join([*text, "*NSET,NSET=foot,GENERATE\n1,100\n"])


def spent():
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


def read(folder, lines):
    points, cells = lattice(lines)
    print(f"{len(cells)} hexahedra, {len(points)} nodes")
    for name, write in (("fixed.bdf", fixed), ("free.bdf", free), ("part.inp", abaqus)):
        path = folder / name
        text = write(points, cells)
        path.write_text(text)
        count = text.count("\n")
        del text
        start = spent()
        meshes.read(path)
        print(f"{name:10s} {count:8d} lines {spent() - start:6.1f} s")


def mesh(folder):
    path = folder / "hub.step"
    step_shapes.write(path, step_shapes.add_hub)
    for h in (0.02, 0.012, 0.008, 0.005):
        with session.model():
            gmsh.model.occ.importShapes(str(path))
            gmsh.model.occ.synchronize()
            gmsh.model.addPhysicalGroup(2, [tag for _, tag in gmsh.model.getEntities(2)], name="all")
            session.generate(h=h, degree=2)
            share = session.model_input(3)
        start = spent()
        untangle(share)
        extra = spent() - start
        start = spent()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", MeshWarning)
            part = meshes.from_step(path, tags={}, h=h)
        whole = spent() - start
        print(f"h = {h:5.3f} m {whole:5.1f} s, of which untangling {extra:4.2f} s; {meshes.quality(part)}")


if __name__ == "__main__":
    begin = time.perf_counter()
    with tempfile.TemporaryDirectory() as name:
        mesh(Path(name))
        read(Path(name), int(sys.argv[1]) if len(sys.argv) > 1 else 1_000_000)
    print(f"{time.perf_counter() - begin:.0f} s")
