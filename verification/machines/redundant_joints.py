"""What the feet of a row of four-bars bear.

Five rods of 1 m and 1 kg make two windows, hinged by three-dimensional revolute joints of which most constraints are
redundant: single reactions across the plane are not determined. Those of all feet together follow from the motion of
the one degree of freedom, and the loops stay closed.
"""

from __future__ import annotations

import numpy as np

import flexmbd as fm
from verification.machines.n_four_bar import four_bars
from verification.reference import Computed, Reference, Source, Sureness, numbers

SOURCE = Source(
    "IFToMM Technical Committee for Multibody Dynamics, Library of Computational Benchmark Problems, A02 for the "
    "machine; Newton's law for all of its mass"
)
WINDOWS, T_END = 2, 2.0
WEIGHT = (2 * WINDOWS + 1) * 9.81
REFERENCES = (
    Reference("force on all feet in 2 s: error over the weight", "", (0.0,), 1e-6, Sureness.PRIMARY, size=1.0),
    Reference("force across the plane, over the weight", "", (0.0,), 1e-9, Sureness.PRIMARY, size=1.0),
    Reference("gaps of the loops", "m, rad", (0.0,), 1e-10, Sureness.PRIMARY, size=1.0),
)


def exact(angle: np.ndarray) -> np.ndarray:
    """(n, 2) N on the feet, along x and y, by the uprights' angles from the vertical; they begin upright at 1 rad/s."""
    arm = 0.5 * (WINDOWS + 1) + WINDOWS  # kg m, of all mass about the feet
    inertia = (WINDOWS + 1) / 3.0 + WINDOWS
    s, c = np.sin(angle), np.cos(angle)
    square, change = 1.0 + 2.0 * 9.81 * arm / inertia * (1.0 - c), 9.81 * arm / inertia * s
    return np.column_stack([arm * (c * change - s * square), arm * (-s * change - c * square) + WEIGHT])


def compute() -> Computed:
    """One run."""
    scene, corner, feet = four_bars(WINDOWS)
    run = scene.simulate(T_END, rtol=1e-9, integrator=fm.ExplicitRungeKutta(fm.Pair.DORMAND_PRINCE_8))
    total = np.sum(
        [np.einsum("tij,tj->ti", run.rotation(foot.child), run.reaction(foot)[:, :3]) for foot in feet], axis=0
    )
    place = run.position(corner)
    off = total[:, :2] - exact(np.arctan2(place[:, 0], place[:, 1]))
    return Computed(
        (
            numbers(abs(off).max() / WEIGHT), numbers(abs(total[:, 2]).max() / WEIGHT),
            numbers(run.stats.constraint_residual),
        ),
        accuracy="Dormand & Prince 8(5,3), rtol 1e-9",
    )  # fmt: skip
