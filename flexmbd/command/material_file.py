"""A material file: the form, its parameters in SI units, and the damping (docs/command_line.md).

form = "solid_linear"          # or a form file, "my_form.py", beside this file

[parameters]
E = 2.1e11
nu = 0.3
rho = 7850.0

[damping]                      # or alpha and beta (Rayleigh), or tau (Kelvin-Voigt)
ratio = 0.005                  # of the free body's modes,
held = ["bore_1"]              # or, with ratio, or alpha and beta, of those of the body held at interfaces
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flexmbd.errors import FlexmbdError, FormulationError
from flexmbd.toml_file import TomlSection, read_toml

if TYPE_CHECKING:
    from types import ModuleType

    from flexmbd.reduction.damping import Damping

_DAMPINGS = ({"ratio"}, {"alpha", "beta"}, {"tau"})


@dataclass(frozen=True)
class Material:
    """The contents of a material file.

    Attributes:
        form: the name of a form, or the path of a form file.
        parameters: the form's, in SI units.
        damping: numbers by name: ratio; alpha and beta; tau; or none.
        held: the interfaces that do not move in the modes that are damped.
    """

    form: str
    parameters: dict[str, float]
    damping: dict[str, float]
    held: tuple[str, ...] = ()


def read_material(path: Path) -> Material:
    """Read a material file. Not collective.

    Raises:
        FormulationError: it cannot be read, or holds something else.
    """
    top = read_toml(path, kind=FormulationError)
    top.allow(("form", "parameters", "damping"))
    form = top.text("form")
    if form.endswith(".py"):
        form = str(path.parent / form)
    parameters = _numbers(top.table("parameters"))
    damping: dict[str, float] = {}
    held: tuple[str, ...] = ()
    if top.has("damping"):
        section = top.table("damping")
        damping = {key: section.number(key) for key in section.values if key != "held"}
        held = tuple(section.texts("held")) if section.has("held") else ()
        if (damping or held) and set(damping) not in _DAMPINGS:
            top.fail("damping", "must have ratio; or alpha and beta (Rayleigh); or tau (Kelvin-Voigt)")
        if held and "tau" in damping:
            section.fail("held", "goes with ratio, or with alpha and beta: tau is of the material, whatever is held")
    return Material(form, parameters, damping, held)


def _numbers(section: TomlSection) -> dict[str, float]:
    return {key: section.number(key) for key in section.values}


def make_damping(values: dict[str, float], *, held: tuple[str, ...] = ()) -> Damping | None:
    """The damping of a material file's numbers; None where there are none.

    Raises:
        ReductionError: a number is out of its range.
    """
    from flexmbd.reduction import KelvinVoigtDamping, ModalDamping, RayleighDamping

    if "ratio" in values:
        return ModalDamping(values["ratio"], held)
    if "alpha" in values:
        return RayleighDamping(values["alpha"], values["beta"], held)
    return KelvinVoigtDamping(values["tau"]) if "tau" in values else None


def make_parameters(form: ModuleType, values: dict[str, float]) -> Any:
    """The form's `Parameters` with these values.

    Raises:
        FormulationError: a field is missing or unknown, or a value out of its range.
    """
    fields = dataclasses.fields(form.Parameters)
    needed = [
        field.name
        for field in fields
        if field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING
    ]
    missing = [name for name in needed if name not in values]
    unknown = [name for name in values if name not in {field.name for field in fields}]
    faults = [f"{kind} {', '.join(names)}" for kind, names in (("no", missing), ("unknown", unknown)) if names]
    if faults:
        raise FormulationError(
            f"{form.__name__} has the parameters {', '.join(field.name for field in fields)}; {'; '.join(faults)}: "
            "give each as --parameter NAME=VALUE or in the material file"
        )
    try:
        return form.Parameters(**values)
    except FlexmbdError:
        raise
    except (TypeError, ValueError) as error:
        raise FormulationError(f"{form.__name__}: {error}") from error
