"""SLEPc's methods on the statics of a body."""

from __future__ import annotations

from functools import partial

from flexmbd.continuum.matrices.blocks import FloatArray
from flexmbd.continuum.matrices.saddle_point import principal_part
from flexmbd.errors import ReductionError
from flexmbd.reduction.modes.eigensolver import KrylovSchur, ModeSearch, SpectrumSlicing
from flexmbd.reduction.modes.krylov_schur import KrylovSchurSearch, SlicingSearch
from flexmbd.reduction.static_shapes.statics import Statics


def slepc_search(statics: Statics, choice: KrylovSchur | SpectrumSlicing, *, start: FloatArray) -> ModeSearch:
    """Begin a search. Collective.

    Args:
        statics: of the body.
        choice: of the method.
        start: (rows of `statics.mask`, b).

    Raises:
        ReductionError: on all ranks: slices cannot be counted for such a body.
    """
    model, mask = statics.model, statics.mask

    arguments = {
        "solve": statics.solve,
        "stiffness": statics.stiffness,
        "mass": statics.M,
        "start": start,
        "size": statics.size,
        "prefix": choice.prefix,
    }
    if isinstance(choice, KrylovSchur):
        return KrylovSchurSearch(**arguments)
    if statics.held_averages is not None or not statics.has_factor or not model.is_definite:
        raise ReductionError(
            "spectrum slicing takes rigid interfaces or none, a factor of the stiffness, and no unknowns like "
            "pressures; take eigensolver=KrylovSchur() or BlockMethod(), whose modes are counted as well"
        )
    return SlicingSearch(partial(principal_part, model.K, mask), **arguments)
