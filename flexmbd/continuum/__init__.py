"""The continuum side: everything that needs DOLFINx, PETSc, SLEPc or mpi4py."""

from flexmbd.continuum.finite_elements.cut_mesh import CutMesh as CutMesh
from flexmbd.continuum.finite_elements.cut_mesh import cut_mesh as cut_mesh
from flexmbd.continuum.finite_elements.homogeneous_energy import homogeneous_energy as homogeneous_energy
from flexmbd.continuum.finite_elements.interface import Interface as Interface
from flexmbd.continuum.finite_elements.mass_moments import rigid_body_of as rigid_body_of
from flexmbd.continuum.finite_elements.mass_moments import solid_of as solid_of
from flexmbd.continuum.finite_elements.model import ContinuumModel as ContinuumModel
from flexmbd.continuum.history.updated_lagrangian import UpdatedLagrangian as UpdatedLagrangian
from flexmbd.continuum.interior.contact_plane import RigidPlane as RigidPlane
from flexmbd.continuum.interior.explicit import ExplicitContinuum as ExplicitContinuum
from flexmbd.continuum.interior.explicit_run import EnergyAccount as EnergyAccount
from flexmbd.continuum.interior.explicit_run import ExplicitRun as ExplicitRun
from flexmbd.continuum.interior.implicit import ImplicitContinuum as ImplicitContinuum
from flexmbd.continuum.interior.nodal_motion import Support as Support
from flexmbd.continuum.interior.run_checkpoint import RegularCheckpoints as RegularCheckpoints
from flexmbd.continuum.parallel import MpiTeam as MpiTeam
