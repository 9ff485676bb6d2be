"""Joints and couplings, and the types that connecting bodies gives and takes; docs/joints.md.

A public name: users enter here, and `flexmbd.scene_file`.
"""

from flexmbd.multibody.joint.connection import Connection as Connection
from flexmbd.multibody.joint.constant_velocity import ConstantVelocity as ConstantVelocity
from flexmbd.multibody.joint.coordinate_coupling import Term as Term
from flexmbd.multibody.joint.cylindrical import Cylindrical as Cylindrical
from flexmbd.multibody.joint.distance import Distance as Distance
from flexmbd.multibody.joint.enforcement import Enforcement as Enforcement
from flexmbd.multibody.joint.fixed import Fixed as Fixed
from flexmbd.multibody.joint.free import Free as Free
from flexmbd.multibody.joint.gear import Gear as Gear
from flexmbd.multibody.joint.generic import Generic as Generic
from flexmbd.multibody.joint.kinematic_pair import FIXED as FIXED
from flexmbd.multibody.joint.kinematic_pair import FREE as FREE
from flexmbd.multibody.joint.kinematic_pair import PRISMATIC as PRISMATIC
from flexmbd.multibody.joint.kinematic_pair import REVOLUTE as REVOLUTE
from flexmbd.multibody.joint.kinematic_pair import SPHERICAL as SPHERICAL
from flexmbd.multibody.joint.kinematic_pair import KinematicPair as KinematicPair
from flexmbd.multibody.joint.kinematic_pair import screw as screw
from flexmbd.multibody.joint.planar import Planar as Planar
from flexmbd.multibody.joint.planar_point import PlanarPoint as PlanarPoint
from flexmbd.multibody.joint.point_on_line import PointOnLine as PointOnLine
from flexmbd.multibody.joint.point_on_plane import PointOnPlane as PointOnPlane
from flexmbd.multibody.joint.prismatic import Prismatic as Prismatic
from flexmbd.multibody.joint.protocol import CarriedBySteps as CarriedBySteps
from flexmbd.multibody.joint.protocol import Joint as Joint
from flexmbd.multibody.joint.protocol import Row as Row
from flexmbd.multibody.joint.protocol import Step as Step
from flexmbd.multibody.joint.rack_and_pinion import RackAndPinion as RackAndPinion
from flexmbd.multibody.joint.revolute import Revolute as Revolute
from flexmbd.multibody.joint.rolling_disc import RollingDisc as RollingDisc
from flexmbd.multibody.joint.screw import Screw as Screw
from flexmbd.multibody.joint.spherical import Spherical as Spherical
from flexmbd.multibody.joint.translation_joint import Translation as Translation
from flexmbd.multibody.joint.universal import Universal as Universal
from flexmbd.multibody.kernels.base.kinds import ROW_ANGLE as ROW_ANGLE
from flexmbd.multibody.kernels.base.kinds import ROW_AXIS as ROW_AXIS
from flexmbd.multibody.kernels.base.kinds import ROW_DIRECTION as ROW_DIRECTION
from flexmbd.multibody.kernels.base.kinds import ROW_DISTANCE as ROW_DISTANCE
from flexmbd.multibody.kernels.base.kinds import ROW_SCREW as ROW_SCREW
from flexmbd.multibody.kernels.base.kinds import ROW_TRANSLATION as ROW_TRANSLATION
