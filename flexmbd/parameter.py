"""What may take other values in a compiled machine, `scene.compile(parameters={...})`; docs/ensembles.md.

A public name: users enter here.
"""

from flexmbd.multibody.parameter.bodies import Axes as Axes
from flexmbd.multibody.parameter.bodies import CentreOfMass as CentreOfMass
from flexmbd.multibody.parameter.bodies import Inertia as Inertia
from flexmbd.multibody.parameter.bodies import Mass as Mass
from flexmbd.multibody.parameter.bodies import Place as Place
from flexmbd.multibody.parameter.bodies import Record as Record
from flexmbd.multibody.parameter.forces import OfForce as OfForce
from flexmbd.multibody.parameter.joints import ModalPosition as ModalPosition
from flexmbd.multibody.parameter.joints import ModalVelocity as ModalVelocity
from flexmbd.multibody.parameter.joints import Position as Position
from flexmbd.multibody.parameter.joints import PrescribedMotion as PrescribedMotion
from flexmbd.multibody.parameter.joints import Velocity as Velocity
from flexmbd.multibody.parameter.protocol import Parameter as Parameter
