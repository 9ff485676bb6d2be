"""Which deformations of a body with nodal interfaces are stiffened.

Each node that moves by itself is three static shapes that dent the body in its place. They are there to be summed up to
what neighbours do, and by themselves they are stiff: a stress changes their stiffness by its ratio to the modulus and
no more, while it changes that of bending by as much again as the part is slender, squared. Nor is the stress of a dent
one that the body's motion or a load on a frame causes. So the stiffening is that of what the reduction resolves: the
body's own modes up to the highest frequency of the fixed-interface modes, or up to that of the deformations by its own
motion where this is higher, and the static responses to loads, whose stress is then complete. What is left out are
deformations above the range in which a reduced body is right.
"""

from __future__ import annotations

import numpy as np

from flexmbd.continuum.matrices.blocks import FloatArray, symmetric
from flexmbd.reduction.modes.ritz import independent
from flexmbd.round_off import EQUAL


def resolved_deformations(
    mass: FloatArray, responses: FloatArray, *, accelerations: FloatArray, eigenvalue: float
) -> FloatArray:
    """An orthonormal basis of the deformations that are stiffened.

    Args:
        mass: (n, n) in a basis of deformations of the same energy without energy in common, s^2.
        responses: (n, l) static responses to loads in this basis.
        accelerations: (l,) sizes of the accelerations of inertia loads, as of `UnitLoads`; zero of others.
        eigenvalue: the highest of the fixed-interface modes', 1/s^2; 0 where there are none.

    Returns:
        (n, r).
    """
    own = responses[:, accelerations > 0.0] / accelerations[accelerations > 0.0]
    energies = np.einsum("ij,ij->j", own, own)
    own = own[:, energies > EQUAL * energies.max(initial=0.0)]
    quotients = np.einsum("ij,ij->j", own, mass @ own) / np.einsum("ij,ij->j", own, own)
    values, vectors = np.linalg.eigh(symmetric(mass))
    highest = max(eigenvalue, float((1.0 / quotients).max(initial=0.0)))
    modes = vectors[:, values * highest >= 1.0][:, ::-1]
    rest = responses - modes @ (modes.T @ responses)
    more = rest @ independent(symmetric(rest.T @ rest), np.einsum("ij,ij->j", responses, responses))
    return np.hstack([modes, more])
