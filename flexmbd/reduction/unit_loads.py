"""Distributed loads of unit size, and the nodal forces that do the same work.

The generalised forces are the integral of load . v over the initial configuration for each shape
function v of the displacement (Ambrosio & Nikravesh 1992, eq. 35).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import ufl
from dolfinx import fem, la
from dolfinx.mesh import exterior_facet_indices
from numpy.typing import ArrayLike, NDArray

from flexmbd.continuum import compat, parallel
from flexmbd.continuum.finite_elements.discretisation import Discretisation
from flexmbd.continuum.finite_elements.held_expansion import held_expansion
from flexmbd.continuum.finite_elements.linear_model import LinearModel
from flexmbd.continuum.finite_elements.temperature import (
    checked_rise,
    refuse_nonlinear_expansion,
    refuse_without_expansion,
    rise_function,
)
from flexmbd.errors import FormulationError, MeshError, ReductionError
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


@checked("name", error=ReductionError)
@dataclass(frozen=True, eq=False, repr=False)
class TemperatureRise:
    """A rise of temperature above that at which the body is free of stress; its size is dimensionless.

    Attributes:
        name: of the load.
        rise: K: a number, a function of points (n, 3) m in the mesh's axes that gives (n,), or the values (nodes,) at
            the mesh's nodes in the order of its input.

    Raises:
        ReductionError: the rise is none of these.
    """

    name: str
    rise: Any = 1.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "rise", checked_rise(self.rise, f"load {self.name!r}", kind=ReductionError))

    def __repr__(self) -> str:
        """As text: the same on all ranks, as the address of a function is not."""
        return f"<{self}>"

    def __str__(self) -> str:
        if callable(self.rise):
            return f"temperature {self.name!r}, a function of points"
        if self.rise.ndim:
            return f"temperature {self.name!r}, {self.rise.min():g} to {self.rise.max():g} K"
        return f"temperature {self.name!r}, {self.rise:g} K"


Load = Pressure | Traction | BodyForce | TemperatureRise
"""A load of unit size on the whole body or on facets."""


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
                f"a load must be a Pressure, Traction, BodyForce or TemperatureRise, got {load!r}"
            )
        if isinstance(load, TemperatureRise):
            _check_expansion(model, load)
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
        if isinstance(load, (BodyForce, TemperatureRise)):
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
        (owned dofs, k) N per unit of each load, in the mesh's axes. Of a rise of temperature the forces that strain
        the body as the rise does, whose stress is that of the strain less the expansion.
    """
    forces: FloatArray = np.zeros((model.layout.n_owned, len(loads)), order="F")
    v = ufl.TestFunction(model.space)
    for i, load in enumerate(loads):
        if isinstance(load, TemperatureRise):
            if not isinstance(model, LinearModel):
                raise ReductionError(
                    f"load {load.name!r}: the temperature of a body with history is no force; give it among the loads "
                    "of follow, ImplicitContinuum or ExplicitContinuum, as Heating(...)"
                )
            forces[:, i] = -held_expansion(model).forces(rise_of(model, load))
            continue
        work = ufl.inner(unit_force(model, load), displacement(v)) * measure(model, load)
        vector = fem.assemble_vector(fem.form(work))
        vector.scatter_reverse(la.InsertMode.add)
        forces[:, i] = vector.array[: model.layout.n_owned]
    return forces if model.ties is None else model.ties.condense_dofs(forces)


def rise_of(model: Discretisation, load: TemperatureRise) -> fem.Function:
    """The rise of temperature of a load as a function on the mesh, K. Collective.

    Raises:
        ReductionError: on all ranks: it gives no finite value at each node.
    """
    return rise_function(model, load.rise, f"load {load.name!r}", kind=ReductionError)


def whole_rise(model: Discretisation, loads: Sequence[Load], sizes: FloatArray) -> fem.Function | None:
    """The sum of the temperatures among loads, each times its size, K; None where there are none. Collective."""
    whole: fem.Function | None = None
    for load, size in zip(loads, sizes, strict=True):
        if not isinstance(load, TemperatureRise):
            continue
        rise = rise_of(model, load)
        rise.x.array[:] *= size
        if whole is not None:
            rise.x.array[:] += whole.x.array
        whole = rise
    return whole


def _check_expansion(model: LinearModel, load: TemperatureRise) -> None:
    """Refuse a temperature that strains nothing, or whose load would not be one of unit size. Not collective."""
    try:
        refuse_without_expansion(model.groups)
        refuse_nonlinear_expansion(model.groups)
    except FormulationError as error:
        raise ReductionError(f"load {load.name!r}: {error}") from error


def unit_force(model: Discretisation, load: Pressure | Traction | BodyForce) -> ufl.core.expr.Expr:
    """The load per unit of its measure on the initial configuration, in the mesh's axes; not collective."""
    if isinstance(load, Pressure):
        return -ufl.FacetNormal(model.mesh.mesh)
    # a constant, so that another direction is not compiled again
    return fem.Constant(model.mesh.mesh, np.asarray(load.direction))


def measure(model: Discretisation, load: Pressure | Traction | BodyForce) -> ufl.Measure:
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
