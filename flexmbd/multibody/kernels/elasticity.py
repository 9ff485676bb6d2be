"""Elastic and viscous forces of a reduced body, and its strain energy."""

from __future__ import annotations

from flexmbd.multibody.kernels import layout as at
from flexmbd.multibody.kernels.compiling import entry_kernel, kernel


@entry_kernel
def add_elastic_forces(plan, flex, q, qd, out):
    """Add the modal forces of deformation and its rate, K q + D qd and those of `stretch`."""
    modal = plan.modal
    n = flex[at.N_MODES]
    k0 = flex[at.MODAL_STIFFNESS]
    d0 = flex[at.MODAL_DAMPING]
    for j in range(n):
        out[j] += modal[k0 + j] * q[j]
    if d0 >= 0:
        for j in range(n):
            t = 0.0
            for k in range(n):
                t += modal[d0 + n * j + k] * qd[k]
            out[j] += t
    for row in range(flex[at.N_STRETCH]):
        k, o, s = stretch(plan, flex, q, row)
        stiffness = modal[k0 + k]
        out[k] += stiffness * s
        force = stiffness * (q[k] + s)
        for i in range(n):
            t = modal[o + i] * q[i]
            for j in range(i):
                t += modal[o + j] * q[j]
                out[j] += force * modal[o + j] * q[i]
            out[i] += force * t
            o += i + 1


@kernel
def elastic_energy(plan, flex, q):
    """Strain energy: the sum of K_kk (q_k + s_k)^2 / 2 with the second-order part s_k of `stretch`."""
    modal = plan.modal
    k0 = flex[at.MODAL_STIFFNESS]
    energy = 0.0
    for j in range(flex[at.N_MODES]):
        energy += 0.5 * modal[k0 + j] * q[j] * q[j]
    for row in range(flex[at.N_STRETCH]):
        k, _, s = stretch(plan, flex, q, row)
        energy += 0.5 * modal[k0 + k] * s * (2.0 * q[k] + s)
    return energy


@kernel
def stretch(plan, flex, q, row):
    """Mode k of a row, the offset of its matrix C, and s_k = q^T C q / 2.

    The mode's strain takes s_k of all modes' rotations besides its own q_k (`ModalStretch`); of C the lower
    triangle is stored, row by row.
    """
    modal = plan.modal
    n = flex[at.N_MODES]
    first = flex[at.STRETCH] + row * (1 + n * (n + 1) // 2)
    s = 0.0
    o = first + 1
    for i in range(n):
        t = 0.5 * modal[o + i] * q[i]
        for j in range(i):
            t += modal[o + j] * q[j]
        s += q[i] * t
        o += i + 1
    return int(modal[first]), first + 1, s
