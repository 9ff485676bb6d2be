"""Bodies that touch: shapes, laws of the normal force, friction; docs/contact.md.

A public name: users enter here.
"""

from flexmbd.multibody.contact.along_beam import capsules_along as capsules_along
from flexmbd.multibody.contact.along_beam import spheres_along as spheres_along
from flexmbd.multibody.contact.contact import Contact as Contact
from flexmbd.multibody.contact.contact_laws import Friction as Friction
from flexmbd.multibody.contact.contact_laws import Hertz as Hertz
from flexmbd.multibody.contact.contact_laws import NormalLaw as NormalLaw
from flexmbd.multibody.contact.contact_laws import PowerLaw as PowerLaw
from flexmbd.multibody.contact.hard_contact import Hard as Hard
from flexmbd.multibody.contact.hard_contact import HardContact as HardContact
from flexmbd.multibody.contact.hard_group import HardGroup as HardGroup
from flexmbd.multibody.contact.impact_law import ImpactLaw as ImpactLaw
from flexmbd.multibody.contact.lowest_points import LowestPoint as LowestPoint
from flexmbd.multibody.contact.lowest_points import ProfileOutline as ProfileOutline
from flexmbd.multibody.contact.lowest_points import Rim as Rim
from flexmbd.multibody.contact.nodes import NodalContact as NodalContact
from flexmbd.multibody.contact.nodes import Nodes as Nodes
from flexmbd.multibody.contact.nodes import SurfaceFacets as SurfaceFacets
from flexmbd.multibody.contact.nodes import TouchedByNodes as TouchedByNodes
from flexmbd.multibody.contact.polytopes import Polytope as Polytope
from flexmbd.multibody.contact.profile import Profile as Profile
from flexmbd.multibody.contact.shapes import Box as Box
from flexmbd.multibody.contact.shapes import Capsule as Capsule
from flexmbd.multibody.contact.shapes import ConvexPolytope as ConvexPolytope
from flexmbd.multibody.contact.shapes import Cylinder as Cylinder
from flexmbd.multibody.contact.shapes import Disc as Disc
from flexmbd.multibody.contact.shapes import HalfSpace as HalfSpace
from flexmbd.multibody.contact.shapes import HollowCylinder as HollowCylinder
from flexmbd.multibody.contact.shapes import HollowSphere as HollowSphere
from flexmbd.multibody.contact.shapes import Sphere as Sphere
from flexmbd.multibody.contact.shapes import TouchedShape as TouchedShape
from flexmbd.multibody.contact.shapes import TouchShape as TouchShape
from flexmbd.multibody.contact.shapes import Vertex as Vertex
from flexmbd.multibody.contact.touch import AnyContact as AnyContact
from flexmbd.multibody.contact.touch import Touching as Touching
from flexmbd.multibody.contact.triangle_surface import TriangleSurface as TriangleSurface
from flexmbd.multibody.results.contact_series import ContactSeries as ContactSeries
from flexmbd.multibody.results.contact_series import HardContactSeries as HardContactSeries
from flexmbd.multibody.results.contact_series import HardGroupSeries as HardGroupSeries
from flexmbd.record.pressed_patches import PressedPatches as PressedPatches
from flexmbd.record.pressed_patches import press as press
