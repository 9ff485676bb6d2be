"""Files that gmsh and OpenCASCADE read are tried in a process of their own first; what others read is read there.

On a damaged file these libraries may end the process, take all memory, or never return.
"""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from enum import Enum
from pathlib import Path

import numpy as np

from flexmbd.errors import MeshError

# At the beginning of every script: limits of the process; and how errors are told.
_BEGIN = """
import os, resource, sys
path, kind, seconds, memory = sys.argv[1], sys.argv[2], int(sys.argv[3]), int(sys.argv[4])
resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds))
resource.setrlimit(resource.RLIMIT_AS, (memory, memory))

def refuse(error):
    print(" ".join(f"{type(error).__name__} {error}".split())[:300], file=sys.stderr)
    sys.stderr.flush()
    os._exit(3)
"""

_READ = """
import gmsh
gmsh.initialize([], readConfigFiles=False, interruptible=False)
gmsh.option.setNumber("General.Terminal", 0)
try:
    if kind == "step":
        gmsh.model.occ.importShapes(path, format="step")
        gmsh.model.occ.synchronize()
        for dimension, tag in gmsh.model.getEntities():
            gmsh.model.getBoundingBox(dimension, tag)
            if dimension > 1:
                gmsh.model.occ.getMass(dimension, tag)
    else:
        gmsh.merge(path)
        gmsh.model.mesh.getNodes()
        for dimension, tag in gmsh.model.getEntities():
            gmsh.model.mesh.getElements(dimension, tag)
            gmsh.model.getPhysicalGroupsForEntity(dimension, tag)
except Exception as error:
    refuse(error)
os._exit(0)
"""

# What a script that reads writes in the end: `found`, arrays by their names.
_END = """
try:
    found = read(path)
    numpy.savez(kind, **found)
except (Exception, SystemExit) as error:
    refuse(error)
os._exit(0)
"""


class Kind(Enum):
    """What a file is read as."""

    STEP = "step"
    MSH = "msh"


@dataclass(frozen=True)
class TrialLimits:
    """What reading a file may take.

    Attributes:
        seconds: of processor time, whatever its size; and for each byte.
        bytes: of memory, whatever its size; and for each byte.
    """

    seconds: tuple[float, float] = (60.0, 1e-5)
    bytes: tuple[float, float] = (2.0**31, 1000.0)


LIMITS = TrialLimits()


def try_to_read(path: Path, kind: Kind) -> None:
    """Refuse a file that gmsh cannot read, whatever it does to the process; on rank 0.

    Raises:
        MeshError: it cannot be read, or not within the limits of time and memory.
    """
    if sys.platform == "win32":  # which has no such limits
        return
    _run(path, "gmsh", _BEGIN + _READ, kind.value)


def arrays_of(path: Path, library: str, script: str) -> dict[str, np.ndarray]:
    """What a library reads from a file, in a process of its own; on rank 0.

    Args:
        path: of the file.
        library: name of the package.
        script: Python that imports numpy and defines `read(path)`, which returns arrays by their names.

    Raises:
        MeshError: the library is not there; the file cannot be read, or not within the limits of time and memory.
    """
    if importlib.util.find_spec(library) is None:
        raise MeshError(f"{path}: {library} reads such files, and is not there: pip install 'flexmbd[meshes]'")
    limits = _BEGIN.partition("resource.setrlimit")[0].replace("resource, ", "") if sys.platform == "win32" else _BEGIN
    with tempfile.TemporaryDirectory(prefix="flexmbd-") as folder:
        target = Path(folder) / "arrays.npz"
        _run(path, library, limits + script + _END, str(target))
        with np.load(target, allow_pickle=False) as arrays:
            return dict(arrays)


def _run(path: Path, library: str, script: str, argument: str) -> None:
    size = path.stat().st_size
    seconds, memory = (int(fixed + each * size) for fixed, each in (LIMITS.seconds, LIMITS.bytes))
    # a process of its own, that no launcher of MPI knows of
    launchers = ("OMPI_", "PMI", "MPI", "HYDRA", "I_MPI")
    surroundings = {name: value for name, value in os.environ.items() if not name.startswith(launchers)}
    command = [sys.executable, "-c", script, str(path), argument, str(seconds), str(memory)]
    try:
        done = subprocess.run(
            command, env=surroundings, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
            timeout=10.0 * seconds, check=False,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        raise MeshError(f"{path}: damaged: {library} did not read it in {10 * seconds} s") from None
    except OSError as error:
        raise MeshError(f"{path}: no process can be started to read it: {error.strerror}") from error
    if done.returncode == 0:
        return
    told = done.stderr.decode(errors="replace").strip().splitlines()
    if done.returncode == 3:
        raise MeshError(f"{path}: {library} cannot read it: {told[-1] if told else 'it says nothing'}")
    how = f"by signal {-done.returncode}" if done.returncode < 0 else "early"
    raise MeshError(
        f"{path}: damaged: {library} ended {how} as it read it, within {seconds} s and {memory / 2**30:.1f} GiB; "
        "export it again from the program that made it"
    )
