"""Ball and roller on an elastic block that has contact patches (Hertz).

A rigid ball of 1 m is pressed into a block until its contact is 0.12 and 0.24 m in radius, a rigid roller until its
half width is 0.12 m: statics of a reduced body. The block is finite: what its far part gives grows with the force
alone and drops out of two loads. Radius and half width are those of the second moments of the forces, 2/5 a^2 and
1/4 a^2.
"""

from __future__ import annotations

import numpy as np

import flexmbd as fm
from flexmbd.record.pressed_patches import contact_patches
from verification.contact._pressed import (
    FINE,
    MODULUS,
    RADIUS,
    approach_of,
    pressed,
    quarter_block,
    reduced,
    unreduced_approach_of_ball,
)
from verification.reference import Computed, Reference, Source, Sureness, numbers

SOURCE = Source(
    "Hertz 1882, Journal fuer die reine und angewandte Mathematik 92; Johnson 1985, Contact Mechanics, section 4.2"
)
CELLS = 8
SIZES = (FINE / CELLS, 2.0 * FINE / CELLS)  # m, of patches
LOW, HIGH = 0.12, 0.24  # m, radii of the contact
FORCES = tuple(4.0 * MODULUS * a**3 / (3.0 * RADIUS) for a in (LOW, HIGH))
LINE = np.pi * MODULUS * LOW**2 / (4.0 * RADIUS)  # N/m
PEAK, LINE_PEAK = 2.0 * MODULUS * HIGH / (np.pi * RADIUS), 2.0 * LINE / (np.pi * LOW)
REFERENCES = (
    Reference("ball, patches of a/8: approach, without the far part", "m", (LOW**2 / RADIUS,), 0.02, Sureness.PRIMARY),
    Reference("ball: radius of the contact", "m", (HIGH,), 0.01, Sureness.PRIMARY),
    Reference("ball: largest pressure", "Pa", (PEAK,), 0.01, Sureness.PRIMARY),
    Reference("ball: approach over that of the unreduced mesh's nodes", "", (1.0,), 5e-3, Sureness.OWN),
    Reference("ball, patches of a/4: approach over that of a/8", "", (1.0,), 0.02, Sureness.PRIMARY),
    Reference("ball, patches of a/4: largest pressure", "Pa", (PEAK,), 0.02, Sureness.PRIMARY),
    Reference("ball, 0 and 20 modes: approach over that of 5 modes", "", (1.0, 1.0), 1e-8, Sureness.PRIMARY),
    Reference("roller, patches of a/4: half width of the contact", "m", (LOW,), 0.02, Sureness.PRIMARY),
    Reference("roller: largest pressure", "Pa", (LINE_PEAK,), 0.02, Sureness.PRIMARY),
)


def second_moment(body: fm.ReducedBody, approach: float, *, is_ball: bool) -> tuple[float, float]:
    """m^2 and Pa: mean square of the distance from the middle, patches' own extent included; largest pressure."""
    found, patches = pressed(body, approach, is_ball=is_ball), contact_patches(body)
    squares = patches.x[:, 0] ** 2 + (patches.x[:, 1] ** 2 if is_ball else 0.0)
    own = (patches.area / 6.0) if is_ball else SIZES[0] ** 2 / 12.0  # of squares
    return float(found.force @ (squares + own) / found.force.sum()), float(found.pressure.max())


def compute() -> Computed:
    """All of them; a quarter of the ball's block, half of a slice of the roller's."""
    mesh = quarter_block(CELLS)
    fine, coarse = (reduced(mesh, size=size, modes=5) for size in SIZES)
    low, high = (approach_of(fine, force / 4.0, is_ball=True) for force in FORCES)
    # with the far part c: low = dent + c P, high = 4 dent + 8 c P
    dent = (8.0 * low - high) / 4.0
    square, peak = second_moment(fine, high, is_ball=True)
    other = approach_of(coarse, FORCES[1] / 4.0, is_ball=True)
    modes = [
        approach_of(reduced(mesh, size=SIZES[1], modes=modes), FORCES[1] / 4.0, is_ball=True) / other
        for modes in (0, 20)
    ]
    slice_of = reduced(quarter_block(CELLS, through=1), size=SIZES[0], modes=5)
    deep = approach_of(slice_of, 0.5 * LINE * SIZES[0], is_ball=False)
    wide, line_peak = second_moment(slice_of, deep, is_ball=False)
    return Computed(
        (
            numbers(dent), numbers(np.sqrt(2.5 * square)), numbers(peak),
            numbers(high / unreduced_approach_of_ball(mesh, FORCES[1] / 4.0)), numbers(other / high),
            numbers(second_moment(coarse, other, is_ball=True)[1]), numbers(modes),
            numbers(2.0 * np.sqrt(wide)), numbers(line_peak),
        ),
        mesh=f"{CELLS} x {CELLS} bricks of degree 2 and patches under the contact",
    )  # fmt: skip
