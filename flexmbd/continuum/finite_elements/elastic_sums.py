"""Sums over a body: its mass, its volume, and its stiffness under uniform strains."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum import parallel
from flexmbd.continuum.compat import cell_nodes
from flexmbd.continuum.contract.dof_layout import DofLayout
from flexmbd.continuum.grid.tagged_mesh import TaggedMesh
from flexmbd.errors import UnitWarning, warn

FloatArray = NDArray[np.float64]

# What solids there are: aerogels to osmium, by a factor or two; waves in diamond; lead, which is soft and heavy.
_LIGHTEST, _HEAVIEST = 0.5, 3e4  # kg/m^3
_FASTEST, _SLOWEST_OF_HEAVY, _HEAVY = 2e4, 100.0, 2000.0  # m/s, m/s, kg/m^3

_VERTICES = {"tetrahedron": (0, 1, 2, 3), "hexahedron": (0, 1, 2, 4)}  # one and its three neighbours


@dataclass(frozen=True)
class ElasticSums:
    """Of a body at rest that nothing holds.

    Attributes:
        mass: kg.
        volume: m^3, of cells with straight edges; 0 of surfaces and lines.
        shear: N m, the mean shear modulus times the volume, of the six simple shears.
        bulk: N m, the mean bulk modulus times the volume, of a uniform expansion.
    """

    mass: float
    volume: float
    shear: float
    bulk: float

    @property
    def wave_speed(self) -> float:
        """m/s, about that of a stretch along a bar; of a beam or plate within a factor of two.

        Of surfaces and lines the slower one of shear and of uniform expansion: stiffness against bending, which may be
        made up, is in the first, and that of volume that is kept in the second.
        """
        modulus = 2.6 * self.shear
        if self.volume == 0.0:
            modulus = min(modulus, 9.0 * self.bulk / 2.0)
        return float(np.sqrt(max(modulus, 0.0) / self.mass))

    @property
    def poisson(self) -> float:
        """Poisson's ratio of a solid."""
        return poissons_ratio(self.shear, self.bulk)


def poissons_ratio(shear: float, bulk: float) -> float:
    """Of an isotropic solid of these moduli, or of these times a volume."""
    return (3.0 * bulk - 2.0 * shear) / (2.0 * (3.0 * bulk + shear))


def elastic_sums(mesh: TaggedMesh, layout: DofLayout, stiffness: PETSc.Mat, mass: PETSc.Mat) -> ElasticSums:
    """Of the body with these matrices. Collective."""
    own = layout.displacement_dofs[: layout.n_owned_nodes]
    u, force = stiffness.createVecRight(), stiffness.createVecLeft()

    def energy(matrix: PETSc.Mat, field: FloatArray) -> float:
        """u^T A u of displacements (owned nodes, 3)."""
        values = np.zeros(layout.n_owned)
        values[own] = field
        u.array[:] = values
        matrix.mult(u, force)
        return float(u.dot(force))

    total = sum(energy(mass, np.tile(axis, (layout.n_owned_nodes, 1))) for axis in np.eye(3)) / 3.0
    shear, bulk = uniform_stiffness(layout, partial(energy, stiffness))
    u.destroy()
    force.destroy()
    occupied = float(mesh.comm.allreduce(float(cell_volumes(mesh).sum())))
    return ElasticSums(total, occupied, shear, bulk)


def uniform_stiffness(layout: DofLayout, work: Callable[[FloatArray], float]) -> tuple[float, float]:
    """Shear and bulk modulus times the volume, N m, as of `ElasticSums`, by uniform strains.

    Args:
        layout: of the unknown.
        work: u . f(u), N m, of displacements (owned nodes, 3) of a unit strain, over all ranks.
    """
    x, axes = layout.node_x[: layout.n_owned_nodes], np.eye(3)
    shears = [work(x[:, [j]] * axes[i]) for i in range(3) for j in range(3) if i != j]
    return sum(shears) / 6.0, work(x) / 9.0


def cell_edges(mesh: TaggedMesh) -> FloatArray:
    """(owned cells, 3, 3) m: three edges of each solid cell from its first vertex; none of surfaces and lines."""
    corners = _VERTICES.get(mesh.mesh.topology.cell_name())
    if corners is None:
        return np.zeros((0, 3, 3))
    owned = mesh.mesh.topology.index_map(3).size_local
    points = mesh.mesh.geometry.x[cell_nodes(mesh.mesh)[:owned, corners]]
    edges: FloatArray = points[:, 1:] - points[:, :1]
    return edges


def cell_volumes(mesh: TaggedMesh) -> FloatArray:
    """(owned cells,) m^3, of cells with straight parallel edges."""
    share = 1.0 / 6.0 if mesh.mesh.topology.cell_name() == "tetrahedron" else 1.0
    volumes: FloatArray = share * np.abs(np.linalg.det(cell_edges(mesh)))
    return volumes


def tell_units(sums: ElasticSums, comm: MPI.Comm) -> None:
    """Warn on rank 0 of density or stiffness that no material has in SI units. Collective.

    Warns:
        UnitWarning: the density, or the speed of waves.
    """
    density = sums.mass / sums.volume if sums.volume > 0.0 else np.nan
    speed = sums.wave_speed
    if density < _LIGHTEST or density > _HEAVIEST:
        odd = f"the body's density is {density:.3g} kg/m^3 ({sums.mass:.3g} kg in {sums.volume:.3g} m^3)"
    elif speed > _FASTEST:
        odd = f"waves run through the body with some {speed:.2g} m/s, faster than through diamond"
    elif density > _HEAVY and speed < _SLOWEST_OF_HEAVY:
        odd = f"waves run through the body with some {speed:.2g} m/s at a density of {density:.3g} kg/m^3"
    else:
        return
    text = (
        f"{odd}, which no material does in SI units: lengths are m, rho kg/m^3 (steel 7850), E Pa (steel 2.1e11). "
        "In another consistent system of units all results are in that system, except gravity and files whose "
        "units are fixed; a material that is soft on purpose is computed as given"
    )
    parallel.on_root(comm, lambda: warn(text, UnitWarning))
