"""Integrators, one a room, written against the residual, the retraction and the constraints; docs/integrators.md.

Users enter here; the system, runs, scene files and FMUs enter the rooms.
"""

from flexmbd.integrate.alpha.generalized_alpha import GeneralizedAlpha as GeneralizedAlpha
from flexmbd.integrate.controller import Rule as Rule
from flexmbd.integrate.controller import Stepper as Stepper
from flexmbd.integrate.discrete_gradient.energy_momentum import EnergyMomentum as EnergyMomentum
from flexmbd.integrate.explicit.central_difference import CentralDifference as CentralDifference
from flexmbd.integrate.explicit.explicit_runge_kutta import ExplicitRungeKutta as ExplicitRungeKutta
from flexmbd.integrate.explicit.explicit_runge_kutta import Rotations as Rotations
from flexmbd.integrate.explicit.tableau import Pair as Pair
from flexmbd.integrate.explicit.tableau import Tableau as Tableau
from flexmbd.integrate.protocol import Integrator as Integrator
from flexmbd.integrate.radau.radau_iia import RadauIIA as RadauIIA
from flexmbd.integrate.state import Groups as Groups
from flexmbd.integrate.state import State as State
