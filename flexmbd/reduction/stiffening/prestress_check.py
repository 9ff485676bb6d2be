"""What `prestressed` asks of its arguments, and of the state that it finds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from mpi4py import MPI

import numpy as np
from numpy.typing import ArrayLike

from flexmbd.continuum.finite_elements.interface import AveragedInterface, RigidInterface
from flexmbd.continuum.finite_elements.linear_model import LinearModel, StaticState
from flexmbd.continuum.matrices.blocks import FloatArray
from flexmbd.errors import ReductionError
from flexmbd.reduction.unit_loads import Load, check_loads

# Largest rotation, rad, up to which a formulation's rotations are taken for those of small motions.
_ROTATION = 1e-3


def check_loading(
    model: LinearModel, *, frame: str, loads: Sequence[tuple[Load, float]], forces: Mapping[str, FloatArray]
) -> FloatArray:
    """Refuse what is not well formed; the sizes of the loads. Collective."""
    if model.state is not None:
        raise ReductionError("the model is prestressed already: give all loads at once, to the model at rest")
    model.interface(frame)
    if frame in forces:
        raise ReductionError(f"interface {frame!r} is held, so a force on it does nothing; leave it out")
    for name in forces:
        if not isinstance(model.interface(name), RigidInterface):
            raise ReductionError(f"interface {name!r} is averaged: load its facets by a Traction, or make it rigid")
    if not any(isinstance(one, RigidInterface) for one in model.interfaces):
        raise ReductionError("no interface of the model is rigid, and a prestressed body needs a rigid one")
    averaged = any(isinstance(one, AveragedInterface) for one in model.interfaces)
    if averaged and _has_rotations(model):
        raise ReductionError(
            f"{model.form_name} has rotations, and averaged interfaces of rotations about a loaded state are not "
            "supported; make the interface rigid"
        )
    check_loads(model, [load for load, _ in loads])
    return np.array([float(size) for _, size in loads])


def check_rotations(model: LinearModel, state: StaticState) -> None:
    """Refuse a state with rotations that small motions do not simply add to. Collective."""
    others = model.layout.kinematic.copy()
    others[model.displacement_dofs.reshape(-1)] = False
    largest = model.comm.allreduce(float(abs(state.displacement[others]).max(initial=0.0)), op=MPI.MAX)
    if largest > _ROTATION:
        raise ReductionError(
            f"the rotations of {model.form_name} reach {largest:.2g} rad in the loaded state, and motions about it are "
            f"only known up to {_ROTATION:g} rad, as of a straight beam under tension; reduce the loads, or use a solid"
        )


def _has_rotations(model: LinearModel) -> bool:
    """Whether rigid motions move more than the displacement. Collective."""
    more = int(model.layout.kinematic.sum()) != model.displacement_dofs.size
    return bool(model.comm.allreduce(more, op=MPI.LOR))


def finite_numbers(what: str, value: ArrayLike, count: int) -> FloatArray:
    """That many finite numbers.

    Raises:
        ReductionError: they are not.
    """
    try:
        numbers = np.array(value, dtype=float)
    except (TypeError, ValueError):
        numbers = np.zeros(0)
    if numbers.shape != (count,) or not np.isfinite(numbers).all():
        raise ReductionError(f"{what} must be finite, {count} in number, got {value!r}")
    return numbers
