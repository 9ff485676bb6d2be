"""Choices for the reduction of bodies with large displacements, and which bodies can be reduced so."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from flexmbd.continuum.finite_elements.linear_model import LinearModel
from flexmbd.errors import ReductionError
from flexmbd.given import checked, is_number


@checked("held", error=ReductionError)
@dataclass(frozen=True)
class ModalDerivatives:
    """How a body that bends a lot is reduced: by modal derivatives and a strain energy of degree four.

    Attributes:
        loads: largest sizes of the loads between which the body is to be right, in either direction, each alone and
            by twos: by the names of `GeometricStiffness`, as ``{"tip.y": 200.0, "acceleration z": 50.0}``, in N, N m,
            m/s^2, rad/s^2, rad^2/s^2 or factors of named loads; or ``fixed-interface 1`` and so on, a mode's largest
            displacement in m.
        held: names of interfaces that are held in the body frame beside that of the frame itself while the loads are on
            the body, as both ends of a panel that is clamped there.
        tol: largest estimated error of the strain energy at these loads, relative.
        most: how many derivatives may be kept.
        order: to which power of the loads the full model's equilibria are followed, 2 or more.
    """

    loads: Mapping[str, float]
    held: Sequence[str] = ()
    tol: float = 1e-3
    most: int = 24
    order: int = 5

    def __post_init__(self) -> None:
        if not isinstance(self.loads, Mapping) or not self.loads:
            raise ReductionError(
                f"ModalDerivatives takes loads by their names, as {{'tip.y': 200.0}}, got {self.loads!r:.100}"
            )
        for name, size in self.loads.items():
            if not isinstance(name, str) or not is_number(size) or not float(size) > 0.0:
                raise ReductionError(f"ModalDerivatives: load {name!r:.50} needs a positive size, got {size!r:.50}")
        if isinstance(self.held, str) or not all(isinstance(name, str) for name in self.held):
            raise ReductionError(f"ModalDerivatives: held must be a list of interfaces' names, got {self.held!r:.50}")
        if not is_number(self.tol) or not 0.0 < float(self.tol) < 1.0:
            raise ReductionError(f"ModalDerivatives: tol must lie between 0 and 1, got {self.tol!r:.50}")
        for name, least in (("most", 1), ("order", 2)):
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, int) or value < least:
                raise ReductionError(f"ModalDerivatives: {name} must be an integer from {least} on, got {value!r:.50}")


def refuse_other_nonlinear(value: object) -> None:
    """Refuse what is neither `ModalDerivatives` nor None; not collective.

    Raises:
        ReductionError: it is another object.
    """
    if value is not None and not isinstance(value, ModalDerivatives):
        raise ReductionError(f"nonlinear must be ModalDerivatives(loads=...), got {value!r:.100}")


def check_nonlinear(model: LinearModel) -> None:
    """Refuse a body for which there are no modal derivatives. Collective.

    Raises:
        ReductionError: on all ranks.
    """
    for there, what in (
        (bool(model.interfaces) is False, "bodies without interfaces"),
        (bool(model.nodal), "nodal interfaces"),
        (model.ties is not None, "welds"),
        (model.state is not None, "prestressed bodies"),
        (any(group.has_sections for group in model.groups), f"rotations of cross-sections, as of {model.form_name}"),
        (int(model.layout.kinematic.sum()) != model.layout.n_local, f"further unknowns, as of {model.form_name}"),
        (model.condensed is not None, f"fields of one cell, as of {model.form_name}"),
    ):
        if there:
            raise ReductionError(f"nonlinear=ModalDerivatives(...) is for solids at rest with interfaces, no {what}")
