"""What the checks ask of a form on a mesh: of its material whether it varies, of its fields which are free."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from flexmbd.continuum.contract.hessian import EXACT
from flexmbd.continuum.contract_suite.measures import largest
from flexmbd.continuum.contract_suite.trial import FloatArray, Trial, equilibration

# m, by which a mesh is moved to see whether a material varies with the place.
_ELSEWHERE = np.array([0.37, -0.23, 0.41])


def is_uniform(trial: Trial) -> bool:
    """Whether the stiffness at rest is the same wherever the mesh is: the material does not vary with the place.

    A form may be written with the place for another reason, as one whose strains are functions of a cell's own axes.
    """
    return not trial.holds_place or _is_unmoved(trial, lambda: trial.stiffness(trial.rest()))


def has_uniform_mass(trial: Trial) -> bool:
    """The same of the mass."""
    return not trial.mass_holds_place or _is_unmoved(
        trial, lambda: np.asarray(sum(mass.toarray() for mass in trial.masses()))
    )


#: Why forms of the small strain are not turned.
SMALL_STRAIN = (
    "the form sees the small strain alone, and takes rotations to be small, as bodies do whose axes turn with them "
    "(reduced, ContinuumBody)"
)


def sees_small_strain(trial: Trial) -> bool:
    """Whether the form sees the small strain alone: no force changes by a motion that is one of small rotations.

    However large that is, and whatever else the form makes of the strain. What else the unknown holds is at rest.
    """
    rows = trial.displacement.reshape(-1)
    displaced = trial.rest()
    displaced[rows] = trial.some(1)[rows]
    turned = displaced + trial.rigid[:, 3:] @ [0.9, -0.5, 0.7]
    force = trial.scale * trial.force(displaced)
    change = trial.scale * trial.force(turned) - force
    return largest(change[rows]) < 1e-9 * largest(force[rows])


def free_constants(trial: Trial, scaled: FloatArray) -> int:
    """Constants of further unknowns that do nothing, as that of an electric potential without a ground.

    Args:
        trial: the form on a mesh.
        scaled: (n, n) stiffness at rest, scaled by `trial.scale`.
    """
    shapes = [shape / trial.scale for shape in _constants(trial)]
    return sum(largest(scaled @ (shape / largest(shape))) < EXACT * largest(scaled) for shape in shapes)


def _constants(trial: Trial) -> list[FloatArray]:
    """One of each component of the continuous fields that no rigid motion moves."""
    found = []
    for field in trial.layout.fields:
        if trial.layout.kinematic[field.dofs].any() or field.space.ufl_element().discontinuous:
            continue
        size = field.space.dofmap.index_map_bs
        for component in range(size):
            shape = trial.rest()
            shape[field.dofs[component::size]] = 1.0
            found.append(shape)
    return found


def _is_unmoved(trial: Trial, matrix: Callable[[], FloatArray]) -> bool:
    """Whether a matrix is the same on the mesh moved as a whole, within its dimension, as on it."""
    here, x = matrix(), trial.mesh.geometry.x
    kept = x.copy()
    x[:, : trial.dim] += _ELSEWHERE[: trial.dim]
    try:
        there = matrix()
    finally:
        x[:] = kept
    d = equilibration(here)
    return largest(d[:, None] * (there - here) * d) < EXACT
