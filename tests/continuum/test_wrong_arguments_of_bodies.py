"""Wrong types, shapes and numbers for every parameter of what is public of parts on meshes: one clear error each."""

from __future__ import annotations

import pytest
from public_calls import Public, public_calls
from public_examples import left_out
from public_trials import faults

ROOMS = ("continuum", "meshes", "reduction")
PUBLIC = [one for one in public_calls() if one.room in ROOMS and not left_out(one)]


@pytest.mark.parametrize("public", PUBLIC, ids=lambda one: one.name)
def test_a_wrong_argument_is_an_answer_or_one_clear_error(public: Public, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert faults(public) == {}
