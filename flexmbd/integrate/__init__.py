"""Integrators, one a room, written against the residual, the retraction and the constraints; docs/integrators.md.

Users enter here; the system, runs, scene files and FMUs enter the rooms.  What a method of one's own is written of
stands here, too (docs/extending.md).
"""

from flexmbd.integrate.alpha.generalized_alpha import AlphaFamily as AlphaFamily
from flexmbd.integrate.alpha.generalized_alpha import GeneralizedAlpha as GeneralizedAlpha
from flexmbd.integrate.alpha.implicit_method import ImplicitMethod as ImplicitMethod
from flexmbd.integrate.controller import NoMemory as NoMemory
from flexmbd.integrate.controller import Rule as Rule
from flexmbd.integrate.controller import Stepper as Stepper
from flexmbd.integrate.controller import make_advance as make_advance
from flexmbd.integrate.controller import next_step as next_step
from flexmbd.integrate.controller import no_factors as no_factors
from flexmbd.integrate.discrete_gradient.energy_momentum import EnergyMomentum as EnergyMomentum
from flexmbd.integrate.explicit.central_difference import CentralDifference as CentralDifference
from flexmbd.integrate.explicit.explicit_machine import ExplicitMachine as ExplicitMachine
from flexmbd.integrate.explicit.explicit_machine import accelerate as accelerate
from flexmbd.integrate.explicit.explicit_machine import accept as accept
from flexmbd.integrate.explicit.explicit_machine import close_loops as close_loops
from flexmbd.integrate.explicit.explicit_machine import judge as judge
from flexmbd.integrate.explicit.explicit_machine import move as move
from flexmbd.integrate.explicit.explicit_machine import new_explicit_machine as new_explicit_machine
from flexmbd.integrate.explicit.explicit_runge_kutta import ExplicitRungeKutta as ExplicitRungeKutta
from flexmbd.integrate.explicit.explicit_runge_kutta import Rotations as Rotations
from flexmbd.integrate.explicit.loop_dynamics import LoopMemory as LoopMemory
from flexmbd.integrate.explicit.loop_dynamics import Loops as Loops
from flexmbd.integrate.explicit.loop_dynamics import new_loop_memory as new_loop_memory
from flexmbd.integrate.explicit.loop_dynamics import set_row_scales as set_row_scales
from flexmbd.integrate.explicit.tableau import Pair as Pair
from flexmbd.integrate.explicit.tableau import Tableau as Tableau
from flexmbd.integrate.explicit.tableau import TableauArrays as TableauArrays
from flexmbd.integrate.interior_support import refuse_interiors as refuse_interiors
from flexmbd.integrate.moreau.moreau_jean import MoreauJean as MoreauJean
from flexmbd.integrate.protocol import Integrator as Integrator
from flexmbd.integrate.radau.radau_iia import RadauIIA as RadauIIA
from flexmbd.integrate.state import ERROR_RATIO as ERROR_RATIO
from flexmbd.integrate.state import OUTCOME as OUTCOME
from flexmbd.integrate.state import RATE as RATE
from flexmbd.integrate.state import STEP_END as STEP_END
from flexmbd.integrate.state import TIME as TIME
from flexmbd.integrate.state import Groups as Groups
from flexmbd.integrate.state import State as State
from flexmbd.multibody.kernels.base.array_struct import ArrayStruct as ArrayStruct
from flexmbd.multibody.kernels.base.compiling import entry_kernel as entry_kernel
from flexmbd.multibody.kernels.base.compiling import kernel as kernel
from flexmbd.room import public_names as _public_names

__all__ = _public_names(globals())
