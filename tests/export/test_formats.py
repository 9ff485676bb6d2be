"""What holds for every format: what is not a reduced body is refused by name, and nothing is written."""

import pytest
from exported_bodies import soft_bar

import flexmbd as fm
from flexmbd.errors import ExportError


@pytest.mark.parametrize("one", fm.export.FORMATS, ids=lambda one: one.name)
@pytest.mark.parametrize("make", [fm.System, lambda: fm.FlexibleBody(soft_bar())], ids=["System", "FlexibleBody"])
def test_only_reduced_bodies_are_written(tmp_path, one, make):
    with pytest.raises(ExportError, match=r"take a ReducedBody, .* not a (System|FlexibleBody); a whole System"):
        one.write(make(), tmp_path / f"body{one.suffix}")
    assert not list(tmp_path.iterdir())
