"""Whether the gradients of displacements are strain rather than rotation."""

from __future__ import annotations

import numpy as np
import ufl
from dolfinx import fem
from numpy.typing import NDArray

from flexmbd.continuum.finite_elements.linear_model import LinearModel

FloatArray = NDArray[np.float64]

# Times the rotation's square: in shear a gradient is strain and rotation alike, in bending the more rotation.
_ROTATION = 3.0


def strain_over_rotation(model: LinearModel, fields: FloatArray) -> FloatArray:
    """Integrals of e_i : e_j - 3 w_i : w_j, e the symmetric part of grad u, w the other one. Collective.

    Of a field it is positive where the gradient is strain for three quarters of its square and more. On a line or a
    surface the gradient is that along it.

    Args:
        model: the body; in a mixed unknown the displacement comes first.
        fields: (local dofs including ghosts, n) u_i, m.

    Returns:
        (n, n) symmetric, m^3 (m^2 on a surface, m on a line), the same to the bit on every rank.
    """
    arguments = ufl.TestFunction(model.space), ufl.TrialFunction(model.space)
    b, c = (ufl.as_tensor([ufl.grad(field)[i, :] for i in range(3)]) for field in arguments)
    # its sign is what matters: as many points as hold the gradients' size
    rule = ufl.dx(degree=2 * max(model.space.ufl_element().embedded_superdegree - 1, 1))
    density = ufl.inner(ufl.sym(b), ufl.sym(c)) - _ROTATION * ufl.inner(ufl.skew(b), ufl.skew(c))
    form = fem.form(density * rule)
    matrix = fem.create_matrix(form)
    fem.assemble_matrix(matrix, form)
    # this rank's own cells; rows of ghosts are not added to their owners, the ranks' sums are instead
    local = matrix.to_scipy(ghosted=True).tocsr()[:, : len(fields)]
    found: FloatArray = model.comm.bcast(model.comm.reduce(fields.T @ (local @ fields), root=0), root=0)
    return np.asarray(0.5 * (found + found.T))
