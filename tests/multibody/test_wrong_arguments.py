"""Wrong types, shapes and numbers for every parameter of what is public, found by inspection: one clear error each."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import matplotlib as mpl
import pytest
from public_calls import Public, public_calls
from public_examples import left_out, right_call
from public_untried import UNTRIED
from wrong_values import judged, wrong_for

from flexmbd import SceneError
from flexmbd.given import checked

if TYPE_CHECKING:
    from flexmbd.visual import Look

mpl.use("Agg")
#: Rooms whose calls are tried here, those of the root first.
TRIED = ("", "joint", "force", "output", "parameter", "beams", "export")
#: What is not yet right: (place, parameter).
OPEN = {("joint.Gear", "first"), ("joint.Gear", "second")}

PUBLIC = [one for one in public_calls() if one.room in TRIED and not left_out(one) and one.name not in UNTRIED]


@pytest.mark.parametrize("public", PUBLIC, ids=lambda one: one.name)
def test_a_wrong_argument_is_an_answer_or_one_clear_error(public: Public, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    right_call(public)({})
    found = defaultdict(list)
    for name, parameter in public.parameters.items():
        if parameter.kind in (parameter.VAR_POSITIONAL, parameter.VAR_KEYWORD):
            continue
        for value, wrong in wrong_for(parameter.annotation):
            fault = judged(lambda: right_call(public)({name: value}), public.name, name, value, wrong=wrong)  # noqa: B023
            if fault is not None:
                found[public.name, name].append(str(fault))
    still = {place for place in OPEN if place[0] == public.name}
    assert {place: faults for place, faults in found.items() if place not in OPEN} == {}
    assert still <= set(found), "mended: take it off the list of what is open"


def test_all_that_is_public_is_tried_or_listed():
    """A new public name gets a right call in tests/helpers/public_examples.py, or is seen to be without one."""
    here = [one for one in public_calls() if not left_out(one)]
    assert {one.name for one in here} - {one.name for one in PUBLIC} == UNTRIED


def test_what_is_imported_for_type_checkers_alone_is_open():
    @checked()
    def shown(looks: Mapping[str, Look] | None = None, **more: Any) -> Any:
        return looks

    assert shown({"rod": 3}) == {"rod": 3}
    assert shown() is shown(None) is None
    with pytest.raises(SceneError, match="looks must be a mapping of a text to anything or None, got 3"):
        shown(3)
    with pytest.raises(SceneError, match="looks must be a mapping"):
        shown({4: 3})
