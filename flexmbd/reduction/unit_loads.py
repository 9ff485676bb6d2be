"""Distributed loads of unit size, and the nodal forces that do the same work.

The generalised forces are the integral of load . v over the initial configuration for each shape
function v of the displacement (Ambrosio & Nikravesh 1992, eq. 35).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import ufl
from dolfinx import fem, la
from dolfinx.mesh import exterior_facet_indices
from numpy.typing import ArrayLike, NDArray

from flexmbd.continuum import compat, parallel
from flexmbd.continuum.finite_elements.discretisation import Discretisation
from flexmbd.continuum.finite_elements.linear_model import LinearModel
from flexmbd.errors import MeshError, ReductionError
from flexmbd.given import checked

FloatArray = NDArray[np.float64]


@checked(error=ReductionError)
@dataclass(frozen=True)
class Pressure:
    """A pressure of 1 Pa on facets of a solid: it pushes against their outward normal.

    Attributes:
        name: of the load.
        facets: the mesh's facet group.
    """

    name: str
    facets: str

    def __str__(self) -> str:
        return f"pressure {self.name!r} on {self.facets!r}"


@checked("name", "facets", error=ReductionError)
@dataclass(frozen=True, eq=False)
class Traction:
    """A force of 1 N/m^2 on facets, of fixed direction in the body; on edges of a shell 1 N/m.

    Attributes:
        name: of the load.
        facets: the mesh's facet group.
        direction: (3,) in the mesh's axes; only where it points is read.

    Raises:
        ReductionError: the direction is not three finite numbers, or zero.
    """

    name: str
    facets: str
    direction: ArrayLike

    def __post_init__(self) -> None:
        object.__setattr__(self, "direction", _unit(self.name, self.direction))

    def __str__(self) -> str:
        return f"traction {self.name!r} along {_text(self.direction)} on {self.facets!r}"


@checked("name", error=ReductionError)
@dataclass(frozen=True, eq=False)
class BodyForce:
    """A force of 1 N/m^3 in all cells, of fixed direction in the body; on a shell 1 N/m^2, on a line 1 N/m.

    Attributes:
        name: of the load.
        direction: (3,) in the mesh's axes; only where it points is read.

    Raises:
        ReductionError: the direction is not three finite numbers, or zero.
    """

    name: str
    direction: ArrayLike

    def __post_init__(self) -> None:
        object.__setattr__(self, "direction", _unit(self.name, self.direction))

    def __str__(self) -> str:
        return f"body force {self.name!r} along {_text(self.direction)}"


Load = Pressure | Traction | BodyForce
"""A distributed load of unit size."""


def check_loads(model: LinearModel, loads: Sequence[Load]) -> None:
    """Refuse loads that are not well formed. Collective.

    Raises:
        ReductionError: on all ranks: something that is not a load, two of one name, or a pressure on a
            mesh that is not a solid.
        MeshError: on all ranks: no such facet group, or it has facets inside the part.
    """
    for load in loads:
        if not isinstance(load, Load):
            raise ReductionError(
                f"a load must be a Pressure, Traction or BodyForce, got {load!r}"
            )
        if isinstance(load, Pressure) and model.mesh.dim != 3:
            raise ReductionError(
                f"load {load.name!r}: a pressure needs facets of a solid; use Traction or BodyForce"
            )
    names = [load.name for load in loads]
    for name in names:
        if names.count(name) > 1:
            raise ReductionError(f"two loads are called {name!r}; give each its own name")
    topology = model.mesh.mesh.topology
    for load in loads:
        if isinstance(load, BodyForce):
            continue
        facets = model.mesh.facets(load.facets)
        topology.create_connectivity(topology.dim - 1, topology.dim)
        own = facets[facets < topology.index_map(topology.dim - 1).size_local]
        inside = len(np.setdiff1d(own, exterior_facet_indices(topology)))
        if model.comm.allreduce(inside) > 0:
            raise MeshError(
                f"load {load.name!r}: the group {load.facets!r} has facets inside the part; tag only "
                "those of its surface"
            )


@checked("model", "loads", error=ReductionError, agree=parallel.told_to_all)
def load_vectors(model: Discretisation, loads: Sequence[Load]) -> FloatArray:
    """Nodal forces of unit loads. Collective.

    Args:
        model: the body.
        loads: k of them, which `check_loads` let pass.

    Returns:
        (owned dofs, k) N per unit of each load, in the mesh's axes.
    """
    forces: FloatArray = np.zeros((model.layout.n_owned, len(loads)), order="F")
    v = ufl.TestFunction(model.space)
    for i, load in enumerate(loads):
        form = ufl.inner(unit_force(model, load), displacement(v)) * measure(model, load)
        vector = fem.assemble_vector(fem.form(form))
        vector.scatter_reverse(la.InsertMode.add)
        forces[:, i] = vector.array[: model.layout.n_owned]
    return forces


def unit_force(model: Discretisation, load: Load) -> ufl.core.expr.Expr:
    """The load per unit of its measure on the initial configuration, in the mesh's axes; not collective."""
    if isinstance(load, Pressure):
        return -ufl.FacetNormal(model.mesh.mesh)
    # a constant, so that another direction is not compiled again
    return fem.Constant(model.mesh.mesh, np.asarray(load.direction))


def measure(model: Discretisation, load: Load) -> ufl.Measure:
    """Where a load is integrated; not collective."""
    mesh = model.mesh
    # exact on straight cells, and for pressures on curved simplices as well
    degree = model.space.ufl_element().embedded_superdegree + 2 * compat.geometry_degree(mesh.mesh)
    metadata = {"quadrature_degree": degree}
    if isinstance(load, BodyForce):
        return ufl.Measure("dx", domain=mesh.mesh, metadata=metadata)
    facets = ufl.Measure("ds", domain=mesh.mesh, subdomain_data=mesh.facet_tags, metadata=metadata)
    return facets(mesh.facet_groups[load.facets])


def displacement(u: ufl.core.expr.Expr) -> ufl.core.expr.Expr:
    """The displacement in an unknown, of which it holds the first three components."""
    return ufl.as_vector([u[i] for i in range(3)])


def _text(direction: ArrayLike) -> str:
    return f"({', '.join(f'{part:.6g}' for part in np.asarray(direction))})"


def _unit(name: str, direction: ArrayLike) -> FloatArray:
    try:
        vector = np.array(direction, dtype=float)
    except (TypeError, ValueError):
        vector = np.zeros(0)
    if vector.shape != (3,) or not np.isfinite(vector).all() or not vector.any():
        raise ReductionError(
            f"load {name!r}: direction must be three finite numbers, not all zero, got {direction!r}"
        )
    unit: FloatArray = vector / np.linalg.norm(vector)
    unit.flags.writeable = False
    return unit
