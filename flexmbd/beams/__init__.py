"""Frames of beams as points and lines, and bodies of such beams by the discrete element method.

numpy and scipy alone, and of flexmbd only the record and the errors: both sides of the wall may import it.
"""

from flexmbd.beams.castigliano import Section as Section
from flexmbd.beams.discrete_body import discrete_body as discrete_body
from flexmbd.beams.discrete_frame import PLANE as PLANE
from flexmbd.beams.discrete_frame import DiscreteFrame as DiscreteFrame
from flexmbd.beams.exact_elements import ElementAtRest as ElementAtRest
from flexmbd.beams.frame_mesh import Beam as Beam
from flexmbd.beams.frame_mesh import FrameMesh as FrameMesh
from flexmbd.beams.frame_mesh import Point as Point
from flexmbd.beams.lumps import Lumping as Lumping
from flexmbd.room import public_names as _public_names

__all__ = _public_names(globals())
