"""The flexibility of contact patches that the kept modes leave out (MacNeal 1971, doi:10.1016/0045-7949(71)90031-9).

With all interfaces fixed a load S has the static response K^-1 S, of which modes V have V (V^T K V)^-1 V^T S. The rest,
R = K^-1 S - V (V^T K V)^-1 V^T S, moves no interface, has no strain energy in common with the modes, and is the
quasi-static share of all modes that were left out. G = S^T R is symmetric and not negative. A body that nothing holds
responds by inertia relief. Of what the interfaces move the static shapes are exact, so G does not hang on which of them
carries the body frame; modes and G together are the full model's statics, with any number of modes.  As a compliance
between a patch and what it touches G takes the place of a penalty, and has no mass (Monjaraz-Tec, Gross & Krack 2022,
doi:10.1016/j.compstruc.2021.106698).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg

from flexmbd.continuum import parallel
from flexmbd.continuum.matrices.blocks import FloatArray, inner, multiply, symmetric
from flexmbd.continuum.matrices.eigen import Modes
from flexmbd.errors import ReductionError
from flexmbd.reduction.contact.found_patches import FoundPatches
from flexmbd.reduction.modes.ritz import ritz_modes
from flexmbd.reduction.residual_vectors import residual_vectors
from flexmbd.reduction.static_shapes.statics import Statics
from flexmbd.reduction.static_shapes.stiffness_round_off import WORTHLESS

# Columns that are solved for together.
_TOGETHER = 48


@dataclass(frozen=True, eq=False)
class PatchResponses:
    """Static responses to unit loads on contact patches, all interfaces fixed.

    Attributes:
        patches: p of them.
        held: (owned dofs, 3 p) m/N, of each patch's normal and tangents, patch by patch.
    """

    patches: FoundPatches
    held: FloatArray


@dataclass(frozen=True, eq=False)
class ResidualFlexibility:
    """What modes leave out of the flexibility of contact patches, all interfaces fixed; the same on every rank.

    Attributes:
        G: (3 p, 3 p) m/N, symmetric and not negative.
        whole: (3 p,) m/N, the patches' own deflections under their loads.
        lost: what round-off made asymmetric or negative of G, as a share of these.
    """

    G: FloatArray
    whole: FloatArray
    lost: float

    @property
    def shares(self) -> FloatArray:
        """(p, 3) of each patch's own deflection what the modes leave out, by its axes; zero where nothing moves."""
        shares = np.divide(np.diag(self.G), self.whole, out=np.zeros(len(self.whole)), where=self.whole > 0.0)
        return shares.reshape(-1, 3)


def patch_responses(statics: Statics, patches: FoundPatches) -> PatchResponses:
    """Solve for the responses, some columns at a time. Collective."""
    size = 3 * len(patches.area)
    held = np.zeros((statics.model.n_owned, size), order="F")
    for begin in range(0, size, _TOGETHER):
        some = slice(begin, min(begin + _TOGETHER, size))
        held[:, some] = statics.held_response(patches.forces(np.eye(size)[:, some]))
    return PatchResponses(patches, held)


def residual_shapes(statics: Statics, modes: Modes, responses: PatchResponses) -> FloatArray:
    """R (owned dofs, 3 p), m/N, what some modes, all interfaces fixed, leave out of the responses. Collective."""
    model, comm, shapes = statics.model, statics.model.comm, modes.shapes
    # the modes are orthogonal to no more than their tolerance
    K = symmetric(inner(comm, shapes, multiply(model.K, shapes)))
    rest: FloatArray = responses.held - shapes @ np.linalg.solve(K, responses.patches.means(shapes).T)
    return rest


def residual_flexibility(statics: Statics, modes: Modes, responses: PatchResponses) -> ResidualFlexibility:
    """What some modes leave out of the patches' flexibility. Collective.

    Raises:
        ReductionError: on all ranks: round-off of the stiffness leaves no digit of it.
    """
    patches = responses.patches
    rest = patches.means(residual_shapes(statics, modes, responses))
    whole = np.maximum(np.diag(patches.means(responses.held)), 0.0)
    G, lost = parallel.on_root(statics.model.comm, lambda: _not_negative(rest, whole))
    return ResidualFlexibility(G, whole, lost)


def contact_shapes(
    statics: Statics, modes: Modes, responses: PatchResponses, *, exact: int, images: FloatArray
) -> Modes | None:
    """The modes and as many contact shapes as the patches' tolerances ask for, or None where that is none. Collective.

    A contact shape is what the modes leave out of the response to one pattern of loads on the patches. The patterns
    are the eigenvectors of G in the scale of what each patch may leave out, the largest first.

    Args:
        statics: of the body.
        modes: with all interfaces fixed.
        responses: to loads on the patches.
        exact: how many of the modes, at first, are eigenvectors, and so share nothing with contact shapes; the others
            are mixed with these to modes of their span.
        images: (owned dofs, fields) M times the fields of the signs' rule.
    """
    patches, comm = responses.patches, statics.model.comm
    tolerances = np.array([np.inf if one.tol is None else one.tol for one in patches.asked])[patches.surface]
    if not np.isfinite(tolerances).any():
        return None
    residual = residual_flexibility(statics, modes, responses)
    loads = parallel.on_root(comm, lambda: _patterns(residual, np.repeat(tolerances, 3)))
    if loads.shape[1] == 0:
        return None
    added = residual_vectors(statics, modes, forces=patches.forces(loads), held=responses.held @ loads, images=images)
    mixed = ritz_modes(statics.model, np.hstack([modes.shapes[:, exact:], added.shapes]), images=images)
    return Modes(
        np.concatenate([modes.eigenvalues[:exact], mixed.eigenvalues]),
        np.hstack([modes.shapes[:, :exact], mixed.shapes]),
    )


def _patterns(residual: ResidualFlexibility, tolerances: FloatArray) -> FloatArray:
    """(3 p, r) loads, as few as bring each patch's share down to its tolerance where their responses are kept."""
    limit = np.multiply(tolerances, residual.whole, out=np.zeros(len(tolerances)), where=residual.whole > 0.0)
    scale = np.divide(1.0, np.sqrt(limit), out=np.zeros(len(limit)), where=limit > 0.0)
    values, vectors = np.linalg.eigh(scale[:, None] * residual.G * scale)
    values, vectors = values[::-1], vectors[:, ::-1]
    # (3 p, r + 1) of each patch's share, over its tolerance, what the first r leave
    kept = np.cumsum(np.hstack([np.zeros((len(scale), 1)), vectors**2 * values]), axis=1)
    left = (np.diag(residual.G) * scale**2)[:, None] - kept
    fewest = int(np.argmax((left <= 1.0).all(axis=0)))
    patterns: FloatArray = scale[:, None] * vectors[:, :fewest]
    return patterns


def _not_negative(G: FloatArray, whole: FloatArray) -> tuple[FloatArray, float]:
    """G without what round-off made asymmetric or negative of it, and how much that was.

    Raises:
        ReductionError: that is no round-off, or leaves no digit.
    """
    scale = np.where(whole > 0.0, np.sqrt(whole), 1.0)
    relative = G / np.outer(scale, scale)
    values, vectors = scipy.linalg.eigh(symmetric(relative))
    lost = max(float(-values[0]), float(abs(relative - relative.T).max()))
    if not lost <= WORTHLESS:
        raise ReductionError(
            f"double precision cannot resolve the flexibility of the contact patches: round-off is {lost:.1e} of it, "
            f"bound {WORTHLESS:.0e}; the body is very thin or slender beside them, or its mesh has slivers"
        )
    sound = (vectors * np.maximum(values, 0.0)) @ vectors.T
    return symmetric(sound * np.outer(scale, scale)), max(lost, 0.0)
