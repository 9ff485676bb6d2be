"""Every format by the command line: what `flexmbd export` writes is found again by `flexmbd convert`."""

import json
import zipfile

import pytest
from exported_bodies import soft_bar

from flexmbd.cli import main
from flexmbd.export import FORMATS, SidColumns, format_named
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


@pytest.mark.parametrize(
    ("name", "words", "options"),
    [
        ("dmig", ["first=101"], {"first": 101}),
        ("calculix", ["name=ROD", "first=7"], {"name": "ROD", "first": 7}),
        ("openfast", ["interface=x_max", "gravity=9"], {"interface": "x_max", "gravity": 9.0}),
        ("sid", ["columns=by_axis", "nodes=[]"], {"columns": SidColumns.BY_AXIS}),
    ],
)
def test_options_are_those_of_the_writers(tmp_path, monkeypatch, capsys, name, words, options):
    monkeypatch.chdir(tmp_path)
    soft_bar().save("a.h5")
    for folder in "bcd":
        (tmp_path / folder).mkdir()
    given = [word for one in words for word in ("--option", one)]
    assert main(["export", "a.h5", "--to", name, "--lossy", "-o", "b/a", *given]) == 0, capsys.readouterr().err
    format_named(name).write(ReducedBody.load("a.h5"), "c/a", lossy=True, **options)
    format_named(name).write(ReducedBody.load("a.h5"), "d/a", lossy=True)
    assert (tmp_path / "b/a").read_bytes() == (tmp_path / "c/a").read_bytes()
    assert (tmp_path / "b/a").read_bytes() != (tmp_path / "d/a").read_bytes()


def test_a_unit_of_fmi_2_and_a_deck(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    soft_bar().save("a.h5")
    assert main(["export", "a.h5", "--to", "fmu", "--lossy", "--option", "fmi=2"]) == 0
    with zipfile.ZipFile("a.fmu") as unit:
        assert b'fmiVersion="2.0"' in unit.read("modelDescription.xml")
    words = ["export", "a.h5", "--to", "mbdyn", "--lossy", "--deck", "p.mbd", "--option", "end=0.25"]
    assert main(words) == 0, capsys.readouterr().err
    assert "0.25" in (tmp_path / "p.mbd").read_text()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("--to dmig --option frst=1", "dmig has no option 'frst'; did you mean 'first'?"),
        ("--to dmig --option first=one", "option first of dmig must be a whole number, got 'one'"),
        ("--to fmu --option fmi=[1]", "option fmi of fmu must be one of 2, 3 or a whole number, got '[1]'"),
        ("--to sid --option nodes=1", "option nodes of sid must be a list, as [1, 2], each a whole number, got '1'"),
        ("--to npz --option first=1", "npz has no option 'first'; it has none"),
        ("--to npz --option first", "--option takes NAME=VALUE"),
        ("--to npz --deck a.mbd", "there is no deck for npz; there is for mbdyn"),
    ],
)
def test_wrong_options(tmp_path, monkeypatch, capsys, words, message):
    monkeypatch.chdir(tmp_path)
    soft_bar().save("a.h5")
    assert main(["export", "a.h5", *words.split()]) == 2
    assert message in capsys.readouterr().err
