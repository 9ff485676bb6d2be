"""The patch test: fields of constant strain are solutions on any mesh, and the stress does their work."""

from __future__ import annotations

from typing import Any, cast

import numpy as np
import ufl

from flexmbd.continuum.contract.entries import optional_entries
from flexmbd.continuum.contract.hessian import EXACT
from flexmbd.continuum.contract.local_newton import point_keywords
from flexmbd.continuum.contract_suite.fields import is_uniform
from flexmbd.continuum.contract_suite.measures import largest, ratio
from flexmbd.continuum.contract_suite.outcome import Figure, Outcome, Remark, Verdict
from flexmbd.continuum.contract_suite.trial import FloatArray, Trial

# So small that a stress of finite strain is that of the linear one to four digits.
_STRAIN = 1e-5

_GRADIENT = np.array([[0.7, -0.3, 0.5], [0.4, -0.6, 0.2], [-0.8, 0.1, 0.9]])

_VARIES = "the material varies with the place: constant strain is not a solution; the observed order stands for it"


def patch_test(trial: Trial) -> Outcome:
    """States of constant strain, prescribed on the boundary, are found inside on a distorted mesh.

    Of a solid a linear displacement, and its rotation; of a line stretch, twist and bending; of a surface stretch,
    shear, bending and twist in its plane.
    """
    if not is_uniform(trial):
        return Remark(Verdict.SKIP, _VARIES)
    kinematic = np.flatnonzero(trial.layout.kinematic)
    if len(kinematic) == len(trial.boundary):
        return Remark(Verdict.FAIL, "no unknown lies inside the mesh")
    off = []
    for state in states(trial):
        solved = solve(trial, state)
        scaled = (solved - state)[kinematic] / trial.scale[kinematic]
        off.append(ratio(largest(scaled), largest(state[kinematic] / trial.scale[kinematic])))
    return [Figure("displacements off by", max(off), EXACT)]


def stress_work(trial: Trial) -> Outcome:
    """The stress of a constant strain does the work that the energy says (solids)."""
    u = trial.u
    state = optional_entries(trial.form).state
    history = None if state is None else ufl.as_ufl(state(trial.parameters))
    given = point_keywords(trial.form, u, history, trial.parameters)
    stress = cast(Any, trial.form).stress(u, history, trial.parameters, **given)
    if trial.dim < 3 or stress.ufl_shape != (3, 3):
        return Remark(Verdict.SKIP, "for solids with a stress of shape (3, 3)")
    displacement = ufl.as_vector([u[i] for i in range(3)])
    density = ufl.inner(stress, ufl.sym(ufl.grad(displacement))) / 2
    solved = solve(trial, states(trial)[0])
    work = trial.scalar_of(density, degree=2 * trial.degree + 2)(solved)
    energy = solved @ trial.stiffness(trial.rest()) @ solved / 2
    # where the material varies the two rules differ
    limit = 1e-3 if is_uniform(trial) else 0.05
    return [Figure("work off by", ratio(abs(work - energy), abs(energy)), limit)]


def constant_strain() -> FloatArray:
    """(3, 3) strain of the solid's state among `states`."""
    strain: FloatArray = _STRAIN / 2 * (_GRADIENT + _GRADIENT.T)
    return strain


def solve(trial: Trial, state: FloatArray) -> FloatArray:
    """Solution of the linear problem with a state's displacements and rotations on the boundary."""
    d = trial.scale
    scaled = d[:, None] * trial.stiffness(trial.rest()) * d
    fixed = trial.boundary
    free = np.setdiff1d(np.arange(trial.size), fixed)
    solution = np.zeros(trial.size)
    solution[fixed] = state[fixed] / d[fixed]
    right = -scaled[np.ix_(free, fixed)] @ solution[fixed]
    # an unknown without stiffness must not end the test
    solution[free] = np.linalg.lstsq(scaled[np.ix_(free, free)], right, rcond=None)[0]
    return d * solution


def states(trial: Trial) -> list[FloatArray]:
    """Unknowns of constant strain. What no rigid motion moves, as pressures, is zero.

    A point's unknown follows from its displacement and the rotation of its section by `rigid_motion`.
    """
    x = ufl.SpatialCoordinate(trial.mesh)
    zero, axes = ufl.as_vector((0.0, 0.0, 0.0)), [ufl.unit_vector(i, 3) for i in range(3)]
    if trial.dim == 3:
        # where the unknown has rotations, they are those of the displacement: no couples, no slip
        g = _GRADIENT
        turn = [(g[2, 1] - g[1, 2]) / 2, (g[0, 2] - g[2, 0]) / 2, (g[1, 0] - g[0, 1]) / 2]
        fields = [(ufl.dot(ufl.as_matrix(g.tolist()), x), ufl.as_vector(turn))]
    elif trial.dim == 1:
        along, s = axes[0], x[0]
        bent = [(s**2 / 2 * ufl.cross(axis, along), s * axis) for axis in axes[1:]]
        fields = [(s * along, zero), (zero, s * along), *bent]
    else:
        normal = axes[2]
        stretches = [x[0] * axes[0], x[1] * axes[1], x[1] * axes[0] + x[0] * axes[1]]
        heights = [x[0] ** 2 / 2, x[1] ** 2 / 2, x[0] * x[1]]
        slopes = [x[0] * axes[0], x[1] * axes[1], x[1] * axes[0] + x[0] * axes[1]]
        # a normal turned by w moves by w x n, which is minus the slope
        bent = [(h * normal, ufl.cross(normal, -s)) for h, s in zip(heights, slopes, strict=True)]
        fields = [*((stretch, zero) for stretch in stretches), *bent]
    return [
        trial.interpolated(_STRAIN * trial.form.rigid_motion(zero, displacement, rotation))
        for displacement, rotation in fields
    ]
