"""Residual vectors: the static contribution of the modes that are left out, as further modes.

A load's static response with all interfaces fixed, less what the modes have of it, is the quasi-static share of all
modes that were left out. Kept as shapes beside the modes they do what the mode acceleration method does afterwards
(modal truncation augmentation: Dickens, Nakagawa & Wittbrodt 1997, Computers & Structures 62): stresses converge as
fast as displacements. They are orthogonal to the modes in mass and in stiffness.
"""

from __future__ import annotations

import numpy as np

from flexmbd.continuum.matrices.blocks import FloatArray, inner, multiply, total
from flexmbd.continuum.matrices.eigen import Modes
from flexmbd.reduction.modes.ritz import independent_shapes, ritz_modes
from flexmbd.reduction.static_shapes.statics import Statics


def residual_vectors(
    statics: Statics, fixed: Modes, *, forces: FloatArray, held: FloatArray, images: FloatArray
) -> Modes:
    """Modes beside the fixed-interface modes, as many as the loads have independent rests. Collective.

    Args:
        statics: of the body.
        fixed: the modes there are, on all owned dofs, without stiffness in common.
        forces: (owned dofs, l) nodal forces of unit loads.
        held: (owned dofs, l) the static response to them with all interfaces fixed.
        images: (owned dofs, fields) M times the fields of the signs' rule.

    Returns:
        The modes, eigenvalues by the Rayleigh-Ritz method, ascending.
    """
    model, comm = statics.model, statics.model.comm
    stiff = multiply(model.K, held)
    energies = total(comm, np.einsum("ij,ij->j", held, stiff))
    energies += statics.cancelled_energies(forces, forces=stiff)
    known = inner(comm, fixed.shapes, forces) / fixed.eigenvalues[:, None]
    rest = np.asfortranarray(held - fixed.shapes @ known)
    shapes = independent_shapes(model, rest, whole=energies)
    # what rounding left of the modes
    shapes = np.asfortranarray(shapes - fixed.shapes @ inner(comm, fixed.shapes, multiply(model.M, shapes)))
    return ritz_modes(model, shapes, images=images)
