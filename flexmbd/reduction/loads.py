"""The record's distributed loads: resultants and modal forces of loads that turn with the body."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from dolfinx import fem

from flexmbd.continuum.finite_elements.linear_model import LinearModel
from flexmbd.continuum.finite_elements.nodes import node_numbers
from flexmbd.continuum.finite_elements.temperature import at_nodes
from flexmbd.continuum.matrices.blocks import FloatArray, inner, total
from flexmbd.errors import ReductionError
from flexmbd.record.reduced_body import DistributedLoads, Heat
from flexmbd.reduction.spread_groups import all_numbers
from flexmbd.reduction.unit_loads import Load, TemperatureRise


def loads_group(
    model: LinearModel,
    loads: Sequence[Load],
    *,
    forces: FloatArray,
    modes: FloatArray,
    p: FloatArray,
    R: FloatArray,
) -> DistributedLoads:
    """The record's group. Collective; the same to the bit on every rank.

    Args:
        model: the body.
        loads: k of them.
        forces: (owned dofs, k) their nodal forces, in the mesh's axes.
        modes: (owned dofs, n) in normal form, in the mesh's axes.
        p: (3,) m, the body frame's origin in the mesh's axes.
        R: (3, 3) rotation from the body frame's axes to the mesh's.
    """
    resultant = inner(model.comm, forces, model.rigid_motions(p, R))
    modal = inner(model.comm, forces, modes)
    return DistributedLoads(
        tuple(load.name for load in loads), resultant[:, :3], resultant[:, 3:], modal
    )


def check_temperatures(model: LinearModel, loads: Sequence[Load], *, keeps_stress: bool, nonlinear: bool) -> None:
    """Refuse temperatures whose stress, or what it does to the stiffness, the record would leave out. Not collective.

    Args:
        model: the body.
        loads: of the record.
        keeps_stress: whether the record keeps stress modes.
        nonlinear: whether it has the strain energy of large displacements.

    Raises:
        ReductionError: there are some; the same on every rank.
    """
    for load in loads:
        if not isinstance(load, TemperatureRise):
            continue
        if model.conditions is not None and model.conditions.ports:
            there = ", ".join(repr(port.name) for port in model.conditions.ports)
            raise ReductionError(
                f"load {load.name!r}: the record has no charge that a temperature brings onto the electrodes {there}; "
                "leave the temperature out, ground them or let them float, or take a NonlinearModel"
            )
        if model.state is not None:
            raise ReductionError(
                f"load {load.name!r}: a body is heated about rest alone; give the temperature to prestressed(...), or "
                "reduce the body at rest"
            )
        if keeps_stress:
            raise ReductionError(
                f"load {load.name!r}: stress modes do not hold the stress of an expansion that is held; leave "
                "Keep(stress=True) out, and take stresses from the model (Keep(modes=True))"
            )
        if nonlinear:
            raise ReductionError(
                f"load {load.name!r}: the strain energy of large displacements is that of a cold body; reduce it "
                "without ModalDerivatives, or load it as a NonlinearModel"
            )


def heat_group(model: LinearModel, rises: Mapping[str, fem.Function]) -> Heat:
    """The temperatures among the record's loads at all displacement nodes. Collective; the same on every rank.

    Args:
        model: the body.
        rises: K, by the names of `UnitLoads`.
    """
    numbers = node_numbers(model)
    node = all_numbers(model.comm, numbers[: model.n_owned_nodes])
    values = np.stack([at_nodes(model, rise)[: model.n_owned_nodes] for rise in rises.values()])
    whole = np.zeros((len(rises), len(node)))
    whole[:, np.searchsorted(node, numbers[: model.n_owned_nodes])] = values
    return Heat(tuple(name.removeprefix("load ") for name in rises), node, total(model.comm, whole))


def missing_energy(
    model: LinearModel,
    *,
    forces: FloatArray,
    displacements: FloatArray,
    modal: FloatArray,
    stiffness: FloatArray,
) -> FloatArray:
    """The part of the static strain energy under each load that the modes lack, (k,). Collective.

    The static response of the reduced body to a load on the interfaces is exact; to a distributed load
    it is the best that its modes can do, 1 - sum of (modal force)^2 / stiffness / (f . u) away from the
    exact energy, and its largest error relative to that of the exact one is about the root of this.

    Args:
        model: the body.
        forces: (owned dofs, k) nodal forces, N; of a floating body self-equilibrated.
        displacements: (owned dofs, k) the full model's static response, m.
        modal: (k, n) modal forces.
        stiffness: (n,) 1/s^2.
    """
    full = model.comm.allreduce(np.einsum("ij,ij->j", forces, displacements))
    reduced = (modal**2 / stiffness).sum(axis=1)
    # a load that strains nothing, as no rise of temperature, lacks nothing
    part: FloatArray = np.maximum(1.0 - np.divide(reduced, full, out=np.ones_like(full), where=full > 0.0), 0.0)
    return part
