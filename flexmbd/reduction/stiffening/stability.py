"""Whether a body that is held at its frame is stable: no small displacement of it lowers the energy."""

from __future__ import annotations

from petsc4py import PETSc

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum.matrices.blocks import inner, symmetric
from flexmbd.continuum.matrices.saddle_point import negative_directions, principal_part
from flexmbd.errors import ReductionError
from flexmbd.reduction.static_shapes.factor import Factor
from flexmbd.reduction.static_shapes.statics import Statics


def is_stable(statics: Statics) -> bool:
    """Whether the stiffness of a body held at its frame is positive definite. Collective.

    By Sylvester's law: the signs of the pivots with all rigid interfaces fixed, then those of the condensed stiffness
    of the interfaces. Unknowns without a rigid motion, as pressures, bring pivots of their own.
    """
    model = statics.model
    shapes, forces = statics.moving
    condensed = symmetric(inner(model.comm, shapes, forces))
    scale = np.sqrt(abs(np.diag(condensed)))
    if condensed.size and not np.linalg.eigvalsh(condensed / np.outer(scale, scale))[0] > 0.0:
        return False
    others = statics.mask & ~model.layout.kinematic[: model.n_owned]
    return _negative_pivots(model.K, statics.mask) == negative_directions(model.K, others)


def _negative_pivots(stiffness: PETSc.Mat, mask: NDArray[np.bool_]) -> int:
    """How many negative eigenvalues the rows and columns of a symmetric matrix have; all if singular. Collective."""
    part = principal_part(stiffness, mask)
    try:
        factor = Factor(part, definite=False)
        count = factor.negative_pivots
        factor.destroy()
    except ReductionError:
        count = int(part.getSize()[0])
    finally:
        part.destroy()
    return count
