"""Paths that close, and those that only pass near where they began, of curves that are known."""

from dataclasses import dataclass

import numpy as np
import pytest

from flexmbd.continuation.follow import follow
from flexmbd.continuation.newton import corrected
from flexmbd.continuation.request import Bounds
from flexmbd.continuation.space import PathDirection
from flexmbd.continuation.station import station

STEP = 0.1


@dataclass(frozen=True, eq=False)
class Place:
    xi: np.ndarray
    factor: float
    iterations: int = 0


class Circle:
    """a^2 + f^2 = 1 and b = 0, as a path space; ``memory`` counts the points that were accepted."""

    width = 1.0

    def __init__(self, *, remembers=False):
        self.remembers, self.accepted = remembers, {}

    def equations(self, x):
        a, b, f = x
        return np.array([a * a + f * f - 1.0, b]), np.array([[2.0 * a, 0.0, 2.0 * f], [0.0, 1.0, 0.0]])

    def product(self, a, b):
        return float(a.xi @ b.xi + a.factor * b.factor)

    def largest(self, a):
        return float(np.abs(np.append(a.xi, a.factor)).max())

    def along_factor(self, sign):
        return PathDirection(np.zeros(2), sign)

    def difference(self, before, after):
        return PathDirection(after.xi - before.xi, after.factor - before.factor)

    def remember_alike(self, one, other):
        return not self.remembers or self.accepted[one] == self.accepted[other]

    def remembered(self, here, factor):
        there = Place(here.xi, factor, here.iterations)
        self.accepted[there] = len(self.accepted)
        return there

    def spectrum(self, here):
        return None

    def tangent(self, here, onwards):
        along = np.linalg.svd(self.equations(np.append(here.xi, here.factor))[1])[2][-1]
        found = PathDirection(along[:2], float(along[2]))
        return found if self.product(found, onwards) > 0.0 else found.times(-1.0)

    def correct(self, start, step, across, *, undetermined=0):
        x = np.append(start.xi, start.factor)

        def iterate(change, iteration, close):
            nonlocal x
            x = x + np.append(change.xi, change.factor)
            if close:
                return Place(x[:2], float(x[2]), iteration)
            lacking, slopes = self.equations(x)
            more = np.linalg.solve(np.vstack([slopes, np.append(across.xi, across.factor)]), np.append(-lacking, 0.0))
            return PathDirection(more[:2], float(more[2]))

        return corrected(self, step, iterate, most=12)


class Helix(Circle):
    """Around that circle, rising by ``rise`` along b each time."""

    def __init__(self, rise):
        super().__init__()
        self.rise = rise

    def equations(self, x):
        a, b, f = x
        turn = 2.0 * np.pi / self.rise
        c, s = np.cos(turn * b), np.sin(turn * b)
        return np.array([a - c, f - s]), np.array([[1.0, turn * s, 0.0], [0.0, -turn * c, 1.0]])


def around(space, *, points=200):
    """The stretches of a path from a = cos 1, f = sin 1 with f growing; no bound lies on it."""
    where = getattr(space, "rise", 0.0) / (2.0 * np.pi)
    first = space.remembered(Place(np.array([np.cos(1.0), where]), float(np.sin(1.0))), float(np.sin(1.0)))
    bounds = Bounds(to=5.0, back_to=-5.0, longest=STEP, points=points)
    return list(follow(space, station(space, first, space.along_factor(1.0)), bounds))


def test_a_circle_is_gone_round_once():
    stretches = around(Circle())
    assert [one.closes for one in stretches] == [False] * (len(stretches) - 1) + [True]
    first, last = stretches[0].before, stretches[-1].after
    assert last.point.factor == first.point.factor
    assert last.point.xi == pytest.approx(first.point.xi, abs=1e-12)
    assert (last.tangent.xi, last.tangent.factor) == (
        pytest.approx(first.tangent.xi, abs=1e-9), pytest.approx(first.tangent.factor, abs=1e-9),
    )  # fmt: skip
    turned = [np.arctan2(one.after.point.factor, one.after.point.xi[0]) for one in stretches]
    assert np.ptp(np.unwrap([1.0, *turned])) == pytest.approx(2.0 * np.pi, abs=1e-12)


@pytest.mark.parametrize("apart", [0.5, 1e-2, 1e-3])
def test_a_path_that_passes_near_where_it_began_goes_on(apart):
    """A helix, whose turns are a part of a step apart."""
    stretches = around(Helix(apart * STEP))
    assert len(stretches) == 199
    assert not any(one.closes for one in stretches)
    ends = [one.after.point for one in stretches]
    b = np.array([one.xi[1] for one in ends])
    assert (np.diff(b) > 0.0).all()
    assert b[-1] > 2.0 * apart * STEP


def test_what_remembers_something_else_has_not_come_back():
    stretches = around(Circle(remembers=True))
    assert len(stretches) == 199
    assert not any(one.closes for one in stretches)
