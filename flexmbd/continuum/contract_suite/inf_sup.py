"""The inf-sup number of a mixed form: whether its further unknown is held by the displacements, however fine the mesh.

Chapelle & Bathe 1993, doi:10.1016/0045-7949(93)90340-J: the smallest singular value, but for those that are zero, of
the coupling between displacements in H1 and the further unknown in L2, with displacements held on the boundary. Here
over the largest, so that it is a number without unit. An element whose numbers fall as the mesh is refined locks, or
its pressures alternate; further zeros are pressures that no displacement feels.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.linalg
import scipy.sparse
import scipy.sparse.linalg
import ufl
from dolfinx import fem

from flexmbd.continuum.contract.formulation import Formulation
from flexmbd.continuum.contract_suite.trial import FloatArray, Trial
from flexmbd.continuum.contract_suite.trial_mesh import DIMENSION, Family, family_mesh

_DIVISIONS = {1: (3, 4, 6, 8), 2: (2, 3, 4, 5)}
_OTHERS = (1, 2, 3, 4)
_ZERO = 1e-7  # a singular value over the largest


@dataclass(frozen=True)
class InfSup:
    """Of one cell and degree.

    Attributes:
        cell, degree: of the element.
        divisions: (k,) cells along an edge of 1 m.
        numbers: (k,) smallest singular value that is not zero, over the largest; NaN without any.
        zeros: (k,) how many are zero.
        fault: why there are none; empty where there are.
    """

    cell: str
    degree: int
    divisions: tuple[int, ...]
    numbers: tuple[float, ...]
    zeros: tuple[int, ...]
    fault: str = ""


def inf_sup(
    form: Formulation, cell: str, degree: int, *, tell: Callable[[str], None] = lambda text: None
) -> InfSup | None:
    """The number on ever finer regular meshes; None of a form without a saddle point. On this rank alone. Compiles."""
    divisions = _DIVISIONS.get(degree, _OTHERS) if DIMENSION[cell] == 3 else (2, 4, 6, 8)
    try:
        if not _has_saddle(Trial(form, cell, degree)):
            return None
        tell(f"inf-sup number of {cell} {degree}")
        found = [_values(Trial(form, cell, degree, mesh=family_mesh(cell, Family.REGULAR, n=n))) for n in divisions]
    except Exception as error:  # noqa: BLE001  (a form file is foreign code)
        lines = str(error).strip().splitlines() or [""]
        return InfSup(cell, degree, (), (), (), f"{type(error).__name__}: {lines[-1]}")
    numbers, zeros = [], []
    for values in found:
        there = values[values > _ZERO * values.max(initial=0.0)]
        numbers.append(float(there.min() / values.max()) if len(there) else float("nan"))
        zeros.append(len(values) - len(there))
    return InfSup(cell, degree, divisions, tuple(numbers), tuple(zeros))


def _has_saddle(trial: Trial) -> bool:
    """Whether displacements hold a further unknown anywhere more firmly than its own stiffness, zero or negative, does.

    A pressure of a nearly incompressible solid is such a one; an electric potential, or strains of a cell, are not.
    """
    kinematic = trial.layout.kinematic
    further, moving = np.flatnonzero(~kinematic), np.setdiff1d(np.flatnonzero(kinematic), trial.boundary)
    if not len(further) or not len(moving):
        return False
    d = trial.scale
    scaled = d[:, None] * trial.stiffness(trial.rest()) * d
    own, coupling = scaled[np.ix_(further, further)], scaled[np.ix_(further, moving)]
    held = coupling @ np.linalg.lstsq(scaled[np.ix_(moving, moving)], coupling.T, rcond=None)[0]
    least = _ZERO * abs(scaled).max()
    return bool(np.linalg.eigvalsh(own)[-1] < least and np.linalg.eigvalsh(held + own)[-1] > least)


def _values(trial: Trial) -> FloatArray:
    """Singular values of the coupling, ascending."""
    kinematic = trial.layout.kinematic
    moving = np.setdiff1d(np.flatnonzero(kinematic), trial.boundary)
    further = np.flatnonzero(~kinematic)
    if not len(moving):
        return np.zeros(len(further))
    coupling = trial.quick_stiffness()[further][:, moving].toarray()
    gradients, values = _norms(trial)
    inner = gradients[moving][:, moving].tocsc()
    squares = coupling @ scipy.sparse.linalg.splu(inner).solve(coupling.T)
    lengths = values[further][:, further].toarray()
    found = scipy.linalg.eigh((squares + squares.T) / 2, lengths, eigvals_only=True)
    return np.asarray(np.sqrt(np.maximum(found, 0.0)))


def _norms(trial: Trial) -> tuple[scipy.sparse.csr_matrix, scipy.sparse.csr_matrix]:
    """Squares of the gradients of what rigid motions move, and of the values of what else the unknown holds."""
    u, v = ufl.TrialFunction(trial.space), ufl.TestFunction(trial.space)
    kinematic = trial.layout.kinematic
    moved: list[int] = []
    others: list[int] = []
    for field in trial.layout.fields:
        (moved if kinematic[field.dofs].any() else others).extend(range(field.components.start, field.components.stop))
    squares = (
        sum(ufl.inner(ufl.grad(u[i]), ufl.grad(v[i])) for i in moved),
        sum(u[i] * v[i] for i in others),
    )
    forms = [fem.form(one * ufl.dx(domain=trial.mesh, degree=2 * trial.degree + 2)) for one in squares]
    gradients, values = (fem.assemble_matrix(form).to_scipy().tocsr() for form in forms)
    return gradients, values
