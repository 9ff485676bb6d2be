"""A material file: the form, its parameters in SI units, and the damping (docs/command_line.md).

form = "solid_linear"          # or a form file, "my_form.py", beside this file

[parameters]
E = 2.1e11
nu = 0.3
rho = 7850.0

[damping]                      # or alpha and beta (Rayleigh), or tau (Kelvin-Voigt)
ratio = 0.005
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from flexmbd.errors import FormulationError
from flexmbd.toml_file import TomlSection, read_toml

if TYPE_CHECKING:
    from flexmbd.reduction.damping import Damping

_DAMPINGS = ({"ratio"}, {"alpha", "beta"}, {"tau"})


@dataclass(frozen=True)
class Material:
    """What a material file says.

    Attributes:
        form: the name of a form, or the path of a form file.
        parameters: the form's, in SI units.
        damping: numbers by name: ratio; alpha and beta; tau; or none.
    """

    form: str
    parameters: dict[str, float]
    damping: dict[str, float]


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
    damping = _numbers(top.table("damping")) if top.has("damping") else {}
    if damping and set(damping) not in _DAMPINGS:
        top.fail("damping", "must have ratio; or alpha and beta (Rayleigh); or tau (Kelvin-Voigt)")
    return Material(form, parameters, damping)


def _numbers(section: TomlSection) -> dict[str, float]:
    return {key: section.number(key) for key in section.values}


def make_damping(values: dict[str, float]) -> Damping | None:
    """The damping of a material file's numbers; None where there are none.

    Raises:
        ReductionError: a number is out of its range.
    """
    from flexmbd.reduction import KelvinVoigtDamping, ModalDamping, RayleighDamping

    if "ratio" in values:
        return ModalDamping(values["ratio"])
    if "alpha" in values:
        return RayleighDamping(values["alpha"], values["beta"])
    return KelvinVoigtDamping(values["tau"]) if "tau" in values else None
