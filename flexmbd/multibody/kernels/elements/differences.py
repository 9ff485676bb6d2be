"""Steps of differences, for elements whose derivative nobody gives."""

from __future__ import annotations

from flexmbd.multibody.kernels.base.compiling import kernel

_STEP = 6e-6  # share of a variable's size: the cube root of round-off


@kernel
def difference_step(per_x, per_v, size_x, size_v):
    """How far along (per_x, per_v) the larger of the changes is `_STEP` of its size; 0 where there is no direction."""
    share = 0.0
    if per_x != 0.0:
        share = abs(per_x) / size_x
    if per_v != 0.0:
        share = max(share, abs(per_v) / size_v)
    return _STEP / share if share > 0.0 else 0.0

