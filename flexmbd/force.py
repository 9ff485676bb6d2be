"""Force elements, and the types that users' own forces take; docs/forces.md.

A public name: users enter here, and `flexmbd.scene_file`.
"""

from flexmbd.multibody.force.beam_element import BeamElement as BeamElement
from flexmbd.multibody.force.bearing_friction import BearingFriction as BearingFriction
from flexmbd.multibody.force.between_pairs import BetweenPairs as BetweenPairs
from flexmbd.multibody.force.bushing import Bushing as Bushing
from flexmbd.multibody.force.distributed_load import DistributedLoad as DistributedLoad
from flexmbd.multibody.force.frame_force import Axes as Axes
from flexmbd.multibody.force.frame_force import FrameForce as FrameForce
from flexmbd.multibody.force.gravitation import Gravitation as Gravitation
from flexmbd.multibody.force.joint_damper import JointDamper as JointDamper
from flexmbd.multibody.force.joint_force import JointForce as JointForce
from flexmbd.multibody.force.joint_friction import JointFriction as JointFriction
from flexmbd.multibody.force.joint_law import JointLaw as JointLaw
from flexmbd.multibody.force.joint_spring import JointSpring as JointSpring
from flexmbd.multibody.force.joint_stop import JointStop as JointStop
from flexmbd.multibody.force.joint_torque import JointTorque as JointTorque
from flexmbd.multibody.force.kane_body import KaneBody as KaneBody
from flexmbd.multibody.force.kane_force import KaneForce as KaneForce
from flexmbd.multibody.force.line_force import LineForce as LineForce
from flexmbd.multibody.force.plastic_joint_spring import PlasticJointSpring as PlasticJointSpring
from flexmbd.multibody.force.plastic_spring import PlasticSpring as PlasticSpring
from flexmbd.multibody.force.port_effort import PortEffort as PortEffort
from flexmbd.multibody.force.protocol import BetweenFrames as BetweenFrames
from flexmbd.multibody.force.protocol import ElementTable as ElementTable
from flexmbd.multibody.force.protocol import Force as Force
from flexmbd.multibody.force.protocol import OnCoordinate as OnCoordinate
from flexmbd.multibody.force.protocol import StateEquations as StateEquations
from flexmbd.multibody.force.protocol import WithStates as WithStates
from flexmbd.multibody.force.protocol import check_numbers as check_numbers
from flexmbd.multibody.force.shaft_inertia import ShaftInertia as ShaftInertia
from flexmbd.multibody.force.shared_numbers import SharedNumbers as SharedNumbers
from flexmbd.multibody.force.shared_numbers import WithSharedNumbers as WithSharedNumbers
from flexmbd.multibody.force.shunt import shunt as shunt
from flexmbd.multibody.force.spring_damper import SpringDamper as SpringDamper
from flexmbd.multibody.force.state_force import StateForce as StateForce
from flexmbd.multibody.functions.callback import Law as Law
from flexmbd.multibody.functions.callback import StateFunction as StateFunction
from flexmbd.multibody.kane.equations import Kinematics as Kinematics
from flexmbd.multibody.kane.equations import active_forces as active_forces
from flexmbd.multibody.kane.equations import elastic_forces as elastic_forces
from flexmbd.multibody.kane.equations import inertia_forces as inertia_forces
from flexmbd.multibody.kane.inertia import InertiaAndForces as InertiaAndForces
from flexmbd.multibody.motion.machine import Contribution as Contribution
