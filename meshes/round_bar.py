"""A quarter of a round bar, of bricks."""

from __future__ import annotations

from mpi4py import MPI

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum.grid.tagged_mesh import TaggedMesh, from_arrays
from flexmbd.meshes.dimension import check_arguments, checked_part, require_counts, require_positive

# Half the side of the square in the middle, and its outward bulge, by the radius.
_CORE, _BULGE = 0.5, 0.08


@checked_part
def round_bar(
    radius: float,
    length: float,
    *,
    divisions: tuple[int, int, int],
    comm: MPI.Comm = MPI.COMM_WORLD,
) -> TaggedMesh:
    """Mesh the quarter x, y >= 0 of the round bar of the axis z, 0 <= z <= length, with 8-node bricks. Collective.

    In the section a square in the middle is surrounded by a ring. The cells are straight and their outer nodes lie on
    the radius: the section is a polygon of 8 n sides, n the first of the divisions, and lacks
    1 - 4 n sin(pi / 4 n) / pi of the circle's area, and the body of its mass: 2.6 % with n = 2, 0.64 % with 4, 0.16 %
    with 8. Facet groups: "x_min" and "y_min", the planes of symmetry, "z_min", "z_max", "side"; cell group "round_bar".

    Args:
        radius: m.
        length: along z, m.
        divisions: number of intervals along a side of the square, across the ring, and along z.
        comm: the communicator of the mesh.

    Raises:
        MeshError: on all ranks; an argument is out of range, or not the same on all ranks.
    """
    arguments = dict(locals())

    def check() -> None:
        require_positive(radius=radius, length=length)
        require_counts("divisions", divisions, number=3)

    check_arguments(comm, arguments, check)
    section, quads = _section(int(divisions[0]), int(divisions[1]))
    layers = int(divisions[2])
    z = np.repeat(np.linspace(0.0, length, layers + 1), len(section))
    points = np.column_stack([np.tile(radius * section, (layers + 1, 1)), z])
    below = np.concatenate([quads + k * len(section) for k in range(layers)])
    cells = np.hstack([below, below + len(section)])
    near = 1e-9 * max(radius, length)
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
            "side": lambda x: abs(np.hypot(x[0], x[1]) - radius) < near,
        },
        cell_groups={"round_bar": lambda x: np.full(x.shape[1], True)},
    )


def _section(n: int, m: int) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Points (k, 2) of the quarter of a unit disc, and its quadrilaterals, their corners x fastest."""
    s = np.linspace(0.0, 1.0, n + 1)
    x, y = np.meshgrid(s, s, indexing="ij")
    # the sides that face the ring bulge out
    core = _CORE * np.stack([x * (1.0 + _BULGE * (1.0 - y**2)), y * (1.0 + _BULGE * (1.0 - x**2))], axis=-1)
    number = np.arange((n + 1) ** 2).reshape(n + 1, n + 1)
    quads = [_corners(number)]
    # along the core's outer border, from the x axis to the y axis
    border = np.concatenate([number[-1], number[-2::-1, -1]])
    angle = np.linspace(0.0, np.pi / 2, 2 * n + 1)
    arc = np.column_stack([np.cos(angle), np.sin(angle)])
    # exactly on the planes of symmetry
    arc[0, 1] = arc[-1, 0] = 0.0
    share = np.linspace(0.0, 1.0, m + 1)[1:, None, None]
    core = core.reshape(-1, 2)
    ring = (1.0 - share) * core[border] + share * arc
    rows = np.vstack([border, len(core) + np.arange(m * (2 * n + 1)).reshape(m, -1)])
    return np.vstack([core, ring.reshape(-1, 2)]), np.vstack([*quads, _corners(rows)])


def _corners(number: NDArray[np.int64]) -> NDArray[np.int64]:
    """Quadrilaterals of a grid of point numbers, the first index fastest."""
    corners = number[:-1, :-1], number[1:, :-1], number[:-1, 1:], number[1:, 1:]
    return np.stack([corner.ravel() for corner in corners], axis=1)
