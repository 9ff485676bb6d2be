"""Whether an element locks: where volume hardly changes, and where the body is thin.

`nu`, with `E`, and `t` among a form's parameters mean Poisson's ratio, Young's modulus and the thickness of a surface
(docs/writing_a_form.md); that the solid is the isotropic one of these numbers is tried, not taken for granted.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
import ufl

from flexmbd.continuum.contract.formulation import Formulation, Reference, set_symbols
from flexmbd.continuum.contract_suite.order import StaticProblem
from flexmbd.continuum.contract_suite.patch import constant_strain, solve, states
from flexmbd.continuum.contract_suite.trial import Trial
from flexmbd.continuum.contract_suite.trial_mesh import DIMENSION, Family, bar_mesh, family_mesh
from flexmbd.forms._shared import IncompressibleReference

#: Poisson's ratios that are tried.
RATIOS = (0.3, 0.45, 0.49, 0.499, 0.4999)
#: Thicknesses that are tried, of a length of 1 m.
THICKNESSES = (1.0, 0.1, 0.01, 0.001)

_CELLS_OF_SOLIDS = {1: (4, 8), 2: (2, 4)}
_CELLS_OF_SURFACES = {1: (4, 8), 2: (2, 4)}
_ALONG = 8  # cells along the bar that is bent
_CURVATURE = 1e-3  # 1/m
_SAME = 1e-6
_FALLS = 2.0  # by this an error falls at least where cells are halved and the solution is the form's


@dataclass(frozen=True)
class Locking:
    """Of one cell and degree.

    Attributes:
        cell, degree: of the element.
        over: what is varied: "nu" or "thickness [m]".
        measure: what is told.
        values: (k,) what was tried.
        results: (k,) the measure.
        fault: why there are none; empty where there are.
    """

    cell: str
    degree: int
    over: str
    measure: str
    values: tuple[float, ...]
    results: tuple[float, ...]
    fault: str = ""


@dataclass(frozen=True)
class _BentBar:
    """Pure bending about y of a bar along x of an isotropic solid, exact (Timoshenko & Goodier 1970, section 102)."""

    parameters: Any

    def displacement(self, x: ufl.core.expr.Expr) -> ufl.core.expr.Expr:
        nu, c = self.parameters.nu, _CURVATURE
        bent = c * x[0] ** 2 / 2 + nu * c * (x[2] ** 2 - x[1] ** 2) / 2
        return ufl.as_vector((-c * x[0] * x[2], nu * c * x[1] * x[2], bent))

    def body_force(self, x: ufl.core.expr.Expr) -> ufl.core.expr.Expr:
        return ufl.as_vector((0.0 * x[0], 0.0 * x[0], 0.0 * x[0]))


@dataclass(frozen=True)
class _BentPlate:
    """A plate in z = 0 bent without load: w is harmonic, so that moments have no divergence and there is no shear.

    Its Laplacian is zero, and with it the shear force -D grad(div grad w) (Timoshenko & Woinowsky-Krieger 1959, section
    21); normals turn with the surface whatever the thickness is.
    """

    form: Formulation

    def displacement(self, x: ufl.core.expr.Expr) -> ufl.core.expr.Expr:
        w = 1e-3 * ufl.exp(2 * x[0]) * ufl.cos(2 * x[1])
        slope = 2e-3 * ufl.exp(2 * x[0]) * ufl.sin(2 * x[1])  # minus that along y
        zero = ufl.as_vector((0.0, 0.0, 0.0))
        return self.form.rigid_motion(zero, ufl.as_vector((0.0, 0.0, w)), ufl.as_vector((-slope, -2 * w, 0.0)))

    def body_force(self, x: ufl.core.expr.Expr) -> ufl.core.expr.Expr:
        return ufl.as_vector([0.0 * x[0]] * self.displacement(x).ufl_shape[0])


def volumetric_locking(form: Formulation, cell: str, degree: int) -> list[Locking]:
    """Errors of a field that keeps the volume but for 1 - 2 nu, and their order, as nu approaches 1/2.

    On this rank alone. Compiles.
    """
    divisions = _CELLS_OF_SOLIDS.get(degree, (1, 2))
    found: list[tuple[float, ...]] = []

    def study() -> tuple[float, ...]:
        for n in divisions:
            body = Trial(form, cell, degree, mesh=family_mesh(cell, Family.REGULAR, n=n))
            problem = StaticProblem(body, cast(Reference, IncompressibleReference(body.parameters)))
            found.append(tuple(_at(body, problem.error, nu=nu) for nu in RATIOS))
        return found[-1]

    measure = f"relative error, {divisions[-1]} cells an edge"
    errors = _attempted(
        Locking(cell, degree, "nu", measure, (), ()), RATIOS, study, lambda: _not_isotropic(form, cell, degree)
    )
    if errors.fault:
        return [errors]
    ratios = np.log(np.array(found[0]) / np.array(found[1])) / np.log(divisions[1] / divisions[0])
    measure = f"order from {divisions[0]} to {divisions[1]} cells an edge"
    return [errors, dataclasses.replace(errors, measure=measure, results=tuple(map(float, ratios)))]


def bending_locking(form: Formulation, cell: str, degree: int) -> Locking:
    """How much too stiff a bar of one cell through its thickness is in bending; on this rank alone. Compiles.

    Strain energy over the exact one, E I kappa^2 L / 2, both ends being held as in the solution: 1 is right.
    """
    result = Locking(cell, degree, "thickness [m]", "bending stiffness over the exact", (), ())

    def one(thickness: float) -> float:
        body = Trial(form, cell, degree, mesh=bar_mesh(cell, n=_ALONG, thickness=thickness))
        reference = _BentBar(body.parameters)
        ends = lambda x: np.isclose(x[0], 0.0) | np.isclose(x[0], 1.0)  # noqa: E731
        energy = StaticProblem(body, cast(Reference, reference), held=ends).solve()[1]
        E = float(form.reference().parameters.E)
        return energy / (E * thickness**4 / 12.0 * _CURVATURE**2 / 2.0)

    def study() -> tuple[float, ...]:
        return tuple(map(one, THICKNESSES))

    return _attempted(result, THICKNESSES, study, lambda: _not_isotropic(form, cell, degree))


def thin_surface_locking(form: Formulation, cell: str, degree: int) -> Locking:
    """Errors of a plate that is bent without shear, as its parameter `t` goes to nothing; on this rank alone. Compiles.

    What the thickness does to the exact solution is nothing, so that an error that grows is the element's.
    """
    coarse, fine = _CELLS_OF_SURFACES.get(degree, (2, 4))
    result = Locking(cell, degree, "thickness [m]", f"relative error, {fine} cells an edge", (), ())
    thicknesses = THICKNESSES[1:]

    def errors(n: int, values: tuple[float, ...]) -> tuple[float, ...]:
        body = Trial(form, cell, degree, mesh=family_mesh(cell, Family.REGULAR, n=n))
        problem = StaticProblem(body, cast(Reference, _BentPlate(form)))
        return tuple(_at(body, problem.error, t=t) for t in values)

    def reason() -> str:
        if fault := _missing(form, ("t",)):
            return fault
        thick = THICKNESSES[:1]
        if errors(coarse, thick)[0] > _FALLS * errors(fine, thick)[0]:
            return ""
        return "not tried: no plate of isotropic material, for a thick one does not bend as such does"

    return _attempted(result, thicknesses, lambda: errors(fine, thicknesses), reason)


def locking_studies(
    form: Formulation, cell: str, degree: int, *, tell: Callable[[str], None] = lambda text: None
) -> list[Locking]:
    """Those that there are for such cells; lines have none."""
    tell(f"locking of {cell} {degree}")
    if DIMENSION[cell] == 3:
        return [*volumetric_locking(form, cell, degree), bending_locking(form, cell, degree)]
    return [thin_surface_locking(form, cell, degree)] if DIMENSION[cell] == 2 else []


def _at(body: Trial, measure: Callable[[], float], **changed: float) -> float:
    """A measure with other values of parameters; NaN where the form does not allow them."""
    parameters = body.form.reference().parameters
    try:
        other = dataclasses.replace(parameters, **changed)
    except ValueError:
        return float("nan")
    set_symbols(body.parameters, other)
    return measure()


def _attempted(
    result: Locking, values: tuple[float, ...], study: Callable[[], tuple[float, ...]], reason: Callable[[], str]
) -> Locking:
    try:
        fault = reason()
        if not fault:
            return dataclasses.replace(result, values=values, results=study())
    except Exception as error:  # noqa: BLE001  (a form file is foreign code)
        lines = str(error).strip().splitlines() or [""]
        fault = f"{type(error).__name__}: {lines[-1]}"
    return dataclasses.replace(result, fault=fault)


def _missing(form: Formulation, names: tuple[str, ...]) -> str:
    """Which of these parameters a form does not have, in words; empty if it has them."""
    parameters = form.reference().parameters
    known = {one.name for one in dataclasses.fields(parameters) if isinstance(getattr(parameters, one.name), float)}
    missing = [name for name in names if name not in known]
    return f"not tried: the form has no parameter {' and no '.join(missing)}" if missing else ""


def _not_isotropic(form: Formulation, cell: str, degree: int) -> str:
    """Why E and nu are not those of an isotropic solid, by the energy of a constant strain; empty if they are."""
    if fault := _missing(form, ("E", "nu")):
        return fault
    trial = Trial(form, cell, degree)
    state = solve(trial, states(trial)[0])
    energy = state @ trial.stiffness(trial.rest()) @ state / 2
    parameters, strain = cast(Any, form.reference().parameters), constant_strain()
    shear, nu = parameters.E / (2 * (1 + parameters.nu)), parameters.nu
    density = shear * (np.sum(strain**2) + nu / (1 - 2 * nu) * np.trace(strain) ** 2)
    if abs(energy / (density * trial.volume) - 1) < _SAME:
        return ""
    return "not tried: E and nu are not those of an isotropic solid, by the energy of a constant strain"
