"""Published problems: the quick ones are computed anew, and the page is of what is kept."""

from __future__ import annotations

import json
import re
from types import SimpleNamespace

import pytest

from verification import __main__ as command
from verification import page, results, scripts
from verification.reference import Computed, Reference, Sureness, numbers

KEPT = results.load()


@pytest.mark.parametrize("name", scripts.quick(KEPT))
def test_what_is_published_is_met(name):
    """And what is said to fail does, or it would no longer be said."""
    script = scripts.load(name)
    found = script.compute()
    for reference, ours in zip(script.REFERENCES, found.values, strict=True):
        told = f"{reference.quantity}: {ours}, published {reference.published}"
        assert reference.is_met(ours) == (not reference.fails), told


@pytest.mark.parametrize("name", scripts.names())
def test_a_script_says_what_it_is(name):
    script = scripts.load(name)
    assert re.fullmatch(r"[^\n.]{5,90}\.", (script.__doc__ or "").split("\n\n")[0])
    assert len(scripts.description(name)) > 60
    assert re.fullmatch(r"(10\.\d{4,}/\S+)?", script.SOURCE.doi)
    for reference in script.REFERENCES:
        assert 0.0 < reference.within < 0.05
        assert reference.scale > 0.0
        assert reference.is_met(reference.published)


def test_the_page_is_of_what_is_kept():
    assert page.TARGET.read_text(encoding="utf-8") == page.text(KEPT), (
        "write it anew: ./run python -m verification --page"
    )


@pytest.mark.parametrize(("target", "text"), [(page.README, page.readme), (page.PAPER, page.paper)])
def test_what_is_quoted_is_what_is_kept(target, text):
    assert target.read_text(encoding="utf-8") == text(KEPT), "write it anew: ./run python -m verification --page"


def test_the_sentence_counts_what_is_met():
    met = [
        reference.is_met(ours)
        for name in KEPT
        for reference, ours in zip(scripts.load(name).REFERENCES, KEPT[name].values, strict=True)
    ]
    told = f"Of {len(met)} quantities of {len(KEPT)} problems {sum(met)} are met"
    assert page.headline(KEPT).startswith(told)
    for target in (page.TARGET, page.README, page.PAPER):
        assert told in " ".join(target.read_text(encoding="utf-8").split())


def test_every_script_was_run():
    assert sorted(KEPT) == sorted(scripts.names())
    assert json.loads(results.KEPT.read_text(encoding="utf-8")).keys() == KEPT.keys()


def test_each_number_that_is_not_met_has_a_reason_and_stands_apart():
    last = page.text(KEPT).split("## Not met\n")[1]
    for name in scripts.names():
        for reference, ours in zip(scripts.load(name).REFERENCES, KEPT[name].values, strict=True):
            assert reference.is_met(ours) == (not reference.fails), (name, reference.quantity)
            line = f"- {scripts.title(name)}, {reference.quantity}: "
            assert (line in last) == bool(reference.fails), line


LENGTH = Reference("length", "m", (2.0, 0.0), 1e-3, Sureness.PRIMARY)


def test_differences_are_over_the_largest_component():
    assert LENGTH.difference((2.0, 0.001)) == pytest.approx(5e-4)
    assert LENGTH.difference((1.99, 0.001)) == pytest.approx(-5e-3)
    assert LENGTH.is_met((2.0, 0.001))
    assert not LENGTH.is_met((1.99, 0.0))
    assert not LENGTH.is_met((float("nan"), 0.0))
    with pytest.raises(ValueError, match="'length' has 2 numbers, and 1 were computed"):
        LENGTH.difference((2.0,))


@pytest.mark.parametrize(
    ("second", "seconds", "kept", "time"),
    [
        (2.0005, 1.5, 2.0005, 2.0),  # nothing but what moved by less than a tenth of what is allowed
        (2.0006, 0.6, 2.0005, 0.6),
        (2.0011, 1.5, 2.0011, 2.0),
        (2.0030, 9.0, 2.0030, 2.0),
    ],
)
def test_what_hardly_moved_stays(second, seconds, kept, time):
    first = results.settled(Computed(((2.0005, 0.0),)), None, references=(LENGTH,), seconds=2.0)
    found = Computed(((second, 0.0),), "fine")
    again = results.settled(found, first, references=(LENGTH,), seconds=seconds)
    assert again == results.Result(((kept, 0.0),), "fine", "", time)
    assert results.settled(found, first, references=(LENGTH,), seconds=9.0, new_time=True).seconds == 9.0


def test_a_number_that_is_met_no_longer_does_not_stay():
    first = results.settled(Computed(((2.00199, 0.0),)), None, references=(LENGTH,), seconds=1.0)
    again = results.settled(Computed(((2.00201, 0.0),)), first, references=(LENGTH,), seconds=1.0)
    assert again.values == ((2.00201, 0.0),)


def own(value, *, fails=""):
    """A script that finds one length."""
    reference = Reference("length", "m", (2.0,), 1e-3, Sureness.OWN, fails=fails)
    return SimpleNamespace(REFERENCES=(reference,), compute=lambda: Computed((numbers(value),)))


def broken():
    raise ZeroDivisionError


@pytest.mark.parametrize(
    ("script", "good", "told"),
    [
        (own(2.0), True, "difference 0.0e+00: met"),
        (own(2.1), False, "difference 5.0e-02: NOT MET"),
        (own(2.1, fails="so it is"), True, "not met, as said"),
        (own(2.0, fails="so it was"), False, "MET, though said to fail"),
    ],
)
def test_the_command_tells_and_fails(script, good, told, monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(scripts, "load", lambda name: script)
    monkeypatch.setattr(scripts, "title", lambda name: "A length")
    monkeypatch.setattr(results, "KEPT", tmp_path / "results.json")
    monkeypatch.setattr(results, "save", lambda kept: None)
    kept = {}
    assert command._run("machines.length", kept, new_time=False) == good
    assert told in capsys.readouterr().out
    assert kept["machines.length"].values == script.compute().values


def test_a_script_that_raises_stops_nothing(monkeypatch, capsys):
    script = own(2.0)
    script.compute = broken
    monkeypatch.setattr(scripts, "load", lambda name: script)
    monkeypatch.setattr(scripts, "title", lambda name: "A length")
    kept = {}
    assert not command._run("machines.length", kept, new_time=False)
    assert "ZeroDivisionError" in capsys.readouterr().err
    assert not kept


def test_what_is_no_script_is_refused(capsys):
    with pytest.raises(SystemExit):
        command.main(["machines.andrew"])
    assert "machines.andrew is not there; there are machines.andrews, " in capsys.readouterr().err


def test_the_list_has_names_and_times(capsys):
    assert command.main(["--list", "machines.andrews"]) == 0
    assert re.fullmatch(r"machines\.andrews +\d+\.\d\d s   Andrews' squeezing .*\n", capsys.readouterr().out)
