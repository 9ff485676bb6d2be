"""Wrong types, shapes and numbers for every parameter of what is public, found by inspection: one clear error each.

A new public name fails here until it has a right call in tests/helpers/public_examples.py.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import matplotlib as mpl
import numpy as np
import pytest
from public_calls import Public, public_calls
from public_examples import left_out
from public_trials import faults

import flexmbd as fm
from flexmbd import SceneError
from flexmbd.given import checked

if TYPE_CHECKING:
    from flexmbd.visual import Look

mpl.use("Agg")
#: Rooms of parts on meshes, whose calls tests/continuum tries.
OF_BODIES = ("continuum", "meshes", "reduction")

PUBLIC = [one for one in public_calls() if not left_out(one)]


@pytest.mark.parametrize("public", [one for one in PUBLIC if one.room not in OF_BODIES], ids=lambda one: one.name)
def test_a_wrong_argument_is_an_answer_or_one_clear_error(public: Public, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert faults(public) == {}


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


def test_a_number_given_for_a_real_one_is_a_float():
    """Else kernels were compiled for whole numbers, and one of 101 bits raised from inside."""

    @checked("a")
    def shown(a: float, b: float | None = None, *more: float, c: int | float = 3, d: Any = 1) -> Any:
        return a, b, more, c, d

    found = shown(10**30, np.array(2), 5, c=7, d=8)
    assert found == (1e30, 2.0, (5,), 7, 8)
    assert [type(one) for one in found] == [float, float, tuple, int, int]
    assert shown(np.float32(0.5)) == (0.5, None, (), 3, 1)
    with pytest.raises(SceneError, match="a must be a finite number, got True"):
        shown(True)


def test_a_method_is_named_by_its_object_s_class():
    """Also where the class has inherited it."""
    with pytest.raises(SceneError, match=r"^System\.show: frames must be True or False, got 1$"):
        fm.System().show(frames=1)
