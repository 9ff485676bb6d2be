"""A quarter of a thin-walled square tube of bricks, with a dent where its first fold shall begin."""

from __future__ import annotations

import math

from mpi4py import MPI

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum.grid.tagged_mesh import TaggedMesh, from_arrays
from flexmbd.errors import MeshError
from flexmbd.meshes.dimension import check_arguments, checked_part, require_counts, require_positive

FloatArray = NDArray[np.float64]

# What lies nearer than this share of the tube's width is one node.
_SAME = 1e-9


@checked_part
def crash_tube(
    width: float,
    wall: float,
    length: float,
    *,
    divisions: tuple[int, int, int],
    fold: float,
    dent: float,
    mitred: bool = False,
    comm: MPI.Comm = MPI.COMM_WORLD,
) -> TaggedMesh:
    """Mesh the quarter x, y >= 0 of a square tube along z, from z = 0 to z = length. Collective.

    From z = 0 to `fold` one pair of walls is dented inwards and the other outwards by up to `dent`, as a half
    wave along z and along each wall; corners stay where they are. The cells are hexahedra.

    Facet groups: "x_min" and "y_min", the planes of symmetry, "z_min", "z_max"; cell group "tube".

    Args:
        width: outer, m.
        wall: thickness, m; less than half the width.
        length: along z, m.
        divisions: number of equal intervals along half a side (without the corner), across the wall, and
            along z.
        fold: length of the dent along z, m; up to the tube's.
        dent: its depth, m; less than the wall.
        mitred: cells go round the corner, where their faces lie at 45 degrees, and third edges of cells lie across
            the wall, as `forms.solid_shell` takes them. Else the corner is a block of cells of its own.
        comm: the communicator of the mesh.

    Raises:
        MeshError: on all ranks; an argument is out of range, or not the same on all ranks.
    """
    arguments = dict(locals())

    def check() -> None:
        require_positive(width=width, wall=wall, length=length, fold=fold, dent=dent)
        require_counts("divisions", divisions, number=3)
        if not wall < width / 2:
            raise MeshError(f"wall must be below half the width, {width / 2:g} m, got {wall:g}")
        if not (fold <= length and dent < wall):
            raise MeshError(f"fold must be up to the length and dent below the wall, got {fold:g} and {dent:g} m")
        if not isinstance(mitred, bool):
            raise MeshError(f"mitred must be True or False, got {mitred!r}")
        if mitred and not (width - wall) / divisions[0] > wall:
            raise MeshError(
                f"{divisions[0]} cells along half a side of {width / 2:g} m are too short for the mitred corner of a "
                f"wall of {wall:g} m, which takes half of that from them; take up to {math.ceil(width / wall) - 2}"
            )

    check_arguments(comm, arguments, check)
    around = _mitred_section if mitred else _section
    section, quads = around(width / 2, wall, int(divisions[0]), int(divisions[1]))
    layers = int(divisions[2])
    z = np.repeat(np.linspace(0.0, length, layers + 1), len(section))
    points = np.column_stack([np.tile(section, (layers + 1, 1)), z])
    _dent(points, width / 2 - wall, fold, dent)
    below = np.concatenate([quads + k * len(section) for k in range(layers)])
    cells = np.hstack([below, below + len(section)])
    if mitred:
        # corners of basix's bricks by z, y, x: along the tube is the second edge, across the wall the third
        cells = cells.reshape(-1, 2, 2, 2).transpose(0, 2, 1, 3).reshape(-1, 8)
    near = _SAME * max(width, length)
    return from_arrays(
        comm,
        points,
        cells,
        cell="hexahedron",
        degree=1,
        facet_groups={
            "x_min": lambda x: abs(x[0]) < near,
            "y_min": lambda x: abs(x[1]) < near,
            "z_min": lambda x: abs(x[2]) < near,
            "z_max": lambda x: abs(x[2] - length) < near,
        },
        cell_groups={"tube": lambda x: np.full(x.shape[1], True)},
    )


def _section(half: float, wall: float, n: int, m: int) -> tuple[FloatArray, NDArray[np.int64]]:
    """Points (k, 2) of the quarter section, and its quadrilaterals, their corners x fastest."""
    along, across = np.linspace(0.0, half - wall, n + 1), np.linspace(half - wall, half, m + 1)
    points: list[FloatArray] = []
    quads, first = [], 0
    for x, y in ((along, across), (across, across), (across, along)):
        points.append(np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2))
        number = first + np.arange(len(x) * len(y)).reshape(len(x), len(y))
        corners = number[:-1, :-1], number[1:, :-1], number[:-1, 1:], number[1:, 1:]
        quads.append(np.stack([corner.ravel() for corner in corners], axis=1))
        first += number.size
    every = np.concatenate(points)
    # the blocks share the nodes of their borders
    _, kept, place = np.unique(
        np.round(every / (_SAME * half)).astype(np.int64), axis=0, return_index=True, return_inverse=True
    )
    return every[kept], place.reshape(-1)[np.concatenate(quads)]


def _mitred_section(half: float, wall: float, n: int, m: int) -> tuple[FloatArray, NDArray[np.int64]]:
    """The same, from the plane y = 0 round the corner to x = 0; corners first along, then outwards."""
    outwards = np.linspace(half - wall, half, m + 1)
    along = np.linspace(0.0, half - wall / 2, n + 1)
    rows = []
    for place in outwards:
        up = np.column_stack([np.full(n + 1, place), np.append(along[:-1], place)])
        rows.append(np.concatenate([up, up[-2::-1, ::-1]]))
    number = np.arange((m + 1) * (2 * n + 1)).reshape(m + 1, 2 * n + 1)
    corners = number[:-1, :-1], number[:-1, 1:], number[1:, :-1], number[1:, 1:]
    return np.concatenate(rows), np.stack([corner.ravel() for corner in corners], axis=1)


def _dent(points: FloatArray, side: float, fold: float, depth: float) -> None:
    """Move the walls' nodes, of which `side` is half the length between the corners."""
    x, y, z = points.T
    along_z = np.where(z < fold, np.sin(np.pi * z / fold), 0.0) * depth
    across_x = np.where(x < side, np.cos(np.pi / 2 * x / side), 0.0)
    across_y = np.where(y < side, np.cos(np.pi / 2 * y / side), 0.0)
    # a wall is what has no corner: the wall at large y runs along x
    on_x, on_y = (y >= side * (1 - _SAME)) & (x < side), (x >= side * (1 - _SAME)) & (y < side)
    points[on_x, 1] -= (along_z * across_x)[on_x]
    points[on_y, 0] += (along_z * across_y)[on_y]
