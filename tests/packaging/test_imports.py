"""The wall: what runs a machine loads nothing of the continuum side, and forms import only UFL."""

import ast
import json
import pkgutil
import subprocess
import sys
from pathlib import Path

import pytest
from fresh_python import ran_afresh

REPOSITORY = Path(__file__).resolve().parents[2]

CONTINUUM = {"basix", "dolfinx", "ffcx", "gmsh", "mpi4py", "petsc4py", "slepc4py", "ufl"}
PICTURES = {"matplotlib", "pyvista", "vtk", "vtkmodules", "imageio"}

# Beside the machine stand the continuum's rooms, pictures, and the commands, which lead to all of them.
ELSEWHERE = {"continuum", "reduction", "meshes", "forms", "visual", "command", "cli", "__main__"}
MACHINE = sorted({name for _, name, _ in pkgutil.iter_modules([str(REPOSITORY / "flexmbd")])} - ELSEWHERE)
ALLOWED_IN_FORMS = {"__future__", "basix", "collections", "dataclasses", "enum", "math", "typing", "ufl"}


def test_flexmbd_loads_neither_continuum_nor_pictures() -> None:
    script = "import flexmbd, json, sys\nprint(json.dumps(sorted({m.partition('.')[0] for m in sys.modules})))"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, cwd="/", check=True)
    assert not set(json.loads(done.stdout)) & (CONTINUUM | PICTURES)


def test_machine_modules_load_neither_continuum_nor_pictures() -> None:
    """A module, or a room with all modules in it."""
    everything = (
        "import flexmbd.{} as room, importlib, pkgutil\n"
        "for found in pkgutil.walk_packages(getattr(room, '__path__', []), room.__name__ + '.'):\n"
        "    importlib.import_module(found.name)"
    )
    ran = dict(zip(MACHINE, ran_afresh([everything.format(name) for name in MACHINE]), strict=True))
    assert {name: one.error for name, one in ran.items() if one.error} == {}
    loaded = {name: sorted(one.packages & (CONTINUUM | PICTURES)) for name, one in ran.items()}
    assert {name: packages for name, packages in loaded.items() if packages} == {}


FORMS = [file for file in sorted((REPOSITORY / "forms").rglob("*.py")) if file.name != "__init__.py"]


@pytest.mark.parametrize("file", FORMS, ids=lambda file: file.stem)
def test_forms_import_ufl_and_little_else(file: Path) -> None:
    imported = set()
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.Import):
            imported |= {alias.name.partition(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and not str(node.module).startswith("flexmbd.forms"):
            imported.add("." if node.level else str(node.module).partition(".")[0])
    assert imported <= ALLOWED_IN_FORMS


def with_wheel(folder: Path, text: str, script: str) -> str:
    """What a script prints where PyPI's wheel of DOLFINx is installed, of which one module stands in a folder."""
    (folder / "dolfinx_solver.py").write_text(text)
    script = f"import sys; sys.path.insert(0, {str(folder)!r})\n{script}"
    return subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True).stdout.strip()


@pytest.mark.parametrize("room", ["continuum", "meshes", "reduction"])
def test_a_wheel_s_mpi_comes_after_h5py_and_before_all_that_needs_it(room: str, tmp_path: Path) -> None:
    wheel = "import sys\nprint({'h5py', 'mpi4py', 'petsc4py', 'slepc4py', 'dolfinx'} & set(sys.modules))"
    assert with_wheel(tmp_path, wheel, f"import flexmbd.{room}") == "{'h5py'}"


def test_a_wheel_that_does_not_load_is_told(tmp_path: Path) -> None:
    wheel = "raise ImportError('petsc4py would be imported from elsewhere')"
    script = (
        "from flexmbd.errors import MissingLibraryError\n"
        "try: import flexmbd.meshes\n"
        "except MissingLibraryError as error: print(error)"
    )
    said = with_wheel(tmp_path, wheel, script)
    assert said == "PyPI's wheel of DOLFINx does not load: petsc4py would be imported from elsewhere"
