"""Elastic and viscous forces of a reduced body, and its strain energy."""

from __future__ import annotations

from flexmbd.multibody.kernels import layout as at
from flexmbd.multibody.kernels.compiling import entry_kernel, kernel, summing_kernel


@summing_kernel
def elastic_forces(modal, flex, q, qd, scratch, out):
    """Add the modal forces of deformation and its rate, K q + D qd and those of `stretch`; ``scratch`` (n,)."""
    n = flex[at.N_MODES]
    k0 = flex[at.MODAL_STIFFNESS]
    d0 = flex[at.MODAL_DAMPING]
    spring = modal[k0 : k0 + n]
    for j in range(n):
        out[j] += spring[j] * q[j]
    if d0 >= 0:
        damper = modal[d0 : d0 + n * n].reshape((n, n))
        for j in range(n):
            t = 0.0
            for i in range(n):
                t += damper[j, i] * qd[i]
            out[j] += t
    o = flex[at.STRETCH]
    for _ in range(flex[at.N_STRETCH]):
        k = int(modal[o])
        o += 1
        s = 0.0
        for i in range(n):
            row = modal[o : o + i + 1]
            f = q[i]
            t = 0.0
            for j in range(i):
                c = row[j]
                t += c * q[j]
                scratch[j] += c * f
            s += f * (t + 0.5 * row[i] * f)
            scratch[i] = t + row[i] * f
            o += i + 1
        stiffness = spring[k]
        out[k] += stiffness * s
        force = stiffness * (q[k] + s)
        for i in range(n):
            out[i] += force * scratch[i]


@entry_kernel
def add_elastic_forces(plan, flex, q, qd, scratch, out):
    """`elastic_forces`, for Python."""
    elastic_forces(plan.modal, flex, q, qd, scratch, out)


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
