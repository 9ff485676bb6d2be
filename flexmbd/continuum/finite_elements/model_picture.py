"""Pictures of a body on a mesh: its surface and the axes of its interfaces."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmbd.continuum import parallel
from flexmbd.continuum.compat import cell_nodes
from flexmbd.continuum.finite_elements.discrete_forms import DiscretisedBody
from flexmbd.continuum.finite_elements.mesh_outline import outline_of
from flexmbd.continuum.grid.tagged_mesh import TaggedMesh
from flexmbd.portraits import portraits

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


class PicturedModel(DiscretisedBody):
    """A body of formulations on a mesh that can be shown."""

    def __repr__(self) -> str:
        """Its size and its interfaces. Not collective."""
        names = ", ".join(face.name for face in self.interfaces) or "none"
        space = self.space.dofmap
        count = space.index_map.size_global * space.index_map_bs
        cells = self.mesh.mesh.topology.index_map(self.mesh.dim).size_global
        return f"<{type(self).__name__}: {count} unknowns, {cells} cells of degree {self.degree}, interfaces {names}>"

    def show(
        self,
        *,
        path: str | Path | None = None,
        size: tuple[int, int] = (1280, 720),
        view: ArrayLike | None = None,
    ) -> Path | None:
        """Show the mesh and its interfaces' axes in a window or a notebook, or write it to ``path``. Collective.

        Args:
            path: a .png; needs no display.
            size: width and height in pixels, even numbers.
            view: (3,) direction from the body to the camera, in the mesh's axes.

        Raises:
            PictureError: there is no display, or the file cannot be written: on all ranks.
        """
        scene = self._scene()
        return parallel.on_root(
            self.mesh.comm, lambda: portraits().present(scene, path=path, size=size, view=view)
        )

    def to_pyvista(self) -> Any:
        """The scene of ``show`` as a pyvista.MultiBlock (m); the mesh itself is ``mesh.to_pyvista()``. Collective.

        Raises:
            PictureError: pyvista is not installed.
        """
        return self._scene().to_pyvista()

    def _scene(self) -> Any:
        frames = {face.name: (face.p, face.R) for face in self.interfaces}
        if self.mesh.dim == 3:
            outline = outline_of(self.mesh)
            return portraits().mesh_scene(outline.x, outline.triangles, frames=frames)
        x, cells = _whole_mesh(self.mesh)
        if self.mesh.dim == 1:
            return portraits().mesh_scene(x, np.zeros((0, 3), np.int64), lines=cells[:, :2], frames=frames)
        return portraits().mesh_scene(x, _flat_triangles(cells, self.mesh), frames=frames)

    def _repr_html_(self) -> str:
        """Its text and, on one rank where pyvista can draw, a picture."""
        alone = self.mesh.comm.size == 1  # what draws is collective, and this may be asked of one rank
        return portraits().html_of(repr(self), lambda: self._scene() if alone else None)


def _whole_mesh(mesh: TaggedMesh) -> tuple[FloatArray, IntArray]:
    """Nodes (n, 3) m and cells (c, nodes of a cell) of a mesh, the same on every rank. Collective."""
    geometry = mesh.mesh.geometry
    owned = mesh.mesh.topology.index_map(mesh.dim).size_local
    local = cell_nodes(mesh.mesh)[:owned]
    nodes = np.unique(local)
    numbers = np.asarray(geometry.input_global_indices, dtype=np.int64)
    parts = [parallel.gather_rows(mesh.comm, rows) for rows in (numbers[local], numbers[nodes], geometry.x[nodes])]

    def make() -> tuple[FloatArray, IntArray]:
        cells, known, places = (np.asarray(part) for part in parts)
        used, first = np.unique(known, return_index=True)
        return places[first], np.searchsorted(used, cells).astype(np.int64)

    return parallel.on_root(mesh.comm, make)


def _flat_triangles(cells: IntArray, mesh: TaggedMesh) -> IntArray:
    """(t, 3) triangles between the vertices of triangles, or of quadrilaterals, whose vertices are lexicographic."""
    if mesh.mesh.topology.cell_name() == "triangle":
        return cells[:, :3]
    return np.vstack([cells[:, [0, 1, 3]], cells[:, [0, 3, 2]]])
