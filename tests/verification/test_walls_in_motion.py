"""Thin walls by central differences, against laws and closed forms; `verification/walls` has longer and finer ones."""

import numpy as np
import pytest

from verification.walls import struck_cylinder, tumbling_plate


def test_a_plate_falls_and_tumbles():
    """Momenta and centre to round-off, which grows as the root of the steps; energy swings, and does not drift."""
    steps = 2000
    found = tumbling_plate.flown(steps)
    round_off = 20 * np.finfo(float).eps * np.sqrt(steps)
    assert [found.linear, found.way] == pytest.approx([1.0, 1.0], abs=round_off)
    assert found.angular == pytest.approx([1.0, 0.0, 0.0], abs=round_off)
    assert np.ptp(found.energy) < 1e-6
    assert found.bent > 5e-3
    assert found.spun > 0.6
    assert found.axes == pytest.approx(found.rigid, abs=1e-3)


def test_a_cylinder_is_struck():
    """Coarser than `verification/walls`: 3 % on 12 x 20 cells, 10 on 12 x 12."""
    times = struck_cylinder.TIMES
    endless = struck_cylinder.pressed((12, 1), 0.1, diaphragm=False)
    exact = struck_cylinder.breathing(times)
    assert endless == pytest.approx(exact, abs=8e-3 * abs(exact).max())
    held = struck_cylinder.pressed((12, 20), struck_cylinder.HALF, diaphragm=True)
    exact = struck_cylinder.waves(times)
    assert held == pytest.approx(exact, abs=4e-2 * abs(exact).max())
    assert abs(exact - struck_cylinder.breathing(times)).max() > 0.5 * abs(exact).max()
