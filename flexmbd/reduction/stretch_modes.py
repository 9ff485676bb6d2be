"""Further modes for what the loads of a body's own motion stretch.

A spinning beam is stretched by forces that grow along it, and its tension stiffens its bending.  Interface shapes have
the tension of a force at the tip, and the modes that would mend it are far above the range of frequencies that modes
are chosen for.  The static displacement of such a load with all interfaces fixed, as far as the modes have not got it,
is orthogonal to them in mass and stiffness, and can be added to them as it is (modal truncation augmentation: Dickens,
Nakagawa & Wittbrodt 1997, A critique of mode acceleration and modal truncation augmentation methods for modal
response analysis, Computers & Structures 62).
"""

from __future__ import annotations

import numpy as np
import scipy.linalg

from flexmbd.continuum import parallel
from flexmbd.continuum.blocks import FloatArray, inner, multiply, symmetric
from flexmbd.continuum.eigen import Modes
from flexmbd.continuum.ghosts import with_ghosts
from flexmbd.continuum.stress_stiffness import stress_stiffness
from flexmbd.reduction.signs import determined_rotation
from flexmbd.reduction.statics import Statics

# A mode is added for what makes this part of a kind of load's geometric stiffness.
_EFFECT = 0.05
# Not for a kind that stiffens less than this beside another, where both strain the body with the same energy.
_STIFFENS = 1e-3


def stretch_modes(
    statics: Statics,
    fixed: Modes,
    *,
    names: tuple[str, ...],
    loads: FloatArray,
    displacements: FloatArray,
    images: FloatArray,
) -> Modes:
    """Modes beside the fixed-interface modes, orthonormal with them, by their signs' rule. Collective.

    Args:
        statics: of the body.
        fixed: the modes there are, on all owned dofs.
        names: (l,) of the loads, a kind and its axes.
        loads: (owned dofs, l) nodal forces, N per unit of each load.
        displacements: (owned dofs, l) the static response to them, interfaces free.
        images: (owned dofs, fields) M times the fields of the signs' rule.

    Returns:
        The modes, eigenvalues by the Rayleigh-Ritz method, ascending; none where no stress changes the stiffness.
    """
    model, comm = statics.model, statics.model.comm
    rest = np.zeros(loads.shape, order="F")
    rest[statics.mask] = statics.solve(np.asfortranarray(loads[statics.mask]))
    rest = np.asfortranarray(rest - fixed.shapes @ (inner(comm, fixed.shapes, loads) / fixed.eigenvalues[:, None]))
    basis: FloatArray = np.asfortranarray(np.hstack([statics.static.shapes[:, 6:], fixed.shapes]))
    energy = np.diag(inner(comm, basis, multiply(model.K, basis)))
    fields = with_ghosts(model, np.hstack([rest, displacements]))
    found = stress_stiffness(model, fields, with_ghosts(model, basis / np.sqrt(energy)))
    if found is None:
        return Modes(np.zeros(0), np.zeros((len(rest), 0), order="F"))
    work = np.einsum("ij,ij->j", displacements, multiply(model.K, displacements))
    strain = np.sqrt(np.maximum(comm.allreduce(work), 0.0))
    chosen = parallel.on_root(comm, lambda: _combinations(found, names, strain))
    shapes = np.asfortranarray(rest @ chosen)
    # what rounding left of the modes
    shapes = np.asfortranarray(shapes - fixed.shapes @ inner(comm, fixed.shapes, multiply(model.M, shapes)))
    mass, stiffness = (symmetric(inner(comm, shapes, multiply(matrix, shapes))) for matrix in (model.M, model.K))
    projections = inner(comm, shapes, images)

    def ritz() -> tuple[FloatArray, FloatArray]:
        # mass by stiffness, as in the normal form
        inverse, x = scipy.linalg.eigh(mass, stiffness)
        eigenvalues = 1.0 / inverse[::-1]
        x = x[:, ::-1] * np.sqrt(eigenvalues)
        return eigenvalues, x @ determined_rotation(eigenvalues, x.T @ projections)

    eigenvalues, x = parallel.on_root(comm, ritz)
    return Modes(eigenvalues, np.asfortranarray(shapes @ x))


def _combinations(found: FloatArray, names: tuple[str, ...], strain: FloatArray) -> FloatArray:
    """(l, m) the combinations of rests that matter.

    Args:
        found: (2 l, n, n) stress stiffness of the rests, and of the whole displacements, in modes of equal energy.
        names: (l,) of the loads.
        strain: (l,) roots of the strain energy of the whole displacements.
    """
    rest, whole = np.split(found.reshape(2 * len(names), -1), 2)
    kinds = np.array([name.rsplit(" ", 1)[0] for name in names])
    norms = np.linalg.norm(whole, axis=1)
    rate = np.divide(norms, strain, out=np.zeros_like(norms), where=strain > 0.0)
    weights = np.zeros(len(names))
    for kind in set(kinds):
        one = kinds == kind
        if rate[one].max() > _STIFFENS * rate.max():
            weights[one] = 1.0 / norms[one].max()
    left, effect, _ = np.linalg.svd(rest * weights[:, None], full_matrices=False)
    chosen: FloatArray = weights[:, None] * left[:, effect > _EFFECT]
    return chosen
