"""STEP files made by gmsh: the bracket of meshes/data, and others for the tests.

`./run python tests/helpers/step_shapes.py FILE` writes the bracket.
"""

import re
import sys
from pathlib import Path

import gmsh

# Millimetres, as a CAD program has them.
FOOT = (80.0, 40.0, 8.0)
BOLT_BORES, BOLT = (-28.0, 28.0), 4.5
LUG_THICKNESS, LUG_RADIUS, PIN_HEIGHT, PIN = 20.0, 20.0, 40.0, 8.0
FILLET, HUB, BORE = 3.0, 18.0, 6.35  # mm


def add_bracket():
    """A foot with two bolt bores along z, and a lug with a rounded end and a pin bore along x."""
    add = gmsh.model.occ
    length, width, height = FOOT
    foot = add.addBox(-length / 2, -width / 2, 0, length, width, height)
    half = LUG_THICKNESS / 2
    web = add.addBox(-half, -LUG_RADIUS, height, LUG_THICKNESS, 2 * LUG_RADIUS, PIN_HEIGHT - height)
    eye = add.addCylinder(-half, 0, PIN_HEIGHT, LUG_THICKNESS, 0, 0, LUG_RADIUS)
    whole, _ = add.fuse([(3, foot)], [(3, web), (3, eye)])
    bores = [(3, add.addCylinder(x, 0, -1, 0, 0, height + 2, BOLT)) for x in BOLT_BORES]
    bores.append((3, add.addCylinder(-half - 1, 0, PIN_HEIGHT, LUG_THICKNESS + 2, 0, 0, PIN)))
    add.cut(whole, bores)


def add_hub():
    """A plate with a hub on it, a fillet between them, and three bores."""
    add = gmsh.model.occ
    whole, _ = add.fuse([(3, add.addBox(0, 0, 0, 90, 60, 12))], [(3, add.addCylinder(30, 30, 0, 0, 0, 40, HUB))])
    bores = [(30, 30, BORE), (75, 45, 4), (75, 15, 4)]
    whole, _ = add.cut(whole, [(3, add.addCylinder(x, y, -10, 0, 0, 100, radius)) for x, y, radius in bores])
    add.synchronize()
    root = [
        tag
        for _, tag in gmsh.model.getEntities(1)
        if abs(add.getCenterOfMass(1, tag)[2] - 12) < 1e-6 and add.getMass(1, tag) > 100
    ]
    add.fillet([whole[0][1]], [tag for tag in root if gmsh.model.getType(1, tag) == "Circle"], [FILLET])


def write(path, shape, *, says="SI_UNIT(.MILLI.,.METRE.)"):
    """Write what `shape` adds, in millimetres, to a file that says its unit as it is told to."""
    gmsh.initialize([], readConfigFiles=False, interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.option.setString("Geometry.OCCTargetUnit", "MM")
        shape()
        gmsh.model.occ.synchronize()
        gmsh.write(str(path))
    finally:
        gmsh.finalize()
    text = Path(path).read_text()
    assert "SI_UNIT(.MILLI.,.METRE.)" in text
    text = text.replace("SI_UNIT(.MILLI.,.METRE.)", says)
    Path(path).write_text(text)


if __name__ == "__main__":
    file = Path(sys.argv[1])
    write(file, add_bracket)
    file.write_text(
        re.sub(r"FILE_NAME\(.*?\);", "FILE_NAME('bracket.step','',(''),(''),'','','');", file.read_text(), flags=re.S)
        .replace("Open CASCADE STEP translator 7.8 1", "bracket")
    )
