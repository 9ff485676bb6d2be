"""Joints, one a file; each exists as joint coordinates along the tree and as loop constraints."""

from flexmbd.multibody.joint.fixed import Fixed as Fixed
from flexmbd.multibody.joint.free import Free as Free
from flexmbd.multibody.joint.prismatic import Prismatic as Prismatic
from flexmbd.multibody.joint.revolute import Revolute as Revolute
from flexmbd.multibody.joint.spherical import Spherical as Spherical
