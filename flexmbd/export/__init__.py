"""Reduced bodies for other programs, and from them: one format a file (docs/export.md).

``fm.export.NAME(body, path)`` writes the format NAME and returns what the file leaves out of the body;
``fm.export.read_NAME(path)`` reads it back. Numpy only; nothing here knows DOLFINx.  Users enter here, commands by
`FORMATS`; formats of one family share a room.
"""

from flexmbd.export.exudyn_files.exudyn_file import exudyn as exudyn
from flexmbd.export.exudyn_files.exudyn_reader import read_exudyn as read_exudyn
from flexmbd.export.exudyn_files.exudyn_scene import ExudynBody as ExudynBody
from flexmbd.export.exudyn_files.exudyn_scene import add_to_exudyn as add_to_exudyn
from flexmbd.export.formats import FORMATS as FORMATS
from flexmbd.export.formats import Format as Format
from flexmbd.export.formats import Reader as Reader
from flexmbd.export.formats import Writer as Writer
from flexmbd.export.formats import format_named as format_named
from flexmbd.export.functional_mockup.machine_parts import Method as Method
from flexmbd.export.functional_mockup.machine_ports import Given as Given
from flexmbd.export.functional_mockup.machine_unit import fmu_machine as fmu_machine
from flexmbd.export.functional_mockup.model_description import Fmi as Fmi
from flexmbd.export.functional_mockup.reduced_unit import fmu as fmu
from flexmbd.export.loss import Capabilities as Capabilities
from flexmbd.export.loss import check_losses as check_losses
from flexmbd.export.mbdyn_files.mbdyn_deck import MbdynPendulum as MbdynPendulum
from flexmbd.export.mbdyn_files.mbdyn_deck import mbdyn_deck as mbdyn_deck
from flexmbd.export.mbdyn_files.mbdyn_file import mbdyn as mbdyn
from flexmbd.export.mbdyn_files.mbdyn_reader import read_mbdyn as read_mbdyn
from flexmbd.export.record_arrays import npz as npz
from flexmbd.export.record_arrays import read_npz as read_npz
from flexmbd.export.sid_files.sid_file import SidColumns as SidColumns
from flexmbd.export.sid_files.sid_file import read_sid as read_sid
from flexmbd.export.sid_files.sid_file import sid as sid
from flexmbd.export.superelements.calculix_file import calculix as calculix
from flexmbd.export.superelements.calculix_file import read_calculix as read_calculix
from flexmbd.export.superelements.dmig_file import dmig as dmig
from flexmbd.export.superelements.dmig_file import read_dmig as read_dmig
from flexmbd.export.superelements.extptfm_file import openfast as openfast
from flexmbd.export.superelements.extptfm_file import openfast_connections as openfast_connections
from flexmbd.export.superelements.extptfm_file import read_openfast as read_openfast
from flexmbd.export.superelements.full_matrices import NodeSet as NodeSet
from flexmbd.export.superelements.full_matrices import Sparse as Sparse
from flexmbd.export.superelements.full_matrices import read_matrix_market as read_matrix_market
from flexmbd.export.superelements.full_matrices import read_triplets as read_triplets
from flexmbd.export.superelements.full_matrices import reduce_matrices as reduce_matrices
from flexmbd.export.superelements.matrix_storage import read_matrix_storage as read_matrix_storage
from flexmbd.export.superelements.op4_file import op4 as op4
from flexmbd.export.superelements.op4_file import read_op4 as read_op4
from flexmbd.export.superelements.simscape_file import read_simscape as read_simscape
from flexmbd.export.superelements.simscape_file import simscape as simscape
from flexmbd.export.superelements.superelement import Superelement as Superelement
from flexmbd.export.superelements.superelement import superelement as superelement
from flexmbd.export.superelements.superelement_frames import InterfaceNode as InterfaceNode
from flexmbd.export.vtkhdf_file import vtkhdf as vtkhdf
from flexmbd.export.vtkhdf_file import vtkhdf_modes as vtkhdf_modes
from flexmbd.room import public_names as _public_names

__all__ = _public_names(globals())
