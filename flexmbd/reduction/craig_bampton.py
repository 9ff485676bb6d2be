"""Craig-Bampton reduction: static shapes of the interfaces and fixed-interface modes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from flexmbd.continuum import parallel
from flexmbd.continuum.finite_elements.interface import AveragedInterface
from flexmbd.continuum.finite_elements.linear_model import LinearModel
from flexmbd.continuum.matrices import eigen
from flexmbd.continuum.matrices.blocks import FloatArray, inner, multiply
from flexmbd.errors import ReductionError
from flexmbd.given import refuse_no_truth
from flexmbd.record.reduced_body import FRAME_DOFS, ReducedBody
from flexmbd.reduction.damping import Damping
from flexmbd.reduction.modes.eigensolver import Eigensolver, chosen_eigensolver
from flexmbd.reduction.modes.fixed_modes import fixed_interface_modes
from flexmbd.reduction.modes.signs import asymmetric_fields, determined_rotation
from flexmbd.reduction.modes.truncation import Truncation, chosen_truncation
from flexmbd.reduction.optional_groups import Contents, Keep, Responses, responses
from flexmbd.reduction.projection import Basis, project
from flexmbd.reduction.static_shapes.interior_stiffness import Solver
from flexmbd.reduction.static_shapes.statics import Statics, body_statics, rigid_coordinates
from flexmbd.reduction.stiffening.geometric_stiffness import n_inertia_loads
from flexmbd.reduction.stiffening.stretch_modes import stretch_modes
from flexmbd.reduction.unit_loads import Load, listed


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
) -> ReducedBody:
    """Reduce a model to its interfaces and its lowest fixed-interface modes. Collective.

    The body frame sits on the interface `frame`, so that every mode vanishes there, in the mean where
    that is averaged; each other interface brings six static shapes (Craig & Bampton
    1968, doi:10.2514/3.4741).  Or it floats: its origin is the centre of mass, its axes the
    mesh's, and every mode fulfils the mean-axis conditions integral rho phi = 0 and integral rho x
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
            there are no fixed-interface modes.
        loads: distributed loads of unit size that the record shall hold (`DistributedLoads`). What the
            modes miss of the static response to each is in the record's provenance.
        damping: of the deformation; none by default.
        keep: what the record holds of the modes on the mesh; nothing by default.
        solver: by what the stiffness is inverted; None: by a factor, or where that would not fit in the
            memory there is by conjugate gradients.
        eigensolver: by what the modes are found: `BlockMethod()`, the default, or SLEPc's `KrylovSchur()` or
            `SpectrumSlicing()`.

    Returns:
        The record, the same to the bit on every rank.

    Raises:
        InterfaceError: the model has no interface `frame`.
        ReductionError: arguments that differ between the ranks; more modes than interior dofs; no
            frequency below `below_hz`; a tolerance that no number of modes reaches (the message says what
            they do reach); a singular stiffness; a failed accuracy check; loads or a damping that are not
            well formed.
        MeshError: a load's facet group is not there, or not on the boundary.
        FormulationError: stress modes of a stress that is not linear in the displacement.
        ConvergenceError: the eigensolver or conjugate gradients did not converge.
    """
    given = listed(loads)
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
    )
    refuse_no_truth(ReductionError, geometric_stiffness=geometric_stiffness)
    method = chosen_eigensolver(eigensolver)
    truncation = chosen_truncation(modes)
    contents = Contents(geometric_stiffness=geometric_stiffness, loads=given, damping=damping, keep=keep)
    contents.check(model)
    basis, count, notes = _basis(
        model,
        frame,
        truncation=truncation,
        contents=contents,
        solver=solver,
        eigensolver=method,
    )
    provenance = {
        "reduction": _name(model, count),
        "fixed-interface modes": str(count),
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
    averaged = [one.name for one in model.interfaces if isinstance(one, AveragedInterface)]
    if averaged:
        provenance["averaged interfaces"] = ", ".join(averaged)
    return project(model, basis, provenance=provenance, contents=contents)


def _name(model: LinearModel, modes: int) -> str:
    if not model.interfaces:
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
) -> tuple[Basis, int, dict[str, str]]:
    """The basis, its number of fixed-interface modes and its provenance. Collective."""
    with body_statics(model, frame=frame, solver=solver) as statics:
        fields = asymmetric_fields(model)
        images = multiply(model.M, fields)
        static = statics.static
        fixed, notes = _signed_modes(statics, truncation, fields, images, eigensolver=eigensolver)
        found = responses(statics, contents)
        count = len(fixed.eigenvalues)
        if contents.geometric_stiffness and count > 0:
            more = _stretch_modes(statics, fixed, found, images)
            fixed = eigen.Modes(
                np.concatenate([fixed.eigenvalues, more.eigenvalues]), np.hstack([fixed.shapes, more.shapes])
            )
            notes["stretch modes"] = str(len(more.eigenvalues))
    # the shapes of the first interface were only for the check
    shapes: FloatArray = np.hstack([static.shapes[:, 6:], fixed.shapes])
    forces = np.hstack([static.forces[:, 6:], multiply(model.K, fixed.shapes)])
    n, interfaces = shapes.shape[1], statics.interfaces
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
        rows=np.eye(6 * len(interfaces), n, -6) - moved,
        names=_names(statics, count, len(fixed.eigenvalues) - count),
        shapes=shapes,
        forces=forces,
        eigenvalues=fixed.eigenvalues,
        rigid_part=rigid_part,
        projections=inner(model.comm, shapes, images),
        responses=found,
    )
    return basis, count, {**notes, "rigid motion error": f"{static.rigid_error:.1e}", "solver": statics.solver}


def _stretch_modes(statics: Statics, fixed: eigen.Modes, found: Responses, images: FloatArray) -> eigen.Modes:
    number = n_inertia_loads(floating=statics.floating)
    return stretch_modes(
        statics,
        fixed,
        loads=found.loads.first(number),
        displacements=found.displacements[:, :number],
        images=images,
    )


def _names(statics: Statics, modes: int, stretch: int) -> tuple[str, ...]:
    """(n,) names of the coordinates."""
    static = [f"{one.name}.{dof}" for one in statics.interfaces[1:] for dof in FRAME_DOFS]
    if statics.floating and statics.interfaces:
        static = [f"{name} from {statics.interfaces[0].name}" for name in static]
    kind = "fixed-interface" if statics.interfaces else "free-free"
    modal = [f"{kind} {i + 1}" for i in range(modes)]
    return (*static, *modal, *(f"stretch {i + 1}" for i in range(stretch)))


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
