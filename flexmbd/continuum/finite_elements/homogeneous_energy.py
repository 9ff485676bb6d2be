"""A strain energy W(F) written in UFL, compiled to a C function for pseudo-rigid bodies."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any, TypeAlias

from mpi4py import MPI

import basix.ufl
import dolfinx.jit
import numpy as np
import ufl

from flexmbd.continuum import parallel
from flexmbd.continuum.contract import formulation
from flexmbd.continuum.contract.entries import has_facet_terms, optional_entries
from flexmbd.errors import FlexmbdError, FormulationError
from flexmbd.given import checked
from flexmbd.multibody.bodies.homogeneous import CompiledEnergy

Expr: TypeAlias = ufl.core.expr.Expr
EnergyDensity: TypeAlias = Callable[[Expr], Expr]

_CELL = "tetrahedron"  # F is the same throughout, so that any would do


@checked("comm", error=FormulationError)
def homogeneous_energy(
    source: EnergyDensity | ModuleType | str | Path, parameters: Any = None, *, comm: MPI.Comm = MPI.COMM_WORLD
) -> CompiledEnergy:
    """Compile an energy, its stress and its tangent as one C function of F. Collective; compiles.

    Args:
        source: a function that takes F, a UFL expression (3, 3), and returns W (J/m^3); or a formulation of solids, as
            `ContinuumModel` takes it, whose strain energy is taken for the homogeneous displacement (F - 1) X.
        parameters: the formulation's; none with a function.
        comm: the ranks that compile together.

    Returns:
        For `flexmbd.PseudoRigidBody`; it lives as long as the compiled code does, in this process alone.

    Raises:
        FormulationError: on all ranks: no scalar, a formulation that breaks its contract or has no strain energy of a
            displacement alone, or parameters that are not its own.
        SceneError: on all ranks: not finite at F = 1, or it changes as the body turns.
    """
    domain = ufl.Mesh(basix.ufl.element("Lagrange", _CELL, 1, shape=(3,)))
    F = ufl.variable(ufl.Constant(domain, shape=(3, 3)))
    is_module = isinstance(source, (ModuleType, str, Path))
    try:
        name, W = _of_form(source, parameters, F, domain) if is_module else _of_function(source, parameters, F)
    except FlexmbdError:
        raise
    except Exception as reason:
        raise FormulationError(f"the energy cannot be written as UFL of F: {reason}") from reason
    if not isinstance(W, ufl.core.expr.Expr) or W.ufl_shape != () or W.ufl_free_indices:
        raise FormulationError(f"energy {name}: it must be a UFL scalar, got {W!r:.80}")
    stress = ufl.diff(W, F)
    tangent = ufl.diff(stress, F)
    i = range(3)
    values = [W, *(stress[a, b] for a in i for b in i)]
    values += [tangent[a, b, c, d] for a in i for b in i for c in i for d in i]
    whole = ufl.algorithms.expand_derivatives(ufl.as_vector(values))
    kept = dolfinx.jit.ffcx_jit(comm, (whole, np.full((1, 3), 0.25)))
    compiled, module, _ = kept
    address = int(module.ffi.cast("intptr_t", compiled.tabulate_tensor_float64))
    error: Exception | None = None
    try:
        energy = CompiledEnergy(address, name, kept)
    except FlexmbdError as reason:
        error = reason
    parallel.raise_collectively(comm, error)
    return energy


def _of_function(source: Any, parameters: Any, F: Expr) -> tuple[str, Any]:
    if parameters is not None:
        raise FormulationError("parameters belong to a formulation; a function of F contains its numbers itself")
    return getattr(source, "__name__", "W"), source(F)


def _of_form(source: Any, parameters: Any, F: Expr, domain: ufl.Mesh) -> tuple[str, Any]:
    """Name and energy of a formulation at the displacement (F - 1) X, whose gradient is F - 1."""
    form = formulation.load_form(source)
    name = str(getattr(form, "__name__", source)).rpartition(".")[2]
    if not isinstance(parameters, form.Parameters):
        raise FormulationError(f"{name}: parameters must be its Parameters, got {parameters!r}")
    element = form.element(_CELL, 3, 1) if _CELL in form.CELLS else None
    if optional_entries(form).strain_energy is None or element is None or element.reference_value_shape != (3,):
        raise FormulationError(f"{name}: a pseudo-rigid body needs the strain energy of a solid's displacement alone")
    if optional_entries(form).dissipation is not None:
        raise FormulationError(f"{name} has a dissipation, whose forces a pseudo-rigid body would leave out")
    if optional_entries(form).gyroscopic is not None:
        raise FormulationError(f"{name} has gyroscopic(u, v, p), whose forces a pseudo-rigid body would leave out")
    if has_facet_terms(form):
        raise FormulationError(f"{name} has terms on facets, which a pseudo-rigid body would leave out")
    u = ufl.Coefficient(ufl.FunctionSpace(domain, element))
    W = sum((term for term, _ in form.strain_energy(u, parameters)), ufl.as_ufl(0.0))
    return name, ufl.replace(W, {u: ufl.dot(F - ufl.Identity(3), ufl.SpatialCoordinate(domain))})
