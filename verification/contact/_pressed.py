"""Blocks with contact patches that a rigid ball or roller is pressed into, for Hertz's problems."""

from __future__ import annotations

import itertools
from collections.abc import Callable

from mpi4py import MPI

import numpy as np
import scipy.sparse
import scipy.sparse.linalg
from scipy.optimize import brentq, nnls

import flexmbd as fm
from flexmbd import contact, meshes
from flexmbd.continuum import ContinuumModel, Interface, SymmetryPlane
from flexmbd.forms import solid_linear
from flexmbd.record.pressed_patches import contact_patches
from flexmbd.reduction import Patch, craig_bampton

E, NU, RADIUS = 1.0e7, 0.3, 1.0  # Pa, and m of the ball
MODULUS = E / (1.0 - NU**2)
#: m, the part of the surface that has patches; the block goes on to 1 m.
FINE = 0.25


def quarter_block(cells: int, *, through: int | None = None) -> meshes.TaggedMesh:
    """A quarter of a block of 2 x 2 x 1 m below z = 0, of equal cells where it is touched, coarser outside.

    Args:
        cells: along x in the part that is touched.
        through: None: as many along y. A number: the block is a slice along y, as thick as so many of these cells.
    """
    near = np.linspace(0.0, FINE, cells + 1)
    side = np.concatenate([near, FINE * (1.0 / FINE) ** (np.arange(1, 6) / 5)])
    width = side if through is None else near[: through + 1]
    depth = np.concatenate([[0.0], np.cumsum(np.geomspace(1.0, 7.0, cells))])
    depth = -depth[::-1] / depth[-1]
    x = np.array([(a, b, c) for c, b, a in itertools.product(depth, width, side)])
    number = np.arange(len(x)).reshape(len(depth), len(width), len(side))
    # corners along x, then y, then z
    rows = np.stack([
        number[k : len(depth) - 1 + k, j : len(width) - 1 + j, i : len(side) - 1 + i].ravel()
        for k, j, i in itertools.product((0, 1), repeat=3)
    ], axis=1)  # fmt: skip
    thick = width[-1]
    groups: dict[str, Callable[[np.ndarray], np.ndarray]] = {
        "foot": lambda x: x[2] < -1.0 + 1e-9,
        "across_x": lambda x: x[0] < 1e-9,
        "across_y": lambda x: x[1] < 1e-9,
        "behind_y": lambda x: x[1] > thick - 1e-9,
    }
    if through is None:
        del groups["behind_y"]
    return meshes.from_arrays(MPI.COMM_SELF, x, rows, cell="hexahedron", degree=1, facet_groups=groups)


def reduced(mesh: meshes.TaggedMesh, *, size: float, modes: int) -> fm.ReducedBody:
    """Held at its foot, with patches of a size (m) where it is touched."""
    planes = [
        SymmetryPlane(name, (1, 0, 0) if name.endswith("x") else (0, 1, 0))
        for name in mesh.facet_groups if name != "foot"
    ]  # fmt: skip
    model = ContinuumModel(
        mesh, solid_linear, solid_linear.Parameters(E=E, nu=NU, rho=1000.0), degree=2,
        interfaces=[Interface("foot", origin=(0, 0, -1))], supports=planes,
    )  # fmt: skip
    spot = Patch("spot", size=size, facets=lambda x: (x[2] > -1e-9) & (x[0] < FINE + 1e-9) & (x[1] < FINE + 1e-9))
    return craig_bampton(model, modes=modes, frame="foot", contact=[spot], geometric_stiffness=False)


def pressed(body: fm.ReducedBody, approach: float, *, is_ball: bool) -> contact.PressedPatches:
    """By a rigid ball, or a roller along y, that comes in by so much (m)."""
    x = contact_patches(body).x
    squares = x[:, 0] ** 2 + (x[:, 1] ** 2 if is_ball else 0.0)
    return contact.press(body, gap=squares / (2.0 * RADIUS) - approach, normal=(0, 0, -1))


def approach_of(body: fm.ReducedBody, force: float, *, is_ball: bool) -> float:
    """m, at which the patches bear a force (N)."""
    found = brentq(lambda d: pressed(body, d, is_ball=is_ball).force.sum() - force, 1e-4, 0.2, xtol=1e-12)
    return float(found)


def unreduced_approach_of_ball(mesh: meshes.TaggedMesh, force: float) -> float:
    """m, at which the nodes of a quarter block bear a force (N): each of them touches or does not.

    By the sparse stiffness of all nodes, and forces by least squares without negative ones.
    """
    material = solid_linear.Parameters(E=E, nu=NU, rho=1000.0)
    model = ContinuumModel(mesh, solid_linear, material, degree=2, interfaces=[Interface("foot")])
    pointers, columns, values = model.K.getValuesCSR()
    x = model.node_x
    moves = np.column_stack([x[:, 0] > 1e-9, x[:, 1] > 1e-9, np.full(len(x), True)]) & (x[:, 2:] > -1.0 + 1e-9)
    free = np.flatnonzero(moves.ravel())
    K = scipy.sparse.csr_array((values, columns, pointers), (x.size, x.size))[free][:, free].tocsc()
    factor = scipy.sparse.linalg.splu(K, permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True})
    touched = np.flatnonzero((x[:, 2] > -1e-9) & (np.hypot(x[:, 0], x[:, 1]) < 1.05 * FINE))
    rows = np.searchsorted(free, 3 * touched + 2)
    A = np.array([factor.solve(np.eye(1, len(free), row).ravel())[rows] for row in rows])
    L = np.linalg.cholesky(0.5 * (A + A.T))
    gap = (x[touched, 0] ** 2 + x[touched, 1] ** 2) / (2.0 * RADIUS)

    def lacking(approach: float) -> float:
        return float(nnls(L.T, np.linalg.solve(L, approach - gap))[0].sum() - force)

    return float(brentq(lacking, 1e-4, 0.2, xtol=1e-9))
