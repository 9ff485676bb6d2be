"""Joints, one a file; lower pairs, universal and free joints exist as coordinates and as constraints.

The others are constraints alone; couplings act on the coordinates of joints.
"""

from flexmbd.multibody.joint.constant_velocity import ConstantVelocity as ConstantVelocity
from flexmbd.multibody.joint.cylindrical import Cylindrical as Cylindrical
from flexmbd.multibody.joint.distance import Distance as Distance
from flexmbd.multibody.joint.fixed import Fixed as Fixed
from flexmbd.multibody.joint.free import Free as Free
from flexmbd.multibody.joint.gear import Gear as Gear
from flexmbd.multibody.joint.planar import Planar as Planar
from flexmbd.multibody.joint.point_on_line import PointOnLine as PointOnLine
from flexmbd.multibody.joint.point_on_plane import PointOnPlane as PointOnPlane
from flexmbd.multibody.joint.prismatic import Prismatic as Prismatic
from flexmbd.multibody.joint.rack_and_pinion import RackAndPinion as RackAndPinion
from flexmbd.multibody.joint.revolute import Revolute as Revolute
from flexmbd.multibody.joint.rolling_disc import RollingDisc as RollingDisc
from flexmbd.multibody.joint.screw import Screw as Screw
from flexmbd.multibody.joint.spherical import Spherical as Spherical
from flexmbd.multibody.joint.universal import Universal as Universal
