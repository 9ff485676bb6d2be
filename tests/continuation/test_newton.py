"""Newton's method, its search along steps, and strides, on equations whose solutions are known."""

from dataclasses import dataclass

import numpy as np
import pytest

from flexmbd.continuation.line_search import ShareTrial, by_work, searched
from flexmbd.continuation.newton import Correction, NewtonEnd, newton
from flexmbd.continuation.strides import stride_along
from flexmbd.errors import ConvergenceError, SceneError


@dataclass(frozen=True)
class Root:
    """f(x) = 0; steps that are longer than ``longest`` are cut, and searched along by the work of f on them."""

    f: object
    slope: object
    longest: float = np.inf
    searches: bool = False

    def is_solved(self, here, *, close):
        return close

    def correction(self, here):
        step = -self.f(here) / self.slope(here)
        return Correction(step, abs(step), share=min(1.0, self.longest / max(abs(step), 1e-300)))

    def moved(self, here, correction, *, close):
        step = correction.share * correction.change
        if not self.searches or close:
            return here + step

        def trial(share):
            there = here + share * step
            return by_work(there, share, work=self.f(there) * step, before=self.f(here) * step, ratio=0.8)

        return searched(trial, most=20).place


SQUARE = Root(lambda x: x * x - 2.0, lambda x: 2.0 * x)
ARC = Root(np.arctan, lambda x: 1.0 / (1.0 + x * x))


def test_it_ends_one_step_after_a_close_one():
    """x^2 = 2 from 1.5: the errors e -> e^2 / (2 x) are 6e-3, 1.5e-6 (relative: a step of 2e-6), 1.6e-12, ..."""
    found = newton(SQUARE, 1.5, most=20, close=1e-5)
    assert (found.end, found.iterations) == (NewtonEnd.SOLVED, 3)
    assert found.place == pytest.approx(np.sqrt(2.0), rel=1e-11, abs=0.0)
    assert newton(SQUARE, 1.5, most=2, close=1e-5).end is NewtonEnd.MOST


def test_corrections_that_grow_are_given_up_and_a_search_lets_them_converge():
    """arctan from 2: undamped steps overshoot by more and more (|x| > 1.3917 diverges)."""
    lost = newton(ARC, 2.0, most=50, close=1e-9, grows=2.0)
    assert lost.end is NewtonEnd.GROWN
    assert lost.iterations < 5
    found = newton(Root(ARC.f, ARC.slope, searches=True), 2.0, most=50, close=1e-9, grows=2.0)
    assert found.is_solution
    assert abs(found.place) < 1e-15
    cut = newton(Root(ARC.f, ARC.slope, longest=0.5), 20.0, most=50, close=1e-9)
    assert cut.is_solution
    assert cut.iterations > 30


def test_no_number_is_no_solution():
    found = newton(Root(lambda x: np.nan, lambda x: 1.0), 1.0, most=5, close=1e-9)
    assert (found.end, found.place, found.iterations) == (NewtonEnd.GROWN, 1.0, 0)


def test_a_search_takes_the_best_where_none_is_good_and_halves_what_leads_nowhere():
    tried = []

    def trial(share):
        tried.append(share)
        if share > 0.3:
            raise SceneError("nothing there")
        return ShareTrial(share, share, 1.0 + (share - 0.06) ** 2)

    assert searched(trial, most=5, fails=(SceneError,)).place == 0.0625
    assert tried == [1.0, 0.5, 0.25, 0.125, 0.0625]
    with pytest.raises(SceneError, match="nothing there"):
        searched(trial, most=2, fails=(SceneError,))
    with pytest.raises(SceneError, match="nothing there"):
        searched(trial, most=5, fails=(ConvergenceError,))


@pytest.mark.parametrize("before", [-3.0, 1e-20, 7.0])
def test_the_search_of_a_linear_law_ends_where_its_work_vanishes(before):
    """Work that falls to -a of its beginning over the whole step vanishes at 1 / (1 + a) of it, beyond halves."""
    found = searched(lambda s: by_work(s, s, work=before * (1.0 - 4.0 * s), before=before, ratio=0.8), most=9)
    assert found.share == pytest.approx(0.25)


def test_strides_grow_and_are_halved_before_a_wall():
    """A wall at 0.7 that no stride longer than 0.01 passes."""
    went = []

    def attempt(reached, ahead):
        if reached < 0.7 < ahead and ahead - reached > 0.01:
            return None
        went.append((reached, ahead))
        return 2.0

    assert stride_along(attempt, 0.0, 1.0, first=0.125, least=1e-3) == 1.0
    assert [one[0] for one in went[1:]] == [one[1] for one in went[:-1]]
    assert went[0][0] == 0.0
    assert went[-1][1] == 1.0
    went.clear()
    reached = stride_along(attempt, 0.0, 1.0, first=0.125, least=0.02)
    assert 0.7 - 0.04 <= reached < 0.7


def test_no_stride_is_tried_twice():
    tried = []

    def attempt(reached, ahead):
        tried.append(ahead)
        return None

    assert stride_along(attempt, 0.0, 1.0, first=8.0, least=0.2) == 0.0
    assert tried == [1.0, 0.5, 0.25]


def test_a_small_step_does_not_end_it_where_it_leads_nowhere():
    """From the top of x^4 / 4 - x^2 / 2 steps that are turned downhill lead on to a bottom, at 1."""

    class Downhill(Root):
        def correction(self, here):
            slope = self.slope(here)
            step = -self.f(here) / abs(slope) if slope > 0.0 else 0.1
            return Correction(step, 0.0 if slope < 0.0 else abs(step), share=1.0, ends=slope > 0.0)

    found = newton(Downhill(lambda x: x**3 - x, lambda x: 3.0 * x * x - 1.0), 0.0, most=50, close=1e-9)
    assert found.is_solution
    assert found.place == pytest.approx(1.0, abs=1e-15)
