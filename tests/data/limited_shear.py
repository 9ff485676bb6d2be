"""The updated Lagrangian form, whose steps it asks to be of shears below a hundredth."""

import ufl

from flexmbd.forms import updated_lagrangian
from flexmbd.forms.updated_lagrangian import CELLS as CELLS
from flexmbd.forms.updated_lagrangian import ORDER as ORDER
from flexmbd.forms.updated_lagrangian import REFERENCE as REFERENCE
from flexmbd.forms.updated_lagrangian import Parameters as Parameters
from flexmbd.forms.updated_lagrangian import cell_mean as cell_mean
from flexmbd.forms.updated_lagrangian import element as element
from flexmbd.forms.updated_lagrangian import energies as energies
from flexmbd.forms.updated_lagrangian import kinetic_energy as kinetic_energy
from flexmbd.forms.updated_lagrangian import local_residual as local_residual
from flexmbd.forms.updated_lagrangian import local_unknowns as local_unknowns
from flexmbd.forms.updated_lagrangian import reference as reference
from flexmbd.forms.updated_lagrangian import residual as residual
from flexmbd.forms.updated_lagrangian import rigid_motion as rigid_motion
from flexmbd.forms.updated_lagrangian import scaled_yield as scaled_yield
from flexmbd.forms.updated_lagrangian import state as state
from flexmbd.forms.updated_lagrangian import stress as stress
from flexmbd.forms.updated_lagrangian import update as update


def increment_size(u, state, p):
    shear = ufl.dev(updated_lagrangian.linear_strain(u) + updated_lagrangian.nonlinear_strain(u))
    return ufl.sqrt(ufl.inner(shear, shear)) / 0.01
