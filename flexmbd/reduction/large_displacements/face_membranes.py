"""A stiff membrane on the face of a rigid interface, which keeps it rigid where shapes of a basis strain it.

The displacement of a face is affine, d + A X, and linear in the coordinates. Turned by a finite angle it is rigid only
where the coordinates of the further shapes follow the turn; left alone they give way to the body's stress, which would
strain a face that is to be rigid.  The energy

    1/2 e : P : e,   e = (A + A^T + A^T A) / 2,

holds them: none of a turn, of degree four in the coordinates as the body's own.  P is `STIFF` times what the body has
against such a strain, its other interfaces at rest and its interior in equilibrium; so what is left of the strain
is the STIFF-th part.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexmbd.continuum.finite_elements.interface import RigidInterface
from flexmbd.continuum.matrices.blocks import FloatArray, inner, multiply, symmetric
from flexmbd.record.strain_polynomial import monomials
from flexmbd.reduction.large_displacements.face_fields import prescribe
from flexmbd.reduction.static_shapes.statics import Statics

#: The stiffness of the membranes over the body's.
STIFF = 100.0
# Strains xx yy zz and twice yz xz xy, by their entries of A.
_VOIGT = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))


@dataclass(frozen=True, eq=False)
class FaceMembranes:
    """Membranes on the faces of a body.

    Attributes:
        stiffness: (b, 6, 6) P, J, by strains xx yy zz and twice yz xz xy in the mesh's axes; zero of averaged faces and
            of the body frame's.
        gradients: (b, 3, 3, n) A by the coordinates, in the mesh's axes.
    """

    stiffness: FloatArray
    gradients: FloatArray

    @property
    def strains(self) -> FloatArray:
        """(b, 6, n) of the first order."""
        A = self.gradients
        return np.stack([A[:, a, a] if a == b else A[:, a, b] + A[:, b, a] for a, b in _VOIGT], axis=1)

    def products(self, other: FaceMembranes) -> FloatArray:
        """(n, m) J: the membranes' stiffness between these fields and others."""
        return np.asarray(np.einsum("bin,bij,bjm->nm", self.strains, self.stiffness, other.strains, optimize=True))

    def higher_products(self) -> tuple[FloatArray, FloatArray]:
        """e_i : P : h_jk (n, pairs) and h_ij : P : h_kl (pairs, pairs), h_ij = sym(A_i^T A_j), sums over the faces."""
        A = self.gradients
        first, second = monomials(A.shape[3], 2).T
        second_order = np.zeros((len(A), 6, len(first)))
        for i, (a, b) in enumerate(_VOIGT):
            products = np.einsum("fcn,fcm->fnm", A[:, :, a], A[:, :, b])
            whole = products if a == b else products + products.transpose(0, 2, 1)
            second_order[:, i] = whole[:, first, second]
        stress = self.stiffness @ second_order
        linear = np.einsum("fin,fip->np", self.strains, stress, optimize=True)
        return linear, np.einsum("fip,fir->pr", second_order, stress, optimize=True)


def membrane_stiffness(statics: Statics) -> FloatArray:
    """(b, 6, 6) P, J, of all faces. Collective."""
    model, found = statics.model, np.zeros((len(statics.interfaces), 6, 6))
    strains = np.zeros((3, 4, 6))
    for i, (a, b) in enumerate(_VOIGT):
        strains[a, 1 + b, i] += 0.5
        strains[b, 1 + a, i] += 0.5
    for i in range(0 if statics.floating else 1, len(statics.interfaces)):
        one = statics.interfaces[i]
        if isinstance(one, RigidInterface):
            strained = np.zeros((model.n_owned, 6), order="F")
            prescribe(model, one, strains, strained)
            u = np.asfortranarray(strained + statics.held_response(-multiply(model.K, strained)))
            found[i] = STIFF * symmetric(inner(model.comm, u, multiply(model.K, u)))
    return found
