"""Formulations: one a file, written in UFL alone; ufl, basix.ufl, dataclasses and other forms are all it imports.

What several have in common stands in `_shared`; a file of a user's own needs nothing of it.
The contract of such a file is `flexmbd.continuum.contract.formulation.Formulation`. A formulation need not
live here: any module that satisfies the contract can be handed to the continuum side.
"""

from flexmbd.libraries import require as _require

_require("flexmbd.forms", "basix", "ufl")

from flexmbd.forms import beam_exact as beam_exact
from flexmbd.forms import beam_timoshenko as beam_timoshenko
from flexmbd.forms import hencky_plasticity as hencky_plasticity
from flexmbd.forms import j2_plasticity as j2_plasticity
from flexmbd.forms import neo_hookean as neo_hookean
from flexmbd.forms import plane_stress as plane_stress
from flexmbd.forms import plate_mitc as plate_mitc
from flexmbd.forms import solid_enhanced as solid_enhanced
from flexmbd.forms import solid_linear as solid_linear
from flexmbd.forms import solid_micropolar as solid_micropolar
from flexmbd.forms import solid_mixed as solid_mixed
from flexmbd.forms import solid_nearly_incompressible as solid_nearly_incompressible
from flexmbd.forms import solid_orthotropic as solid_orthotropic
from flexmbd.forms import solid_piezo as solid_piezo
from flexmbd.forms import st_venant_kirchhoff as st_venant_kirchhoff
from flexmbd.forms import updated_lagrangian as updated_lagrangian
