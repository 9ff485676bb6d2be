"""How soon flexmbd answers: what is loaded for a command and a first simulation, and the processor time of both."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

FIRST_SIMULATION = """
import flexmbd as fm

scene = fm.System(gravity=(0.0, 0.0, -9.81))
body = scene.add(fm.RigidBody(1.0, (1.0, 1.0, 1.0), com=(0.5, 0.0, 0.0)))
scene.connect(fm.joint.Revolute("y"), scene.ground.frame(), body.frame())
scene.simulate(0.1)
"""


@pytest.fixture(scope="module")
def environment(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """One in which Python keeps the bytecode, as it does for users."""
    kept = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    return {**kept, "PYTHONPYCACHEPREFIX": str(tmp_path_factory.mktemp("bytecode"))}


def processor_seconds(script: str, environment: dict[str, str]) -> float:
    """Of a fresh process, its start included."""
    code = f"{script}\nimport time\nprint()\nprint(time.process_time())"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, env=environment)
    return float(done.stdout.splitlines()[-1])


def ratio(script: str, other: str, environment: dict[str, str]) -> float:
    """Of the least processor times of several runs in turns, the first of which fill the caches."""
    times = [(processor_seconds(script, environment), processor_seconds(other, environment)) for _ in range(4)][1:]
    return min(one for one, _ in times) / min(two for _, two in times)


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
    assert {name for name in names if name.split(".")[0] == "flexmbd"} == {"flexmbd"}
    assert "numpy" not in names


def test_help_takes_less_than_importing_numpy(environment: dict[str, str]) -> None:
    assert ratio(HELP, "import numpy", environment) < 1.0


def test_a_first_simulation_takes_some_three_times_its_libraries(environment: dict[str, str]) -> None:
    """Kernels from the cache: 0.9 s of processor time, where numpy, scipy and numba alone take 0.4 s."""
    assert ratio(FIRST_SIMULATION, "import numba, scipy.linalg", environment) < 3.5


def test_every_public_name_is_there_in_either_way() -> None:
    """As an attribute, and by `from flexmbd import ...`, each first in its process."""
    source = Path(__file__).parents[2] / "flexmbd" / "names.py"
    names = [line.split()[-1] for line in source.read_text().splitlines() if line.startswith("from flexmbd")]
    assert len(names) > 60
    some = names[:: len(names) // 4]
    for name in some:
        names_by = f"import flexmbd\nfrom flexmbd import {name} as one\nassert one is flexmbd.{name}"
        subprocess.run([sys.executable, "-c", names_by], check=True)
