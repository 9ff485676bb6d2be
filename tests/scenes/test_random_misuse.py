"""Random machines of right and wrong parts, used in right and wrong ways; by the hour: tools/misuse.py."""

import pytest
from random_misuse.children import tried

SEEDS = 40
#: Machines that once ended otherwise: energies beyond all numbers, inertias so unlike that round-off takes one, motions
#: whose square is no number, a load factor of 101 bits, rows of numbers without dimensions or ragged, and
#: a slide set to the largest double; energies and rows of joints whose squares overflow; masses and stiffnesses of the
#: largest double, a rate that no step follows, friction asked for at rest; strangers with long texts, a time of
#: 101 bits, a table of no rows.
ONCE = (
    12857, 13281, 15015, 15128, 40877, 41260, 41271, 41330, 42199, 42286, 44127, 45480, 46518, 47747, 47820, 70937,
    71665, 71942, 72022, 72170, 200647, 221734, 231686, 234149, 241483, 254179, 254291, 255276, 258960, 301451, 323427,
)  # fmt: skip


GROUP = 12
ALL = (*range(SEEDS), *ONCE)
GROUPS = [ALL[k : k + GROUP] for k in range(0, len(ALL), GROUP)]


@pytest.mark.parametrize("seeds", GROUPS, ids=lambda some: f"{some[0]}")
def test_whatever_is_done_gives_an_answer_or_one_clear_error(seeds):
    """No other exception, text from inside, silent NaN, numpy warning, crash, hang, or gigabytes; in a child."""
    found = tried(seeds)
    wrong = [one for one in found.findings if one.kind != "slow"]  # of which tools/misuse.py tells
    told = [f"{one.kind} at {one.where} (seed {one.seed}): {one.text[:300]}" for one in wrong]
    assert not told, "\n".join(told)
    assert found.seeds == len(seeds)
    assert found.statements > 6 * len(seeds)  # and it did something
    assert found.refused > 0
