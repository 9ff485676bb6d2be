"""The order at which the reference problem's error falls, against the one that the form claims."""

from __future__ import annotations

import numpy as np
import scipy.sparse.linalg
import ufl

from flexmbd.continuum.contract.formulation import orders
from flexmbd.continuum.contract.hessian import EXACT
from flexmbd.continuum.contract_suite.outcome import Figure, Outcome
from flexmbd.continuum.contract_suite.trial import Trial
from flexmbd.continuum.contract_suite.trial_mesh import even_mesh

# Coarse and fine, by the degree of the element and the dimension of the cells.
_DIVISIONS = {(1, 3): (4, 8), (2, 3): (2, 4), (1, 2): (6, 12), (2, 2): (3, 6), (1, 1): (8, 16), (2, 1): (4, 8)}

# How much less than the claimed order two coarse meshes may show.
_SHORT = 0.15



def observed_order(trial: Trial) -> Outcome:
    """The displacement's L2 error in the reference problem falls at the claimed order."""
    claimed = orders(trial.form, trial.cell)[trial.degree]
    coarse, fine = _DIVISIONS.get((trial.degree, trial.dim), (1, 2))
    errors = [relative_error(trial, n=n) for n in (coarse, fine)]
    if errors[1] < EXACT:
        return [Figure("error of the reference problem", errors[1], EXACT)]
    observed = float(np.log(errors[0] / errors[1]) / np.log(fine / coarse))
    remark = f"{observed:.2f} of {claimed}; error {errors[1]:.1e} with {fine} cells an edge"
    return [Figure("short of the claimed order by", max(claimed - observed, 0.0), _SHORT, remark)]


def relative_error(trial: Trial, *, n: int) -> float:
    """Relative L2 error of the displacement in the form's reference problem, n cells an edge.

    Not collective.
    """
    problem = trial.form.reference()
    body = Trial(trial.form, trial.cell, trial.degree, mesh=even_mesh(trial.cell, n=n))
    x, v = ufl.SpatialCoordinate(body.mesh), ufl.TestFunction(body.space)
    degree = 2 * body.degree + 4
    exact, force = problem.displacement(x), problem.body_force(x)
    values, places = body.interpolated(exact), body.boundary
    if exact.ufl_shape == (3,):
        places = np.intersect1d(places, body.displacement)
    stiffness = body.quick_stiffness()
    load = body.load(sum(force[i] * v[i] for i in range(force.ufl_shape[0])), degree=degree)
    free = np.setdiff1d(np.arange(body.size), places)
    values[free] = 0.0
    # entries of displacements and pressures are of very different size
    diagonal = abs(stiffness.diagonal())[free]
    d = 1 / np.sqrt(np.where(diagonal > 0, diagonal, 1.0))
    inner = stiffness[free][:, free].multiply(d[:, None]).multiply(d).tocsc()
    values[free] = d * scipy.sparse.linalg.spsolve(inner, d * (load - stiffness @ values)[free])
    off = ufl.as_vector([body.u[i] - exact[i] for i in range(3)])
    error = body.scalar_of(ufl.inner(off, off), degree=degree)
    return float(np.sqrt(error(values) / error(body.rest())))
