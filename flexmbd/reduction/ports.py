"""Ports of a reduced body: what a unit of effort does to the modes, and the capacity that the modes leave out.

An electrode's voltage V loads the body by the forces f V, and its charge is f^T z + C V (`FieldConditions`). With all
interfaces fixed z = K^-1 f V, of which the modes Phi have Phi (Phi^T K Phi)^-1 Phi^T f V. What they leave out,
R = K^-1 f less that, is the potential that follows the voltage at rest, and the quasi-static share of all modes that
were left out: as f^T R it goes into the capacity. So the statics of the record, of voltages and of forces on
interfaces, are the full model's with any number of modes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexmbd.continuum.finite_elements.field_conditions import FieldConditions, refuse_unheld
from flexmbd.continuum.finite_elements.linear_model import LinearModel
from flexmbd.continuum.matrices.blocks import FloatArray, inner, multiply, symmetric
from flexmbd.continuum.matrices.eigen import Modes
from flexmbd.continuum.matrices.saddle_point import principal_part
from flexmbd.errors import ReductionError
from flexmbd.record.reduced_body import Ports
from flexmbd.reduction.static_shapes.factor import Factor
from flexmbd.reduction.static_shapes.statics import Statics


@dataclass(frozen=True, eq=False)
class PortResponses:
    """Static responses to one unit of effort of each port, all interfaces fixed.

    Attributes:
        conditions: of the model, with k ports.
        held: (owned dofs, k).
    """

    conditions: FieldConditions
    held: FloatArray


@dataclass(frozen=True, eq=False)
class PortCapacity:
    """Flow per effort, beside what the modes do; the same on every rank.

    Attributes:
        conditions: of the model, with k ports.
        direct: (k, k) symmetric.
        whole: (k,) of each port's own flow per effort with all interfaces fixed, modes included.
    """

    conditions: FieldConditions
    direct: FloatArray
    whole: FloatArray


def check_ports(model: LinearModel, *, nonlinear: bool) -> None:
    """Refuse fields that nothing holds, and ports of a body with a strain energy of large displacements. Collective.

    Raises:
        ReductionError: on all ranks: it has such.
    """
    if model.state is None:
        refuse_unheld(model.K, model.forms, model.conditions)
    if nonlinear and model.conditions is not None and model.conditions.ports:
        raise ReductionError(
            f"nonlinear= goes without ports, as {model.conditions.ports[0]}: what a voltage does to a body that bends "
            "a lot is not known; reduce it for small displacements, or ground the electrode"
        )


def port_responses(statics: Statics) -> PortResponses | None:
    """Solve for the responses; None without ports. Collective."""
    conditions = statics.model.conditions
    if conditions is None or not conditions.ports:
        return None
    return PortResponses(conditions, statics.held_response(conditions.forces))


def deformations(statics: Statics, responses: PortResponses) -> tuple[FloatArray, FloatArray]:
    """The responses without the potential that a voltage makes at rest, and forces that call them. Collective.

    Returns:
        (owned dofs, k) shapes, of which the massless unknowns are in balance without a load on them, so that the strain
        energy of each is positive; (owned dofs, k) K times them.
    """
    model, forces = statics.model, responses.conditions.forces
    massless = np.zeros(model.n_owned, dtype=bool)
    massless[statics.mask] = statics.massless
    block = principal_part(model.K, massless)
    factor = Factor(block, definite=False)
    shapes = responses.held.copy(order="F")
    shapes[massless] -= factor.solve(np.asfortranarray(forces[massless]))
    factor.destroy()
    block.destroy()
    return shapes, multiply(model.K, shapes)


def port_capacity(statics: Statics, modes: Modes, responses: PortResponses) -> PortCapacity:
    """What some modes, all interfaces fixed, leave out of the ports' flow. Collective."""
    model, forces, shapes = statics.model, responses.conditions.forces, modes.shapes
    fixed = symmetric(responses.conditions.capacity + inner(model.comm, forces, responses.held))
    # the modes are orthogonal to no more than their tolerance
    K = symmetric(inner(model.comm, shapes, multiply(model.K, shapes)))
    load = inner(model.comm, shapes, forces)
    direct = symmetric(fixed - load.T @ np.linalg.solve(K, load))
    return PortCapacity(responses.conditions, direct, np.diag(fixed).copy())


def ports_group(model: LinearModel, capacity: PortCapacity, *, modes: FloatArray) -> Ports:
    """The record's group. Collective; the same on every rank.

    Args:
        model: the body.
        capacity: what the modes leave out.
        modes: (owned dofs, n) in normal form.
    """
    ports = capacity.conditions.ports
    return Ports(
        names=tuple(one.name for one in ports),
        efforts=tuple(one.EFFORT[0] for one in ports),
        effort_units=tuple(one.EFFORT[1] for one in ports),
        flows=tuple(one.FLOW[0] for one in ports),
        flow_units=tuple(one.FLOW[1] for one in ports),
        load=inner(model.comm, capacity.conditions.forces, modes),
        capacity=capacity.direct,
    )


def port_notes(capacity: PortCapacity) -> dict[str, str]:
    """What the provenance says of each port; not collective."""
    notes = {}
    for one, whole, direct in zip(capacity.conditions.ports, capacity.whole, np.diag(capacity.direct), strict=True):
        per = f"{one.FLOW[1]}/{one.EFFORT[1]}"
        notes[f"port {one.name}"] = (
            f"{one}; with all interfaces fixed {whole:.6g} {per}, of which the modes have {1 - direct / whole:.2%}"
        )
    return notes
