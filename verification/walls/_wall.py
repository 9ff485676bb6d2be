"""Thin walls of one solid-shell through the thickness, or of two where the middle surface is held."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise

from mpi4py import MPI

import numpy as np
from numpy.typing import NDArray

import flexmbd as fm
from flexmbd import meshes
from flexmbd.continuum import NonlinearModel, equilibrium_path, follow
from flexmbd.continuum.history.displacement_newton import Newton
from flexmbd.continuum.slow_loading.body_path import BodyPath
from flexmbd.forms import solid_shell, solid_shell_plasticity
from flexmbd.forms.j2_plasticity import LinearHardening
from verification.reference import Source

FloatArray = NDArray[np.float64]
Place = Callable[[FloatArray, FloatArray], tuple[FloatArray | float, ...]]
Normals = Callable[[FloatArray], FloatArray]

SZE = Source(
    "Sze, Liu & Lo 2004, Finite Elements in Analysis and Design 40:1551, its tables; from MBDyn's tests, which quote "
    "them",
    "10.1016/j.finel.2003.11.001",
)
MACNEAL = Source("MacNeal & Harder 1985, Finite Elements in Analysis and Design 1:3", "10.1016/0168-874X(85)90003-4")


def radial(x: FloatArray) -> FloatArray:
    """Normals of a cylinder about y."""
    return np.asarray(x * [[1.0], [0.0], [1.0]])


class Wall:
    """A wall at rest, its nodes, and what of it is held.

    Attributes:
        body: it.
        x: (nodes, 3) places at rest.
        dofs: (nodes, 3) of displacements.
        held: dofs.
    """

    def __init__(
        self,
        cells: tuple[int, int],
        place: Place,
        thickness: float,
        *,
        E: float,
        nu: float,
        yield_stress: float | None = None,
        hardening: float = 0.0,
        normals: Normals | None = None,
        layers: int = 1,
    ) -> None:
        """Of cells about the surface place(i, j), (i, j) in the unit square; elastic, or hardening linearly."""
        n, m = cells
        i, j = (v.ravel() for v in np.meshgrid(np.linspace(0, 1, n + 1), np.linspace(0, 1, m + 1), indexing="ij"))
        row = np.arange((n + 1) * (m + 1)).reshape(n + 1, m + 1)
        corners = np.stack([row[a : a + n, b : b + m].ravel() for b in (0, 1) for a in (0, 1)], axis=1)
        points = np.stack([np.broadcast_to(v, i.shape) for v in place(i, j)], axis=1).astype(float)
        surface = meshes.from_arrays(
            MPI.COMM_SELF, points, corners, cell="quadrilateral", degree=1, facet_groups={}
        )
        mesh = meshes.wall(surface, thickness, normals=normals, layers=layers)
        if yield_stress is None:
            self.body = NonlinearModel(mesh, solid_shell, solid_shell.Parameters(E=E, nu=nu, rho=1.0), degree=1)
        else:
            metal = solid_shell_plasticity.Parameters(
                E=E, nu=nu, rho=1.0, yield_stress=yield_stress, hardening=LinearHardening(hardening)
            )
            self.body = NonlinearModel(mesh, solid_shell_plasticity, metal, degree=1)
        self.x, self.dofs = self.body.layout.node_x, self.body.layout.displacement_dofs
        self.held: NDArray[np.int32] = np.zeros(0, dtype=np.int32)
        self._round_off = 1e-9 * float(np.ptp(self.x, axis=0).max())

    def on(self, axis: int, value: float) -> NDArray[np.intp]:
        """Nodes of a plane."""
        return np.flatnonzero(abs(self.x[:, axis] - value) < self._round_off)

    def near(self, place: Sequence[float], distance: float) -> NDArray[np.intp]:
        """Nodes of the middle surface and of the faces at a place of it."""
        return np.flatnonzero(np.linalg.norm(self.x - place, axis=1) < distance)

    def hold(self, nodes: NDArray[np.intp], axes: Sequence[int]) -> None:
        """Fix nodes along axes."""
        self.held = np.union1d(self.held, self.dofs[nodes][:, axes].ravel()).astype(np.int32)

    def forces(self, *loads: tuple[NDArray[np.intp], Sequence[float]]) -> FloatArray:
        """(dofs,) of forces (3,), each spread evenly over nodes."""
        found = np.zeros(self.body.n_owned)
        for nodes, force in loads:
            found[self.dofs[nodes]] += np.asarray(force) / len(nodes)
        return found

    def weight(self, per_volume: Sequence[float]) -> FloatArray:
        """(dofs,) of a force per volume (3,)."""
        mass = self.body.mass()  # of density one
        one, found = mass.createVecs()
        one.array[self.dofs] = per_volume
        mass.mult(one, found)
        return np.asarray(found.array.copy())

    def linear(self, force: FloatArray) -> FloatArray:
        """(nodes, 3) displacement, of small strain and rotations."""
        still = np.zeros(self.body.layout.n_local)
        found = Newton(self.body, self.held).solve_columns(self.body.tangent(still), force[:, None])
        return np.asarray(found[:, 0][self.dofs])

    def pulled(
        self, force: FloatArray, shares: Sequence[float], ends: Callable[[FloatArray], list[float]]
    ) -> FloatArray:
        """(shares, k): what ``ends`` takes of the displacement (nodes, 3), under shares of the forces (dofs,)."""
        found: list[list[float]] = []
        for reached, share in pairwise([0.0, *shares]):
            self.path(force, fm.Continuation(to=share), reached=reached)
            found.append(ends(self.body.displacement[self.dofs]))
        return np.array(found)

    def pushed(self, nodes: NDArray[np.intp], axis: int, ways: Sequence[float]) -> FloatArray:
        """(ways,) forces along an axis on nodes that are moved together along it, to one way after the other."""
        moved = self.dofs[nodes][:, axis]
        held = np.union1d(self.held, moved).astype(np.int32)
        drives = np.isin(held, moved)
        sign = np.sign(ways[-1])
        path = follow(
            self.body, [abs(way) for way in ways], prescribed=held,
            displacement=lambda t: np.where(drives, sign * t, 0.0),
        )  # fmt: skip
        forces = {step.t: float(step.reactions[drives].sum()) for step in path.steps}
        return np.array([forces[abs(way)] for way in ways])

    def path(self, force: FloatArray, path: fm.Continuation, *, reached: float = 0.0) -> BodyPath:
        """Equilibria along their arc, under factors times the forces (dofs,)."""
        return equilibrium_path(self.body, path, prescribed=self.held, load=lambda t: t * force, reached=reached)
