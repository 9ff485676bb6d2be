"""Which of a body's displacements are membrane fields.

The second-order strain of two displacements i and j has a part T_kij in the strain of a third one k, all of the same
energy (`stress_stiffness`).  Bending a slender part turns it far at little energy, so that it stretches other fields
and is not stretched itself; pulling it does the opposite.  That is the kind of a strain, and it needs neither the order
of frequencies nor a bound: with

    E_kl = sum_ij T_kij T_lij    what pairs of displacements stretch k by,
    G_il = sum_kj T_kij T_klj    what i stretches others by, in pairs with any displacement,

quadratic forms of the same trace on the same space, the membrane fields are those of which E is more than G: the
positive eigenspace of E - G.  It does not depend on the basis, so that of modes of equal or neighbouring frequencies
none is treated otherwise than the rest.  Where E and G are alike neither is large: there all is of the size of the
strain itself, as of a short block, and either choice changes next to nothing.

A membrane field follows what others stretch it by, and is then a displacement without a strain: its second-order
strain together with what turns is of the third order in rotations, and is left out with all of that order.  That of
pure stretch with itself is complete: with u' + (u'^2 + w'^2) / 2 = 0 a bent beam is as long as before, exactly.
"""

from __future__ import annotations

import numpy as np

from flexmbd.continuum.matrices.blocks import FloatArray, symmetric
from flexmbd.round_off import EQUAL


def membrane_fields(second_order: FloatArray, *, first: int = 0) -> FloatArray:
    """An orthonormal basis of the membrane fields.

    Args:
        second_order: (n, n, n) T_kij, symmetric in i and j, in a basis of displacements of the same energy without
            energy in common.
        first: only combinations of the displacements from this one on are looked at.

    Returns:
        (n - first, m) combinations of these.
    """
    n = len(second_order)
    taken = second_order.reshape(n, n * n)
    given = np.moveaxis(second_order, 1, 0).reshape(n, n * n)
    excess = symmetric(taken @ taken.T) - symmetric(given @ given.T)
    values, fields = np.linalg.eigh(excess[first:, first:])
    chosen: FloatArray = fields[:, values > EQUAL * np.abs(values).max(initial=0.0)]
    return chosen[:, ::-1]


def stretching_fields(fields: FloatArray, gradients: FloatArray) -> FloatArray:
    """An orthonormal basis of the membrane fields that stretch and do not turn.

    Args:
        fields: (n, m) from `membrane_fields`.
        gradients: (n, n) `strain_over_rotation` of the basis.

    Returns:
        (n, k) combinations of the basis.
    """
    values, vectors = np.linalg.eigh(symmetric(fields.T @ gradients @ fields))
    chosen: FloatArray = fields @ vectors[:, values > EQUAL * np.abs(values).max(initial=0.0)]
    return chosen
