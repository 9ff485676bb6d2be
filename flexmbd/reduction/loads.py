"""The record's distributed loads: resultants and modal forces of loads that turn with the body."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from flexmbd.continuum.finite_elements.linear_model import LinearModel
from flexmbd.continuum.matrices.blocks import FloatArray, inner
from flexmbd.record.reduced_body import DistributedLoads
from flexmbd.reduction.unit_loads import Load


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
    part: FloatArray = np.maximum(1.0 - reduced / full, 0.0)
    return part
