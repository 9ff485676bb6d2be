"""Eigenvalues of the stiffness of a single free cell: its rigid motions, and how unlike its other modes are."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from flexmbd.continuum.contract.entries import is_layered
from flexmbd.continuum.contract.formulation import Formulation
from flexmbd.continuum.contract.hessian import EXACT
from flexmbd.continuum.contract_suite.trial import FloatArray, Trial, equilibration
from flexmbd.continuum.contract_suite.trial_mesh import single_cell


@dataclass(frozen=True)
class CellSpectrum:
    """Of one cell.

    Attributes:
        cell, degree: of the element.
        is_distorted: whether the cell is moved by the map of the distorted meshes; else its edges of 1 m lie along the
            axes.
        values: (n,) ascending, over the largest; of the stiffness between what rigid motions move, the rest being
            solved for, and where rotations are among it, scaled to entries of one on the diagonal.
        fault: why there are none; empty where there are.
    """

    cell: str
    degree: int
    is_distorted: bool
    values: tuple[float, ...]
    fault: str = ""

    @property
    def zeros(self) -> int:
        """Motions without energy; six of a sound solid."""
        return sum(abs(value) < EXACT for value in self.values)


def cell_spectrum(
    form: Formulation, cell: str, degree: int, *, distorted: bool, tell: Callable[[str], None] = lambda text: None
) -> CellSpectrum:
    """The eigenvalues of one cell; on this rank alone. Compiles."""
    tell(f"eigenvalues of one cell, {cell} {degree}")
    try:
        trial = Trial(form, cell, degree, mesh=single_cell(cell, distorted=distorted, layered=is_layered(form)))
        matrix = _condensed(trial)
        if matrix.shape[0] > trial.displacement.size:
            d = equilibration(matrix)
            matrix = d[:, None] * matrix * d
        values = np.linalg.eigvalsh((matrix + matrix.T) / 2)
    except Exception as error:  # noqa: BLE001  (a form file is foreign code)
        lines = str(error).strip().splitlines() or [""]
        return CellSpectrum(cell, degree, distorted, (), f"{type(error).__name__}: {lines[-1]}")
    return CellSpectrum(cell, degree, distorted, tuple(float(one) for one in values / abs(values).max()))


def _condensed(trial: Trial) -> FloatArray:
    """Stiffness at rest of what rigid motions move; the rest of the unknown is in equilibrium."""
    stiffness, kinematic = trial.stiffness(trial.rest()), trial.layout.kinematic
    moved = stiffness[np.ix_(kinematic, kinematic)]
    if kinematic.all():
        return np.asarray(moved)
    d = trial.scale
    own = (d[:, None] * stiffness * d)[np.ix_(~kinematic, ~kinematic)]
    coupling = (d[:, None] * stiffness)[np.ix_(~kinematic, kinematic)]
    # an unknown that nothing holds, as a potential without ground, is left where it is
    return np.asarray(moved - coupling.T @ np.linalg.lstsq(own, coupling, rcond=None)[0])
