"""Large elastic deformation: a strip rolled up by a moment, and Cook's membrane of a neo-Hookean solid."""

from itertools import pairwise

import numpy as np
import pytest
from cooks_membrane import raised
from rolled_strip import LENGTH, E, Strip, flexure

from flexmbd.forms import neo_hookean

TURN = 2 * np.pi


def test_a_strip_is_rolled_up_to_a_circle():
    """By the moment that bends a beam to one: length 10, height 1/4. The coarsest goes all the way, from rest.

    With mesh and layers refined the angle is that of the solid bent to a circle, 0.4 % more than the beam's, by the
    square of height over radius; a fifth of it is missed by one quadratic cell over the height. What is left is the
    ends', which stay plane and as high as they were.
    """
    height = 0.25
    moment = TURN / LENGTH * E * height**3 / 12
    kappa, stretch = flexure(
        moment, height=height, stress=lambda a: E / 2 * (a - 1 / a), slope=lambda a: E / 2 * (1 + 1 / a**2)
    )
    angle = kappa * LENGTH
    assert angle == pytest.approx(TURN, rel=5e-3)
    strips = [Strip(n, neo_hookean, height=height, layers=layers) for n, layers in ((12, 1), (24, 1), (48, 1), (48, 2))]
    strips[0].roll(0.1 * moment, steps=5)
    for coarse, fine in pairwise(strips):
        fine.bend(0.1 * moment, fine.guess(coarse), fine.frame)
    first, second, third = np.diff([strip.frame[2] for strip in strips])
    # of fourth order along the strip
    assert first / second > 10
    limit = strips[3].frame[2] + second / 15
    assert 0 < third < 1e-3 * TURN
    assert limit == pytest.approx(angle, rel=2e-4)
    exact = stretch / kappa * np.array([np.sin(angle), 1 - np.cos(angle)])
    assert strips[3].tip == pytest.approx(exact, abs=6e-4 * LENGTH)
    # where the clamped end is
    assert abs(strips[3].tip).max() < 4e-3 * LENGTH


@pytest.mark.parametrize(("n", "middle", "corner"), [(4, 19.151795, 17.470217), (8, 19.272378, 17.573440)])
def test_cooks_membrane_of_a_neo_hookean_solid(n, middle, corner):
    """E = 70, a dead shear load of 6.25 over the end, plane strain: felupe 11.3 on the same meshes, by its own rule.

    Its meshes of 16 and 32 graded cells a side have 17.620 and 17.626 mm at the corner: strain stiffens the panel,
    which by small strain rises by 32.3.
    """
    found = raised(n, neo_hookean, young=70.0, load=100.0, degree=2, held=("z_min", "z_max"))
    assert found == pytest.approx([middle, corner], abs=1e-6)
