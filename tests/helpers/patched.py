"""Bodies of particles with contact patches, whose displacements and flexibility are random."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from particles import particle_body
from scipy.spatial.transform import Rotation

import flexmbd as fm
from flexmbd.record.contact_patches import ContactPatches


def patched_body(
    seed: int, *, modes: int, patches: int = 7, softness: float = 1e-3, size: float = 0.3
) -> fm.FlexibleBody:
    """Patches of two surfaces, "one" and "other", somewhere on a ball; ``softness``: m/N of one."""
    rng = np.random.default_rng(seed)
    out = rng.standard_normal((patches, 3))
    out /= np.linalg.norm(out, axis=1)[:, None]
    axes = np.stack([Rotation.align_vectors(n[None], [[1.0, 0.0, 0.0]])[0].as_matrix() for n in out])
    half = rng.standard_normal((3 * patches, 3 * patches)) / np.sqrt(3 * patches)
    G = softness * (half @ half.T + 0.3 * np.eye(3 * patches))
    group = ContactPatches(
        names=("one", "other"), surface=np.arange(patches) % 2, x=size * out, axes=axes,
        area=4.0 * np.pi * size**2 / patches * rng.uniform(0.5, 1.5, patches),
        phi=0.2 * rng.standard_normal((patches, 3, modes)), G=G,
        facet=np.zeros((0, 3), np.int64), patch=np.zeros(0, np.int64),
    )  # fmt: skip
    return fm.FlexibleBody(replace(particle_body(seed, modes=modes).record, contact=group))
