"""The statics of a body: its supports, its frame, and the factor of its stiffness."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum.finite_elements.held_surface import held_dofs
from flexmbd.continuum.finite_elements.interface import FoundInterface, RigidInterface
from flexmbd.continuum.finite_elements.linear_model import LinearModel
from flexmbd.continuum.finite_elements.nodal_interface import retained_dofs
from flexmbd.continuum.matrices.blocks import FloatArray
from flexmbd.errors import ReductionError
from flexmbd.reduction.static_shapes.constraint import Constraint, constrain
from flexmbd.reduction.static_shapes.factor import SINGULAR
from flexmbd.reduction.static_shapes.interface_motions import average_columns, averaged, rigidly_bound
from flexmbd.reduction.static_shapes.interior_stiffness import InteriorStiffness, Solver, factorised
from flexmbd.reduction.static_shapes.memory import workspace
from flexmbd.reduction.static_shapes.nodal_shapes import check_retained
from flexmbd.reduction.static_shapes.rigid_modes import RigidModes, rigid_modes
from flexmbd.reduction.static_shapes.statics import Statics, flexibility
from flexmbd.reduction.static_shapes.support import is_held, minimal_support, needs_support

# Responses to the inertia forces of the body's own motion, about as many as that.
_RESPONSES = 12


@contextmanager
def body_statics(
    model: LinearModel,
    *,
    frame: str | None,
    solver: Solver | None = None,
    modes: int = 0,
    grounded: bool = False,
    carrying: Sequence[str] = (),
) -> Iterator[Statics]:
    """Factorise the stiffness of a body for a `with` block, or make another inverse. Collective.

    Args:
        model: the body.
        frame: the interface that carries the body frame; None: it floats on the mean axis.
        solver: the same on all ranks; None: the quickest that fits in memory.
        modes: how many will be looked for, by which the memory that is left is judged.
        grounded: whether supports may hold the body alone; else they are at rest in the frame of an interface.
        carrying: nodal interfaces whose nodes tell the rigid motions of a body without frames, as far as they can.

    Yields:
        The statics; its memory is given back at the end of the block.

    Raises:
        InterfaceError: on all ranks: the model has no interface `frame`.
        ReductionError: on all ranks: the stiffness is singular, averages depend on each other, or
            there is not enough memory; or the solver does not fit the formulation.
        ConvergenceError: on all ranks, where the statics are used: an iterative solver does not converge.
    """
    interfaces = model.interfaces
    if model.state is not None and frame != model.state.frame:
        raise ReductionError(
            f"the loaded state is that of a body held at {model.state.frame!r}, and so must its reduction be: "
            f"give frame={model.state.frame!r}, not {frame!r}"
        )
    if frame is not None:
        carrier = model.interface(frame)
        interfaces = (carrier, *(other for other in model.interfaces if other is not carrier))
    supported = needs_support(model, interfaces)
    check_retained(model)
    _refuse_unheld(model, interfaces, frame=frame, grounded=grounded)
    rigid = rigid_modes(model) if supported or (frame is None and not model.supports) else None
    p, R = _body_frame(interfaces, rigid if frame is None else None)
    boundary = minimal_support(model, rigid) if supported and rigid is not None else _bound(model, interfaces)
    boundary = boundary | model.tied_dofs
    if not is_held(model, boundary):
        raise ReductionError(f"the stiffness of the interior has no inverse: {SINGULAR}")
    shapes = 6 * len(interfaces) + model.comm.allreduce(int(retained_dofs(model).sum())) + _RESPONSES
    beside = workspace(model, shapes=shapes, modes=modes)
    with factorised(model, boundary, solver=solver, beside=beside) as interior:
        mask = np.ones_like(interior.mask) if supported else interior.mask
        yield Statics(
            model=model,
            interfaces=interfaces,
            floating=frame is None and not model.supports,
            p=p,
            R=R,
            rigid=rigid,
            mask=mask,
            M=model.M if supported else interior.M,
            _interior=interior,
            _constraint=_averages(model, interfaces, interior, mask=mask, axes=R, free=rigid if supported else None),
            _beside=beside,
            _carrying=tuple(carrying),
        )


def _refuse_unheld(
    model: LinearModel, interfaces: Sequence[FoundInterface], *, frame: str | None, grounded: bool
) -> None:
    """Refuse a body frame that supports or springs on facets cannot be at rest in. Collective."""
    if model.supports and not grounded and (frame is None or not isinstance(interfaces[0], RigidInterface)):
        raise ReductionError(
            f"{model.supports[0].text}: supports are at rest in the body frame, which must therefore be that of a "
            "rigid interface, frame=...; a frame that floats with the body is no ground to them"
        )
    if model.supports and averaged(interfaces):
        raise ReductionError(
            f"{model.supports[0].text}: a part with supports has no averaged interfaces, for the average over a half "
            f"is not the average over the whole; make {averaged(interfaces)[0].name!r} Coupling.RIGID"
        )
    if model.has_surface_energy and (frame is None or needs_support(model, interfaces)):
        raise ReductionError(
            "springs on facets (surface_energy) reach from the surface to the body frame, which must therefore be that "
            "of an interface, frame=..., on a body with a rigid interface (Coupling.RIGID); a frame that floats with "
            "the body is no ground to them"
        )


def _body_frame(
    interfaces: Sequence[FoundInterface], floating_on: RigidModes | None
) -> tuple[FloatArray, FloatArray]:
    """(3,) m and (3, 3): origin and axes of the body frame in the mesh's axes."""
    if floating_on is not None:
        return floating_on.com, np.eye(3)
    if not interfaces:
        return np.zeros(3), np.eye(3)
    return interfaces[0].p, interfaces[0].R


def _averages(
    model: LinearModel,
    interfaces: Sequence[FoundInterface],
    interior: InteriorStiffness,
    *,
    mask: NDArray[np.bool_],
    axes: FloatArray,
    free: RigidModes | None,
) -> Constraint | None:
    """What holds the averaged interfaces, if there are some. Collective."""
    names = [one.name for one in averaged(interfaces)]
    if not names:
        return None
    return constrain(
        model.comm,
        lambda block: flexibility(interior, interior.solve, free, block),
        average_columns(model, interfaces, axes=axes)[mask],
        rigid=np.zeros((int(mask.sum()), 0)) if free is None else free.motions,
        names=names,
    )


def _bound(model: LinearModel, interfaces: Sequence[FoundInterface]) -> NDArray[np.bool_]:
    """(owned dofs,) whether a rigid interface binds a dof, a nodal one keeps it, or a support holds it."""
    boundary = held_dofs(model.supports, layout=model.layout) | retained_dofs(model)
    for interface in rigidly_bound(interfaces):
        boundary[interface.dofs[interface.dofs < model.n_owned]] = True
    return boundary
