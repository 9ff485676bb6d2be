"""The continuum side: everything that needs DOLFINx, PETSc, SLEPc or mpi4py."""

from flexmbd.continuum.contact_plane import RigidPlane as RigidPlane
from flexmbd.continuum.cut_mesh import CutMesh as CutMesh
from flexmbd.continuum.cut_mesh import cut_mesh as cut_mesh
from flexmbd.continuum.explicit import ExplicitContinuum as ExplicitContinuum
from flexmbd.continuum.explicit_run import EnergyAccount as EnergyAccount
from flexmbd.continuum.explicit_run import ExplicitRun as ExplicitRun
from flexmbd.continuum.homogeneous_energy import homogeneous_energy as homogeneous_energy
from flexmbd.continuum.implicit import ImplicitContinuum as ImplicitContinuum
from flexmbd.continuum.interface import Interface as Interface
from flexmbd.continuum.mass_moments import rigid_body_of as rigid_body_of
from flexmbd.continuum.mass_moments import solid_of as solid_of
from flexmbd.continuum.model import ContinuumModel as ContinuumModel
from flexmbd.continuum.nodal_motion import Support as Support
from flexmbd.continuum.parallel import MpiTeam as MpiTeam
from flexmbd.continuum.run_checkpoint import RegularCheckpoints as RegularCheckpoints
from flexmbd.continuum.updated_lagrangian import UpdatedLagrangian as UpdatedLagrangian
