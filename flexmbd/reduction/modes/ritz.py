"""Modes by the Rayleigh-Ritz method in the span of given shapes."""

from __future__ import annotations

import numpy as np
import scipy.linalg

from flexmbd.continuum import parallel
from flexmbd.continuum.finite_elements.linear_model import LinearModel
from flexmbd.continuum.matrices.blocks import FloatArray, inner, multiply, symmetric
from flexmbd.continuum.matrices.eigen import Modes
from flexmbd.reduction.modes.signs import determined_rotation
from flexmbd.round_off import EQUAL


def ritz_modes(model: LinearModel, shapes: FloatArray, *, images: FloatArray) -> Modes:
    """Mass-normalised modes in the span of independent shapes, by the signs' rule. Collective.

    Args:
        model: the body.
        shapes: (owned dofs, k).
        images: (owned dofs, fields) M times the fields of the signs' rule.

    Returns:
        k modes, eigenvalues ascending.
    """
    comm = model.comm
    mass, stiffness = (symmetric(inner(comm, shapes, multiply(matrix, shapes))) for matrix in (model.M, model.K))
    projections = inner(comm, shapes, images)

    def ritz() -> tuple[FloatArray, FloatArray]:
        # mass by stiffness, as in the normal form
        inverse, x = scipy.linalg.eigh(mass, stiffness)
        eigenvalues = 1.0 / inverse[::-1]
        x = x[:, ::-1] * np.sqrt(eigenvalues)
        return eigenvalues, x @ determined_rotation(eigenvalues, x.T @ projections)

    eigenvalues, x = parallel.on_root(comm, ritz)
    return Modes(eigenvalues, np.asfortranarray(shapes @ x))


def independent_shapes(model: LinearModel, shapes: FloatArray, *, whole: FloatArray) -> FloatArray:
    """Combinations of shapes, of unit strain energy and without any in common, but for what is round-off. Collective.

    Args:
        model: the body.
        shapes: (owned dofs, k).
        whole: (k,) twice the strain energies that the shapes' round-off is of.

    Returns:
        (owned dofs, r), r no more than k.
    """
    energies = symmetric(inner(model.comm, shapes, multiply(model.K, shapes)))
    return np.asfortranarray(shapes @ parallel.on_root(model.comm, lambda: independent(energies, whole)))


def independent(energies: FloatArray, whole: FloatArray) -> FloatArray:
    """(l, r) combinations of shapes, of energy 1/2, none in common, but for what is round-off of the whole."""
    scale = np.divide(1.0, np.sqrt(np.abs(whole)), out=np.zeros(len(whole)), where=whole != 0.0)
    values, vectors = np.linalg.eigh(scale[:, None] * energies * scale)
    own = values > EQUAL
    combinations: FloatArray = scale[:, None] * vectors[:, own] / np.sqrt(values[own])
    return combinations
