"""The mutants that tools/mutants.py makes can be made: their texts and their tests are there."""

from pathlib import Path

import pytest
from mutants import MUTANTS

REPOSITORY = Path(__file__).resolve().parents[2]


@pytest.mark.parametrize("mutant", MUTANTS, ids=lambda mutant: mutant.name)
def test_its_text_stands_once_in_its_file_and_its_tests_are_there(mutant):
    assert (REPOSITORY / mutant.file).read_text().count(mutant.old) == 1
    assert mutant.old != mutant.new
    assert all((REPOSITORY / tests.split()[0]).is_file() for tests in mutant.tests)


def test_there_are_twenty_in_ten_rooms():
    rooms = {mutant.file.removeprefix("flexmbd/").partition("/")[0] for mutant in MUTANTS}
    assert len(MUTANTS) >= 20
    assert len(rooms) >= 10
