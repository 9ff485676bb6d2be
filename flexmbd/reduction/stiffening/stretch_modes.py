"""Further modes for membrane strains by the loads of a body's own motion.

A spinning beam is stretched by forces that grow along it, and its tension stiffens its bending.  Interface shapes have
the tension of a force at the tip, and the modes that would mend it are far above the range of frequencies that modes
are chosen for.  The static displacement of such a load with all interfaces fixed, as far as the modes have not got it,
is orthogonal to them in mass and stiffness, and can be added to them as it is (modal truncation augmentation: Dickens,
Nakagawa & Wittbrodt 1997, A critique of mode acceleration and modal truncation augmentation methods for modal
response analysis, Computers & Structures 62).  What stretches nothing, as the bending by such a load, is left out:
only the membrane part of the displacements is added (`flexmbd.reduction.stiffening.membrane`).
"""

from __future__ import annotations

import numpy as np

from flexmbd.continuum import parallel
from flexmbd.continuum.finite_elements.ghosts import with_ghosts
from flexmbd.continuum.finite_elements.linear_model import LinearModel
from flexmbd.continuum.matrices.blocks import FloatArray, inner, multiply, symmetric
from flexmbd.continuum.matrices.eigen import Modes
from flexmbd.reduction.modes.ritz import independent, ritz_modes
from flexmbd.reduction.static_shapes.statics import Statics
from flexmbd.reduction.stiffening.geometric_stiffness import UnitLoads
from flexmbd.reduction.stiffening.membrane import membrane_fields
from flexmbd.reduction.stiffening.resolved import resolved_deformations
from flexmbd.reduction.stiffening.stress_stiffness import stress_stiffness

# Of the largest effect of the loads on the stiffness what one of them may lack.
_LACKING = 1e-3


def stretch_modes(
    statics: Statics,
    fixed: Modes,
    *,
    loads: UnitLoads,
    displacements: FloatArray,
    held: FloatArray,
    images: FloatArray,
) -> Modes:
    """Modes beside the fixed-interface modes, orthonormal with them, by their signs' rule. Collective.

    Args:
        statics: of the body.
        fixed: the modes there are, on all owned dofs.
        loads: l of them, the inertia forces of the body's own motion, named by a kind and its axes.
        displacements: (owned dofs, l) the static response to them, interfaces free.
        held: (owned dofs, l) that with all interfaces fixed.
        images: (owned dofs, fields) M times the fields of the signs' rule.

    Returns:
        The modes, eigenvalues by the Rayleigh-Ritz method, ascending; none where no stress changes the stiffness.
    """
    model, comm = statics.model, statics.model.comm
    known = inner(comm, fixed.shapes, loads.forces) / fixed.eigenvalues[:, None]
    rest = np.asfortranarray(held - fixed.shapes @ known)
    basis: FloatArray = np.asfortranarray(np.hstack([statics.moving[0], fixed.shapes]))
    of_basis, of_rest, of_whole = (_energies(model, fields) for fields in (basis, rest, displacements))
    modal = parallel.on_root(comm, lambda: independent(of_basis, np.diag(of_basis)))
    if model.nodal:
        modal = modal @ _resolved(statics, basis @ modal, loads=loads, displacements=displacements, fixed=fixed)
    own = parallel.on_root(comm, lambda: independent(of_rest, np.diag(of_whole)))
    scaled = np.hstack([basis @ modal, rest @ own])
    local = with_ghosts(model, scaled)
    found = stress_stiffness(model, local, local)
    if found is None:
        return Modes(np.zeros(0), np.zeros((len(rest), 0), order="F"))
    projected = inner(comm, scaled, multiply(model.K, displacements))
    # the rests in their own basis: own^T of_rest own = 1
    projected[modal.shape[1] :] = own.T @ of_rest
    chosen = parallel.on_root(comm, lambda: own @ _combinations(found, loads, projected, first=modal.shape[1]))
    shapes = np.asfortranarray(rest @ chosen)
    # what rounding left of the modes
    shapes = np.asfortranarray(shapes - fixed.shapes @ inner(comm, fixed.shapes, multiply(model.M, shapes)))
    return ritz_modes(model, shapes, images=images)


def _resolved(
    statics: Statics, scaled: FloatArray, *, loads: UnitLoads, displacements: FloatArray, fixed: Modes
) -> FloatArray:
    """Which combinations of fields, of the same energy without energy in common, are stiffened. Collective."""
    model, comm = statics.model, statics.model.comm
    responses = inner(comm, scaled, multiply(model.K, displacements))
    if statics.floating and statics.rigid is not None:
        scaled = statics.rigid.deformation(scaled)
    mass = symmetric(inner(comm, scaled, multiply(model.M, scaled)))
    highest = float(fixed.eigenvalues.max(initial=0.0))
    return parallel.on_root(
        comm,
        lambda: resolved_deformations(mass, responses, accelerations=loads.accelerations, eigenvalue=highest),
    )


def _energies(model: LinearModel, fields: FloatArray) -> FloatArray:
    """(l, l) twice the strain energies of fields and of their pairs. Collective."""
    return symmetric(inner(model.comm, fields, multiply(model.K, fields)))


def _combinations(found: FloatArray, loads: UnitLoads, held: FloatArray, *, first: int) -> FloatArray:
    """(r, m) what of the rests to add: their membrane part, as far as it stiffens.

    Args:
        found: (n + r, n + r, n + r) stress stiffness of n modes and r rests, all of the same energy and without any in
            common, in the same.
        loads: l of them.
        held: (n + r, l) the static displacements under them in these.
        first: n.
    """
    # motions of the body by the same accelerations, those about one axis as fast as those about another
    kinds = np.array([name.rsplit(" ", 1)[0] for name in loads.names])
    held = held * np.array([1.0 / loads.accelerations[kinds == kind].max() for kind in kinds])
    effect = found[:, :first, :first].reshape(len(found), first * first)
    whole, fields = np.linalg.norm(held.T @ effect, axis=1), membrane_fields(found)
    # what is not a membrane force is left out in any case, and its size is all that can be reached
    bending = np.linalg.norm((held - fields @ (fields.T @ held)).T @ effect, axis=1)
    reached = np.maximum(_LACKING * whole.max(initial=0.0), bending)
    scale = np.divide(1.0, reached, out=np.zeros_like(reached), where=reached > 0.0)
    membrane = membrane_fields(found, first=first)
    directions, sizes, _ = np.linalg.svd(membrane @ (membrane.T @ held[first:]) * scale, full_matrices=False)
    lacking = sizes * np.linalg.norm(directions.T @ effect[first:], axis=1)
    chosen: FloatArray = directions[:, lacking > 1.0]
    return chosen
