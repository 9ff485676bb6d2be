"""Reductions: from a continuum model to a `flexmbd.record.reduced_body.ReducedBody`.

Users enter here; `flexmbd.command` the rooms.  Static shapes, modes and stiffening stand in rooms of their own; a
reduction puts them together and changes nothing of the model.
"""

from flexmbd.libraries import OF_THE_CONTINUUM as _OF_THE_CONTINUUM
from flexmbd.libraries import require as _require
from flexmbd.room import public_names as _public_names

_require("flexmbd.reduction", *_OF_THE_CONTINUUM)

from flexmbd.continuum.finite_elements.linear_model import StaticState as StaticState
from flexmbd.continuum.finite_elements.prestressed import PrestressedModel as PrestressedModel
from flexmbd.reduction.buckling import BucklingModes as BucklingModes
from flexmbd.reduction.buckling import linear_buckling as linear_buckling
from flexmbd.reduction.contact.patch import Patch as Patch
from flexmbd.reduction.craig_bampton import craig_bampton as craig_bampton
from flexmbd.reduction.damping import Damping as Damping
from flexmbd.reduction.damping import KelvinVoigtDamping as KelvinVoigtDamping
from flexmbd.reduction.damping import ModalDamping as ModalDamping
from flexmbd.reduction.damping import RayleighDamping as RayleighDamping
from flexmbd.reduction.guyan import guyan as guyan
from flexmbd.reduction.large_displacements.modal_derivatives import ModalDerivatives as ModalDerivatives
from flexmbd.reduction.modes.eigensolver import BlockMethod as BlockMethod
from flexmbd.reduction.modes.eigensolver import Eigensolver as Eigensolver
from flexmbd.reduction.modes.eigensolver import KrylovSchur as KrylovSchur
from flexmbd.reduction.modes.eigensolver import SpectrumSlicing as SpectrumSlicing
from flexmbd.reduction.modes.fixed_modes import TruncationErrors as TruncationErrors
from flexmbd.reduction.modes.fixed_modes import truncation_errors as truncation_errors
from flexmbd.reduction.modes.interface_modes import InterfaceModes as InterfaceModes
from flexmbd.reduction.modes.truncation import Truncation as Truncation
from flexmbd.reduction.optional_groups import Keep as Keep
from flexmbd.reduction.static_shapes.condensation import CondensedMatrices as CondensedMatrices
from flexmbd.reduction.static_shapes.condensation import static_condensation as static_condensation
from flexmbd.reduction.static_shapes.interior_stiffness import Solver as Solver
from flexmbd.reduction.stiffening.prestress import prestressed as prestressed
from flexmbd.reduction.unit_loads import BodyForce as BodyForce
from flexmbd.reduction.unit_loads import Load as Load
from flexmbd.reduction.unit_loads import Pressure as Pressure
from flexmbd.reduction.unit_loads import TemperatureRise as TemperatureRise
from flexmbd.reduction.unit_loads import Traction as Traction
from flexmbd.reduction.unit_loads import load_vectors as load_vectors

__all__ = _public_names(globals())
