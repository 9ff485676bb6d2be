"""A formulation made of a law of stress and strain that is a Python function, compiled with numba; docs/laws.md."""

from __future__ import annotations

import dataclasses
import enum
import inspect
from collections.abc import Callable, Mapping, Sequence
from types import ModuleType
from typing import Any

import numpy as np
import ufl
from numpy.typing import NDArray
from ufl.core.expr import Expr

from flexmbd.continuum.contract.point_law import FAULTS, PointLaw
from flexmbd.continuum.laws.compiled_law import compiled_law
from flexmbd.errors import FormulationError
from flexmbd.forms import j2_plasticity, solid_linear
from flexmbd.given import checked, numbers, shown
from flexmbd.multibody.kernels.base.fingerprint import fingerprint

FloatArray = NDArray[np.float64]

# Rows and columns of xx, yy, zz, yz, xz, xy.
_PLACES = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))


class StrainMeasure(enum.Enum):
    """The strain that a law is given, in the axes of the undeformed body; the stress that does work on it.

    The body's frame carries the rotation of the whole body in a machine.  The finite measures see no rotation at all:
    a law of theirs is objective however parts of the body turn.  The small one takes rotations in that frame to be
    small.
    """

    SMALL = "small"  # sym grad u; Cauchy's stress
    GREEN_LAGRANGE = "Green-Lagrange"  # (F^T F - 1) / 2; the second Piola-Kirchhoff stress
    LOGARITHMIC = "logarithmic"  # ln(F^T F) / 2; the stress that does work on it, Kirchhoff's turned back if isotropic


@checked("law", "state", "strain", "yielding", "scaled_yield", "energies", "dt", error=FormulationError)
def law_form(
    law: Callable[..., Any],
    parameters: type,
    *,
    trial: Any,
    state: Mapping[str, Sequence[float]] | None = None,
    strain: StrainMeasure = StrainMeasure.SMALL,
    yielding: Sequence[Any] = (),
    scaled_yield: Callable[[Any, float], Any] | None = None,
    energies: Callable[[Expr, Expr, Expr, Any], Mapping[str, Expr]] | None = None,
    dt: float | None = None,
) -> ModuleType:
    """Make a formulation of a law; compiles, for some seconds. Not collective: called on each rank.

    The formulation is one like a form file, for `NonlinearModel` and `check_form`.

    Args:
        law: (step, p) -> stress (6,) Pa, tangent (6, 6) Pa, state (n,), in what numba compiles.  ``step`` is a
            `PointStep`: strain and stress at the step's begin, the increment of the strain, the state, dt.  ``p`` has
            the parameters by name.  The tangent is the derivative of the stress by the increment.  Strains are xx, yy,
            zz, yz, xz, xy with twice the tensor's shears.  It must not change its arguments.
        parameters: frozen dataclass of floats, among them the density ``rho`` of the undeformed body, kg/m^3.
        trial: parameters that the checks try.
        state: parts of the state by name, with their values at rest.
        strain: which strain the law is given.
        yielding: parameters of which strains of a percent leave something behind; `trial` alone if empty.
        scaled_yield: (p, factor) parameters with yield limits `factor` times as high, where bodies are linearised.
        energies: (strain, stress, state, p) densities, J per undeformed volume, by name, as UFL: "elastic", "plastic".
        dt: s, length of the steps that the checks try, of a law that depends on it; None: it does not.

    Raises:
        FormulationError: the law cannot be compiled, or does not return at rest what it must; parameters are not a
            frozen dataclass of floats with a density; the trial ones, or one that yields, are not of their kind; a part
            of the state is not of numbers; dt is not positive.  A model of the form raises it where what the law names
            outside itself has changed since.
    """
    names = _checked_names(law, parameters, trial)
    for given in yielding:
        if not isinstance(given, parameters):
            raise FormulationError(f"{law.__name__}: yielding must hold {parameters.__name__}, got {shown(given)}")
    if dt is not None and dt <= 0.0:
        raise FormulationError(f"{law.__name__}: dt must be the length of a step (s), more than 0, got {dt!r}")
    parts = {name: _part(law.__name__, name, values) for name, values in (state or {}).items()}
    begin = np.concatenate([np.zeros(12), *parts.values()])
    logarithmic = strain is StrainMeasure.LOGARITHMIC
    code = compiled_law(law, names=names, n=len(begin) - 12, logarithmic=logarithmic)
    measure = _small_strain if strain is StrainMeasure.SMALL else _green_lagrange
    compiled = PointLaw(code.address, code, begin, measure, lambda p: [getattr(p, name) for name in names])
    _check_at_rest(law.__name__, compiled, trial)
    reads = fingerprint(law)

    def point_law(p: Any) -> PointLaw:
        if fingerprint(law) != reads:
            raise FormulationError(
                f"{law.__name__}: numbers, arrays or functions that the law names outside itself have changed since "
                "law_form compiled it with the old ones: call law_form again, or give them as parameters"
            )
        return compiled

    form = ModuleType(law.__name__)
    reference = LawReference(trial, tuple(yielding) or (trial,), compiled, dt)
    entries: dict[str, Any] = {
        "__doc__": inspect.getdoc(law),
        "Parameters": parameters,
        "CELLS": solid_linear.CELLS,
        "ORDER": solid_linear.ORDER,
        "REFERENCE": "INITIAL",
        "element": solid_linear.element,
        "kinetic_energy": solid_linear.kinetic_energy,
        "rigid_motion": solid_linear.rigid_motion,
        "reference": lambda: reference,
        "point_law": point_law,
        "state": lambda p: ufl.as_vector(begin.tolist()),
        "state_names": lambda p: {"strain": 6, "stress": 6, **{name: len(values) for name, values in parts.items()}},
        **_point_functions(compiled, strain, timed=dt is not None),
    }
    if scaled_yield is not None:
        entries["scaled_yield"] = scaled_yield
    if energies is not None:
        entries["energies"] = _energies(energies)
    vars(form).update(entries)
    return form


@dataclasses.dataclass(frozen=True, eq=False)
class LawReference:
    """The static problem of `solid_linear`, with the elasticity that a law has at rest.

    Attributes:
        parameters: of the trial.
        yielding: parameters that yield.
        law: compiled.
        dt: s, of the steps that are tried.
    """

    parameters: Any
    yielding: tuple[Any, ...]
    law: PointLaw
    dt: float | None

    def displacement(self, x: Expr) -> Expr:
        """Exact displacement, m, at the point x; prescribed on the whole boundary."""
        return solid_linear.Reference(solid_linear.Parameters(1.0, 0.0, 1.0)).displacement(x)

    def body_force(self, x: Expr) -> Expr:
        """Body force, N/m^3, with which it is in equilibrium at small strain."""
        tangent = self.law.evaluate(np.zeros(6), self.law.begin, constants=self.law.values(self.parameters))[1]
        strain = _small_strain(self.displacement(x))
        stress = [sum(tangent[i, j] * strain[j] for j in range(6) if tangent[i, j]) for i in range(6)]
        return -ufl.div(_stress_tensor(stress))


def _point_functions(law: PointLaw, strain: StrainMeasure, *, timed: bool) -> dict[str, Callable[..., Any]]:
    """residual, update and stress of a form."""

    def residual(u: Expr, v: Expr, state: Expr, p: Any, *, z: Expr) -> list[Any]:
        stress = law.working_stress(z)
        turned = ufl.grad(v) if strain is StrainMeasure.SMALL else _stretch(u).T * ufl.grad(v)
        return [(ufl.inner(stress, _strain_vector(ufl.sym(turned))), j2_plasticity.rule(u))]

    def update(u: Expr, state: Expr, p: Any, *, z: Expr) -> Expr:
        return ufl.as_vector([z[i] for i in range(law.kept)])

    def stress(u: Expr, state: Expr, p: Any, *, z: Expr) -> Expr:
        own, f = _stress_tensor(law.working_stress(z)), _stretch(u)
        return own if strain is StrainMeasure.SMALL else f * own * f.T / ufl.det(f)

    functions: dict[str, Callable[..., Any]] = {"residual": residual, "update": update, "stress": stress}
    return {name: _timed(function) for name, function in functions.items()} if timed else functions


def _timed(function: Callable[..., Any]) -> Callable[..., Any]:
    """The same function with the keyword `dt`, which the compiled law takes by itself."""

    def taking(*given: Any, z: Any, dt: Any) -> Any:
        return function(*given, z=z)

    return taking


def _energies(energies: Callable[..., Mapping[str, Expr]]) -> Callable[..., Any]:
    def terms(u: Expr, state: Expr, p: Any) -> dict[str, Any]:
        strain, stress = (ufl.as_vector([state[first + i] for i in range(6)]) for first in (0, 6))
        own = ufl.as_vector([state[i] for i in range(12, state.ufl_shape[0])]) if state.ufl_shape[0] > 12 else None
        return {name: (density, j2_plasticity.rule(u)) for name, density in energies(strain, stress, own, p).items()}

    return terms


def _part(law: str, name: str, values: object) -> FloatArray:
    """A part of the state at rest."""
    found = numbers(values).ravel()
    if found.size == 0 or not np.isfinite(found).all():
        raise FormulationError(f"{law}: state {name!r} must be finite numbers, its values at rest, got {shown(values)}")
    return found


def _checked_names(law: Callable[..., Any], parameters: type, trial: Any) -> list[str]:
    """Of the parameters, in their order."""
    if not (dataclasses.is_dataclass(parameters) and parameters.__dataclass_params__.frozen):  # type: ignore[attr-defined]
        raise FormulationError(f"{law.__name__}: the parameters must be a frozen dataclass, got {parameters!r}")
    if not isinstance(trial, parameters):
        raise FormulationError(f"{law.__name__}: trial must be an instance of {parameters.__name__}, got {trial!r}")
    names = [item.name for item in dataclasses.fields(parameters)]
    wrong = [name for name in names if not isinstance(getattr(trial, name), float)]
    if wrong or "rho" not in names:
        what = f"{', '.join(wrong)} are not" if wrong else "there is no density rho"
        raise FormulationError(f"{law.__name__}: all parameters must be floats, rho (kg/m^3) among them; {what}")
    return names


def _check_at_rest(name: str, law: PointLaw, trial: Any) -> None:
    """Refuse a law that does not return what it must of no strain."""
    made, _, fault = law.evaluate(np.zeros(6), law.begin, constants=law.values(trial))
    if fault:
        raise FormulationError(f"{name}: at rest, in a step of no strain and no time, {FAULTS[fault - 1]}")
    if made[6:12].any():
        raise FormulationError(f"{name}: at rest there is the stress {made[6:12].tolist()} Pa; a body at rest has none")


def _stretch(u: Expr) -> Expr:
    return ufl.Identity(3) + ufl.grad(u)


def _small_strain(u: Expr) -> Expr:
    return _strain_vector(ufl.sym(ufl.grad(u)))


def _green_lagrange(u: Expr) -> Expr:
    h = ufl.grad(u)
    return _strain_vector(ufl.sym(h) + h.T * h / 2)


def _strain_vector(tensor: Expr) -> Expr:
    return ufl.as_vector([(1 if i == j else 2) * tensor[i, j] for i, j in _PLACES])


def _stress_tensor(vector: Any) -> Expr:
    xx, yy, zz, yz, xz, xy = (vector[k] for k in range(6))
    return ufl.as_matrix([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
