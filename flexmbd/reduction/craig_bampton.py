"""Craig-Bampton reduction: static shapes of the interfaces and fixed-interface modes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from flexmbd.continuum import parallel
from flexmbd.continuum.finite_elements.interface import AveragedInterface
from flexmbd.continuum.finite_elements.linear_model import LinearModel
from flexmbd.continuum.finite_elements.locking import tell_locking
from flexmbd.continuum.matrices import eigen
from flexmbd.errors import ReductionError
from flexmbd.files.tree_file import check_destination
from flexmbd.given import checked, refuse_no_truth
from flexmbd.record.reduced_body import ReducedBody
from flexmbd.reduction.contact.found_patches import find_patches
from flexmbd.reduction.contact.patch import Patch
from flexmbd.reduction.craig_bampton_basis import craig_bampton_basis
from flexmbd.reduction.damping import Damping
from flexmbd.reduction.large_displacements.modal_derivatives import ModalDerivatives
from flexmbd.reduction.modes.eigensolver import Eigensolver, chosen_eigensolver
from flexmbd.reduction.modes.interface_modes import (
    InterfaceModes,
    check_interface_modes,
)
from flexmbd.reduction.modes.truncation import Truncation, chosen_truncation
from flexmbd.reduction.optional_groups import Contents, Keep
from flexmbd.reduction.projection import project
from flexmbd.reduction.stages import stages
from flexmbd.reduction.static_shapes.interior_stiffness import Solver
from flexmbd.reduction.unit_loads import Load


@checked("model", "loads", "contact", "stream", error=ReductionError, agree=parallel.told_to_all)
def craig_bampton(
    model: LinearModel,
    *,
    modes: int | Truncation,
    frame: str | None = None,
    geometric_stiffness: bool = True,
    loads: Sequence[Load] = (),
    contact: Sequence[Patch] = (),
    damping: Damping | None = None,
    keep: Keep = Keep(),  # noqa: B008  (frozen)
    solver: Solver | None = None,
    eigensolver: Eigensolver | None = None,
    interface_modes: InterfaceModes | None = None,
    residual_vectors: bool = False,
    nonlinear: ModalDerivatives | None = None,
    progress: bool = False,
    stream: str | Path | None = None,
) -> ReducedBody:
    """Reduce a model to its interfaces and its lowest fixed-interface modes. Collective.

    The body frame sits on the interface `frame`, so that every mode vanishes there, in the mean where
    that is averaged; each other interface brings six static shapes (Craig & Bampton
    1968, doi:10.2514/3.4741), and each node of a nodal interface three.  Or it floats: its origin is the centre of
    mass, its axes the mesh's, and every mode fulfils the mean-axis conditions integral rho phi = 0 and integral rho x
    cross phi = 0; with the rigid motions the modes span the same fields.  The response to loads on the
    interfaces is exact in statics; frequencies converge from above.  Signs follow
    `flexmbd.reduction.modes.signs`.

    Args:
        model: with at least the interface `frame`; about a loaded state if it is one of `prestressed`.
        modes: how many fixed-interface modes: a number, or `Truncation(below_hz=...)`, `Truncation(tol=...)`.
        frame: name of the interface that carries the body frame; None: it floats on the mean axis.
        geometric_stiffness: whether the record says how loads change the stiffness
            (`GeometricStiffness`, `ModalStretch`), without which a spinning body comes out too soft; left
            out where the strain energy is quadratic. A few modes are then added (`stretch_modes`), unless
            there are no fixed-interface modes. Beside nodal interfaces it is that of the deformations that the
            reduction resolves (`flexmbd.reduction.stiffening.resolved`).
        loads: distributed loads of unit size that the record shall hold (`DistributedLoads`). What the
            modes miss of the static response to each is in the record's provenance.
        contact: surfaces that may be touched, divided into contact patches (`ContactPatches`), with the residual
            flexibility of these: what the modes leave out of their statics. Shares are in the provenance; a patch's
            `tol` has contact shapes kept as further modes.
        damping: of the deformation; none by default.
        keep: fields of the modes on the mesh that the record keeps; none by default.
        solver: of the stiffness; None: the quickest that fits in the available memory.
        eigensolver: of the modes: `BlockMethod()`, the default, or SLEPc's `KrylovSchur()` or
            `SpectrumSlicing()`.
        interface_modes: which interfaces keep their static shapes, and how many characteristic modes stand for
            those of the others, nodal ones among them; None: all keep them.
        residual_vectors: whether the quasi-static response of the modes that are left out, to `loads` and to the
            inertia forces of the body's own motion, is kept as further modes, up to one a load, high ones. Stresses are
            then as good as displacements (`flexmbd.reduction.residual_vectors`).
        nonlinear: how a body that bends a lot gets a strain energy of degree four and the shapes for it, in the
            place of geometric stiffness; None: small displacements about a frame that moves. `modes` is a number.
        progress: whether the first rank shows a bar with the stages and the memory that is expected.
        stream: a file that the record goes to, the one that `ReducedBody.save` would make, in a folder that all ranks
            see. Each rank writes its part of what `keep` names, which no rank holds as a whole.

    Returns:
        The record, the same to the bit on every rank; with `stream` without what `keep` names, which is in the file.

    Raises:
        InterfaceError: the model has no interface `frame`.
        ReductionError: arguments that differ between the ranks; more modes than interior dofs; no
            frequency below `below_hz`; a tolerance that no number of modes reaches (the message says what
            they do reach); a singular stiffness; a failed accuracy check; loads or a damping that are not
            well formed.
        MeshError: a load's facet group is not there, or not on the boundary.
        FormulationError: stress modes of a body under load.
        ConvergenceError: the eigensolver or conjugate gradients did not converge.
        RecordError: the file cannot be written, of which what can be known is known before the reduction begins.
    """
    given, touched = tuple(loads), tuple(contact)
    parallel.check_same(
        model.comm,
        ReductionError,
        modes=modes,
        frame=frame,
        geometric_stiffness=geometric_stiffness,
        loads=given,
        contact=touched,
        damping=damping,
        keep=keep,
        solver=solver,
        eigensolver=eigensolver,
        interface_modes=interface_modes,
        residual_vectors=residual_vectors,
        nonlinear=nonlinear,
        progress=progress,
        stream=stream,
    )
    if stream is not None:
        parallel.on_root(model.comm, lambda: check_destination(Path(stream)))
    refuse_no_truth(
        ReductionError, geometric_stiffness=geometric_stiffness, residual_vectors=residual_vectors, progress=progress
    )
    method = chosen_eigensolver(eigensolver)
    truncation = chosen_truncation(modes)
    contents = Contents(
        geometric_stiffness=geometric_stiffness and nonlinear is None,
        loads=given,
        damping=damping,
        keep=keep,
        residual_vectors=residual_vectors,
        nonlinear=nonlinear,
    )
    contents.check(model)
    if nonlinear is not None and (truncation.free or interface_modes is not None):
        raise ReductionError("nonlinear= goes with fixed-interface modes and interfaces that keep their six shapes")
    if interface_modes is not None:
        check_interface_modes(interface_modes, model, frame=frame)
    if touched and (nonlinear is not None or interface_modes is not None):
        what = "interface_modes" if nonlinear is None else "nonlinear"
        raise ReductionError(
            f"contact={list(touched)!r:.200} goes without {what}=: residual flexibility is of linear statics, with "
            "interfaces that keep their six shapes"
        )
    contents = replace(contents, patches=find_patches(model, touched))
    tell_locking(model)
    with stages(model.comm, shown=progress) as stage:
        basis, count, notes = craig_bampton_basis(
            model,
            frame,
            truncation=truncation,
            contents=contents,
            solver=solver,
            eigensolver=method,
            choice=interface_modes,
            stage=stage,
        )
        stage.begin("projection")
        provenance = _provenance(model, count, truncation, method, notes=notes, frame=frame)
        return project(model, basis, provenance=provenance, contents=contents, stream=stream)


def _provenance(
    model: LinearModel,
    count: int,
    truncation: Truncation,
    method: Eigensolver,
    *,
    notes: dict[str, str],
    frame: str | None,
) -> dict[str, str]:
    provenance = {
        "reduction": _name(model, count),
        **({} if truncation.free else {"fixed-interface modes": str(count)}),
        "eigensolver": repr(method),
        "eigenvalue tolerance": f"{eigen.TOLERANCE:.0e}",
        **notes,
        "form": model.form_name,
        "parameters": repr(model.parameters),
        "degree": str(model.degree),
        "mesh": model.mesh_fingerprint,
    }
    if model.surfaces:
        listed_groups = (f"{group.name}: {group.form_name} {group.parameters!r}" for group in model.surfaces)
        provenance["surfaces"] = "; ".join(listed_groups)
    if model.has_surface_energy:
        provenance["springs on facets"] = f"to the body frame, {frame}"
    if model.supports:
        texts = "; ".join(one.text for one in model.supports)
        provenance["supports"] = f"{texts}; mass and inertia are of the meshed part alone"
    if model.ties is not None:
        provenance["welds"] = f"{len(model.ties.numbers)} nodes follow facets"
    if model.conditions is not None and model.conditions.others:
        provenance["conditions"] = ", ".join(map(str, model.conditions.others))
    averaged = [one.name for one in model.interfaces if isinstance(one, AveragedInterface)]
    if averaged:
        provenance["averaged interfaces"] = ", ".join(averaged)
    return provenance


def _name(model: LinearModel, modes: int) -> str:
    if not (model.interfaces or model.nodal):
        return "free-free modes"
    return "Craig-Bampton" if modes > 0 else "Guyan"
