"""Which part of a geometric stiffness may be used: that of stresses which follow the motion at once.

The second-order displacement behind a geometric stiffness is a static one: bending draws a beam's end in because its
axis is too stiff to be stretched.  The product of two modes swings with the sum of their frequencies, and a mode that
is slower than that does not follow.  To let it follow all the same is not only wrong: with the terms of fourth order
missing, the mass matrix of a machine can then lose its definiteness.
"""

from __future__ import annotations

import numpy as np

from flexmbd.continuum.blocks import FloatArray, inner, multiply
from flexmbd.continuum.model import ContinuumModel


def following_part(
    model: ContinuumModel,
    *,
    displacements: FloatArray,
    modes: FloatArray,
    by_load: FloatArray,
    by_mode: FloatArray,
) -> FloatArray:
    """The geometric stiffness without what cannot follow. Collective.

    The static displacement under a load is split into its modes, each of its own frequency, and the rest, of the
    frequency that its Rayleigh quotient gives; the stress of each counts for the pairs of modes whose frequencies
    add up to no more.

    Args:
        model: the body.
        displacements: (local dofs including ghosts, l) m per unit of each load.
        modes: (local dofs including ghosts, n) in normal form.
        by_load: (l, n, n) stress stiffness of the displacements.
        by_mode: (n, n, n) stress stiffness of the modes.

    Returns:
        (l, n, n), the same to the bit on every rank.
    """
    own: FloatArray = np.asfortranarray(modes[: model.n_owned])
    loaded: FloatArray = np.asfortranarray(displacements[: model.n_owned])
    omega = np.sqrt(np.diag(inner(model.comm, own, multiply(model.K, own))))
    share = inner(model.comm, loaded, multiply(model.K, own)) / omega**2
    rest = np.asfortranarray(loaded - own @ share.T)
    energy = np.diag(inner(model.comm, rest, multiply(model.K, rest)))
    inertia = np.diag(inner(model.comm, rest, multiply(model.M, rest)))
    omega_rest = np.sqrt(np.divide(energy, inertia, out=np.zeros_like(energy), where=(inertia > 0) & (energy > 0)))
    beat = np.add.outer(omega, omega)
    following = np.where(beat <= omega[:, None, None], by_mode, 0.0)
    remainder = by_load - np.einsum("lk,kij->lij", share, by_mode)
    kept = np.where(beat <= omega_rest[:, None, None], remainder, 0.0)
    return np.einsum("lk,kij->lij", share, following) + kept
