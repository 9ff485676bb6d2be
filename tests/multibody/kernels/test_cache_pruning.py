"""The cache of kernels is pruned by age of use and by size, once a day."""

import os
import time

import pytest

from flexmbd.multibody.kernels.base import cache_pruning
from flexmbd.multibody.kernels.base.cache_pruning import note_use, prune

DAY = 86400.0


@pytest.fixture
def entries(tmp_path):
    """Of so many days, 1000 bytes each."""
    (tmp_path / "room").mkdir()
    for days in (0, 2, 10, 29, 31, 400):
        path = tmp_path / "room" / f"kernel-{days}.nbc"
        path.write_bytes(b"x" * 1000)
        then = time.time() - days * DAY
        os.utime(path, (then, then))
    return tmp_path


def left(folder):
    return sorted(int(path.stem.partition("-")[2]) for path in folder.glob("room/*"))


def test_what_nobody_used_for_a_month_goes_once_a_day(entries):
    note_use(str(entries / "room" / "kernel-400.nbc"))
    note_use(str(entries / "room" / "kernel-none.nbc"))
    assert prune(entries) == 1
    assert left(entries) == [0, 2, 10, 29, 400]
    then = time.time() - 40.0 * DAY
    os.utime(entries / "room" / "kernel-29.nbc", (then, then))
    assert prune(entries) == 0
    os.utime(entries / cache_pruning._LOOKED, (then, then))
    assert prune(entries) == 1


def test_of_too_much_what_was_used_last_stays(entries, monkeypatch):
    monkeypatch.setattr(cache_pruning, "_MOST", 3500)
    assert prune(entries) == 3
    assert left(entries) == [0, 2, 10]


def test_a_folder_that_cannot_be_written_to_stays(tmp_path):
    assert prune(tmp_path / "nowhere") == 0
