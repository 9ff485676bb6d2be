"""Guyan reduction to interface frames: static shapes alone."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from flexmbd.continuum import parallel
from flexmbd.continuum.finite_elements.linear_model import LinearModel
from flexmbd.errors import ReductionError
from flexmbd.given import checked
from flexmbd.record.reduced_body import ReducedBody
from flexmbd.reduction.contact.patch import Patch
from flexmbd.reduction.craig_bampton import craig_bampton
from flexmbd.reduction.damping import Damping
from flexmbd.reduction.optional_groups import Keep
from flexmbd.reduction.static_shapes.interior_stiffness import Solver
from flexmbd.reduction.unit_loads import Load


@checked("model", "loads", "contact", "stream", error=ReductionError, agree=parallel.told_to_all)
def guyan(
    model: LinearModel,
    *,
    frame: str | None = None,
    geometric_stiffness: bool = True,
    loads: Sequence[Load] = (),
    contact: Sequence[Patch] = (),
    damping: Damping | None = None,
    keep: Keep = Keep(),  # noqa: B008  (frozen)
    solver: Solver | None = None,
    progress: bool = False,
    stream: str | Path | None = None,
) -> ReducedBody:
    """Reduce a model to the six dofs of each interface by static condensation. Collective.

    The static shapes of Craig-Bampton without its fixed-interface modes (Guyan 1965,
    doi:10.2514/3.2874): exact for static loads on the interfaces. What spins wants a mode or more: with none its
    tension is uniform between interfaces, by which a blade is stiffened a third too much.

    Args:
        model: with at least the interface `frame`.
        frame: name of the interface that carries the body frame, where every mode vanishes;
            None: it floats on the mean axis.
        geometric_stiffness: as for `craig_bampton`, and so are the others.
        loads: distributed loads of unit size.
        contact: surfaces that may be touched.
        damping: of the deformation.
        keep: fields of the modes on the mesh that the record keeps.
        solver: of the stiffness.
        progress: whether the first rank shows a bar with the stages.
        stream: a file that the record goes to, and what `keep` names to that alone.

    Returns:
        The record, the same to the bit on every rank; n is six times the interfaces but one.

    Raises:
        InterfaceError: the model has no interface `frame`.
        ReductionError: a singular stiffness, a failed accuracy check, or loads or a damping that are
            not well formed.
        RecordError: the file cannot be written.
    """
    return craig_bampton(
        model,
        modes=0,
        frame=frame,
        geometric_stiffness=geometric_stiffness,
        loads=loads,
        contact=contact,
        damping=damping,
        keep=keep,
        solver=solver,
        progress=progress,
        stream=stream,
    )
