"""Modes of the free body in the place of fixed-interface modes (Rubin 1975, doi:10.2514/3.60497; Craig & Chang 1977).

A free mode less the static shapes of its interfaces' motions is at rest on all interfaces, and has no strain energy in
common with the static shapes. With these it spans what the methods of Rubin and of Craig and Chang span by free modes,
rigid motions and residual attachment modes: the static response to loads on the interfaces, and the free body's
modes, which the reduction then has exactly.
"""

from __future__ import annotations

import numpy as np

from flexmbd.continuum.matrices.blocks import FloatArray, inner
from flexmbd.continuum.matrices.eigen import BlockLanczos, Modes
from flexmbd.errors import ReductionError
from flexmbd.reduction.modes.eigensolver import BlockMethod, Eigensolver
from flexmbd.reduction.modes.fixed_modes import GUARD, SEARCH_LIMIT, find_whole_clusters
from flexmbd.reduction.modes.mode_count import count_below
from flexmbd.reduction.modes.ritz import independent_shapes, ritz_modes
from flexmbd.reduction.modes.truncation import Truncation
from flexmbd.reduction.static_shapes.rigid_modes import rigid_modes
from flexmbd.reduction.static_shapes.statics import Statics


def free_interface_modes(
    statics: Statics,
    truncation: Truncation,
    *,
    frames: FloatArray,
    fields: FloatArray,
    images: FloatArray,
    eigensolver: Eigensolver,
) -> tuple[Modes, dict[str, str]]:
    """The lowest elastic modes of the free body less their interfaces' motions, orthonormal. Collective.

    Args:
        statics: of the body.
        truncation: how many; with `free`.
        frames: (owned dofs, 6 b) unit forces on the interfaces, whose transpose takes displacements to their motions.
        fields: (owned dofs, fields) of the signs' rule.
        images: (owned dofs, fields) M times these.
        eigensolver: `BlockMethod` alone.

    Returns:
        The shapes that are at rest on the interfaces, with their Ritz values, and what the provenance says.

    Raises:
        ReductionError: on all ranks: another eigensolver, a loaded state or springs on facets, more modes than there
            are.
        ConvergenceError: on all ranks: the eigensolver did not converge.
    """
    model, static = statics.model, statics.static
    if not isinstance(eigensolver, BlockMethod):
        raise ReductionError("free modes are found by BlockMethod(); leave eigensolver out")
    if model.state is not None or model.has_surface_energy or model.supports or model.nodal:
        raise ReductionError(
            "a prestressed body, or one with supports, nodal interfaces or springs on facets, is held and has no free "
            "modes; leave free=True out"
        )
    shapes, forces = statics.moving
    rigid = statics.rigid if statics.rigid is not None else rigid_modes(model)

    def flexibility(block: FloatArray) -> FloatArray:
        u = statics.response_of(rigid.balanced(block), shapes=shapes, forces=forces)
        return np.asfortranarray(rigid.deformation(u))

    size = statics.size + 6 * max(len(statics.interfaces) - 1, 0)
    wanted = truncation.modes
    if wanted is not None and wanted > size:
        raise ReductionError(f"{wanted} free modes were asked for, and the body has {size}; ask for fewer")
    limit = SEARCH_LIMIT if wanted is None else 10 * (wanted + GUARD) + 100
    search = BlockLanczos(flexibility, model.M, start=fields, limit=limit)
    count = count_below(search, truncation) if wanted is None else wanted
    count = find_whole_clusters(search, count, size=size) if count > 0 else 0
    notes = {"free-interface modes": str(count), "completeness": "not counted"}
    if count == 0:
        return Modes(np.zeros(0), np.zeros((model.n_owned, 0), order="F")), notes
    found = search.modes(count)
    if not statics.interfaces:
        return ritz_modes(model, found.shapes, images=images), notes
    rest = np.asfortranarray(found.shapes - static.shapes @ inner(model.comm, frames, found.shapes))
    whole = independent_shapes(model, rest, whole=found.eigenvalues)
    return ritz_modes(model, whole, images=images), notes
