"""Force elements, one a file."""

from flexmbd.multibody.force.joint_force import JointForce as JointForce
from flexmbd.multibody.force.joint_torque import JointTorque as JointTorque
