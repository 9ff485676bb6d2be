"""Fields of unit strain energy, none of it in common: the inner product in which modal derivatives are told apart."""

from __future__ import annotations

import numpy as np

from flexmbd.continuum import parallel
from flexmbd.continuum.matrices.blocks import FloatArray, inner, multiply, symmetric
from flexmbd.reduction.large_displacements.load_series import FaceFields
from flexmbd.reduction.static_shapes.statics import Statics

# Of the largest strain energy among the candidates: what is left of it by round-off.
_ROUND_OFF = 1e-13


def unit_energies(statics: Statics, fields: FaceFields) -> FaceFields:
    """The same span, orthonormal in the strain energy. Collective."""
    model = statics.model
    k = symmetric(inner(model.comm, fields.u, multiply(model.K, fields.u)))
    scale = 1.0 / np.sqrt(np.diag(k))
    factor = np.linalg.cholesky(k * np.outer(scale, scale))
    return fields.combined(scale[:, None] * np.linalg.inv(factor).T)


def further(statics: Statics, known: FaceFields, candidates: FaceFields, *, most: int, least: float) -> FaceFields:
    """What candidates have beside known fields of unit energy: unit energies, none in common, most needed first.

    Args:
        statics: of the body.
        known: the fields.
        candidates: more.
        most: how many are taken.
        least: twice the energy that is not looked at.
    """
    model = statics.model
    for _ in range(2):
        part = inner(model.comm, known.u, multiply(model.K, candidates.u))
        candidates = candidates.less(known, part)
    k = symmetric(inner(model.comm, candidates.u, multiply(model.K, candidates.u)))

    def change() -> FloatArray:
        values, vectors = np.linalg.eigh(k)
        own = np.flatnonzero(values > max(least, _ROUND_OFF * values[-1]))[::-1][:most]
        found: FloatArray = vectors[:, own] / np.sqrt(values[own])
        return found

    return candidates.combined(parallel.on_root(model.comm, change))
