"""Elastic and viscous forces of a reduced body, and its strain energy."""

from __future__ import annotations

from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.compiling import entry_kernel, kernel, summing_kernel
from flexmbd.multibody.kernels.base.deferred import NUMBER, deferred_kernel
from flexmbd.multibody.kernels.physics.energy_polynomial import add_polynomial_forces, polynomial_energy


@kernel
def elastic_forces(modal, flex, q, qd, scratch, out):
    """Add the modal forces of deformation and its rate: K q + D qd, those of `stretch` or of the energy's polynomial.

    ``scratch``: (n,).
    """
    # in a kernel of its own: loops beside a call through an address are compiled worse
    _add_forces(modal, flex, q, qd, scratch, out)
    if flex[at.POLYNOMIAL] >= 0:
        add_polynomial_forces(modal, flex, q, 1.0, out)


@summing_kernel
def _add_forces(modal, flex, q, qd, scratch, out):
    """`elastic_forces` but for the polynomial's."""
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
        slope = modal[o : o + n]
        o += n
        e = 0.0
        s = 0.0
        for i in range(n):
            e += slope[i] * q[i]
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
        force = e + s
        for i in range(n):
            out[i] += s * slope[i] + force * scratch[i]


@entry_kernel
def add_elastic_forces(plan, flex, q, qd, scratch, out):
    """`elastic_forces`, for Python.

    Args:
        plan: Plan, the compiled scene.
        flex: (N_FLEX,) int64, the body's row of Plan.flex.
        q: (n,) float64, modal coordinates.
        qd: (n,) float64, their rates.
        scratch: (n,) float64.
        out: (n,) float64, modal forces, added to.
    """
    elastic_forces(plan.modal, flex, q, qd, scratch, out)


@deferred_kernel(NUMBER)
def elastic_energy(plan, flex, q):
    """Strain energy (J): K q^2 / 2, of each strain e + s of `stretch` ((e + s)^2 - e^2) / 2, and the polynomial."""
    modal = plan.modal
    k0 = flex[at.MODAL_STIFFNESS]
    energy = 0.0
    for j in range(flex[at.N_MODES]):
        energy += 0.5 * modal[k0 + j] * q[j] * q[j]
    for row in range(flex[at.N_STRETCH]):
        _, _, e, s = stretch(plan, flex, q, row)
        energy += 0.5 * s * (2.0 * e + s)
    if flex[at.POLYNOMIAL] >= 0:
        energy += polynomial_energy(modal, flex, q)
    return energy


@entry_kernel
def strain_energies(plan, flex, rows, o, out):
    """out[k] = `elastic_energy` (J) of the body whose modal coordinates stand from ``o`` in row k of ``rows``.

    Args:
        plan: Plan, the compiled scene.
        flex: (N_FLEX,) int64, the body's row of Plan.flex.
        rows: (k, nx) float64, configurations.
        o: int64, place of the modal coordinates.
        out: (k,) float64, J, output.
    """
    for k in range(rows.shape[0]):
        out[k] = elastic_energy(plan, flex, rows[k, o : o + flex[at.N_MODES]])


@entry_kernel
def strain_forces(plan, flex, rows, o, rest, scratch, out):
    """Add to out[k] (n,) the elastic forces in row k, as `strain_energies`; ``rest``: (n,) zeros, ``scratch``: (n,).

    Args:
        plan: Plan, the compiled scene.
        flex: (N_FLEX,) int64, the body's row of Plan.flex.
        rows: (k, nx) float64, configurations.
        o: int64, place of the modal coordinates.
        rest: (n,) float64, zeros.
        scratch: (n,) float64.
        out: (k, n) float64, added to.
    """
    for k in range(rows.shape[0]):
        elastic_forces(plan.modal, flex, rows[k, o : o + flex[at.N_MODES]], rest, scratch, out[k])


@kernel
def stretch(plan, flex, q, row):
    """A membrane strain (`ModalStretch`): offsets of its slope c and of its matrix C, e = c q and s = q^T C q / 2.

    Its energy is (e + s)^2 / 2, of which e^2 / 2 is in K; of C the lower triangle is stored, row by row.
    """
    modal = plan.modal
    n = flex[at.N_MODES]
    first = flex[at.STRETCH] + row * (n + n * (n + 1) // 2)
    e = 0.0
    s = 0.0
    o = first + n
    for i in range(n):
        e += modal[first + i] * q[i]
        t = 0.5 * modal[o + i] * q[i]
        for j in range(i):
            t += modal[o + j] * q[j]
        s += q[i] * t
        o += i + 1
    return first, first + n, e, s
