"""Surfaces of triangles from files of other programs: STL, OBJ, PLY, VTP; entered by ``shape``."""

from __future__ import annotations

import importlib
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import SceneError
from flexmbd.given import refuse_other

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

SUFFIXES = (".obj", ".ply", ".stl", ".vtp")


def read_triangles(path: str | Path) -> tuple[FloatArray, IntArray]:
    """Points (n, 3), in the file's unit, and triangles (t, 3) of a file. Not collective.

    Raises:
        SceneError: the file is missing, of another kind, or holds no triangles; or pyvista is not installed.
    """
    refuse_other(path, (str, Path), "path", wanted='a file, "part.stl"')
    file = Path(path)
    if file.suffix.lower() not in SUFFIXES:
        raise SceneError(f"{file}: a shape is read from {', '.join(SUFFIXES)}")
    if not file.is_file():
        raise SceneError(f"{file}: there is no such file")
    try:
        pyvista = importlib.import_module("pyvista")
    except ImportError as reason:
        raise SceneError(f"{file} is read by pyvista: pip install 'flexmbd[pictures]' ({reason})") from reason
    vtk = importlib.import_module("vtkmodules.vtkCommonCore")
    loud = vtk.vtkObject.GetGlobalWarningDisplay()
    vtk.vtkObject.SetGlobalWarningDisplay(0)  # what is wrong is told below
    try:
        mesh = pyvista.read(file)
        mesh = mesh.triangulate().clean() if isinstance(mesh, pyvista.PolyData) else pyvista.PolyData()
    except Exception as reason:  # whatever a reader of a foreign file raises
        raise SceneError(f"{file} cannot be read: {reason}") from reason
    finally:
        vtk.vtkObject.SetGlobalWarningDisplay(loud)
    if mesh.n_cells == 0 or not np.isfinite(mesh.points).all():
        raise SceneError(f"{file} holds no triangles of finite numbers: it is empty, damaged or of another kind")
    return np.asarray(mesh.points, dtype=np.float64), np.asarray(mesh.regular_faces, dtype=np.int64)
