"""Damping of a reduced body: the modal matrix D_qq.

All of it acts on the deformation alone: q are displacements relative to the body frame, so that the
frame's motion is not damped.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import ufl
from dolfinx import fem

from flexmbd.continuum.finite_elements import assembly
from flexmbd.continuum.finite_elements.linear_model import LinearModel
from flexmbd.continuum.finite_elements.surface_group import surface_work
from flexmbd.continuum.matrices.blocks import FloatArray, inner, multiply, symmetric
from flexmbd.errors import ReductionError
from flexmbd.given import is_number, numbers


@dataclass(frozen=True)
class ModalDamping:
    """Damping ratios of the record's modes: D_qq = diag(2 zeta_i omega_i).

    The modes are those of the body held at its frame's interface, all else free; where the frame
    floats those of the free body.

    Attributes:
        ratio: zeta, between 0 and 1, for all modes; or one for each, the lowest frequency first.

    Raises:
        ReductionError: a ratio is not a number between 0 and 1.
    """

    ratio: float | Sequence[float]

    def __post_init__(self) -> None:
        ratios = _numbers("damping ratio", self.ratio)
        if not (ratios <= 1.0).all():
            raise ReductionError(
                f"a damping ratio must lie between 0 and 1 (0.02 is two per cent), got {self.ratio!r}"
            )
        if np.ndim(self.ratio) > 0:
            # immutable, and readable in a record's provenance
            object.__setattr__(self, "ratio", tuple(float(ratio) for ratio in ratios))

    def __str__(self) -> str:
        ratios = np.atleast_1d(np.asarray(self.ratio, dtype=float))
        return f"modal, ratio {', '.join(f'{ratio:g}' for ratio in ratios)}"


@dataclass(frozen=True)
class RayleighDamping:
    """D_qq = alpha M_qq + beta K_qq (Rayleigh's proportional damping).

    A mode of angular frequency omega gets the ratio (alpha / omega + beta omega) / 2. The part with
    alpha acts on the motion relative to the body frame, not on that of the frame.

    Attributes:
        alpha: 1/s, not negative.
        beta: s, not negative.

    Raises:
        ReductionError: a value is not a finite number from 0 on.
    """

    alpha: float
    beta: float

    def __post_init__(self) -> None:
        _refuse_no_number("alpha of a Rayleigh damping", self.alpha)
        _refuse_no_number("beta of a Rayleigh damping", self.beta)

    def __str__(self) -> str:
        return f"Rayleigh, alpha {self.alpha:g} 1/s, beta {self.beta:g} s"


@dataclass(frozen=True)
class KelvinVoigtDamping:
    """Viscous stress tau C : strain rate beside the elastic stress C : strain (Anthonis & Ramon 2003, eq. 9-14).

    A mode of angular frequency omega in a body of one tau gets the ratio tau omega / 2.

    Attributes:
        tau: s, not negative: viscosity over stiffness; for all cells, or by the name of each of the
            model's cell groups.

    Raises:
        ReductionError: a value is not a finite number from 0 on.
    """

    tau: float | Mapping[str, float]

    def __post_init__(self) -> None:
        values = self.tau.values() if isinstance(self.tau, Mapping) else [self.tau]
        for value in values:
            _refuse_no_number("tau of a Kelvin-Voigt damping", value)

    def __str__(self) -> str:
        parts = self.tau.items() if isinstance(self.tau, Mapping) else [("all cells", self.tau)]
        return f"Kelvin-Voigt, tau {', '.join(f'{value:g} s in {name}' for name, value in parts)}"


Damping = ModalDamping | RayleighDamping | KelvinVoigtDamping
"""How the deformation of a body is damped."""


def check_damping(model: LinearModel, damping: Damping | None) -> None:
    """Refuse a damping that does not fit the model; the same on every rank, not collective.

    Raises:
        ReductionError: it is none, or names other cell groups than the model's; a formulation's dissipation has no
            matrix, or the body is in a loaded state.
    """
    _check_dissipation(model)
    if damping is not None and not isinstance(damping, Damping):
        raise ReductionError(
            "damping must be a ModalDamping, RayleighDamping or KelvinVoigtDamping, got "
            f"{damping!r}; for a damping ratio write ModalDamping({damping!r})"
        )
    if isinstance(damping, KelvinVoigtDamping) and isinstance(damping.tau, Mapping):
        names = [group.name for group in model.groups]
        if set(damping.tau) != set(names):
            known = ", ".join(repr(name) for name in names if name is not None)
            raise ReductionError(
                f"tau is given for {', '.join(map(repr, damping.tau))}; give one number, or one for "
                f"each cell group of the model{': ' + known if known else ', which has none'}"
            )


def has_dissipation(model: LinearModel) -> bool:
    """Whether formulations of the model have a dissipation of their own."""
    return any(group.optional.dissipation is not None for group in model.groups)


def modal_damping(
    model: LinearModel, damping: Damping | None, *, modes: FloatArray, stiffness: FloatArray
) -> FloatArray:
    """D_qq (n, n), 1/s, symmetric: what is asked for, and what formulations dissipate. Collective.

    The same to the bit on every rank.

    Args:
        model: the body.
        damping: which `check_damping` let pass; None: that of the formulations alone.
        modes: (owned dofs, n) in normal form.
        stiffness: (n,) 1/s^2, the diagonal of K_qq.

    Raises:
        ReductionError: not one ratio for each mode.
    """
    given = _given_damping(model, damping, modes=modes, stiffness=stiffness)
    if not has_dissipation(model):
        return given
    v, w = fem.Function(model.space), ufl.TestFunction(model.space)
    forces = [ufl.derivative(term, v, w) for term in assembly.dissipation(model.groups, v)]
    return given + _projected(model, "dissipation", assembly.derivatives_at_rest(forces, v), modes=modes)


def spring_stiffness(model: LinearModel, *, modes: FloatArray) -> FloatArray | None:
    """K_qq (n, n), 1/s^2, of springs on facets alone; None where there are none. Collective.

    The same to the bit on every rank.

    Args:
        model: the body.
        modes: (owned dofs, n) in normal form.
    """
    if not model.has_surface_energy:
        return None
    u, v = fem.Function(model.space), ufl.TestFunction(model.space)
    forms = assembly.derivatives_at_rest(surface_work(model.surfaces, u, v), u)
    return _projected(model, "stiffness of springs on facets", forms, modes=modes)


def _check_dissipation(model: LinearModel) -> None:
    if not has_dissipation(model):
        return
    if model.state is not None:
        raise ReductionError(
            f"the dissipation of {model.form_name} is that of small motions about rest, and the body is reduced about "
            "a loaded state; give the form no dissipation, and craig_bampton a damping"
        )
    v = fem.Function(model.space)
    for term in assembly.dissipation(model.groups, v):
        third = ufl.derivative(ufl.derivative(ufl.derivative(term, v), v), v)
        if not ufl.algorithms.expand_derivatives(third).empty():
            raise ReductionError(
                f"the dissipation of {model.form_name} is not quadratic in the rates, so that no damping matrix has "
                "its forces; write one that is quadratic"
            )


def _given_damping(
    model: LinearModel, damping: Damping | None, *, modes: FloatArray, stiffness: FloatArray
) -> FloatArray:
    n = len(stiffness)
    if damping is None:
        return np.zeros((n, n))
    if isinstance(damping, ModalDamping):
        ratios = np.atleast_1d(np.asarray(damping.ratio, dtype=float))
        if np.ndim(damping.ratio) > 0 and len(ratios) != n:
            raise ReductionError(
                f"{len(ratios)} damping ratios for {n} modes; give one for all, or one for each"
            )
        return np.diag(2.0 * np.broadcast_to(ratios, n) * np.sqrt(stiffness))
    if isinstance(damping, RayleighDamping):
        return np.diag(damping.alpha + damping.beta * stiffness)
    if not isinstance(damping.tau, Mapping) and model.state is None and not model.has_surface_energy:
        return np.diag(damping.tau * stiffness)
    # of a loaded body, or with springs on facets, the stiffness has a part that is no stress times a strain
    return _projected(model, "viscosity", _viscosity(model, damping.tau), modes=modes)


def _projected(model: LinearModel, name: str, forms: list[fem.Form], *, modes: FloatArray) -> FloatArray:
    """(n, n) of a matrix given by its bilinear forms. Collective."""
    (matrix,) = assembly.assemble({name: forms}, model.groups, model.space)
    viscous: FloatArray = symmetric(inner(model.comm, modes, multiply(matrix, modes)))
    matrix.destroy()
    return viscous


def _viscosity(model: LinearModel, tau: float | Mapping[str, float]) -> list[fem.Form]:
    """The stiffness at rest with the part of each cell group times its tau. Collective."""
    u, v = fem.Function(model.space), ufl.TestFunction(model.space)
    terms = [
        fem.Constant(model.mesh.mesh, float(tau[str(group.name)] if isinstance(tau, Mapping) else tau)) * form
        for group in model.groups
        for form in assembly.internal_work([group], u, v)
    ]
    return assembly.derivatives_at_rest(terms, u)


def _numbers(what: str, value: object) -> FloatArray:
    """The value as numbers (k,), each finite and not negative."""
    found = np.atleast_1d(numbers(value))
    # written so that NaN fails
    if found.ndim != 1 or not ((found >= 0.0) & np.isfinite(found)).all():
        raise ReductionError(f"{what} must be a finite number from 0 on, got {value!r}")
    return found


def _refuse_no_number(what: str, value: object) -> None:
    if not is_number(value) or not numbers(value) >= 0.0:
        raise ReductionError(f"{what} must be a finite number from 0 on, got {value!r}")
