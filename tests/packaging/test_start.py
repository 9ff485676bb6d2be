"""How soon flexmbd answers: what is loaded, and what is compiled, for a command and a first simulation."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

FIRST_SIMULATION = """
import flexmbd as fm

scene = fm.System(gravity=(0.0, 0.0, -9.81))
body = scene.add(fm.RigidBody(1.0, (1.0, 1.0, 1.0), com=(0.5, 0.0, 0.0)))
scene.connect(fm.joint.Revolute("y"), scene.ground.frame(), body.frame())
scene.simulate(0.1)
"""


def loaded(script: str) -> set[str]:
    code = f"{script}\nimport json, sys\nprint()\nprint(json.dumps(sorted(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return set(json.loads(done.stdout.splitlines()[-1]))


HELP = "from flexmbd.cli import main\ntry:\n    main(['--help'])\nexcept SystemExit:\n    pass"


def test_help_loads_no_library_and_no_subcommand() -> None:
    names = loaded(HELP)
    assert not {name.split(".")[0] for name in names} & {"numpy", "scipy", "numba", "h5py", "mpi4py", "dolfinx"}
    own = {"interrupts", "launch", "subcommands", "terminal"}
    assert {name for name in names if name.startswith("flexmbd.command.")} == {f"flexmbd.command.{one}" for one in own}


def test_importing_the_root_loads_nothing_before_a_name_is_asked_for() -> None:
    names = loaded("import flexmbd")
    assert {name for name in names if name.split(".")[0] == "flexmbd"} == {"flexmbd", "flexmbd.portraits"}
    assert "numpy" not in names


COMPILED = """
from numba.core import event
with event.install_recorder("numba:compile") as recorded:
    exec(script)
print()
print(sum(one.is_start for _, one in recorded.buffer))
"""


def compiled(script: str) -> int:
    code = f"script = {script!r}\n{COMPILED}"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return int(done.stdout.splitlines()[-1])


def test_a_first_simulation_loads_what_it_needs_and_compiles_nothing() -> None:
    """Kernels come from the cache, which the run before has filled."""
    names = {name.split(".")[0] for name in loaded(FIRST_SIMULATION)}
    beyond = {"mpi4py", "dolfinx", "ufl", "gmsh", "matplotlib", "pyvista", "vtk", "h5py", "pandas"}
    assert not names & beyond
    names = loaded(FIRST_SIMULATION)
    assert not {name.split(".")[0] for name in names} & beyond
    assert "numba" not in names
    assert "scipy.linalg" not in names  # of which LAPACK alone is loaded, until more is asked for
    assert compiled(FIRST_SIMULATION) == 0
    assert compiled("from numba import njit\nnjit(lambda x: x + 1)(1)") == 1  # it is seen where there is one


def test_every_public_name_is_there_in_either_way() -> None:
    """As an attribute, and by `from flexmbd import ...`, each first in its process."""
    source = Path(__file__).parents[2] / "flexmbd" / "names.py"
    names = [line.split()[-1] for line in source.read_text().splitlines() if line.startswith("from flexmbd")]
    assert len(names) > 60
    some = names[:: len(names) // 4]
    for name in some:
        names_by = f"import flexmbd\nfrom flexmbd import {name} as one\nassert one is flexmbd.{name}"
        subprocess.run([sys.executable, "-c", names_by], check=True)
