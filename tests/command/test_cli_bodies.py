"""`flexmbd inspect`, `export` and `convert`: readable, for scripts, and safe with what is there already."""

import json
import os
import subprocess
import sys

import numpy as np
import pytest
from two_crosses_body import two_crosses

import flexmbd as fm
from flexmbd.cli import main
from flexmbd.command.subcommands import SUBCOMMANDS
from flexmbd.export import FORMATS
from flexmbd.record.reduced_body import ReducedBody


@pytest.fixture
def record(tmp_path, monkeypatch):
    """A record in the current folder, in one with blanks and letters of other languages."""
    folder = tmp_path / "zwei Kreuze, größer 十字"
    folder.mkdir()
    monkeypatch.chdir(folder)
    two_crosses().save("a.h5")
    return folder / "a.h5"


def said(capsys):
    out, err = capsys.readouterr()
    assert err == ""
    return json.loads(out)


def refused(capsys, words, message):
    assert main(words) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("flexmbd: ")
    assert err.count("\n") == 1
    assert message in err


def test_inspect_for_scripts(record, capsys):
    body = two_crosses()
    held = body.interfaces[0].name
    assert main(["inspect", "a.h5", "--json", "--clamped", f"{held}:x,y,z"]) == 0
    found = said(capsys)
    assert list(found) == [
        "file", "record_version", "fingerprint", "mass", "com", "inertia", "frame", "p_MB_M", "R_MB", "n_modes",
        "interfaces", "frequencies", "damping_ratios", "partition", "groups", "provenance",
    ]  # fmt: skip
    assert found["file"] == "a.h5"
    assert found["fingerprint"] == body.fingerprint()
    assert found["mass"] == body.mass
    np.testing.assert_array_equal(found["inertia"], body.inertia)
    np.testing.assert_array_equal(found["frequencies"]["free"], body.frequencies())
    np.testing.assert_array_equal(found["frequencies"]["clamped"]["hz"], body.frequencies({held: ("x", "y", "z")}))
    assert [one["name"] for one in found["interfaces"]] == [one.name for one in body.interfaces]
    assert found["groups"]["stress"] is (body.stress is not None)
    ratios = found["damping_ratios"]
    assert list(ratios["held"]) == [one.name for one in body.interfaces]
    assert ratios["held"][body.frame] == pytest.approx(np.diag(body.damping) / 2 / np.sqrt(body.stiffness))
    assert len(ratios["free"]) == body.n_modes


def test_inspect_with_an_interface_clamped(record, capsys):
    body = two_crosses()
    held = body.interfaces[0].name
    assert main(["inspect", "a.h5", "--clamped", held]) == 0
    out, err = capsys.readouterr()
    sheet, _, more = out.partition("\nfrequencies (Hz) with")
    assert (sheet, err) == (body.inspect(), "")
    lines = more.splitlines()
    assert lines[0] == f" {held} clamped"
    expected = [f"{one:.6g}" for one in body.frequencies([held])]
    assert [line.split()[1] for line in lines[1:]] == expected


@pytest.mark.parametrize(
    ("text", "message"), [("top", "'top'"), (":x", "has no name"), ("{held}:u", "no component 'u'")]
)
def test_inspect_refuses_what_cannot_be_clamped(record, capsys, text, message):
    refused(capsys, ["inspect", "a.h5", "--clamped", text.format(held=two_crosses().interfaces[0].name)], message)


def test_export_and_back(record, capsys):
    assert main(["export", "a.h5", "--to", "npz"]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    assert out.splitlines()[0] == "a.npz: written as npz"
    assert fm.export.read_npz("a.npz").fingerprint() == two_crosses().fingerprint()
    assert main(["convert", "a.npz", "b.h5", "--json"]) == 0
    found = said(capsys)
    size = record.with_name("b.h5").stat().st_size
    assert found == {"file": "b.h5", "format": "record", "bytes": size, "left_out": []}
    assert ReducedBody.load("b.h5").fingerprint() == two_crosses().fingerprint()
    assert main(["inspect", "a.npz", "--json"]) == 0
    assert said(capsys)["fingerprint"] == two_crosses().fingerprint()
    assert main(["convert", "b.h5", "c", "--to", "npz"]) == 0
    assert main(["convert", "c", "d", "--from", "npz", "--to", "record", "--lossy"]) == 0
    assert ReducedBody.load("d").fingerprint() == two_crosses().fingerprint()


def test_export_tells_what_the_file_leaves_out(record, capsys):
    expected = fm.export.npz(two_crosses(), "by_hand.npz")
    assert main(["export", "a.h5", "--to", "npz", "-o", "größer.npz", "--json"]) == 0
    found = said(capsys)
    assert found["left_out"] == list(expected)
    assert found["file"] == "größer.npz"


def test_a_file_that_exists_is_kept_without_force(record, capsys):
    for words in (["export", "a.h5", "--to", "npz"], ["convert", "a.h5", "a.npz"]):
        record.with_name("a.npz").write_bytes(b"of great value")
        refused(capsys, words, "a.npz exists; give --force to replace it")
        assert record.with_name("a.npz").read_bytes() == b"of great value"
        assert main([*words, "--force"]) == 0
        capsys.readouterr()
        assert fm.export.read_npz("a.npz").mass == two_crosses().mass


def test_the_source_is_never_replaced(record, capsys):
    refused(capsys, ["convert", "a.h5", "../" + record.parent.name + "/a.h5", "--force"], "is the file to read")
    assert ReducedBody.load("a.h5").fingerprint() == two_crosses().fingerprint()


def test_unknown_formats_are_answered_by_the_list(record, capsys):
    every = ", ".join(one.name for one in FORMATS)
    refused(capsys, ["export", "a.h5", "--to", "stl"], f"there is no format 'stl'; choose from {every}")
    refused(capsys, ["convert", "a.h5", "b.h5", "--from", "stl"], f"there is no format 'stl'; choose from {every}")
    refused(capsys, ["convert", "a.h5", "a.xyz"], f"no format ends in .xyz; name it by --to: record, {every}")
    refused(capsys, ["inspect", "a.xyz"], "that can be read ends in .xyz; name it by --from: record, ")


@pytest.mark.parametrize("words", ["inspect {}", "export {} --to npz -o new.npz", "convert {} new.npz"])
@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("nowhere.h5", None, "No such file"),
        ("nowhere.npz", None, "No such file"),
        ("folder.h5", "folder", "not a regular file"),
        ("folder.npz", "folder", "not a regular file"),
        ("schlecht.h5", b"\x89HDF\r\n\x1a\n" + bytes(600), "is not a flexmbd record"),
        ("cut.h5", "cut", "truncated"),
        ("cut.npz", b"PK\x03\x04", "be read"),
        ("empty.h5", b"", "truncated"),
    ],
)  # fmt: skip
def test_bad_files(record, capsys, words, name, content, message):
    path = record.with_name(name)
    if content == "folder":
        path.mkdir()
    elif content == "cut":
        path.write_bytes(record.read_bytes()[:-9])
    elif content is not None:
        path.write_bytes(content)
    refused(capsys, words.format(name).split(), message)
    assert not record.with_name("new.npz").exists()


def test_a_destination_without_a_folder(record, capsys):
    refused(capsys, ["export", "a.h5", "--to", "npz", "-o", "nowhere/a.npz"], "there is no folder")


@pytest.mark.parametrize("name", [one.name for one in SUBCOMMANDS])
def test_help_has_an_example(name, capsys):
    with pytest.raises(SystemExit, match="0"):
        main([name, "--help"])
    out, err = capsys.readouterr()
    assert err == ""
    assert f"flexmbd {name}" in out.split("positional arguments" if "positional arguments" in out else "options")[1]


def test_version_and_wrong_words(capsys):
    with pytest.raises(SystemExit, match="0"):
        main(["--version"])
    assert capsys.readouterr().out == f"flexmbd {fm.__version__}\n"
    with pytest.raises(SystemExit, match="2"):
        main(["inspekt", "a.h5"])
    assert "inspect" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["größer 十.h5", b"no text \xff.h5"])
def test_names_that_a_terminal_has_no_letters_for(record, name):
    two_crosses().save(os.fsdecode(name))
    words = [sys.executable, "-m", "flexmbd", "inspect", name, "--json"]
    ascii_alone = {**os.environ, "PYTHONIOENCODING": "ascii", "PYTHONUTF8": "0"}
    done = subprocess.run(words, capture_output=True, text=True, env=ascii_alone)
    assert (done.returncode, done.stderr) == (0, "")
    assert '"file": "' in done.stdout


@pytest.mark.parametrize(("lines", "first"), [(1, ""), (100_000, ""), (100_000, "import flexmbd.continuum; ")])
def test_a_broken_pipe_is_silent(record, lines, first):
    """Nobody reads any more, whether the sheet is shorter than what is kept back for a while or longer.

    PETSc, once it is loaded, has nothing to say of it.
    """
    code = f"{first}import sys; from flexmbd.cli import main; "
    code += "from flexmbd.record.reduced_body import ReducedBody as R; "
    code += f"R.inspect = lambda self: 'line\\n' * {lines}; sys.exit(main(['inspect', 'a.h5']))"
    reading, writing = os.pipe()
    os.close(reading)
    buffered = {key: value for key, value in os.environ.items() if key != "PYTHONUNBUFFERED"}
    words = [sys.executable, "-c", code]
    try:
        done = subprocess.run(words, stdout=writing, stderr=subprocess.PIPE, text=True, env=buffered)
    finally:
        os.close(writing)
    assert done.stderr == ""
    assert done.returncode == 141


def test_ctrl_c_is_one_line(record, capsys, monkeypatch):
    def interrupted(_):
        raise KeyboardInterrupt

    monkeypatch.setattr(ReducedBody, "inspect", interrupted)
    assert main(["inspect", "a.h5"]) == 130
    assert capsys.readouterr() == ("", "flexmbd: stopped by Ctrl-C\n")


def test_ranks_other_than_the_first_keep_silent(record):
    """What is not collective runs on rank 0 alone."""
    code = "import sys; from flexmbd.cli import main; sys.exit(main(['export', 'a.h5', '--to', 'npz']))"
    for rank in ("1", "0"):
        words = ["env", f"OMPI_COMM_WORLD_RANK={rank}", sys.executable, "-c", code]
        done = subprocess.run(words, capture_output=True, text=True, check=True)
        assert (done.stdout != "") is (rank == "0")
