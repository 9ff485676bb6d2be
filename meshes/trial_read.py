"""Files that gmsh and OpenCASCADE read are tried in a process of their own first.

On a damaged file these libraries may end the process, take all memory, or never return.
"""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import dataclass
from enum import Enum
from pathlib import Path

from flexmbd.errors import MeshError

_READ = """
import resource, sys
path, kind, seconds, memory = sys.argv[1], sys.argv[2], int(sys.argv[3]), int(sys.argv[4])
resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds))
resource.setrlimit(resource.RLIMIT_AS, (memory, memory))
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
    print(" ".join(str(error).split()), file=sys.stderr)
    sys.stderr.flush()
    import os
    os._exit(3)
import os
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
    size = path.stat().st_size
    seconds, memory = (int(fixed + each * size) for fixed, each in (LIMITS.seconds, LIMITS.bytes))
    # a process of its own, that no launcher of MPI knows of
    launchers = ("OMPI_", "PMI", "MPI", "HYDRA", "I_MPI")
    surroundings = {name: value for name, value in os.environ.items() if not name.startswith(launchers)}
    command = [sys.executable, "-c", _READ, str(path), kind.value, str(seconds), str(memory)]
    try:
        done = subprocess.run(
            command, env=surroundings, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
            timeout=10.0 * seconds, check=False,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        raise MeshError(f"{path}: damaged: gmsh did not read it in {10 * seconds} s") from None
    except OSError as error:
        raise MeshError(f"{path}: no process can be started to read it: {error.strerror}") from error
    if done.returncode == 0:
        return
    told = done.stderr.decode(errors="replace").strip().splitlines()
    if done.returncode == 3:
        raise MeshError(f"{path}: gmsh cannot read it: {told[-1] if told else 'it says nothing'}")
    how = f"by signal {-done.returncode}" if done.returncode < 0 else "early"
    raise MeshError(
        f"{path}: damaged: gmsh ended {how} as it read it, within {seconds} s and {memory / 2**30:.1f} GiB; "
        "export it again from the program that made it"
    )
