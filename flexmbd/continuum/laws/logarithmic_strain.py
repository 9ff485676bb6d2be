"""A law in logarithmic strain made one in Green and Lagrange's, at a point, compiled.

With the eigenvalues e_i of E = (F^T F - 1) / 2 and f(e) = 1/2 ln(1 + 2 e) the logarithmic strain is f(E).  Its
derivatives in the eigenvectors' axes are divided differences of f, first ones in P = df/dE and second ones in what the
stress T adds to the tangent; the second Piola-Kirchhoff stress is S = T : P.  (Miehe, Apel & Lambrecht 2002,
doi:10.1016/S0045-7825(02)00438-3.)  Divided differences are evaluated so that equal eigenvalues need no case of their
own: first ones by log1p, second ones by Gauss quadrature of

    ln[a, b, c] = - integral from 0 to infinity of dt / ((t + a) (t + b) (t + c)),   t = m (1 + s) / (1 - s)

with m = (a b c)^(1/3): round-off for stretches up to 1.6, 1e-6 for 3; it is in the tangent alone.
"""

from __future__ import annotations

import math

import numpy as np

from flexmbd.multibody.kernels.base.law_function import law_part

_POINTS, _WEIGHTS = np.polynomial.legendre.leggauss(14)

# Of the components xx, yy, zz, yz, xz, xy.
_ROW = np.array([0, 1, 2, 1, 0, 0])
_COLUMN = np.array([0, 1, 2, 2, 2, 1])


@law_part
def tensor_of_strain(strain):  # type: ignore[no-untyped-def]
    """(3, 3) of a strain (6,) with twice the tensor's shears."""
    tensor = np.empty((3, 3))
    for k in range(6):
        value = strain[k] if k < 3 else strain[k] / 2
        tensor[_ROW[k], _COLUMN[k]] = tensor[_COLUMN[k], _ROW[k]] = value
    return tensor


@law_part
def _strain_of_tensor(tensor):  # type: ignore[no-untyped-def]
    strain = np.empty(6)
    for k in range(6):
        strain[k] = (1.0 if k < 3 else 2.0) * tensor[_ROW[k], _COLUMN[k]]
    return strain


@law_part
def _first_difference(a, b):  # type: ignore[no-untyped-def]
    """(ln a - ln b) / (a - b)."""
    x = (a - b) / b
    return math.log1p(x) / (x * b) if x != 0.0 else 1.0 / b


@law_part
def _second_difference(a, b, c):  # type: ignore[no-untyped-def]
    """ln[a, b, c]."""
    m = (a * b * c) ** (1 / 3)
    total = 0.0
    for s, weight in zip(_POINTS, _WEIGHTS):  # noqa: B905  (numba)
        u, v = m * (1 + s), 1 - s
        total -= weight * 2 * m * v / ((u + a * v) * (u + b * v) * (u + c * v))
    return total


@law_part
def logarithmic_strain(strain):  # type: ignore[no-untyped-def]
    """Of Green and Lagrange's strain: the logarithmic one, and what its derivatives are made of.

    Args:
        strain: (6,) with twice the tensor's shears, of a cell that is not inside out: 1 + 2 e > 0.

    Returns:
        The logarithmic strain (6,); stretches' squares 1 + 2 e (3,); the eigenvectors' components, by columns, (3, 3).
    """
    values, vectors = np.linalg.eigh(tensor_of_strain(strain))
    halves = np.empty(3)
    for i in range(3):
        halves[i] = math.log1p(2 * values[i]) / 2
    return _strain_of_tensor((vectors * halves) @ vectors.T), 1 + 2 * values, vectors


@law_part
def pulled_back(stress, tangent, squares, vectors):  # type: ignore[no-untyped-def]
    """Stress and tangent of a law in logarithmic strain, in Green and Lagrange's.

    Args:
        stress: (6,) of the law.
        tangent: (6, 6) of the law.
        squares: (3,) of the stretches.
        vectors: (3, 3) eigenvectors.

    Returns:
        The second Piola-Kirchhoff stress (6,) and its derivative by Green and Lagrange's strain (6, 6).
    """
    first, second = np.empty((3, 3)), np.empty((3, 3, 3))
    for i in range(3):
        for j in range(3):
            first[i, j] = _first_difference(squares[i], squares[j])
            for k in range(3):
                second[i, j, k] = 2 * _second_difference(squares[i], squares[j], squares[k])
    own = np.empty((3, 3))
    for k in range(6):
        own[_ROW[k], _COLUMN[k]] = own[_COLUMN[k], _ROW[k]] = stress[k]
    own = vectors.T @ own @ vectors
    basis, turned = np.empty((6, 3, 3)), np.empty((6, 6))
    unit = np.zeros(6)
    for a in range(6):
        unit[:] = 0.0
        unit[a] = 1.0
        basis[a] = vectors.T @ tensor_of_strain(unit) @ vectors
        turned[:, a] = _strain_of_tensor(vectors @ (first * basis[a]) @ vectors.T)
    result = turned.T @ tangent @ turned
    for a in range(6):
        for b in range(6):
            total = 0.0
            for i in range(3):
                for j in range(3):
                    for k in range(3):
                        both = basis[a, i, k] * basis[b, k, j] + basis[b, i, k] * basis[a, k, j]
                        total += own[i, j] * second[i, k, j] * both
            result[a, b] += total
    return turned.T @ stress, result
