"""The case that every code reduces, its meshes, and how time and memory are taken."""

from __future__ import annotations

import json
import resource
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

LENGTH, WIDTH = 1.0, 0.05
E, NU, RHO = 2.1e9, 0.3, 7850.0
# Six static shapes of the face x = 1 beside these; the face x = 0 carries the body frame.
# The 14th and 15th have equal frequencies, and a reduction keeps both of a pair or none.
FIXED_INTERFACE_MODES = 13

# Size of the tetrahedra (m) by roughly how many dofs they give with a quadratic displacement.
CELL_SIZE = {
    "5k": 0.0285, "19k": 0.0172, "63k": 0.0104, "150k": 0.0073, "300k": 0.0057, "600k": 0.00452, "1M": 0.00381,
}  # fmt: skip
FULL = ("5k", "19k", "63k", "150k", "300k")
COMPARED = ("5k", "19k", "63k")
ITERATED = ("63k", "300k")
MESHERS = ("gmsh", "netgen")


def make_mesh(mesher: str, h: float, path: Path) -> None:
    """Mesh the beam and write its vertices and straight tetrahedra; in a process of its own.

    Args:
        mesher: of MESHERS.
        h: size of the cells, m.
        path: of the .npz file.
    """
    code = f"import sys; sys.path.insert(0, {str(Path(__file__).parent)!r}); import reduction_case as c; "
    code += f"c.WRITERS[{mesher!r}]({h!r}, {str(path)!r})"
    subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)


def write_by_netgen(h: float, path: str) -> None:
    """The work of `make_mesh`, which loads NETGEN."""
    from netgen.csg import CSGeometry, OrthoBrick, Pnt

    geometry = CSGeometry()
    half = WIDTH / 2
    geometry.Add(OrthoBrick(Pnt(0, -half, -half), Pnt(LENGTH, half, half)))
    mesh = geometry.GenerateMesh(maxh=h)
    points = np.array([tuple(point.p) for point in mesh.Points()])
    cells = np.array([[vertex.nr - 1 for vertex in cell.vertices] for cell in mesh.Elements3D()])
    np.savez(path, points=points, tetrahedra=cells)


def write_by_gmsh(h: float, path: str) -> None:
    """The work of `make_mesh`, which loads gmsh and DOLFINx."""
    from flexmbd import meshes
    from flexmbd.continuum.compat import cell_nodes

    mesh = meshes.beam(LENGTH, WIDTH, WIDTH, h=h, degree=1).mesh
    np.savez(path, points=mesh.geometry.x, tetrahedra=cell_nodes(mesh))


WRITERS = {"gmsh": write_by_gmsh, "netgen": write_by_netgen}


def read_mesh(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (k, 3) and straight tetrahedra (m, 4) of a file made here, or with ten-node `tet10`."""
    with np.load(path) as file:
        points = np.asarray(file["points"], dtype=float)
        if "tetrahedra" in file:
            return points, np.asarray(file["tetrahedra"], dtype=np.int64)
        cells = np.asarray(file["tet10"], dtype=np.int64)
    used, rows = np.unique(cells[:, :4], return_inverse=True)
    return points[used], rows.reshape(-1, 4)


def count_dofs(path: Path) -> int:
    """Number of dofs of a quadratic displacement on the mesh: three at each vertex and each edge."""
    points, cells = read_mesh(path)
    edges = np.sort(cells[:, [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]]].reshape(-1, 2), axis=1)
    return 3 * (len(points) + len(np.unique(edges, axis=0)))


class Stopwatch:
    """Seconds by stage, of one process or of several that wait for each other."""

    def __init__(self, wait: Callable[[], object] = lambda: None) -> None:
        self.seconds: dict[str, float] = {}
        self._wait = wait

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Add what the block takes to a stage."""
        self._wait()
        began = time.perf_counter()
        yield
        self._wait()
        self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - began

    def watch(self, function: Callable[..., Any], name: str) -> Callable[..., Any]:
        """The function, with its calls counted to a stage."""

        def watched(*arguments: Any, **keywords: Any) -> Any:
            with self.stage(name):
                return function(*arguments, **keywords)

        return watched


def peak_memory() -> int:
    """Most memory this process had so far, bytes; not that of the process that started it."""
    try:
        status = Path("/proc/self/status").read_text()
        return 1024 * int(status.partition("VmHWM:")[2].split()[0])
    except (OSError, IndexError, ValueError):
        return 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def reduced_frequencies(stiffness: np.ndarray, mass: np.ndarray) -> list[float]:
    """Frequencies (Hz, ascending) of reduced matrices, by which the codes are compared."""
    import scipy.linalg

    scale = 1.0 / np.sqrt(np.diag(stiffness))
    grid = np.outer(scale, scale)
    # mass by stiffness: exact for the low ones
    values = scipy.linalg.eigh(mass * grid, stiffness * grid, eigvals_only=True)
    return [float(f) for f in np.sqrt(1.0 / values[::-1]) / (2.0 * np.pi)]


def write_report(path: str, report: dict[str, Any]) -> None:
    """Hand a worker's figures to the script that started it."""
    Path(path).write_text(json.dumps(report))
