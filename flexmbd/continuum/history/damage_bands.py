"""Whether the cells resolve the bands in which a body is damaged: told, for a band too narrow takes too much work.

A damage d, from 0 (sound) to 1 (broken), falls from a crack as exp(-x / l), and linear cells of the size h make of its
work of fracture 1 + h / (2 l) times as much (Bourdin, Francfort & Marigo 2008, doi:10.1007/s10659-007-9107-3).  What is
looked at is the fall that there is along the edges of cells that are more than half broken, 1 - exp(-h / l) of a crack
across them: so the length that counts is measured, and cells that are coarse where nothing breaks are of no matter.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import basix
import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum import parallel
from flexmbd.continuum.contract.dof_layout import DofLayout, Field
from flexmbd.errors import ConvergenceError, ResolutionWarning, warn

FloatArray = NDArray[np.float64]

# Damage from which on a cell counts as broken; and how many lengths the edge of a linear cell may have.
_BROKEN, _LENGTHS = 0.5, 0.5

# The least that is left at an edge's other end, as what is told is a number.
_STEEPEST = 1e-3


# m, over the size of cells: a displacement at which forces with and without damage are compared.
_SMALL = 1e-6


@dataclass(frozen=True, eq=False)
class _Edges:
    """Edges of cells along which a field is looked at.

    Attributes:
        dofs: (n, 2) of the field at their ends, in the whole unknown.
        lengths: (n,) m.
        degree: of the field's element.
    """

    dofs: NDArray[np.int64]
    lengths: FloatArray
    degree: int


class DamageBands:
    """The scalar fields of a body that are damages, and the edges along which they are looked at."""

    def __init__(self, layout: DofLayout, force: Callable[[FloatArray], FloatArray]) -> None:
        """Find the damages: fields that, being 1, take more than half of the forces of displacements. Collective.

        Args:
            layout: of the body's unknowns.
            force: (owned dofs,) internal forces of the body at rest at an unknown (local dofs including ghosts,);
                collective.
        """
        self._comm = layout.space.mesh.comm
        fields = [field for field in layout.fields[1:] if _is_nodal_scalar(field)]
        self._edges = [_edges(field) for field in fields if _is_damage(field, layout, force)]

    @property
    def is_to_be_looked_at(self) -> bool:
        """Whether there are damages about which nothing was told yet."""
        return bool(self._edges)

    def look(self, values: FloatArray) -> None:
        """Warn once, on rank 0, where a damage among values (local dofs including ghosts,) falls fast. Collective.

        Warns:
            ResolutionWarning: it does.
        """
        worst = (0.0, 0.0, 1)
        for edges in self._edges:
            ends = values[edges.dofs]
            most = ends.max(axis=1, initial=0.0)
            broken = np.flatnonzero(most > _BROKEN)
            if broken.size:
                falls = 1.0 - ends[broken].min(axis=1) / most[broken]
                k = int(falls.argmax())
                worst = max(worst, (float(falls[k]), float(edges.lengths[broken[k]]), edges.degree))
        fall, length, degree = max(self._comm.allgather(worst))
        if fall <= 1.0 - np.exp(-_LENGTHS * degree):
            return
        self._edges = []
        lengths = -np.log(max(1.0 - fall, _STEEPEST))
        text = (
            f"a damage falls by {100.0 * min(fall, 1.0):.0f} % along an edge of {length:.3g} m, as over a length "
            f"of {length / lengths:.2g} m: cells so coarse take some {50.0 * lengths / degree:.0f} % too much work "
            "of fracture. Take cells of a third of the form's length where it breaks, or a longer length"
        )
        parallel.on_root(self._comm, lambda: warn(text, ResolutionWarning))


def _is_nodal_scalar(field: Field) -> bool:
    element = field.space.element.basix_element
    return not field.space.value_shape and element.family == basix.ElementFamily.P and not element.discontinuous


def _is_damage(field: Field, layout: DofLayout, force: Callable[[FloatArray], FloatArray]) -> bool:
    """Collective."""
    x, comm = layout.node_x, layout.space.mesh.comm
    size = max(comm.allgather(float(np.ptp(x, axis=0).max(initial=0.0) if len(x) else 0.0)))
    # the same at a node on all ranks
    moved = _SMALL * size * np.sin(7.0 + x @ np.array([[3.0, 1.0, 2.0], [1.0, 5.0, 3.0], [2.0, 3.0, 7.0]]) / size)
    unknown = layout.at_dofs(moved, owned=False)
    norms = []
    for damage in (0.0, 1.0):
        unknown[field.dofs] = damage
        try:
            found = layout.displacements(force(unknown))
        except ConvergenceError:  # of a form with equations at points; on all ranks
            return False
        norms.append(comm.allreduce(float(np.sum(found**2))))
    return bool(norms[1] < 0.25 * norms[0])


def _edges(field: Field) -> _Edges:
    space = field.space
    element = space.element.basix_element
    vertices, ends = basix.topology(element.cell_type)[:2]
    corners = [space.dofmap.dof_layout.entity_dofs(0, k)[0] for k in range(len(vertices))]
    pairs = space.dofmap.list[:, corners][:, np.array(ends)].reshape(-1, 2)
    pairs = np.unique(np.sort(pairs, axis=1), axis=0)
    x = space.tabulate_dof_coordinates()
    lengths = np.linalg.norm(x[pairs[:, 0]] - x[pairs[:, 1]], axis=1)
    return _Edges(field.dofs[pairs].astype(np.int64), lengths, int(element.degree))
