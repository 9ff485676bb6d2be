"""The paper and what cites flexmbd: figures, keys and numbers are those that are there, and files agree."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAPER = (ROOT / "paper.md").read_text(encoding="utf-8")
ENTRIES = dict(re.findall(r"@\w+\{(\w+),\n(.*?)\n\}", (ROOT / "paper.bib").read_text(encoding="utf-8"), re.DOTALL))


def test_figures_and_references_are_there():
    figures = re.findall(r"\\label\{(fig:\w+)\}\]\((\S+)\)", PAPER)
    assert len(figures) == 3
    for label, path in figures:
        assert (ROOT / path).exists()
        assert f"\\autoref{{{label}}}" in PAPER
    cited = set(re.findall(r"@(\w+\d{4})", PAPER))
    assert cited == set(ENTRIES)
    for key, entry in ENTRIES.items():
        found = re.search(r"doi = \{(.*?)\}", entry)
        assert found is None or re.fullmatch(r"10\.\d{4,5}/[\w./()-]+", found[1]), key


def test_its_length_is_that_of_a_short_paper():
    body = PAPER.split("---\n", 2)[2].split("# References")[0]
    assert 750 <= len(body.split()) <= 1250


def test_what_cites_flexmbd_agrees():
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    deposit = json.loads((ROOT / ".zenodo.json").read_text(encoding="utf-8"))
    said = dict(re.findall(r'^(title|version|license): "?(.*?)"?$', citation, re.MULTILINE))
    assert said == {key: deposit[key] for key in said}
    assert len(said) == 3
    authors = re.findall(r"^  - name: (.*)$", citation.split("authors:")[1].split("abstract:")[0], re.MULTILINE)
    assert authors == [one["name"] for one in deposit["creators"]]
    assert all(f"- name: {author}" in PAPER for author in authors)


@pytest.mark.parametrize("workflow", sorted((ROOT / ".github" / "workflows").glob("*.yml")), ids=lambda file: file.stem)
def test_workflows_call_what_is_there(workflow):
    text = workflow.read_text(encoding="utf-8")
    for called in re.findall(r"(?:\./run python |\./run pytest |python )((?:(?:tools|demos|tests)/\S+ ?)+)", text):
        for path in called.split():
            assert (ROOT / path).exists(), path
