"""Hypothesis for machines: how many, from which seed, and that they were not all thrown away."""

from __future__ import annotations

import os

import pytest
from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis import strategies as st

SEED = int(os.environ.get("METAMORPHIC_SEED", "20261122"))
FEW, SLICE, SLICES = 30, 100, 10

#: After ten machines hypothesis draws most others by copying parts of one within it, so that they are hardly others.
#: The first of each batch is the simplest.
BATCH = 10

#: METAMORPHIC_SHRINK=yes looks for a smaller machine that fails too, which takes up to five minutes.
SHRINK = os.environ.get("METAMORPHIC_SHRINK") == "yes"
PHASES = [Phase.generate, Phase.shrink] if SHRINK else [Phase.generate]
LONG = pytest.mark.timeout(900)

#: A test that fewer than this share of the machines came through says nothing.
TOLD = 0.8

_parts = [pytest.param(0, id="few", marks=[LONG] if SHRINK else [])]
_parts += [pytest.param(k, id=f"hundred {k}", marks=[LONG, pytest.mark.thousand]) for k in range(1, SLICES + 1)]
few_and_a_thousand = pytest.mark.parametrize("part", _parts)


def many(check, number, part, *, few=FEW):
    """Let ``check(data)`` judge many machines.

    Args:
        check: draws what it needs; may throw a machine away by hypothesis.assume.
        number: of the test, so that each draws others.
        part: 0 for a few, else which hundred of the thousand.
        few: how many those are.
    """
    count = few if part == 0 else SLICE
    first = SEED + 1_000_000 * number + 1000 * part
    judged = sum(_judge_a_batch(check, first + k // BATCH, min(BATCH, count - k)) for k in range(0, count, BATCH))
    assert judged >= TOLD * count, f"only {judged} of {count} machines were judged: the others were thrown away"


def _judge_a_batch(check, number, count):
    """How many of them were judged."""
    judged = 0

    @seed(number)
    @settings(
        max_examples=count,
        database=None,
        deadline=None,
        print_blob=True,
        suppress_health_check=list(HealthCheck),
        phases=PHASES,
    )
    @given(st.data())
    def judge(data):
        nonlocal judged
        check(data)
        judged += 1

    judge()
    return judged
