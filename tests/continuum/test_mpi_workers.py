"""Programs of `python -m mpi4py.futures`, whose other ranks wait for tasks: what would wait for them is refused."""

import os
import shutil
import subprocess
import sys

import pytest

from flexmbd.libraries import has_mpi_workers

PROGRAM = """
from flexmbd.errors import FlexmbdError
try:
    import flexmbd.continuum
except FlexmbdError as error:
    print(error)
import petsc4py
from mpi4py import MPI
petsc4py.init(comm=MPI.COMM_SELF)
from flexmbd import meshes
try:
    meshes.block(0.2, 0.05, 0.04, divisions=(4, 1, 1))
except FlexmbdError as error:
    print(error)
print(meshes.block(0.2, 0.05, 0.04, divisions=(4, 1, 1), comm=MPI.COMM_SELF).mesh.topology.index_map(3).size_local)
"""


@pytest.mark.skipif(shutil.which("mpirun") is None, reason="mpirun is not installed")
@pytest.mark.skipif("OMPI_COMM_WORLD_SIZE" in os.environ, reason="an MPI program starts no other one")
def test_what_waits_for_workers_is_refused(tmp_path):
    (tmp_path / "program.py").write_text(PROGRAM)
    command = ["mpirun", "-n", "2", sys.executable, "-m", "mpi4py.futures", str(tmp_path / "program.py")]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=100)
    start, mesh, cells = done.stdout.splitlines()
    assert start.startswith("PETSc would wait without end for all 2 ranks")
    assert "begin with `petsc4py.init(comm=MPI.COMM_SELF)`" in start
    assert mesh.startswith("rank 0 of 2 would wait for the others without end")
    assert cells == "4"
    assert done.returncode == 0


@pytest.mark.parametrize(
    ("words", "has"),
    [
        ("python3 -m mpi4py.futures study.py", True),
        ("python3 -u -W error -Xdev -m mpi4py.futures study.py 10", True),
        ("python3 -um mpi4py.futures study.py", True),
        ("python3 -mmpi4py.futures study.py", True),
        ("python3 --check-hash-based-pycs always -m mpi4py.futures -c pass", True),
        ("python3 -m mpi4py.futures.server", True),
        ("python3", False),
        ("python3 study.py -m mpi4py.futures", False),
        ("python3 -m pytest -m mpi4py.futures", False),
        ("python3 -c pass -m mpi4py.futures", False),
        ("python3 -W mpi4py.futures -", False),
    ],
)
def test_it_is_told_by_how_python_was_started(words, has, monkeypatch):
    monkeypatch.setattr(sys, "orig_argv", words.split())
    assert has_mpi_workers() == has
