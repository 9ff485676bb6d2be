"""Rigid bodies and solids from meshes: mass, centre and second moments by quadrature (eq. 8.20-8.25).

Equation numbers are those of Zienkiewicz, Taylor & Fox, "The finite element method for solid and structural
mechanics", section 8.3.2.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from mpi4py import MPI

import basix
import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum import parallel
from flexmbd.continuum.compat import cell_nodes
from flexmbd.continuum.finite_elements.gram_matrix import gram_matrix
from flexmbd.continuum.finite_elements.linear_model import LinearModel
from flexmbd.continuum.finite_elements.mesh_outline import outline_of
from flexmbd.continuum.grid.tagged_mesh import TaggedMesh
from flexmbd.continuum.matrices.blocks import symmetric
from flexmbd.errors import MeshError
from flexmbd.given import checked
from flexmbd.multibody.bodies.body import RigidBody
from flexmbd.multibody.bodies.solid import Solid

FloatArray = NDArray[np.float64]
Density = float | Mapping[str, float]

_BATCH = 10_000  # cells looked at in one go, which bounds the memory
# Integrals held together: volume; then mass, mass times x, mass times x x^T.
_VOLUME, _MASS, _FIRST, _SECOND, _N = 0, 1, slice(2, 5), slice(5, 14), 14


@checked("body", error=MeshError, agree=parallel.told_to_all)
def rigid_body_of(body: LinearModel | TaggedMesh, *, density: Density | None = None) -> RigidBody:
    """A rigid body with the mass of a continuum body, its frame in the mesh's axes. Collective.

    Args:
        body: a model, whose own consistent mass is taken, beams and shells included; or a mesh of solid cells.
        density: of a mesh, kg/m^3: a number, or one for each cell group.

    Returns:
        The same numbers on every rank.

    Raises:
        MeshError: on all ranks: a density with a model, or none with a mesh; one that is not positive; groups that
            leave cells without a density; a mesh of lines or surfaces.
        FormulationError: on all ranks: a kinetic energy that has no Gram matrix.
    """
    if not isinstance(body, LinearModel):
        return RigidBody.from_solid(_mesh_solid(body, density))
    _refuse_density(density)
    mass, com, second = _model_moments(body)
    return RigidBody(mass, np.trace(second) * np.eye(3) - second, tuple(map(float, com)))


@checked("body", error=MeshError, agree=parallel.told_to_all)
def solid_of(body: LinearModel | TaggedMesh, *, density: Density | None = None) -> Solid:
    """The mass integrals of a body of solid cells and its outline, in the mesh's axes. Collective.

    Args:
        body: a model, whose own consistent mass is taken; or a mesh.
        density: of a mesh, kg/m^3: a number, or one for each cell group.

    Returns:
        The same numbers on every rank.

    Raises:
        MeshError, FormulationError: as `rigid_body_of`; also for a model of lines or surfaces, which have no volume
            of their own.
    """
    if isinstance(body, LinearModel):
        _refuse_density(density)
        volume = float(_integrals(body.mesh, 1.0)[0][_VOLUME])
        weight, centre, moments = _model_moments(body)
        return Solid(weight, volume, centre, moments, outline=outline_of(body.mesh))
    return replace(_mesh_solid(body, density), outline=outline_of(body))


def _mesh_solid(body: TaggedMesh, density: Density | None) -> Solid:
    """As `solid_of`, without what pictures need. Collective."""
    if density is None:
        raise MeshError("a mesh has no mass of its own: give density=, in kg/m^3")
    sums, middle = _integrals(body, density)
    mass = float(sums[_MASS])
    com = np.asarray(sums[_FIRST] / mass, np.float64)
    second = sums[_SECOND].reshape(3, 3) - mass * np.outer(com, com)
    return Solid(mass, float(sums[_VOLUME]), com + middle, symmetric(second))


def _refuse_density(density: Density | None) -> None:
    if density is not None:
        raise MeshError("a model has the density of its parameters: leave density out, or give the mesh")


def _model_moments(model: LinearModel) -> tuple[float, FloatArray, FloatArray]:
    """Mass, centre, and second moments about it. Collective."""
    middle = _middle(model.mesh)
    gram = gram_matrix(model, np.zeros((model.n_owned, 0)), p=middle, R=np.eye(3))
    mass = float(gram[0, 0])
    com = np.asarray(gram[0, 1:4] / mass, np.float64)
    return mass, com + middle, symmetric(gram[1:4, 1:4] - mass * np.outer(com, com))


def _integrals(mesh: TaggedMesh, density: Density) -> tuple[FloatArray, FloatArray]:
    """Integrals (14,) of positions from a point (3,) in the middle, and that point. Collective."""
    if mesh.dim != 3:
        kind = "lines" if mesh.dim == 1 else "surfaces"
        raise MeshError(
            f"a mesh of {kind} has no volume: give a model with sections, or for a closed surface its triangles to "
            "RigidBody.from_surface"
        )
    rho = _cell_densities(mesh, density)
    x, nodes = mesh.mesh.geometry.x, cell_nodes(mesh.mesh)
    element = mesh.mesh.ufl_domain().ufl_coordinate_element().basix_element
    # x x^T has twice the geometry's degree, its Jacobian determinant thrice at most
    points, weights = basix.make_quadrature(element.cell_type, 5 * element.degree)
    table = element.tabulate(1, points)[:, :, :, 0]
    middle = _middle(mesh)
    sums = np.zeros(_N)
    for start in range(0, len(rho), _BATCH):
        part = slice(start, min(start + _BATCH, len(rho)))
        corners = x[nodes[part]] - middle
        place = np.einsum("cni,qn->cqi", corners, table[0], optimize=True)
        jacobian = np.einsum("cni,kqn->cqik", corners, table[1:], optimize=True)
        volume = abs(np.linalg.det(jacobian)) * weights
        mass = volume * rho[part, None]
        sums[_VOLUME] += volume.sum()
        sums[_MASS] += mass.sum()
        sums[_FIRST] += np.einsum("cq,cqi->i", mass, place)
        sums[_SECOND] += np.einsum("cq,cqi,cqj->ij", mass, place, place, optimize=True).ravel()
    # summed on one rank, because a sum may depend on the rank that makes it
    total: FloatArray = mesh.comm.bcast(mesh.comm.reduce(sums, root=0), root=0)
    return total, middle


def _middle(mesh: TaggedMesh) -> FloatArray:
    """(3,) m, the middle of the mesh's extent, so that sums of products lose no digits. Collective."""
    x = mesh.mesh.geometry.x
    low, high = np.min(x, axis=0, initial=np.inf), np.max(x, axis=0, initial=-np.inf)
    mesh.comm.Allreduce(MPI.IN_PLACE, low, op=MPI.MIN)
    mesh.comm.Allreduce(MPI.IN_PLACE, high, op=MPI.MAX)
    middle: FloatArray = 0.5 * (low + high)
    return middle


def _cell_densities(mesh: TaggedMesh, density: Density) -> FloatArray:
    """(cells that this rank owns,) kg/m^3. Collective."""
    parallel.check_same(mesh.comm, MeshError, density=density)
    named = density if isinstance(density, Mapping) else {None: density}
    bad = {name: value for name, value in named.items() if not (np.isfinite(value) and value > 0.0)}
    if bad or not named:
        listed = ", ".join(f"{value}" if name is None else f"{value} of {name!r}" for name, value in bad.items())
        raise MeshError(f"density must be positive (kg/m^3), got {listed or 'none'}")
    owned = mesh.mesh.topology.index_map(mesh.dim).size_local
    rho: FloatArray = np.full(owned, np.nan)
    for name, value in named.items():
        cells = np.arange(owned) if name is None else mesh.cells(name)
        rho[cells[cells < owned]] = value
    bare = mesh.comm.allreduce(int(np.isnan(rho).sum()))
    if bare:
        raise MeshError(f"{bare} cells are in none of the groups {sorted(map(str, named))}, and have no density")
    return rho
