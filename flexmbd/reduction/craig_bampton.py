"""Craig-Bampton reduction: static shapes of the interfaces and fixed-interface modes."""

from __future__ import annotations

import operator
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum.blocks import FloatArray, inner, multiply
from flexmbd.continuum.interface import RigidInterface
from flexmbd.continuum.model import ContinuumModel
from flexmbd.errors import ReductionError
from flexmbd.reduced import ReducedBody
from flexmbd.reduction import eigen, statics
from flexmbd.reduction.projection import Basis, project
from flexmbd.reduction.signs import asymmetric_fields, determined_rotation

# Modes beyond those that are asked for, so that a pair of equal frequencies is not cut unseen.
_GUARD = 2


def craig_bampton(
    model: ContinuumModel,
    *,
    modes: int,
    frame: str,
    keep_modes: bool = False,
    keep_surface: bool = False,
) -> ReducedBody:
    """Reduce a model to its interfaces and its lowest fixed-interface modes. Collective.

    The body frame sits on the interface `frame`, so that every mode vanishes there; each other
    interface brings six static shapes (seed 3 eq. 3.10-3.13; Craig & Bampton 1968,
    doi:10.2514/3.4741).  The response to loads on the interfaces is exact in statics; frequencies
    converge from above.  Signs follow `flexmbd.reduction.signs`.

    Args:
        model: with at least the interface `frame`.
        modes: number of fixed-interface modes; 0 gives Guyan's reduction.
        frame: name of the interface that carries the body frame.
        keep_modes: whether the record holds the modes at all nodes (`NodalModes`).
        keep_surface: whether the record holds the boundary's triangles (`Surface`).

    Returns:
        The record, the same to the bit on every rank.

    Raises:
        InterfaceError: the model has no interface `frame`.
        ReductionError: more modes than interior dofs; a singular stiffness; a failed accuracy check.
        ConvergenceError: the eigensolver did not converge.
    """
    modes = _checked(modes)
    basis, rigid_error = _basis(model, model.interface(frame), modes=modes)
    provenance = {
        "reduction": "Craig-Bampton" if modes > 0 else "Guyan",
        "fixed-interface modes": str(modes),
        "eigenvalue tolerance": f"{eigen.TOLERANCE:.0e}",
        "rigid motion error": f"{rigid_error:.1e}",
        "form": model.form_name,
        "parameters": repr(model.parameters),
        "degree": str(model.degree),
        "mesh": model.mesh_fingerprint,
    }
    return project(
        model, basis, provenance=provenance, keep_modes=keep_modes, keep_surface=keep_surface
    )


def _basis(model: ContinuumModel, frame: RigidInterface, *, modes: int) -> tuple[Basis, float]:
    """The basis, and the error of the rigid motions among its static shapes. Collective."""
    moving = tuple(other for other in model.interfaces if other is not frame)
    boundary, motions = _rigid_boundary(model, (frame, *moving), axes=frame.R)
    interior_size = model.comm.allreduce(int(np.sum(~boundary)))
    if modes > interior_size:
        raise ReductionError(
            f"{modes} fixed-interface modes were asked for, and the interior has {interior_size} "
            "dofs; ask for fewer modes or refine the mesh"
        )
    fields = asymmetric_fields(model)
    images = multiply(model.M, fields)
    with statics.factorised(model, boundary) as interior:
        static, forces = statics.static_shapes(model, interior, motions)
        rigid_error = statics.check_rigid_motions(
            model,
            found=static @ _rigid_coordinates((frame, *moving), origin=frame.p, axes=frame.R),
            expected=model.rigid_motions(frame.p, frame.R),
        )
        fixed = _fixed_interface_modes(model, interior, fields, images, count=modes)
    # the shapes of the frame's own interface were only for the check
    shapes = np.hstack([static[:, 6:], fixed.shapes])
    basis = Basis(
        frame=frame,
        moving=moving,
        shapes=shapes,
        forces=np.hstack([forces[:, 6:], multiply(model.K, fixed.shapes)]),
        eigenvalues=fixed.eigenvalues,
        projections=inner(model.comm, shapes, images),
    )
    return basis, rigid_error


def _checked(modes: int) -> int:
    try:
        number = operator.index(modes)
    except TypeError:
        number = -1
    if number < 0 or isinstance(modes, bool):
        raise ReductionError(f"modes must be a whole number from 0 on, got {modes!r}")
    return number


def _rigid_boundary(
    model: ContinuumModel, interfaces: Sequence[RigidInterface], *, axes: FloatArray
) -> tuple[NDArray[np.bool_], FloatArray]:
    """Which dofs the interfaces bind, and their six unit motions each (owned dofs, 6 b)."""
    boundary = np.zeros(model.n_owned, dtype=bool)
    motions = np.zeros((model.n_owned, 6 * len(interfaces)), order="F")
    for i, interface in enumerate(interfaces):
        nodes = interface.nodes[interface.nodes < model.n_owned // 3]
        dofs = (3 * nodes[:, None] + np.arange(3)).reshape(-1)
        boundary[dofs] = True
        motions[dofs, 6 * i : 6 * i + 6] = model.rigid_motions(interface.p, axes)[dofs]
    return boundary, motions


def _rigid_coordinates(
    interfaces: Sequence[RigidInterface], *, origin: FloatArray, axes: FloatArray
) -> FloatArray:
    """(6 b, 6) the interfaces' motions in a rigid motion of the body about `origin`, along `axes`."""
    coordinates = np.tile(np.eye(6), (len(interfaces), 1))
    for i, interface in enumerate(interfaces):
        arm = axes.T @ (interface.p - origin)
        coordinates[6 * i : 6 * i + 3, 3:] = np.cross(np.eye(3), arm).T
    return coordinates


def _fixed_interface_modes(
    model: ContinuumModel,
    interior: statics.Interior,
    fields: FloatArray,
    images: FloatArray,
    *,
    count: int,
) -> eigen.Modes:
    """The lowest modes with all interfaces fixed, signs by the rule, on all owned dofs."""
    start = np.asfortranarray(fields[interior.mask])
    computed = min(count + _GUARD, interior.size) if count > 0 else 0
    found = eigen.lowest_modes(interior.solve, interior.M, start=start, count=computed)
    projections = inner(model.comm, found.shapes, images[interior.mask])
    rotation = model.comm.bcast(determined_rotation(found.eigenvalues, projections)[:, :count])
    shapes = np.zeros((model.n_owned, count), order="F")
    shapes[interior.mask] = found.shapes @ rotation
    return eigen.Modes(found.eigenvalues[:count], shapes)
