"""A free block that is heated evenly expands as the form says, and has neither force nor stress."""

from __future__ import annotations

import dataclasses
from types import ModuleType
from typing import Any, cast

import numpy as np
import ufl

from flexmbd.continuum.contract.entries import optional_entries
from flexmbd.continuum.contract.formulation import Formulation
from flexmbd.continuum.contract.heated_form import expands, expansion_of
from flexmbd.continuum.contract.ufl_values import NoValueError, evaluate
from flexmbd.continuum.contract_suite.measures import largest, ratio
from flexmbd.continuum.contract_suite.outcome import Figure, Outcome, Remark, Verdict
from flexmbd.continuum.contract_suite.trial import FloatArray, Trial
from flexmbd.continuum.contract_suite.trial_mesh import tagged
from flexmbd.continuum.history.nonlinear_model import NonlinearModel

# K; of a parameter that is zero in the reference and lets the material expand, 1/K; round-off of forces that cancel.
_RISE, _COEFFICIENT, _LEFT = 50.0, 1e-5, 1e-8


def free_expansion(trial: Trial) -> Outcome:
    """Forces and stress of a block that is free to expand, over those of one that is held in its shape.

    Stress is also over that of a block that is stretched along one axis: where the pressure is an unknown, it is zero
    in the block that is held.
    """
    form = trial.form
    named = expansion_of(form)
    if named is None:
        return Remark(Verdict.SKIP, "the form does not say how it expands")
    parameters = expanding_parameters(form)
    if parameters is None:
        return Remark(Verdict.SKIP, "no parameter that is zero in reference() lets the material expand: give it one")
    if optional_entries(form).point_law is not None:
        return Remark(Verdict.SKIP, "a compiled law is given the whole strain, and takes no temperature")
    try:
        cold, warm = (_values(named(parameters, ufl.as_ufl(rise))) for rise in (0.0, _RISE))
    except NoValueError:
        return Remark(Verdict.SKIP, "the expansion depends on the place, so that a free block has stress")
    if optional_entries(form).surface_energy is not None:
        return Remark(Verdict.SKIP, "springs on facets hold the block")
    source = cast(ModuleType, form)
    body = NonlinearModel(tagged(trial.mesh), source, parameters, degree=trial.degree, heated=True)
    body.set_temperature(np.array(_RISE))
    still: FloatArray = np.zeros(body.layout.n_local)
    moved = body.layout.at_dofs(body.layout.node_x @ (warm - cold).T, owned=False)
    across = body.layout.at_dofs(body.layout.node_x * (largest(warm - cold) * np.eye(3)[0]), owned=False)
    forces, stresses = [], []
    for displacement in (still, moved, across):
        forces.append(largest(body.force(displacement, dt=0.0)))
        begun = body.snapshot()
        body.commit(displacement, dt=0.0)
        stresses.append(max(largest(part) for part in body.stress()))
        body.restore(begun)
    if trial.dim < 3 and ratio(forces[1], forces[0]) > _LEFT:
        return Remark(Verdict.NOTE, "it does not expand as freely as a block does, as what is held along the normal")
    return [
        Figure("of what holds the block in shape, a free one has the force", ratio(forces[1], forces[0]), _LEFT),
        Figure("the stress", ratio(stresses[1], max(stresses[0], stresses[2])), _LEFT),
    ]


def expanding_parameters(form: Formulation) -> Any:
    """Those of `reference()`, with an expansion; None where none is found.

    Where the reference does not expand, each number that is zero in it is tried with another value, and takes that if
    the form expands then.
    """
    parameters: Any = form.reference().parameters
    if expands(form, parameters):
        return parameters
    more = {}
    for field in dataclasses.fields(parameters):
        if getattr(parameters, field.name) != 0.0 or isinstance(getattr(parameters, field.name), bool):
            continue
        try:
            changed = dataclasses.replace(parameters, **{field.name: _COEFFICIENT})
        except (TypeError, ValueError):
            continue
        if expands(form, changed):
            more[field.name] = _COEFFICIENT
    return dataclasses.replace(parameters, **more) if more else None


def _values(tensor: Any) -> FloatArray:
    """(3, 3) of a stretch or a small strain."""
    return np.array([[float(evaluate(tensor[i, j], {})) for j in range(3)] for i in range(3)])
