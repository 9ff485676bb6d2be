"""docs/meshes.md: its code runs, and its table of parts says what they are."""

import inspect
import re
from pathlib import Path

from mpi4py import MPI

import lattice
import pytest

from flexmbd import meshes
from flexmbd.continuum.compat import geometry_degree
from flexmbd.meshes import session

pytestmark = pytest.mark.mpi

COMM = MPI.COMM_WORLD
TEXT = (Path(__file__).parents[2] / "docs" / "meshes.md").read_text()

LENGTHS = {"length": 0.3, "width": 0.1, "height": 0.1, "thickness": 0.02, "outer_radius": 0.1, "inner_radius": 0.05}
COARSE = LENGTHS | {"h": 0.03, "divisions": (1, 1, 1)}


def rows():
    """Of the table of parts: function, cells, degree, facet groups, cell groups, arguments."""
    table = TEXT.split("## Parts\n")[1].split("\n## ")[0]
    for line in re.findall(r"^\| `.*\|$", table, re.MULTILINE):
        function, cells, facets, groups, arguments = (field.strip() for field in line.strip("|").split(" | "))
        kinds, degree = re.fullmatch(r"(.*) \((\d)\)", cells).groups()
        quoted = (re.findall(r"`([^`]+)`", field) for field in (facets, groups, arguments))
        yield function.strip("`"), kinds.split(", "), int(degree), *quoted


def test_the_code_runs(shared_path, monkeypatch, capsys):
    monkeypatch.chdir(shared_path)
    if COMM.rank == 0:
        for program, name in (("abaqus", "part.inp"), ("nastran", "part.bdf")):
            part = lattice.lattice("hexahedron", 1, program=program, map=lattice.shear)
            Path(name).write_text(lattice.inp(part, 1) if name == "part.inp" else lattice.bdf(part, 1))
        with session.model():
            import gmsh

            gmsh.model.occ.addBox(0, 0, 0, 1, 1, 1)
            gmsh.model.occ.synchronize()
            gmsh.model.addPhysicalGroup(2, [1], name="foot")
            gmsh.model.addPhysicalGroup(3, [1], name="part")
            session.generate(h=0.5, degree=2)
            gmsh.write("part.msh")
    COMM.barrier()
    blocks = re.findall(r"```python\n(.*?)```", TEXT, re.DOTALL)
    assert len(blocks) == 7
    for block in blocks:
        names = {"meshes": meshes}
        if "COMM_SELF" in block:  # on one process, as it says; then on all
            alone, block = block.split("\npart = ")
            if COMM.rank == 0:
                exec(alone, names)
            COMM.barrier()
            block = f"part = {block}"
        exec(block, names)
    assert names["part"].fingerprint() == meshes.read("part.msh").fingerprint()
    assert capsys.readouterr().out.count("cylinder of radius 0.0045 m") == 2


@pytest.mark.parametrize("row", list(rows()), ids=lambda row: row[0])
def test_the_table_of_parts(row):
    name, cells, degree, facets, groups, arguments = row
    function = getattr(meshes, name)
    parameters = inspect.signature(function).parameters
    assert set(arguments) == parameters.keys() - {"cell", "degree", "comm"}
    assert parameters["degree"].default == degree
    if "cell" in parameters:
        assert parameters["cell"].default == cells[0]
    how = {key: COARSE[key] for key, one in parameters.items() if one.default is inspect.Parameter.empty}
    if name in ("sheet", "line"):
        how["divisions"] = (1, 1) if name == "sheet" else 1
    for cell in cells:
        part = function(**how | ({"cell": cell} if "cell" in parameters else {}))
        assert part.mesh.topology.cell_name() == cell
        assert part.facet_groups.keys() == set(facets)
        assert part.cell_groups.keys() == set(groups)
        assert geometry_degree(part.mesh) == degree


OTHERS = ("read", "write", "from_step", "step_faces", "from_arrays", "materials", "quality", "with_facet_groups")


def test_every_function_is_there():
    made = {name for name, one in vars(meshes).items() if inspect.isfunction(one) and name[0] != "_"}
    # told beside the table
    beside = {"quarter_ring", "round_bar", "crash_tube", "frame", "join", "placed", "spur_gear", "wall"}
    assert {row[0] for row in rows()} | set(OTHERS) | beside == made
    assert all(f"`{name}" in TEXT or f"meshes.{name}(" in TEXT for name in made)
