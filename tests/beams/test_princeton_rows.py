"""The Princeton beam: a strip of aluminium bent and twisted by a dead force across its section, at any angle."""

import dataclasses

import numpy as np
import pytest
from cantilever import Cantilever, rod_tips

from flexmbd.forms import beam_exact, beam_timoshenko

LENGTH, HEIGHT, WIDTH = 0.508, 12.3777e-3, 3.2024e-3  # m, along x, y (stiff), z
STRIP = beam_exact.Parameters.rectangle(71.7e9, 0.31, 2700.0, width=HEIGHT, height=WIDTH, orientation=(0, 1, 0))
FORCES = (8.896, 13.345)  # N

# Tip down along y and along z, m, under either force, by its angle: another program's beam (Obrezkov and others 2022).
TABLE = {
    0: ((0.01071417630, 0.0), (0.01606423724, 0.0)),
    15: ((0.01061328706, 0.04208232124), (0.01645825752, 0.06435812858)),
    30: ((0.01011169630, 0.07939482948), (0.01665873206, 0.117735994)),
    45: ((0.008837226265, 0.108987937), (0.01518618440, 0.156467239)),
    60: ((0.006604665004, 0.129887616), (0.01157837500, 0.181861627)),
    75: ((0.003538889001, 0.142194370), (0.006248967384, 0.196097131)),
    90: ((0.0, 0.146245978), (0.0, 0.200677707)),
}


def torsion_constant(width, height, degree):
    """m^4, of a rectangle: Ritz's, the warping a polynomial of this degree in y and in z on each of its quarters.

    From above. With degree 2 it is that of a section made of four cells of nine nodes.
    """
    points, weights = np.polynomial.legendre.leggauss(degree + 2)
    points, weights = (points + 1) / 2, weights / 2
    powers = np.arange(1, degree + 1)  # the warping is odd in y and in z
    value, slope = points ** powers[:, None], powers[:, None] * points ** (powers[:, None] - 1)
    # in y / (width / 2) and z / (height / 2)
    shape = (degree**2, len(points) ** 2)
    by_y = (slope[:, None, :, None] * value[None, :, None, :]).reshape(shape) / (width / 2)
    by_z = (value[:, None, :, None] * slope[None, :, None, :]).reshape(shape) / (height / 2)
    y, z = (a.ravel() for a in np.meshgrid(points * width / 2, points * height / 2, indexing="ij"))
    w = np.outer(weights, weights).ravel() * width * height / 4
    stiffness, turned = (by_y * w) @ by_y.T + (by_z * w) @ by_z.T, (by_y * z - by_z * y) @ w
    return 4 * (((y**2 + z**2) @ w) - turned @ np.linalg.lstsq(stiffness, turned, rcond=1e-14)[0])


def across(angle):
    """The force's direction: from -y to z, degrees."""
    return np.array([0.0, -np.cos(np.deg2rad(angle)), np.sin(np.deg2rad(angle))])


def tips(p, angle, *, n=16, steps=6, form=beam_exact):
    """(2, 3) m: the tip's displacement under either force, brought up in equal steps with a stop at the first."""
    stop = FORCES[0] / FORCES[1]
    shares = np.unique([*np.arange(1, steps + 1) / steps, stop])
    # one step near the stop suffices
    shares = shares[(abs(shares - stop) > 0.01) | (shares == stop)]
    found = {}
    beam = Cantilever(p, length=LENGTH, n=n, form=form)
    beam.follow(
        [*(FORCES[1] * across(angle)), 0, 0, 0], shares, at=lambda t, u: found.update({round(t, 9): u[:3].copy()})
    )
    return np.array([found[round(stop, 9)], found[1.0]])


FOUR_CELLS = dataclasses.replace(STRIP, J=torsion_constant(HEIGHT, WIDTH, 2))


def test_the_torsion_constant_of_four_cells_is_three_per_cent_too_large():
    """Which is what parts the table's beam from Saint-Venant's; the series is Ritz's limit."""
    assert STRIP.J == pytest.approx(torsion_constant(HEIGHT, WIDTH, 12), rel=1e-8)
    assert FOUR_CELLS.J / STRIP.J == pytest.approx(1.0333, abs=5e-5)


@pytest.mark.parametrize("angle", TABLE)
def test_rows_of_the_table(angle):
    """The form is a rod's to 3e-7 of its bend; both are the table's beam if they twist as a section of four cells."""
    found = tips(FOUR_CELLS, angle)
    rod = rod_tips(FOUR_CELLS, np.outer(FORCES, across(angle)), length=LENGTH)
    assert np.linalg.norm(found - rod, axis=1) == pytest.approx([0, 0], abs=3e-7 * np.linalg.norm(rod[0]))
    table = np.array(TABLE[angle])
    seen = found[:, 1:] * [-1.0, 1.0]
    assert (np.linalg.norm(seen - table, axis=1) < 2.5e-4 * np.linalg.norm(table, axis=1)).all()
    # along y, too, where twist matters
    assert seen[:, 0] == pytest.approx(table[:, 0], rel=4e-4, abs=1e-12)


def test_between_the_planes_the_table_is_not_a_rod_of_that_section():
    """With Saint-Venant's constant it bends as far, and goes one per cent further along y."""
    rod, table = rod_tips(STRIP, np.outer(FORCES, across(75)), length=LENGTH), np.array(TABLE[75])
    assert rod[:, 2] == pytest.approx(table[:, 1], rel=1e-4)
    assert (-rod[:, 1] > 1.005 * table[:, 0]).all()


def test_two_rotations_make_the_same_beam():
    """Bent and twisted in space: by increments, in few steps or many, and by the other form's rotation from rest."""
    exact = tips(STRIP, 45)
    assert tips(STRIP, 45, form=beam_timoshenko) == pytest.approx(exact, rel=2e-6)
    assert tips(STRIP, 45, steps=3) == pytest.approx(exact, rel=2e-6)
