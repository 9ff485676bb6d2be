"""Cantilever of masses on massless beams.

N nodes with the mass in points: relative errors of the lowest three frequencies against Euler's and Bernoulli's beam,
of second order and from below. Hencky's chain of rigid pieces has the same spectrum.
"""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from flexmbd.beams import DiscreteFrame, Lumping, discrete_body
from verification.reference import Computed, Reference, Source, Sureness, numbers

SOURCE = Source("Anthonis & Ramon 2003, Journal of Sound and Vibration 266; errors by an assembly apart")
TABLE = {
    4: (-2.787e-2, -8.823e-2, -0.1377), 8: (-7.118e-3, -2.419e-2, -3.920e-2), 16: (-1.789e-3, -6.181e-3, -1.012e-2),
    32: (-4.479e-4, -1.553e-3, -2.549e-3), 64: (-1.120e-4, -3.889e-4, -6.384e-4),
}  # fmt: skip
REFERENCES = tuple(Reference(f"N = {n}", "", row, 1e-3, Sureness.OWN) for n, row in TABLE.items())
BETA = np.array([1.87510406871, 4.69409113297, 7.85475743824])


def compute() -> Computed:
    """The unit beam without shear, in one plane."""
    unit = SimpleNamespace(
        E=1.0, nu=0.0, rho=1.0, A=1.0, Iy=1.0, Iz=1.0, Iyz=0.0, J=1.0, ky=np.inf, kz=np.inf, orientation=(0.0, 1.0, 0.0)
    )
    points = {"root": (0.0, 0.0, 0.0), "tip": (1.0, 0.0, 0.0)}
    values = []
    for n in TABLE:
        frame = DiscreteFrame(
            points, {"b": [("root", "tip")]}, {"b": unit}, divisions=n, lumping=Lumping.POINTS, coordinates=("y", "rz")
        )
        record = discrete_body(frame, interfaces=["root"], frame="root")
        omega = np.sqrt(record.stiffness[:3])
        values.append(numbers(omega / BETA**2 - 1.0))
    return Computed(tuple(values), mesh="4 to 64 elements")
