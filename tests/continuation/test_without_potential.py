"""Critical points of stiffnesses that are not symmetric, given as functions of the factor."""

from dataclasses import dataclass

import numpy as np
import pytest

from flexmbd.continuation.critical import crossings
from flexmbd.continuation.crossing import CriticalKind
from flexmbd.continuation.space import PathDirection
from flexmbd.continuation.station import Stretch, station
from flexmbd.multibody.linear.stability import MotionSpectrum

COUPLING = 0.1


@dataclass(frozen=True)
class Place:
    factor: float
    iterations: int = 1


class Straight:
    """The path xi = 0, whose stiffness at a factor is given."""

    width = 1.0

    def __init__(self, stiffness):
        self.stiffness = stiffness

    def product(self, a, b):
        return float(a.xi @ b.xi + a.factor * b.factor)

    def difference(self, before, after):
        return PathDirection(np.zeros(2), after.factor - before.factor)

    def sized(self, mode):
        return mode / mode[np.argmax(np.abs(mode))]

    def tangent(self, here, onwards):
        return PathDirection(np.zeros(2), 1.0)

    def spectrum(self, here):
        values, shapes = np.linalg.eig(self.stiffness(here.factor).astype(complex))
        order = np.argsort(values.real, kind="stable")
        return MotionSpectrum(values[order], shapes[:, order].real, False, 1e-14)

    def correct(self, start, step, across, *, undetermined=0):
        return Place(start.factor + step.factor)

    def crossings(self, first, last):
        ahead = PathDirection(np.zeros(2), 1.0)
        before, after = (station(self, Place(factor), ahead) for factor in (first, last))
        return crossings(self, Stretch(before, after, ahead.times(last - first), ahead))


def two_springs(factor):
    """Two vibrations, one of which stiffens with the factor, coupled by forces without a potential."""
    return np.array([[1.0 + factor, COUPLING], [-COUPLING, 2.0]])


def test_flutter_begins_and_ends_where_two_eigenvalues_meet():
    """(k_1 - k_2)^2 = (2 c)^2; the modes there are (1, 1) and (1, -1)."""
    begin, end = Straight(two_springs).crossings(0.0, 1.07), Straight(two_springs).crossings(0.93, 2.0)
    for (found,), factor, mode in ((begin, 0.8, (1.0, 1.0)), (end, 1.2, (1.0, -1.0))):
        assert found.kind is CriticalKind.FLUTTER
        assert found.point.factor == pytest.approx(factor, abs=2e-7)
        assert found.mode / found.mode[0] == pytest.approx(mode, abs=2e-3)


def test_eigenvalues_that_pass_zero_together_are_a_bifurcation():
    (found,) = Straight(lambda factor: np.array([[0.3 - factor, 0.2], [0.0, 2.0 * (0.3 - factor)]])).crossings(0.0, 1.0)
    assert found.kind is CriticalKind.BIFURCATION
    assert found.point.factor == pytest.approx(0.3, abs=2e-7)
