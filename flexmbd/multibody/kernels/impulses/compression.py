"""Poisson's law of impact: the impulses that bring surfaces to rest against each other, and act again where they part.

Compression begins from the velocity with half of what smooth forces do in the step, and ends where no contact
approaches; decompression has the other half, and gives at least e times the impulse of compression.  So what rests is
pressed by twice its compression, which no e exceeds, and stays at rest, and an elastic impact keeps the energy.
"""

from __future__ import annotations

from flexmbd.multibody.kernels.algebra.so3 import dot3, load3, scale3, store3
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.elements.hard_element import LAW_POISSON, LAW_RESTITUTION
from flexmbd.multibody.kernels.impulses.gauss_seidel import solve_impulses


@kernel
def decompresses(contacts, watched):
    """Whether there are contacts with Poisson's law in the step."""
    for i in range(contacts.count[0]):
        if watched.law[contacts.watched[i], LAW_POISSON] != 0.0:
            return True
    return False


@kernel
def compress(parts, contacts, watched, v, share, nothing, most):
    """Write the least normal impulses of the step, and impulses to begin with; the sweeps, and the share at last.

    ``v``: the velocity halfway through the smooth forces; lost.  ``share``, ``nothing``, ``most``: see
    ``solve_impulses``.
    """
    n = contacts.count[0]
    for i in range(n):
        k = contacts.watched[i]
        contacts.shift[i] = contacts.bound[i]
        approach = dot3(load3(watched.normal[k], 0), load3(watched.before[k], 0))
        if watched.law[k, LAW_RESTITUTION] > 0.0 and approach < 0.0:
            contacts.bound[i] = 0.0
        store3(contacts.impulse[i], 0, scale3(0.5, load3(contacts.impulse[i], 0)))
    sweeps, left = solve_impulses(parts, contacts, v, share, nothing, most)
    for i in range(n):
        k = contacts.watched[i]
        contacts.bound[i] = contacts.shift[i]
        if watched.law[k, LAW_POISSON] != 0.0:
            contacts.least[i] = (1.0 + watched.law[k, LAW_RESTITUTION]) * contacts.impulse[i, 0]
        store3(contacts.impulse[i], 0, scale3(2.0, load3(contacts.impulse[i], 0)))
    return sweeps, left
