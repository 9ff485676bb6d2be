"""Six by six matrices among an element's numbers."""

from __future__ import annotations

from flexmbd.multibody.kernels.base.compiling import kernel


@kernel
def _six_dot(data, o, a, b):
    return (
        data[o] * a[0] + data[o + 1] * a[1] + data[o + 2] * a[2]
        + data[o + 3] * b[0] + data[o + 4] * b[1] + data[o + 5] * b[2]
    )


@kernel
def six_times(data, o, a, b):
    """The row-major 6 x 6 matrix data[o:] times (a, b)."""
    return (
        (_six_dot(data, o, a, b), _six_dot(data, o + 6, a, b), _six_dot(data, o + 12, a, b)),
        (_six_dot(data, o + 18, a, b), _six_dot(data, o + 24, a, b), _six_dot(data, o + 30, a, b)),
    )
