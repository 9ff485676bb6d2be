"""Tests are shared by workers: whole files, the longest first, none where there are few."""

from types import SimpleNamespace

import sharing


def config(*given, capture="fd", collectonly=False):
    options = {"capture": capture, "collectonly": collectonly}
    return SimpleNamespace(args=[str(sharing.TESTS / one) for one in given], getoption=options.__getitem__)


def workers(*given, **options):
    return sharing.number_of_workers(config(*given, **options), cores=2)


def test_files_of_the_table_are_there_and_the_longest_is_first():
    """A file that was renamed is to be renamed there too."""
    known = sharing.read_table()
    assert len(known) > 20
    assert [file for file in known if not (sharing.TESTS / file).is_file()] == []
    assert list(known.values()) == sorted(known.values(), reverse=True)


def test_workers_are_as_many_as_cores_where_there_is_enough_to_do():
    assert workers("") == 2
    assert workers("continuum") == 2
    longest, second, *_ = sharing.read_table()
    assert workers(longest) == workers(f"{longest}::test_one", f"{longest}::test_other") == 0
    assert workers(longest, second) == 2
    assert workers("continuation") == 0
    assert workers("", capture="no") == workers("", collectonly=True) == 0
    assert sharing.number_of_workers(config(""), cores=64) == sharing.MOST_WORKERS
    assert sharing.number_of_workers(config(""), cores=1) == 1
