"""The basis of a Craig-Bampton reduction: static shapes, fixed-interface modes, and further shapes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from flexmbd.continuum.finite_elements.interface import FoundInterface
from flexmbd.continuum.finite_elements.linear_model import LinearModel
from flexmbd.continuum.matrices import eigen
from flexmbd.continuum.matrices.blocks import FloatArray, inner, multiply
from flexmbd.reduction.contact.residual_flexibility import contact_shapes, residual_flexibility
from flexmbd.reduction.large_displacements.basis import NonlinearShapes, nonlinear_shapes
from flexmbd.reduction.modes.eigensolver import Eigensolver
from flexmbd.reduction.modes.fixed_modes import fixed_interface_modes
from flexmbd.reduction.modes.free_modes import free_interface_modes
from flexmbd.reduction.modes.interface_modes import (
    InterfaceModes,
    InterfaceShapes,
    all_interface_shapes,
    interface_shapes,
    joints,
    kept_interfaces,
)
from flexmbd.reduction.modes.ritz import independent_shapes, ritz_modes
from flexmbd.reduction.modes.signs import asymmetric_fields, determined_rotation
from flexmbd.reduction.modes.truncation import Truncation
from flexmbd.reduction.optional_groups import Contents, Responses, responses
from flexmbd.reduction.ports import deformations, port_capacity
from flexmbd.reduction.projection import Basis
from flexmbd.reduction.residual_vectors import residual_vectors as residual_modes
from flexmbd.reduction.stages import Stages, ranks_note
from flexmbd.reduction.static_shapes.body_statics import body_statics
from flexmbd.reduction.static_shapes.interface_motions import rigid_coordinates
from flexmbd.reduction.static_shapes.interior_stiffness import Solver
from flexmbd.reduction.static_shapes.statics import Statics
from flexmbd.reduction.stiffening.geometric_stiffness import interface_loads, n_inertia_loads
from flexmbd.reduction.stiffening.stretch_modes import stretch_modes

# How many modes memory is kept for where their number is not given.
_EXPECTED = 64


def craig_bampton_basis(
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
    if contents.patches is not None:
        expected += 3 * len(contents.patches.area)
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
        free = truncation.free
        fixed, counts = _completed(statics, fixed, found, contents, free=free, images=images, stage=stage)
        notes.update(counts)
        beside = None
        if contents.nonlinear is not None:
            stage.begin("modal derivatives")
            beside = nonlinear_shapes(statics, fixed, contents.loads, choice=contents.nonlinear)
            notes.update(beside.notes)
    shapes, forces, rows = _joined_shapes(statics, kept, fixed, choice=choice, beside=beside)
    shapes, moved, rigid_part = _without_rigid_motion(statics, kept.interfaces, shapes, floats=frame is None)
    more = 0 if beside is None else beside.shapes.shape[1]
    contact = None if found.contact is None else residual_flexibility(statics, fixed, found.contact)
    ports = None if found.ports is None else port_capacity(statics, fixed, found.ports)
    basis = Basis(
        frame=frame,
        p=statics.p,
        R=statics.R,
        interfaces=kept.interfaces,
        nodal=kept.nodal,
        rows=rows - moved,
        names=(
            *kept.names,
            *(f"modal derivative {i + 1}" for i in range(more)),
            *_names(statics, count, free=free, added=counts),
        ),
        shapes=shapes,
        forces=forces,
        eigenvalues=fixed.eigenvalues,
        resolved=resolved,
        rigid_part=rigid_part,
        projections=inner(model.comm, shapes, images),
        responses=replace(found, contact=None, ports=None),
        large=None if beside is None else beside.placed(len(kept.names)),
        contact=contact,
        ports=ports,
    )
    return basis, count, {**notes, "rigid motion error": f"{static.rigid_error:.1e}", "solver": statics.solver}


def _completed(
    statics: Statics,
    fixed: eigen.Modes,
    found: Responses,
    contents: Contents,
    *,
    free: bool,
    images: FloatArray,
    stage: Stages,
) -> tuple[eigen.Modes, dict[str, str]]:
    """The modes, and those that complete the response to loads and to contact; how many by kind. Collective."""
    notes, eigenvectors = {}, 0 if free else len(fixed.eigenvalues)
    added = _added_modes(statics, fixed, found, contents, images=images, stage=stage)
    if added is not None:
        fixed = eigen.Modes(
            np.concatenate([fixed.eigenvalues, added.eigenvalues]), np.hstack([fixed.shapes, added.shapes])
        )
        if free:
            # beside modes that are no eigenvectors of the fixed body they share mass or energy
            fixed = ritz_modes(statics.model, fixed.shapes, images=images)
        notes[_kind_added(contents, found)] = str(len(added.eigenvalues))
    if found.contact is not None:
        touched = contact_shapes(statics, fixed, found.contact, exact=eigenvectors, images=images)
        if touched is not None:
            notes["contact shapes"] = str(len(touched.eigenvalues) - len(fixed.eigenvalues))
            fixed = touched
    return fixed, notes


def _kind_added(contents: Contents, found: Responses) -> str:
    """What modes that complete the response to loads are called."""
    if contents.residual_vectors:
        return "residual vectors"
    if not found.loads.rises:
        return "stretch modes"
    return "stretch and expansion modes" if contents.geometric_stiffness else "expansion modes"


def _added_modes(
    statics: Statics,
    fixed: eigen.Modes,
    found: Responses,
    contents: Contents,
    *,
    images: FloatArray,
    stage: Stages,
) -> eigen.Modes | None:
    """Modes that complete the response to loads, where some are wanted. Collective."""
    stretches = contents.geometric_stiffness and len(fixed.eigenvalues) > 0
    if not (contents.residual_vectors or stretches or found.loads.rises):
        return None
    stage.begin(_kind_added(contents, found))
    if contents.residual_vectors:
        # what the loads of the body's motion stretch is among them
        forces, held = found.loads.forces, found.held
        if found.ports is not None:
            shapes, loads = deformations(statics, found.ports)
            forces, held = np.hstack([forces, loads]), np.hstack([held, shapes])
        return residual_modes(statics, fixed, forces=forces, held=held, images=images)
    stretched = _stretch_modes(statics, fixed, found, images) if stretches else None
    if not found.loads.rises:
        return stretched
    expanded = _expansion_modes(statics, fixed, found, images)
    if stretched is None:
        return expanded
    energies = np.concatenate([stretched.eigenvalues, expanded.eigenvalues])
    both = np.asfortranarray(np.hstack([stretched.shapes, expanded.shapes]))
    return ritz_modes(statics.model, independent_shapes(statics.model, both, whole=energies), images=images)


def _expansion_modes(statics: Statics, fixed: eigen.Modes, found: Responses, images: FloatArray) -> eigen.Modes:
    """The response to temperatures: without it what expands freely would seem to be held, by far the larger stress."""
    hot = [found.loads.names.index(name) for name in found.loads.rises]
    forces, held = (np.asfortranarray(block[:, hot]) for block in (found.loads.forces, found.held))
    return residual_modes(statics, fixed, forces=forces, held=held, images=images)


def _without_rigid_motion(
    statics: Statics, interfaces: Sequence[FoundInterface], shapes: FloatArray, *, floats: bool
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Shapes (owned dofs, n) less their part in the rigid modes where the frame floats on the mean axis. Collective.

    Returns:
        The shapes; (6 b, n) the interfaces' motions in that part; (6, n) the part, in rigid modes of mass 1.
    """
    n = shapes.shape[1]
    if not floats or statics.rigid is None:
        return shapes, np.zeros((6 * len(interfaces), n)), np.zeros((6, n))
    c = statics.rigid.coordinates(shapes)
    moved = rigid_coordinates(interfaces, origin=statics.p, axes=statics.R) @ c
    return shapes - statics.rigid.motions @ c, moved, np.linalg.cholesky(statics.rigid.mass).T @ c


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


def _names(statics: Statics, modes: int, *, free: bool, added: Mapping[str, str]) -> tuple[str, ...]:
    """Names of the modes' coordinates; `added`: the numbers of those that complete them, by their kinds."""
    kind = ("free-interface" if free else "fixed-interface") if statics.interfaces or statics.nodal else "free-free"
    counts = {kind: modes, **{what.split()[0]: int(number) for what, number in added.items()}}
    return tuple(f"{what} {i + 1}" for what, number in counts.items() for i in range(number))


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
