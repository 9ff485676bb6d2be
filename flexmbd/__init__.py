"""flexmbd: from a UFL form to a body that moves in a machine.

What a user may rely on is what `dir(flexmbd)` shows, and the names in the rooms among it (`flexmbd.joint`,
`flexmbd.reduction`, ...); all else is private and moves without a word.  This root loads numpy, scipy and numba only:
DOLFINx and PETSc load with `flexmbd.continuum`, `flexmbd.reduction` and `flexmbd.meshes`.
"""

import importlib
import types
import typing

from flexmbd import ensemble as ensemble
from flexmbd import export as export
from flexmbd import force as force
from flexmbd import integrate as integrate
from flexmbd import joint as joint
from flexmbd import output as output
from flexmbd import parameter as parameter
from flexmbd.compiled_machine import CompiledMachine as CompiledMachine
from flexmbd.coupling import Coupling as Coupling
from flexmbd.errors import AssemblyError as AssemblyError
from flexmbd.errors import ConvergenceError as ConvergenceError
from flexmbd.errors import ExportError as ExportError
from flexmbd.errors import FlexmbdError as FlexmbdError
from flexmbd.errors import FormulationError as FormulationError
from flexmbd.errors import InterfaceError as InterfaceError
from flexmbd.errors import MeshError as MeshError
from flexmbd.errors import PictureError as PictureError
from flexmbd.errors import RecordError as RecordError
from flexmbd.errors import ReductionError as ReductionError
from flexmbd.errors import SceneError as SceneError
from flexmbd.errors import StartWarning as StartWarning
from flexmbd.errors import TableWarning as TableWarning
from flexmbd.errors import VersionError as VersionError
from flexmbd.integrate.alpha.generalized_alpha import GeneralizedAlpha as GeneralizedAlpha
from flexmbd.integrate.discrete_gradient.energy_momentum import EnergyMomentum as EnergyMomentum
from flexmbd.integrate.explicit.central_difference import CentralDifference as CentralDifference
from flexmbd.integrate.explicit.explicit_runge_kutta import ExplicitRungeKutta as ExplicitRungeKutta
from flexmbd.integrate.explicit.explicit_runge_kutta import Rotations as Rotations
from flexmbd.integrate.explicit.tableau import Pair as Pair
from flexmbd.integrate.radau.radau_iia import RadauIIA as RadauIIA
from flexmbd.linearized import LinearizedMachine as LinearizedMachine
from flexmbd.linearized import StateSpace as StateSpace
from flexmbd.monitors.yield_history import YieldHistory as YieldHistory
from flexmbd.monitors.yield_history import YieldPoint as YieldPoint
from flexmbd.monitors.yield_monitor import YieldMonitor as YieldMonitor
from flexmbd.monitors.yielding_region import Slab as Slab
from flexmbd.monitors.yielding_region import yielding_slabs as yielding_slabs
from flexmbd.multibody.bodies.body import Body as Body
from flexmbd.multibody.bodies.body import FlexibleBody as FlexibleBody
from flexmbd.multibody.bodies.body import Frame as Frame
from flexmbd.multibody.bodies.body import Ground as Ground
from flexmbd.multibody.bodies.body import RigidBody as RigidBody
from flexmbd.multibody.bodies.continuum_body import ContinuumBody as ContinuumBody
from flexmbd.multibody.bodies.continuum_body import FrameMotion as FrameMotion
from flexmbd.multibody.bodies.continuum_body import Interior as Interior
from flexmbd.multibody.bodies.continuum_body import InteriorFrame as InteriorFrame
from flexmbd.multibody.bodies.continuum_body import Memory as Memory
from flexmbd.multibody.bodies.continuum_body import Push as Push
from flexmbd.multibody.bodies.continuum_body import Scheme as Scheme
from flexmbd.multibody.bodies.homogeneous import CompiledEnergy as CompiledEnergy
from flexmbd.multibody.bodies.homogeneous import HomogeneousEnergy as HomogeneousEnergy
from flexmbd.multibody.bodies.homogeneous import StVenantKirchhoff as StVenantKirchhoff
from flexmbd.multibody.bodies.homogeneous import polar as polar
from flexmbd.multibody.bodies.pseudo_rigid_body import PseudoRigidBody as PseudoRigidBody
from flexmbd.multibody.bodies.pseudo_rigid_swarm import PseudoRigidSwarm as PseudoRigidSwarm
from flexmbd.multibody.bodies.pseudo_rigid_swarm import SwarmEnergy as SwarmEnergy
from flexmbd.multibody.bodies.solid import Outline as Outline
from flexmbd.multibody.bodies.solid import Solid as Solid
from flexmbd.multibody.functions.time_function import Beyond as Beyond
from flexmbd.multibody.functions.time_function import Compiled as Compiled
from flexmbd.multibody.functions.time_function import Motion as Motion
from flexmbd.multibody.functions.time_function import Piecewise as Piecewise
from flexmbd.multibody.functions.time_function import Sine as Sine
from flexmbd.multibody.functions.time_function import Table as Table
from flexmbd.multibody.functions.time_function import TimeFunction as TimeFunction
from flexmbd.multibody.functions.time_function import compiled as compiled
from flexmbd.multibody.interiors.steady import InteriorModes as InteriorModes
from flexmbd.multibody.interiors.steady import LinearInterior as LinearInterior
from flexmbd.multibody.joint.enforcement import AugmentedLagrangian as AugmentedLagrangian
from flexmbd.multibody.joint.enforcement import Multipliers as Multipliers
from flexmbd.multibody.joint.enforcement import Penalty as Penalty
from flexmbd.multibody.joint.enforcement import Way as Way
from flexmbd.multibody.linear.ports import Input as Input
from flexmbd.multibody.linear.working_point import WorkingPoint as WorkingPoint
from flexmbd.multibody.motion.instant import Instant as Instant
from flexmbd.multibody.plan.compiled_scene import CompiledScene as CompiledScene
from flexmbd.multibody.results.energy import Energy as Energy
from flexmbd.multibody.start.consistent_start import Start as Start
from flexmbd.multibody.team import Team as Team
from flexmbd.record.groups import DistributedLoads as DistributedLoads
from flexmbd.record.groups import FurtherUnknowns as FurtherUnknowns
from flexmbd.record.groups import GeometricStiffness as GeometricStiffness
from flexmbd.record.groups import InterfaceFrame as InterfaceFrame
from flexmbd.record.groups import ModalStretch as ModalStretch
from flexmbd.record.groups import NodalModes as NodalModes
from flexmbd.record.groups import StressModes as StressModes
from flexmbd.record.groups import Surface as Surface
from flexmbd.record.reduced_body import ReducedBody as ReducedBody
from flexmbd.record.stress_field import StressField as StressField
from flexmbd.rotation import Axis as Axis
from flexmbd.run.checkpoint import Checkpoint as Checkpoint
from flexmbd.run.departure import Departure as Departure
from flexmbd.run.event import Direction as Direction
from flexmbd.run.event import Event as Event
from flexmbd.run.event import Moment as Moment
from flexmbd.run.event import Occurrence as Occurrence
from flexmbd.run.stopped import SimulationError as SimulationError
from flexmbd.run.stopped import SimulationInterrupted as SimulationInterrupted
from flexmbd.run.trajectory import Stats as Stats
from flexmbd.run.trajectory import Trajectory as Trajectory
from flexmbd.system import System as System

__version__ = "0.1.0"

#: Rooms that load when they are first asked for.
_LAZY = frozenset({"beams", "continuum", "forms", "meshes", "reduction", "visual"})
_LOADED = frozenset({"ensemble", "export", "force", "integrate", "joint", "output", "parameter"})

if typing.TYPE_CHECKING:
    from flexmbd import beams as beams
    from flexmbd import continuum as continuum
    from flexmbd import forms as forms
    from flexmbd import meshes as meshes
    from flexmbd import reduction as reduction
    from flexmbd import visual as visual
else:  # hidden from type checkers, for which it would make every misspelt name good

    def __getattr__(name: str) -> types.ModuleType:
        """A room that is not loaded yet."""
        if name in _LAZY:
            return importlib.import_module(f"{__name__}.{name}")
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    """The public names: no module but the rooms."""
    own = {name for name, value in globals().items() if name[0] != "_" and not isinstance(value, types.ModuleType)}
    return sorted(own | _LAZY | _LOADED | {"__version__"})
