"""Which part of a geometric stiffness a moving body has: that of stresses which follow its motion at once.

The work of a load on the second-order displacement of two modes is a geometric stiffness if that displacement is
the static one: bending draws a beam's end in because its axis is too stiff to be stretched.  The product of modes i
and j swings with up to omega_i + omega_j, and a mode k in the static displacement follows by 1 / (1 - r^2) of it,
r = (omega_i + omega_j) / omega_k.  Taken as static its error is r^2 times that of leaving it out: it counts where
r <= 1.  To let a slower mode follow at once is not only wrong: it takes a negative mass, with which the mass matrix
of a fast mechanism may lose its definiteness.
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

    A static displacement is split into its modes, each of its own frequency, and the rest, of the frequency that its
    Rayleigh quotient gives; the stress of each counts for the pairs of modes whose frequencies add up to no more.

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
    forces = multiply(model.K, own)
    squares = np.diag(inner(model.comm, own, forces))
    share = inner(model.comm, loaded, forces) / squares
    rest = np.asfortranarray(loaded - own @ share.T)
    energy = np.diag(inner(model.comm, rest, multiply(model.K, rest)))
    inertia = np.diag(inner(model.comm, rest, multiply(model.M, rest)))
    # where nothing is left over, there is nothing to weigh
    limits = np.sqrt(np.divide(energy, inertia, out=np.zeros_like(energy), where=(inertia > 0) & (energy > 0)))
    omega = np.sqrt(squares)
    beat = np.add.outer(omega, omega)
    of_modes = np.where(beat <= omega[:, None, None], by_mode, 0.0)
    of_rest = np.where(beat <= limits[:, None, None], by_load - np.einsum("lk,kij->lij", share, by_mode), 0.0)
    following: FloatArray = np.einsum("lk,kij->lij", share, of_modes) + of_rest
    return following
