"""The strain energy of large displacements: a polynomial of degree four in the modal coordinates.

Beside q^T K q / 2 it is sum c_ijk q_i q_j q_k + sum d_ijkl q_i q_j q_k q_l over i >= j >= k >= l (`NonlinearStiffness`
of the record), taken factor by factor from outside: sum_i q_i sum_j q_j sum_k q_k (c_ijk + sum_l d_ijkl q_l).
Plan.modal holds the c, then the d, in the order of these loops.
"""

from __future__ import annotations

from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.compiling import summing_kernel
from flexmbd.multibody.kernels.base.deferred import NUMBER, deferred_kernel


@summing_kernel
def _add_gradient(modal, o, n, q, share, out):
    """Add ``share`` times the gradient to ``out`` (n,): each factor of a product in its turn."""
    cubic = o
    quartic = o + n * (n + 1) * (n + 2) // 6
    for i in range(n):
        by_i = 0.0
        qi = share * q[i]
        for j in range(i + 1):
            by_j = 0.0
            qij = qi * q[j]
            for k in range(j + 1):
                by_k = modal[cubic]
                cubic += 1
                row = modal[quartic : quartic + k + 1]
                quartic += k + 1
                qijk = qij * q[k]
                for m in range(k + 1):
                    by_k += row[m] * q[m]
                    out[m] += row[m] * qijk
                out[k] += qij * by_k
                by_j += q[k] * by_k
            out[j] += qi * by_j
            by_i += q[j] * by_j
        out[i] += share * by_i


@summing_kernel
def _value(modal, o, n, q):
    cubic = o
    quartic = o + n * (n + 1) * (n + 2) // 6
    energy = 0.0
    for i in range(n):
        by_i = 0.0
        for j in range(i + 1):
            by_j = 0.0
            for k in range(j + 1):
                by_k = modal[cubic]
                cubic += 1
                row = modal[quartic : quartic + k + 1]
                quartic += k + 1
                for m in range(k + 1):
                    by_k += row[m] * q[m]
                by_j += q[k] * by_k
            by_i += q[j] * by_j
        energy += q[i] * by_i
    return energy


@summing_kernel
def _add_second_derivatives(modal, o, n, q, share, half):
    """Add to ``half`` (n, n), its lower triangle, what with its transpose is ``share`` times the Hessian."""
    cubic = o
    quartic = o + n * (n + 1) * (n + 2) // 6
    for i in range(n):
        qi = share * q[i]
        row_i = half[i]
        for j in range(i + 1):
            qj = share * q[j]
            row_j = half[j]
            qij = qi * q[j]
            by_ij = 0.0
            for k in range(j + 1):
                by_k = modal[cubic]
                cubic += 1
                row = modal[quartic : quartic + k + 1]
                quartic += k + 1
                row_k = half[k]
                qik = qi * q[k]
                qjk = qj * q[k]
                for m in range(k + 1):
                    d = row[m]
                    by_k += d * q[m]
                    row_k[m] += qij * d
                    row_j[m] += qik * d
                    row_i[m] += qjk * d
                row_j[k] += qi * by_k
                row_i[k] += qj * by_k
                by_ij += q[k] * by_k
            row_i[j] += share * by_ij


@deferred_kernel()
def add_polynomial_forces(modal, flex, q, share, out):
    """Add ``share`` times the polynomial's gradient at q to ``out`` (n,)."""
    _add_gradient(modal, flex[at.POLYNOMIAL], flex[at.N_MODES], q, share, out)


@deferred_kernel(NUMBER)
def polynomial_energy(modal, flex, q):
    """The cubic and quartic part of the strain energy (J)."""
    return _value(modal, flex[at.POLYNOMIAL], flex[at.N_MODES], q)


@deferred_kernel()
def add_polynomial_tangent(modal, flex, q, share, scratch, first, matrix):
    """Add ``share`` times the polynomial's Hessian at q to the block of ``matrix`` from ``first``; scratch (n, n)."""
    n = flex[at.N_MODES]
    for i in range(n):
        for j in range(i + 1):
            scratch[i, j] = 0.0
    _add_second_derivatives(modal, flex[at.POLYNOMIAL], n, q, share, scratch)
    for i in range(n):
        for j in range(i):
            matrix[first + i, first + j] += scratch[i, j]
            matrix[first + j, first + i] += scratch[i, j]
        matrix[first + i, first + i] += 2.0 * scratch[i, i]
