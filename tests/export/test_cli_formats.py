"""Every format by the command line: what `flexmbd export` writes is found again by `flexmbd convert`."""

import json

import pytest
from exported_bodies import soft_bar

from flexmbd.cli import main
from flexmbd.export import FORMATS
from flexmbd.record.reduced_body import ReducedBody


@pytest.mark.parametrize("one", FORMATS, ids=lambda one: one.name)
def test_every_format_by_the_command(tmp_path, monkeypatch, capsys, one):
    """By the name that the command gives the file, among formats of one suffix too."""
    monkeypatch.chdir(tmp_path)
    soft_bar().save("a.h5")
    assert main(["export", "a.h5", "--to", one.name, "--lossy", "--json"]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    found = json.loads(out)
    assert found["file"] == f"a{one.suffix}"
    assert (tmp_path / found["file"]).stat().st_size == found["bytes"] > 0
    assert main(["export", "a.h5", "--to", one.name, "--lossy"]) == 2
    assert "exists; give --force" in capsys.readouterr().err
    if one.read is not None:
        assert main(["convert", found["file"], "back.h5"]) == 0
        assert ReducedBody.load("back.h5").mass == pytest.approx(soft_bar().mass, rel=1e-6)
