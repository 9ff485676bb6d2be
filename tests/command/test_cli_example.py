"""`flexmbd example` and `flexmbd completion`: what they write runs, in a shell of its own where it is for one."""

import json
import shutil
import subprocess

import numpy as np
import pytest

from flexmbd.cli import main
from flexmbd.command.examples import EXAMPLES
from flexmbd.command.subcommands import SUBCOMMANDS
from flexmbd.export import FORMATS
from flexmbd.files.result_table import read_table


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("name", EXAMPLES)
def test_examples_run_as_they_are(folder, monkeypatch, capsys, name):
    assert main(["example", name]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    assert "flexmbd simulate scene.toml" in out
    monkeypatch.chdir(folder / name)
    assert main(["simulate", "scene.toml"]) == 0
    for line in EXAMPLES[name].then:
        if line.startswith("flexmbd plot"):
            assert main([word.strip("'") for word in line.split()[1:]]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    table = read_table(folder / name / "scene_results/results.csv")
    assert np.ptp(table.column("t")) > 0.9
    assert len(table.names) > 5


def test_the_ball_bounces_as_it_should(folder, monkeypatch, capsys):
    assert main(["example", "bouncing_ball", "-o", "ball"]) == 0
    capsys.readouterr()
    assert main(["simulate", "ball/scene.toml", "--json"]) == 0
    first, second = (one["t"] for one in json.loads(capsys.readouterr().out)["events"][:2])
    assert first == pytest.approx(np.sqrt(2 * 0.9 / 9.81), abs=1e-8)
    assert second - first == pytest.approx(2 * 0.8 * first, abs=1e-7)


def test_examples_are_listed_and_kept(folder, capsys):
    assert main(["example"]) == 0
    assert [line.split(":")[0] for line in capsys.readouterr().out.splitlines()] == list(EXAMPLES)
    assert main(["example", "slidercrank"]) == 2
    assert "did you mean 'slider_crank'?" in capsys.readouterr().err
    (folder / "four_bar").mkdir()
    (folder / "four_bar/scene.toml").write_text("mine")
    assert main(["example", "four_bar"]) == 2
    assert "four_bar/scene.toml exists; give --force" in capsys.readouterr().err
    assert (folder / "four_bar/scene.toml").read_text() == "mine"
    assert main(["example", "four_bar", "-o", "four_bar/scene.toml"]) == 2
    assert "cannot make the folder" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["simulte"], "there is no subcommand 'simulte'; did you mean 'simulate'?"),
        (["xyz"], "there is no subcommand 'xyz'; there are check, reduce"),
        (["simulate", "a.toml", "--frce"], "unrecognized arguments: --frce; did you mean '--force'?"),
        (["sweep", "a.toml", "--vary", "a=1", "--sample=3", "b"], "unrecognized arguments: b"),
    ],
)
def test_what_was_meant(words, message, capsys):
    with pytest.raises(SystemExit, match="2"):
        main(words)
    assert message in capsys.readouterr().err


def completed(script, words):
    """What bash completes the last of these words to."""
    line = " ".join(word or "''" for word in words)
    ask = f"source {script}\nCOMP_WORDS=({line})\nCOMP_CWORD={len(words) - 1}\n_flexmbd\n"
    ask += 'printf "%s\\n" "${COMPREPLY[@]}"\n'
    done = subprocess.run(["bash", "-c", ask], capture_output=True, text=True, check=True)
    assert done.stderr == ""
    return [line for line in done.stdout.splitlines() if line]


@pytest.mark.skipif(shutil.which("bash") is None, reason="bash is not installed")
def test_bash_completes(folder, capsys):
    assert main(["completion", "bash"]) == 0
    script = folder / "completion.sh"
    script.write_text(capsys.readouterr().out)
    every = [one.name for one in SUBCOMMANDS]
    assert completed(script, ["flexmbd", ""]) == [*every, "--help", "--version"]
    assert completed(script, ["flexmbd", "sim"]) == ["simulate"]
    assert completed(script, ["flexmbd", "sweep", "--va"]) == ["--vary"]
    assert completed(script, ["flexmbd", "export", "--to", "mb"]) == ["mbdyn"]
    assert completed(script, ["flexmbd", "export", "--to", ""]) == [one.name for one in FORMATS]
    assert completed(script, ["flexmbd", "completion", "z"]) == ["zsh"]
    (folder / "scene.toml").write_text("")
    assert completed(script, ["flexmbd", "simulate", "sce"]) == ["scene.toml"]
    assert completed(script, ["flexmbd", "example", "sl"]) == ["slider_crank"]
    assert main(["completion", "zsh"]) == 0
    assert capsys.readouterr().out.startswith("autoload -U +X bashcompinit")
