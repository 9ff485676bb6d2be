"""Parametrised parts, one geometry a file, and meshes read from files; all lengths in m.

Every function returns a `flexmbd.continuum.grid.tagged_mesh.TaggedMesh`, is collective over `comm`, builds
the part on rank 0, most by gmsh, and raises `flexmbd.errors.MeshError` on all ranks.
"""

from flexmbd.libraries import OF_THE_CONTINUUM as _OF_THE_CONTINUUM
from flexmbd.libraries import require as _require
from flexmbd.room import public_names as _public_names

_require("flexmbd.meshes", *_OF_THE_CONTINUUM, "gmsh")

from flexmbd.continuum.grid.node_order import NodeOrder as NodeOrder
from flexmbd.continuum.grid.tagged_mesh import TaggedMesh as TaggedMesh
from flexmbd.continuum.grid.tagged_mesh import from_arrays as from_arrays
from flexmbd.meshes.beam import beam as beam
from flexmbd.meshes.block import block as block
from flexmbd.meshes.connecting_rod import connecting_rod as connecting_rod
from flexmbd.meshes.crank import crank as crank
from flexmbd.meshes.crash_tube import crash_tube as crash_tube
from flexmbd.meshes.deck_materials import DeckMaterial as DeckMaterial
from flexmbd.meshes.deck_materials import materials as materials
from flexmbd.meshes.frame import frame as frame
from flexmbd.meshes.h5_file import write as write
from flexmbd.meshes.join import join as join
from flexmbd.meshes.line import line as line
from flexmbd.meshes.mesh_file import read as read
from flexmbd.meshes.place import InBox as InBox
from flexmbd.meshes.place import OnCylinder as OnCylinder
from flexmbd.meshes.place import OnPlane as OnPlane
from flexmbd.meshes.place import Place as Place
from flexmbd.meshes.place import with_facet_groups as with_facet_groups
from flexmbd.meshes.placed import placed as placed
from flexmbd.meshes.plate import plate as plate
from flexmbd.meshes.quality import MeshQuality as MeshQuality
from flexmbd.meshes.quality import quality as quality
from flexmbd.meshes.quarter_ring import quarter_ring as quarter_ring
from flexmbd.meshes.round_bar import round_bar as round_bar
from flexmbd.meshes.sheet import sheet as sheet
from flexmbd.meshes.spur_gear import spur_gear as spur_gear
from flexmbd.meshes.step_faces import Cylinder as Cylinder
from flexmbd.meshes.step_faces import StepFace as StepFace
from flexmbd.meshes.step_file import BRACKET as BRACKET
from flexmbd.meshes.step_file import Tag as Tag
from flexmbd.meshes.step_file import from_step as from_step
from flexmbd.meshes.step_file import step_faces as step_faces
from flexmbd.meshes.tube import tube as tube
from flexmbd.meshes.wall import wall as wall

__all__ = _public_names(globals())
