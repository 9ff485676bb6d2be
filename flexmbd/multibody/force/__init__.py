"""Force elements, one a file."""

from flexmbd.multibody.force.joint_damper import JointDamper as JointDamper
from flexmbd.multibody.force.joint_force import JointForce as JointForce
from flexmbd.multibody.force.joint_spring import JointSpring as JointSpring
from flexmbd.multibody.force.joint_torque import JointTorque as JointTorque
