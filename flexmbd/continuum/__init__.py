"""The continuum side: everything that needs DOLFINx, PETSc, SLEPc or mpi4py.

Users enter here; the reduction, the meshes and the commands enter the rooms.  Of the machine it knows the record
and the protocol of interiors alone.
"""

from flexmbd.libraries import OF_THE_CONTINUUM as _OF_THE_CONTINUUM
from flexmbd.libraries import load_continuum as _load_continuum
from flexmbd.libraries import require as _require
from flexmbd.room import public_names as _public_names

_require("flexmbd.continuum", *_OF_THE_CONTINUUM)
_load_continuum()

from petsc4py import PETSc as _PETSc  # noqa: F401  (starts PETSc)

from flexmbd.continuum.parallel import python_takes_broken_pipes as _python_takes_broken_pipes

_python_takes_broken_pipes()

from flexmbd.continuum.contract.cell_fields import CellFields as CellFields
from flexmbd.continuum.contract.dof_layout import DofLayout as DofLayout
from flexmbd.continuum.contract.entries import OptionalEntries as OptionalEntries
from flexmbd.continuum.contract.formulation import Formulation as Formulation
from flexmbd.continuum.contract.formulation import IntegralTerm as IntegralTerm
from flexmbd.continuum.contract.formulation import Quadrature as Quadrature
from flexmbd.continuum.contract.formulation import Reference as Reference
from flexmbd.continuum.contract.formulation import load_form as load_form
from flexmbd.continuum.contract_suite import FormReport as FormReport
from flexmbd.continuum.contract_suite import check_form as check_form
from flexmbd.continuum.contract_suite.check_report import CheckResult as CheckResult
from flexmbd.continuum.contract_suite.outcome import Outcome as Outcome
from flexmbd.continuum.contract_suite.outcome import Verdict as Verdict
from flexmbd.continuum.finite_elements.cell_group import CellGroup as CellGroup
from flexmbd.continuum.finite_elements.cell_group import Pairs as Pairs
from flexmbd.continuum.finite_elements.cell_group import Source as Source
from flexmbd.continuum.finite_elements.condensed_stiffness import CondensedStiffness as CondensedStiffness
from flexmbd.continuum.finite_elements.condition_places import FloatingGroup as FloatingGroup
from flexmbd.continuum.finite_elements.cut_mesh import CutMesh as CutMesh
from flexmbd.continuum.finite_elements.cut_mesh import cut_mesh as cut_mesh
from flexmbd.continuum.finite_elements.discrete_forms import DiscreteForms as DiscreteForms
from flexmbd.continuum.finite_elements.discretisation import Discretisation as Discretisation
from flexmbd.continuum.finite_elements.electrode import Electrode as Electrode
from flexmbd.continuum.finite_elements.field_conditions import FieldConditions as FieldConditions
from flexmbd.continuum.finite_elements.field_conditions import UniformShift as UniformShift
from flexmbd.continuum.finite_elements.held_surface import HeldSurface as HeldSurface
from flexmbd.continuum.finite_elements.held_surface import Roller as Roller
from flexmbd.continuum.finite_elements.held_surface import SurfaceSupport as SurfaceSupport
from flexmbd.continuum.finite_elements.held_surface import SymmetryPlane as SymmetryPlane
from flexmbd.continuum.finite_elements.homogeneous_energy import EnergyDensity as EnergyDensity
from flexmbd.continuum.finite_elements.homogeneous_energy import homogeneous_energy as homogeneous_energy
from flexmbd.continuum.finite_elements.interface import FoundInterface as FoundInterface
from flexmbd.continuum.finite_elements.interface import Interface as Interface
from flexmbd.continuum.finite_elements.linear_model import LinearModel as LinearModel
from flexmbd.continuum.finite_elements.lumping import lumped_mass as lumped_mass
from flexmbd.continuum.finite_elements.mass_moments import Density as Density
from flexmbd.continuum.finite_elements.mass_moments import rigid_body_of as rigid_body_of
from flexmbd.continuum.finite_elements.mass_moments import solid_of as solid_of
from flexmbd.continuum.finite_elements.model import ContinuumModel as ContinuumModel
from flexmbd.continuum.finite_elements.nodal_group import NodalGroup as NodalGroup
from flexmbd.continuum.finite_elements.nodal_group import NodalInterface as NodalInterface
from flexmbd.continuum.finite_elements.nodal_ties import NodalTies as NodalTies
from flexmbd.continuum.finite_elements.nodes import node_numbers as node_numbers
from flexmbd.continuum.finite_elements.surface_group import SurfaceGroup as SurfaceGroup
from flexmbd.continuum.finite_elements.surface_group import Surfaces as Surfaces
from flexmbd.continuum.finite_elements.weld import Weld as Weld
from flexmbd.continuum.grid.mesh_division import Cut as Cut
from flexmbd.continuum.grid.mesh_division import PieceSummary as PieceSummary
from flexmbd.continuum.grid.mesh_division import Region as Region
from flexmbd.continuum.grid.tagged_mesh import TaggedMesh as TaggedMesh
from flexmbd.continuum.history.displacement_newton import Convergence as Convergence
from flexmbd.continuum.history.held_fields import PortStates as PortStates
from flexmbd.continuum.history.loads import BodyAcceleration as BodyAcceleration
from flexmbd.continuum.history.loads import BodyLoad as BodyLoad
from flexmbd.continuum.history.loads import CentrifugalLoad as CentrifugalLoad
from flexmbd.continuum.history.loads import ForceAtNodes as ForceAtNodes
from flexmbd.continuum.history.loads import Heating as Heating
from flexmbd.continuum.history.loads import PressureOnFacets as PressureOnFacets
from flexmbd.continuum.history.loads import TractionOnFacets as TractionOnFacets
from flexmbd.continuum.history.loads import Voltage as Voltage
from flexmbd.continuum.history.nonlinear_model import HistorySnapshot as HistorySnapshot
from flexmbd.continuum.history.nonlinear_model import NonlinearModel as NonlinearModel
from flexmbd.continuum.history.tangent_solver import LinearSolver as LinearSolver
from flexmbd.continuum.history.tangent_solver import Preconditioner as Preconditioner
from flexmbd.continuum.interior.bulk_viscosity import BulkViscosity as BulkViscosity
from flexmbd.continuum.interior.contact_plane import RigidPlane as RigidPlane
from flexmbd.continuum.interior.corotated_interior import CorotatedInterior as CorotatedInterior
from flexmbd.continuum.interior.explicit import ExplicitContinuum as ExplicitContinuum
from flexmbd.continuum.interior.explicit_run import EnergyAccount as EnergyAccount
from flexmbd.continuum.interior.explicit_run import ExplicitRun as ExplicitRun
from flexmbd.continuum.interior.implicit import ImplicitContinuum as ImplicitContinuum
from flexmbd.continuum.interior.nodal_inertia import Support as Support
from flexmbd.continuum.interior.rotational_dofs import Bond as Bond
from flexmbd.continuum.interior.rotational_dofs import ExplicitOperator as ExplicitOperator
from flexmbd.continuum.interior.rotational_dofs import condensed_rotations as condensed_rotations
from flexmbd.continuum.interior.rotational_dofs import lumped_rotations as lumped_rotations
from flexmbd.continuum.interior.run_checkpoint import RegularCheckpoints as RegularCheckpoints
from flexmbd.continuum.laws.compiled_law import PointStep as PointStep
from flexmbd.continuum.laws.law_form import StrainMeasure as StrainMeasure
from flexmbd.continuum.laws.law_form import law_form as law_form
from flexmbd.continuum.laws.plane_form import plane_form as plane_form
from flexmbd.continuum.laws.wall_form import wall_form as wall_form
from flexmbd.continuum.parallel import MpiTeam as MpiTeam
from flexmbd.continuum.parallel import on_root as on_root
from flexmbd.continuum.slow_loading.body_path import BodyCriticalPoint as BodyCriticalPoint
from flexmbd.continuum.slow_loading.body_path import BodyEquilibrium as BodyEquilibrium
from flexmbd.continuum.slow_loading.body_path import BodyPath as BodyPath
from flexmbd.continuum.slow_loading.body_path import equilibrium_path as equilibrium_path
from flexmbd.continuum.slow_loading.static_path import Equilibrium as Equilibrium
from flexmbd.continuum.slow_loading.static_path import StaticPath as StaticPath
from flexmbd.continuum.slow_loading.static_path import clamped_dofs as clamped_dofs
from flexmbd.continuum.slow_loading.static_path import follow as follow
from flexmbd.continuum.slow_loading.static_path import prescribed_dofs as prescribed_dofs
from flexmbd.errors import PathError as PathError

__all__ = _public_names(globals())
