"""Craig-Bampton reduction: static shapes of the interfaces and fixed-interface modes."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from flexmbd.continuum import parallel
from flexmbd.continuum.finite_elements.interface import AveragedInterface
from flexmbd.continuum.finite_elements.linear_model import LinearModel
from flexmbd.continuum.matrices import eigen
from flexmbd.continuum.matrices.blocks import FloatArray, inner, multiply
from flexmbd.errors import ReductionError
from flexmbd.files.tree_file import check_destination
from flexmbd.given import checked, refuse_no_truth
from flexmbd.record.reduced_body import ReducedBody
from flexmbd.reduction.damping import Damping
from flexmbd.reduction.large_displacements.basis import NonlinearShapes, nonlinear_shapes
from flexmbd.reduction.large_displacements.modal_derivatives import ModalDerivatives, check_nonlinear
from flexmbd.reduction.modes.eigensolver import Eigensolver, chosen_eigensolver
from flexmbd.reduction.modes.fixed_modes import fixed_interface_modes
from flexmbd.reduction.modes.free_modes import free_interface_modes
from flexmbd.reduction.modes.interface_modes import (
    InterfaceModes,
    InterfaceShapes,
    all_interface_shapes,
    check_interface_modes,
    interface_shapes,
    joints,
    kept_interfaces,
)
from flexmbd.reduction.modes.ritz import ritz_modes
from flexmbd.reduction.modes.signs import asymmetric_fields, determined_rotation
from flexmbd.reduction.modes.truncation import Truncation, chosen_truncation
from flexmbd.reduction.optional_groups import Contents, Keep, Responses, responses
from flexmbd.reduction.projection import Basis, project
from flexmbd.reduction.residual_vectors import residual_vectors as residual_modes
from flexmbd.reduction.stages import Stages, ranks_note, stages
from flexmbd.reduction.static_shapes.interior_stiffness import Solver
from flexmbd.reduction.static_shapes.statics import Statics, body_statics, rigid_coordinates
from flexmbd.reduction.stiffening.geometric_stiffness import interface_loads, n_inertia_loads
from flexmbd.reduction.stiffening.stretch_modes import stretch_modes
from flexmbd.reduction.unit_loads import Load

# How many modes memory is kept for where their number is not given.
_EXPECTED = 64


@checked("model", "loads", "stream", error=ReductionError, agree=parallel.told_to_all)
def craig_bampton(
    model: LinearModel,
    *,
    modes: int | Truncation,
    frame: str | None = None,
    geometric_stiffness: bool = True,
    loads: Sequence[Load] = (),
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
        damping: of the deformation; none by default.
        keep: what the record holds of the modes on the mesh; nothing by default.
        solver: by what the stiffness is inverted; None: the quickest that fits in the memory there is.
        eigensolver: by what the modes are found: `BlockMethod()`, the default, or SLEPc's `KrylovSchur()` or
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
        FormulationError: stress modes of a stress that is not linear in the displacement.
        ConvergenceError: the eigensolver or conjugate gradients did not converge.
        RecordError: the file cannot be written, of which what can be known is known before the reduction begins.
    """
    given = tuple(loads)
    parallel.check_same(
        model.comm,
        ReductionError,
        modes=modes,
        frame=frame,
        geometric_stiffness=geometric_stiffness,
        loads=given,
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
    if nonlinear is not None:
        check_nonlinear(model)
        if truncation.free or interface_modes is not None:
            raise ReductionError("nonlinear= goes with fixed-interface modes and interfaces that keep their six shapes")
    if interface_modes is not None:
        check_interface_modes(interface_modes, model, frame=frame)
    with stages(model.comm, shown=progress) as stage:
        basis, count, notes = _basis(
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
    averaged = [one.name for one in model.interfaces if isinstance(one, AveragedInterface)]
    if averaged:
        provenance["averaged interfaces"] = ", ".join(averaged)
    return provenance


def _name(model: LinearModel, modes: int) -> str:
    if not (model.interfaces or model.nodal):
        return "free-free modes"
    return "Craig-Bampton" if modes > 0 else "Guyan"


def _basis(
    model: LinearModel,
    frame: str | None,
    *,
    truncation: Truncation,
    contents: Contents,
    solver: Solver | None,
    eigensolver: Eigensolver,
    choice: InterfaceModes | None,
    stage: Stages,
) -> tuple[Basis, int, dict[str, str]]:
    """The basis, its number of fixed-interface modes and its provenance. Collective."""
    expected = _EXPECTED if truncation.modes is None else min(truncation.modes, int(model.K.getSize()[0]))
    stage.begin("factor")
    with body_statics(model, frame=frame, solver=solver, modes=expected, carrying=joints(choice)) as statics:
        told = ranks_note(model.comm.size, int(model.K.getSize()[0]))
        stage.note(f"{statics.solver}; some {statics.memory / 1e6:.1f} MB beside K and M{told}")
        stage.begin("static shapes")
        fields = asymmetric_fields(model)
        images = multiply(model.M, fields)
        static = statics.static
        stage.begin("responses to loads")
        # before the modes, since counting these may take the place of the factor
        found = responses(statics, contents, kept_interfaces(statics, choice))
        stage.begin("modes")
        if truncation.free:
            frames = interface_loads(model, statics.interfaces, R=statics.R).forces
            fixed, notes = free_interface_modes(
                statics, truncation, frames=frames, fields=fields, images=images, eigensolver=eigensolver
            )
        else:
            fixed, notes = _signed_modes(statics, truncation, fields, images, eigensolver=eigensolver)
        kept = all_interface_shapes(statics) if choice is None else interface_shapes(statics, fixed, choice)
        notes.update(kept.notes)
        count, resolved = len(fixed.eigenvalues), float(fixed.eigenvalues.max(initial=0.0))
        wanted = "residual vectors" if contents.residual_vectors else "stretch modes"
        if contents.residual_vectors or (contents.geometric_stiffness and count > 0):
            stage.begin(wanted)
            if contents.residual_vectors:
                # what the loads of the body's motion stretch is among them
                more = residual_modes(statics, fixed, forces=found.loads.forces, held=found.held, images=images)
            else:
                more = _stretch_modes(statics, fixed, found, images)
            fixed = eigen.Modes(
                np.concatenate([fixed.eigenvalues, more.eigenvalues]), np.hstack([fixed.shapes, more.shapes])
            )
            if truncation.free:
                # beside modes that are no eigenvectors of the fixed body they share mass or energy
                fixed = ritz_modes(model, fixed.shapes, images=images)
            notes[wanted] = str(len(more.eigenvalues))
        beside = None
        if contents.nonlinear is not None:
            stage.begin("modal derivatives")
            beside = nonlinear_shapes(statics, fixed, contents.loads, choice=contents.nonlinear)
            notes.update(beside.notes)
    shapes, forces, rows = _joined_shapes(statics, kept, fixed, choice=choice, beside=beside)
    added = 0 if beside is None else beside.shapes.shape[1]
    n, interfaces = shapes.shape[1], kept.interfaces
    moved: FloatArray = np.zeros((6 * len(interfaces), n))
    rigid_part: FloatArray = np.zeros((6, n))
    if frame is None and statics.rigid is not None:
        rigid = statics.rigid
        c = rigid.coordinates(shapes)
        shapes = shapes - rigid.motions @ c
        moved = rigid_coordinates(interfaces, origin=statics.p, axes=statics.R) @ c
        rigid_part = np.linalg.cholesky(rigid.mass).T @ c
    basis = Basis(
        frame=frame,
        p=statics.p,
        R=statics.R,
        interfaces=interfaces,
        nodal=kept.nodal,
        rows=rows - moved,
        names=(
            *kept.names,
            *(f"modal derivative {i + 1}" for i in range(added)),
            *_names(statics, count, len(fixed.eigenvalues) - count, free=truncation.free, more=wanted.split()[0]),
        ),
        shapes=shapes,
        forces=forces,
        eigenvalues=fixed.eigenvalues,
        resolved=resolved,
        rigid_part=rigid_part,
        projections=inner(model.comm, shapes, images),
        responses=found,
        large=None if beside is None else beside.placed(len(kept.names)),
    )
    return basis, count, {**notes, "rigid motion error": f"{static.rigid_error:.1e}", "solver": statics.solver}


def _joined_shapes(
    statics: Statics,
    kept: InterfaceShapes,
    fixed: eigen.Modes,
    *,
    choice: InterfaceModes | None,
    beside: NonlinearShapes | None,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """(owned dofs, n) static shapes, modal derivatives and modes, K times them, and the frames' rows (6 b, n)."""
    K = statics.model.K
    # the shapes of the first interface were only for the check
    shapes, forces = statics.moving
    if choice is not None:
        shapes, forces = shapes @ kept.change, forces @ kept.change
    first = shapes.shape[1]
    if beside is not None:
        shapes, forces = np.hstack([shapes, beside.shapes]), np.hstack([forces, multiply(K, beside.shapes)])
    rows = kept.frame_rows(statics, shapes.shape[1] + fixed.shapes.shape[1])
    if beside is not None:
        rows[:, first : shapes.shape[1]] = beside.rows
    return np.hstack([shapes, fixed.shapes]), np.hstack([forces, multiply(K, fixed.shapes)]), rows


def _stretch_modes(statics: Statics, fixed: eigen.Modes, found: Responses, images: FloatArray) -> eigen.Modes:
    number = n_inertia_loads(floating=statics.floating)
    return stretch_modes(
        statics,
        fixed,
        loads=found.loads.first(number),
        displacements=found.displacements[:, :number],
        held=found.held[:, :number],
        images=images,
    )


def _names(statics: Statics, modes: int, added: int, *, free: bool, more: str) -> tuple[str, ...]:
    """Names of the modes' coordinates."""
    kind = ("free-interface" if free else "fixed-interface") if statics.interfaces or statics.nodal else "free-free"
    modal = [f"{kind} {i + 1}" for i in range(modes)]
    return (*modal, *(f"{more} {i + 1}" for i in range(added)))


def _signed_modes(
    statics: Statics,
    truncation: Truncation,
    fields: FloatArray,
    images: FloatArray,
    *,
    eigensolver: Eigensolver,
) -> tuple[eigen.Modes, dict[str, str]]:
    """The fixed-interface modes, signs by the rule, on all owned dofs, and their provenance."""
    comm, mask = statics.model.comm, statics.mask
    start = np.asfortranarray(fields[mask])
    found = fixed_interface_modes(statics, truncation, start=start, eigensolver=eigensolver)
    eigenvalues, count = found.modes.eigenvalues, found.count
    projections = inner(comm, found.modes.shapes, images[mask])
    rotation = comm.bcast(determined_rotation(eigenvalues, projections)[:, :count])
    shapes = np.zeros((len(mask), count), order="F")
    shapes[mask] = found.modes.shapes @ rotation
    return eigen.Modes(eigenvalues[:count], shapes), found.provenance
