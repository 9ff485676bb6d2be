"""flexmbd: from a UFL form to a body that moves in a machine.

This root loads numpy, scipy and numba only; DOLFINx and PETSc load with ``flexmbd.continuum``.
"""

from flexmbd import export as export
from flexmbd.coupling import Coupling as Coupling
from flexmbd.errors import FlexmbdError as FlexmbdError
from flexmbd.integrate.alpha.generalized_alpha import GeneralizedAlpha as GeneralizedAlpha
from flexmbd.integrate.discrete_gradient.energy_momentum import EnergyMomentum as EnergyMomentum
from flexmbd.integrate.explicit.central_difference import CentralDifference as CentralDifference
from flexmbd.integrate.explicit.explicit_runge_kutta import ExplicitRungeKutta as ExplicitRungeKutta
from flexmbd.integrate.explicit.explicit_runge_kutta import Rotations as Rotations
from flexmbd.integrate.explicit.tableau import Pair as Pair
from flexmbd.integrate.radau.radau_iia import RadauIIA as RadauIIA
from flexmbd.monitors.yield_monitor import YieldMonitor as YieldMonitor
from flexmbd.monitors.yielding_region import Slab as Slab
from flexmbd.monitors.yielding_region import yielding_slabs as yielding_slabs
from flexmbd.multibody import force as force
from flexmbd.multibody import joint as joint
from flexmbd.multibody.bodies.body import FlexibleBody as FlexibleBody
from flexmbd.multibody.bodies.body import RigidBody as RigidBody
from flexmbd.multibody.bodies.continuum_body import ContinuumBody as ContinuumBody
from flexmbd.multibody.bodies.homogeneous import CompiledEnergy as CompiledEnergy
from flexmbd.multibody.bodies.homogeneous import StVenantKirchhoff as StVenantKirchhoff
from flexmbd.multibody.bodies.homogeneous import polar as polar
from flexmbd.multibody.bodies.pseudo_rigid_body import PseudoRigidBody as PseudoRigidBody
from flexmbd.multibody.bodies.pseudo_rigid_swarm import PseudoRigidSwarm as PseudoRigidSwarm
from flexmbd.multibody.bodies.solid import Solid as Solid
from flexmbd.multibody.functions.time_function import Beyond as Beyond
from flexmbd.multibody.functions.time_function import Motion as Motion
from flexmbd.multibody.functions.time_function import Piecewise as Piecewise
from flexmbd.multibody.functions.time_function import Sine as Sine
from flexmbd.multibody.functions.time_function import Table as Table
from flexmbd.multibody.functions.time_function import compiled as compiled
from flexmbd.multibody.interiors.steady import InteriorModes as InteriorModes
from flexmbd.multibody.joint.enforcement import AugmentedLagrangian as AugmentedLagrangian
from flexmbd.multibody.joint.enforcement import Multipliers as Multipliers
from flexmbd.multibody.joint.enforcement import Penalty as Penalty
from flexmbd.multibody.joint.enforcement import Way as Way
from flexmbd.multibody.linear import output as output
from flexmbd.record.reduced_body import ReducedBody as ReducedBody
from flexmbd.run.checkpoint import Checkpoint as Checkpoint
from flexmbd.run.event import Direction as Direction
from flexmbd.run.event import Event as Event
from flexmbd.run.event import Moment as Moment
from flexmbd.run.stopped import SimulationError as SimulationError
from flexmbd.run.stopped import SimulationInterrupted as SimulationInterrupted
from flexmbd.run.trajectory import Trajectory as Trajectory
from flexmbd.system import System as System

__version__ = "0.1.0"
