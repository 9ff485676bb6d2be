"""Damping of a reduced body: the modal matrix D_qq.

All of it acts on the deformation alone, by the rule of `flexmbd.record.held_modes`: it takes no power of a rigid
motion, and what it takes of another does not depend on what carries the body frame.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from petsc4py import PETSc

import numpy as np
import ufl
from dolfinx import fem

from flexmbd.continuum import parallel
from flexmbd.continuum.finite_elements import assembly
from flexmbd.continuum.finite_elements.cell_group import CellGroup
from flexmbd.continuum.finite_elements.held_surface import held_dofs
from flexmbd.continuum.finite_elements.linear_model import LinearModel
from flexmbd.continuum.finite_elements.surface_group import surface_work
from flexmbd.continuum.matrices.blocks import FloatArray, inner, multiply, symmetric
from flexmbd.errors import InterfaceError, ReductionError
from flexmbd.given import is_list, is_number, numbers, shown
from flexmbd.record.held_modes import HeldModes, held_modes
from flexmbd.record.reduced_body import InterfaceFrame
from flexmbd.round_off import EQUAL


@dataclass(frozen=True)
class ModalDamping:
    """Damping ratios of the body's modes: of the free body, or of the one that is held at interfaces.

    A free body whose modes have the ratio zeta, clamped at its root, has less: a uniform beam 0.07 zeta in its first
    mode, 0.66 zeta in its second (docs/damping.md).

    Attributes:
        ratio: zeta, between 0 and 1, for all modes; or one for each, the lowest frequency first.
        held: names of the interfaces that do not move in these modes; none: the body is free. How interfaces that are
            held move against each other is damped by nothing.

    Raises:
        ReductionError: a ratio is not a number between 0 and 1; `held` is no list of names.
    """

    ratio: float | Sequence[float]
    held: Sequence[str] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "held", _names(self.held))
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
        return f"modal, ratio {', '.join(f'{ratio:g}' for ratio in ratios)}, {_state(self.held)}"


@dataclass(frozen=True)
class RayleighDamping:
    """Rayleigh's proportional damping of the deformation: alpha times its mass, and beta times the stiffness.

    A mode of angular frequency omega of the free body, or of the one that is held at interfaces, gets the ratio
    (alpha / omega + beta omega) / 2. The part with alpha pulls at the motion without its rigid part, that of the
    body's momentum, or that of the interface that is held.

    Attributes:
        alpha: 1/s, not negative.
        beta: s, not negative.
        held: names of the interfaces that do not move in the deformation that alpha takes; none: the body is free.

    Raises:
        ReductionError: a value is not a finite number from 0 on; `held` is no list of names.
    """

    alpha: float
    beta: float
    held: Sequence[str] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "held", _names(self.held))
        _refuse_no_number("alpha of a Rayleigh damping", self.alpha)
        _refuse_no_number("beta of a Rayleigh damping", self.beta)

    def __str__(self) -> str:
        return f"Rayleigh, alpha {self.alpha:g} 1/s, beta {self.beta:g} s, {_state(self.held)}"


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
        InterfaceError: it holds an interface that the model has not.
        ReductionError: it is none, or names other cell groups than the model's; a formulation's dissipation has no
            matrix, or the body is in a loaded state.
    """
    _check_dissipation(model)
    if damping is not None and not isinstance(damping, Damping):
        raise ReductionError(
            "damping must be a ModalDamping, RayleighDamping or KelvinVoigtDamping, got "
            f"{damping!r}; for a damping ratio write ModalDamping({damping!r})"
        )
    if isinstance(damping, ModalDamping | RayleighDamping):
        for name in damping.held:
            model.interface(name)  # which says what there is
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
    model: LinearModel,
    damping: Damping | None,
    *,
    modes: FloatArray,
    stiffness: FloatArray,
    gram: FloatArray,
    interfaces: Sequence[InterfaceFrame],
    p: FloatArray,
    R: FloatArray,
) -> FloatArray:
    """D_qq (n, n), 1/s, symmetric: of the damping given and of the formulations' dissipation. Collective.

    The same to the bit on every rank.

    Args:
        model: the body.
        damping: which `check_damping` let pass; None: that of the formulations alone.
        modes: (owned dofs, n) in normal form.
        stiffness: (n,) 1/s^2, the diagonal of K_qq.
        gram: (4 + 3 n, 4 + 3 n) mass integrals of the record.
        interfaces: the record's.
        p: (3,) m, the body frame's origin in the mesh's axes.
        R: (3, 3) rotation from the body frame's axes to the mesh's.

    Raises:
        InterfaceError: an interface that is held has no frame in the record.
        ReductionError: not one ratio for each mode.
    """
    if isinstance(damping, ModalDamping | RayleighDamping):
        free = None if damping.held else _rigid_motions(model, p=p, R=R)
        chosen = [_frame(name, interfaces) for name in damping.held]
        given = parallel.on_root(
            model.comm, lambda: _of_modes(damping, held_modes(gram, stiffness, chosen, rigid=free), stiffness)
        )
    else:
        given = _viscous_damping(model, damping, modes=modes, stiffness=stiffness)
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


def _of_modes(damping: ModalDamping | RayleighDamping, modes: HeldModes, stiffness: FloatArray) -> FloatArray:
    if isinstance(damping, RayleighDamping):
        return damping.alpha * modes.mass() + damping.beta * np.diag(stiffness)
    ratios, m = np.asarray(damping.ratio, dtype=float), len(modes.period)
    if ratios.ndim > 0 and len(ratios) != m:
        raise ReductionError(f"{len(ratios)} damping ratios for {m} modes; give one for all, or one for each")
    return symmetric(modes.damping(ratios))


def _frame(name: str, interfaces: Sequence[InterfaceFrame]) -> InterfaceFrame:
    for one in interfaces:
        if one.name == name:
            return one
    raise InterfaceError(
        f"the damping holds interface {name!r}, of which the record has no frame: it has interface modes; keep its six "
        "shapes (InterfaceModes(joints=...)), or hold another"
    )


def _rigid_motions(model: LinearModel, *, p: FloatArray, R: FloatArray) -> FloatArray | None:
    """(6, r) the rigid motions of the body frame, along its axes, that supports leave; None: all. Collective.

    A part of which a half is meshed is free along its plane of symmetry alone.
    """
    if not model.supports:
        return None
    held = held_dofs(model.supports, layout=model.layout)
    rows = model.rigid_motions(p, R)[held]
    square = inner(model.comm, rows, rows)
    # translations move held nodes by their unit, rotations by their distance
    moved = np.sqrt(np.diag(square)).reshape(2, 3).max(axis=1)
    size = np.repeat(np.where(moved > 0.0, moved, 1.0), 3)
    values, vectors = np.linalg.eigh(square / np.outer(size, size))
    motions: FloatArray = vectors[:, values <= EQUAL] / size[:, None]
    return motions


def _viscous_damping(
    model: LinearModel, damping: KelvinVoigtDamping | None, *, modes: FloatArray, stiffness: FloatArray
) -> FloatArray:
    if damping is None:
        return np.zeros((len(stiffness),) * 2)
    if not isinstance(damping.tau, Mapping) and model.state is None and not model.has_surface_energy:
        return np.diag(damping.tau * stiffness)
    # of a loaded body, or with springs on facets, the stiffness has a part that is no stress times a strain
    if model.condensed is not None:
        times = [_time(damping.tau, group) for group in model.groups]
        return _projection(model, model.condensed.stiffness(factors=times), modes=modes)
    return _projected(model, "viscosity", _viscosity(model, damping.tau), modes=modes)


def _projected(model: LinearModel, name: str, forms: list[fem.Form], *, modes: FloatArray) -> FloatArray:
    """(n, n) of a matrix given by its bilinear forms. Collective."""
    (matrix,) = assembly.assemble({name: forms}, model.groups, model.space)
    return _projection(model, matrix, modes=modes)


def _projection(model: LinearModel, matrix: PETSc.Mat, *, modes: FloatArray) -> FloatArray:
    """(n, n) of a matrix, which is destroyed. Collective."""
    viscous: FloatArray = symmetric(inner(model.comm, modes, multiply(matrix, modes)))
    matrix.destroy()
    return viscous


def _viscosity(model: LinearModel, tau: float | Mapping[str, float]) -> list[fem.Form]:
    """The stiffness at rest with the part of each cell group times its tau. Collective."""
    u, v = fem.Function(model.space), ufl.TestFunction(model.space)
    terms = [
        fem.Constant(model.mesh.mesh, _time(tau, group)) * form
        for group in model.groups
        for form in assembly.internal_work([group], u, v)
    ]
    return assembly.derivatives_at_rest(terms, u)


def _time(tau: float | Mapping[str, float], group: CellGroup) -> float:
    return float(tau[str(group.name)] if isinstance(tau, Mapping) else tau)


def _names(held: Any) -> tuple[str, ...]:
    if not is_list(held) or not all(isinstance(name, str) for name in held):
        raise ReductionError(f"held must be a list of interfaces' names, as held=['root'], got {shown(held)}")
    if len(set(held)) != len(held):
        raise ReductionError(f"held names an interface twice: {', '.join(map(repr, held))}")
    return tuple(held)


def _state(held: Sequence[str]) -> str:
    return f"of the body held at {', '.join(held)}" if held else "of the free body"


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
