"""The order at which the reference problem's error falls, against the one that the form claims."""

from __future__ import annotations

from collections.abc import Callable

import dolfinx.mesh
import numpy as np
import scipy.sparse.linalg
import ufl
from numpy.typing import NDArray

from flexmbd.continuum.contract.formulation import Formulation, Reference, orders
from flexmbd.continuum.contract.hessian import EXACT
from flexmbd.continuum.contract_suite.outcome import Figure, Outcome
from flexmbd.continuum.contract_suite.trial import FloatArray, Trial
from flexmbd.continuum.contract_suite.trial_mesh import even_mesh

# Coarse and fine, by the degree of the element and the dimension of the cells.
_DIVISIONS = {(1, 3): (4, 8), (2, 3): (2, 4), (1, 2): (6, 12), (2, 2): (3, 6), (1, 1): (8, 16), (2, 1): (4, 8)}

#: How much less than the claimed order two coarse meshes may show.
SHORT = 0.15


def observed_order(trial: Trial) -> Outcome:
    """The displacement's L2 error in the reference problem falls at the claimed order."""
    claimed = orders(trial.form, trial.cell)[trial.degree]
    coarse, fine = _DIVISIONS.get((trial.degree, trial.dim), (1, 2))
    form, cell, degree = trial.form, trial.cell, trial.degree
    errors = [relative_error(form, cell, degree, mesh=even_mesh(cell, n=n)) for n in (coarse, fine)]
    if errors[1] < EXACT:
        return [Figure("error of the reference problem", errors[1], EXACT)]
    observed = float(np.log(errors[0] / errors[1]) / np.log(fine / coarse))
    if observed < claimed - SHORT:
        # cells may be too large for the problem: a third mesh says whether the order is still to come
        coarse, fine = fine, 3 * fine // 2
        errors = [errors[1], relative_error(form, cell, degree, mesh=even_mesh(cell, n=fine))]
        observed = float(np.log(errors[0] / errors[1]) / np.log(fine / coarse))
    remark = f"{observed:.2f} of {claimed}; error {errors[1]:.1e} with {fine} cells an edge"
    return [Figure("short of the claimed order by", max(claimed - observed, 0.0), SHORT, remark)]


class StaticProblem:
    """A static problem with a known solution, for a form on a mesh of this rank; not collective.

    Attributes:
        body: the form on the mesh; what its parameters' constants are counts at each solution.
    """

    def __init__(
        self,
        body: Trial,
        reference: Reference,
        *,
        held: Callable[[FloatArray], NDArray[np.bool_]] | None = None,
    ) -> None:
        """Compile.

        Args:
            body: the form on a mesh.
            reference: the solution, and what acts.
            held: of points (3, k) of the boundary, whether the solution is prescribed there; everywhere if None.
        """
        self.body = body
        x, v = ufl.SpatialCoordinate(body.mesh), ufl.TestFunction(body.space)
        self._exact, force = reference.displacement(x), reference.body_force(x)
        self._degree = 2 * body.degree + 4
        self._held = body.boundary if held is None else body.boundary_where(held)
        if self._exact.ufl_shape == (3,):
            self._held = np.intersect1d(self._held, body.displacement)
        self._acting = sum(force[i] * v[i] for i in range(force.ufl_shape[0]))
        off = ufl.as_vector([body.u[i] - self._exact[i] for i in range(3)])
        self._square = body.scalar_of(ufl.inner(off, off), degree=self._degree)

    def solve(self) -> tuple[FloatArray, float]:
        """The unknown, and its strain energy (J)."""
        body, values = self.body, self.body.interpolated(self._exact)
        stiffness, load = body.quick_stiffness(), body.load(self._acting, degree=self._degree)
        free = np.setdiff1d(np.arange(body.size), self._held)
        values[free] = 0.0
        # entries of displacements and pressures are of very different size
        diagonal = abs(stiffness.diagonal())[free]
        d = 1 / np.sqrt(np.where(diagonal > 0, diagonal, 1.0))
        inner = stiffness[free][:, free].multiply(d[:, None]).multiply(d).tocsc()
        values[free] = d * scipy.sparse.linalg.spsolve(inner, d * (load - stiffness @ values)[free])
        return values, float(values @ (stiffness @ values)) / 2

    def error(self) -> float:
        """Relative L2 error of the displacement."""
        return float(np.sqrt(self._square(self.solve()[0]) / self._square(self.body.rest())))


def relative_error(form: Formulation, cell: str, degree: int, *, mesh: dolfinx.mesh.Mesh) -> float:
    """Relative L2 error of the displacement in the form's reference problem on a mesh of this rank; not collective."""
    return StaticProblem(Trial(form, cell, degree, mesh=mesh), form.reference()).error()
