"""Whether static shapes reproduce the rigid motions of a body, and these cost no energy."""

from __future__ import annotations

import numpy as np

from flexmbd.continuum.finite_elements.linear_model import LinearModel
from flexmbd.continuum.matrices.blocks import FloatArray, multiply
from flexmbd.errors import ReductionError
from flexmbd.reduction.static_shapes.stiffness_round_off import MARGIN, WORTHLESS, round_off


def check_rigid_motions(
    model: LinearModel, *, found: FloatArray, origin: FloatArray, axes: FloatArray
) -> float:
    """Refuse static shapes that miss a rigid motion, and a formulation whose rigid motions cost energy. Collective.

    Args:
        model: the body.
        found: (owned dofs, 6) static shapes of a boundary that moves rigidly.
        origin: (3,) m, about which it turns.
        axes: (3, 3), along whose columns it moves.

    Returns:
        The relative error of the worst motion.

    Raises:
        ReductionError: on all ranks: they cost energy, or the error is above its bound.
    """
    expected = model.rigid_motions(origin, axes)
    # coordinates are known to the last digit of themselves, however far from zero the mesh lies
    sizes = abs(expected) + abs(model.rigid_motions(np.zeros(3), axes))
    with round_off(model.K) as noise:
        excess = 0.0 if model.has_surface_energy else noise.excess(multiply(model.K, expected), sizes)
        error = noise.distance(found, expected)
    if not excess <= MARGIN:
        raise ReductionError(
            f"the formulation's rigid_motion costs energy, so that the static shapes miss a rigid motion of the body: "
            f"its forces are {excess:.1e} times the round-off of their terms, bound {MARGIN:.0f}"
        )
    if not error <= WORTHLESS:
        raise ReductionError(
            f"the static shapes miss a rigid motion of the body by {error:.1e} of it, bound {WORTHLESS:.0e}: a part of "
            "the body is connected to no interface or not to the rest, or the formulation has deformations without "
            "energy, or the body is so thin, slender or nearly incompressible that double precision cannot resolve its "
            "softest deformations beside its stiffest: take a formulation for it, of plates or beams"
        )
    return error
