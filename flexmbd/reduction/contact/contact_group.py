"""The record's contact patches, and what its provenance says of them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum import parallel
from flexmbd.continuum.matrices.blocks import FloatArray
from flexmbd.record.contact_patches import ContactPatches
from flexmbd.reduction.contact.found_patches import FoundPatches
from flexmbd.reduction.contact.residual_flexibility import ResidualFlexibility


def contact_group(
    patches: FoundPatches, residual: ResidualFlexibility, *, modes: FloatArray, p: FloatArray, R: FloatArray
) -> ContactPatches:
    """The record's group. Collective; the same to the bit on every rank.

    Args:
        patches: of the body.
        residual: what the modes leave out.
        modes: (owned dofs, n) in normal form, in the mesh's axes.
        p: (3,) m, the body frame's origin in the mesh's axes.
        R: (3, 3) rotation from the body frame's axes to the mesh's.
    """
    phi = patches.means(modes).reshape(len(patches.area), 3, modes.shape[1])
    return parallel.on_root(
        patches.model.comm,
        lambda: ContactPatches(
            names=tuple(one.name for one in patches.asked),
            surface=patches.surface,
            x=(patches.x - p) @ R,
            axes=np.einsum("ba,pbc->pac", R, patches.axes),
            area=patches.area,
            phi=phi,
            G=residual.G,
            facet=patches.facet,
            patch=patches.patch,
        ),
    )


def contact_notes(patches: FoundPatches, residual: ResidualFlexibility) -> dict[str, str]:
    """What the provenance says of each surface; not collective."""
    facets = np.bincount(patches.patch, minlength=len(patches.area))
    notes = {"round-off of the contact patches": f"{residual.lost:.1e}"}
    for i, asked in enumerate(patches.asked):
        own = patches.surface == i
        shares = 100.0 * residual.shares[own]
        notes[f"contact {asked.name}"] = (
            f"{asked!r}: {own.sum()} of {_range(patches.area[own], '.3g')} m^2 and {_range(facets[own], 'd')} facets;\n"
            f"of a patch's deflection under its own load, all interfaces fixed, the modes leave out\n"
            f"{_range(shares[:, 0], '.3g')} % along its normal, {_range(shares[:, 1:], '.3g')} % across it"
        )
    return notes


def _range(values: FloatArray | NDArray[np.int64], digits: str) -> str:
    low, high = format(values.min(), digits), format(values.max(), digits)
    return low if low == high else f"{low} to {high}"
