"""What may take other values in a compiled machine, `scene.compile(parameters={...})`; docs/ensembles.md.

A public name: users enter here.
"""

from flexmbd.multibody.parameter.body_parameters import BodyRecord as BodyRecord
from flexmbd.multibody.parameter.body_parameters import CentreOfMass as CentreOfMass
from flexmbd.multibody.parameter.body_parameters import FrameAxes as FrameAxes
from flexmbd.multibody.parameter.body_parameters import FrameOrigin as FrameOrigin
from flexmbd.multibody.parameter.body_parameters import Inertia as Inertia
from flexmbd.multibody.parameter.body_parameters import Mass as Mass
from flexmbd.multibody.parameter.force_parameters import OfForce as OfForce
from flexmbd.multibody.parameter.joint_parameters import InitialPosition as InitialPosition
from flexmbd.multibody.parameter.joint_parameters import InitialVelocity as InitialVelocity
from flexmbd.multibody.parameter.joint_parameters import ModalPosition as ModalPosition
from flexmbd.multibody.parameter.joint_parameters import ModalVelocity as ModalVelocity
from flexmbd.multibody.parameter.joint_parameters import PrescribedMotion as PrescribedMotion
from flexmbd.multibody.parameter.protocol import Parameter as Parameter
