"""What a report tells of a form beside its check: figures of merit, which judge nothing."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from flexmbd.continuum.contract.formulation import Formulation
from flexmbd.continuum.contract_suite.cell_spectrum import CellSpectrum, cell_spectrum
from flexmbd.continuum.contract_suite.check_report import places
from flexmbd.continuum.contract_suite.convergence import MeshConvergence, convergence
from flexmbd.continuum.contract_suite.inf_sup import InfSup, inf_sup
from flexmbd.continuum.contract_suite.locking_study import Locking, locking_studies
from flexmbd.continuum.contract_suite.trial_mesh import DIMENSION, Family


@dataclass(frozen=True)
class FormStudies:
    """Of all cells and degrees of a form.

    Attributes:
        convergences: on meshes of each family.
        lockings: as nu approaches 1/2 and as the thickness goes to nothing.
        inf_sups: of mixed elements alone.
        spectra: of one cell, along the axes and distorted.
    """

    convergences: Sequence[MeshConvergence]
    lockings: Sequence[Locking]
    inf_sups: Sequence[InfSup]
    spectra: Sequence[CellSpectrum]


def study_form(form: Formulation, *, tell: Callable[[str], None] = lambda text: None) -> FormStudies:
    """Compute all of them, on this rank alone; what a form cannot do is told in its place. Compiles, for a minute.

    Args:
        form: a checked form file.
        tell: is told what begins.
    """
    elements = places(form)
    return FormStudies(
        [
            convergence(form, cell, degree, family=family, tell=tell)
            for cell, degree in elements
            for family in Family
            if DIMENSION[cell] > 1 or family is not Family.CURVED
        ],
        [one for cell, degree in elements for one in locking_studies(form, cell, degree, tell=tell)],
        [one for place in elements if (one := inf_sup(form, *place, tell=tell)) is not None],
        [cell_spectrum(form, *place, distorted=moved, tell=tell) for place in elements for moved in (False, True)],
    )
