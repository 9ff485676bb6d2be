"""docs/export.md: its table is what the formats say of themselves, its code runs, its links lead somewhere."""

import re
from pathlib import Path

import numpy as np
import pytest
from exported_bodies import damped_rod, soft_bar

import flexmbd as fm

PAGE = Path(__file__).parents[2] / "docs" / "export.md"


def row(one):
    """A format's line in the table."""

    def said(carried):
        return "yes" if carried else "-"

    capabilities = one.capabilities
    cells = [
        f"`{one.name}`",
        one.suffix,
        one.programs,
        "all" if capabilities.interfaces is None else f"{capabilities.interfaces or '-'}",
        *(said(getattr(capabilities, name)) for name in ("rotations", "nodal_interfaces", "damping", "gyroscopic")),
        *(said(getattr(capabilities, name)) for name in ("ports", "large_motion", "stiffening")),
        *(said(getattr(capabilities, name)) for name in ("floating", "nodes", "stress")),
        *(said(getattr(capabilities, name)) for name in ("unknowns", "nonlinear", "loads", "heat", "contact")),
        "-" if one.read is None else f"{one.digits} digits",
    ]
    return f"| {' | '.join(cells)} |"


def test_the_table_is_what_the_code_says():
    shown = [line for line in PAGE.read_text(encoding="utf-8").splitlines() if line.startswith("| `")]
    assert shown == [row(one) for one in fm.export.FORMATS]


def test_the_code_runs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    damped_rod().save("rod.h5")
    names = {}
    for block in re.findall(r"^```python\n(.*?)^```$", PAGE.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE):
        exec(block, names)
    np.testing.assert_allclose(names["back"].frequencies(), names["rod"].frequencies(), rtol=1e-12)


@pytest.mark.parametrize("page", ["npz", "sid"])
def test_the_code_of_a_format_runs(tmp_path, monkeypatch, page):
    monkeypatch.chdir(tmp_path)
    names = {"rod": soft_bar()}
    text = (PAGE.parent / "export" / f"{page}.md").read_text(encoding="utf-8")
    for block in re.findall(r"^```python\n(.*?)^```$", text, re.DOTALL | re.MULTILINE):
        exec(block, names)
    np.testing.assert_allclose(names["back"].frequencies(), soft_bar().frequencies(), rtol=1e-10)


def test_links_lead_somewhere():
    for page in (PAGE, *sorted((PAGE.parent / "export").glob("*.md"))):
        for link in re.findall(r"\]\(([^)#:]+)\)", page.read_text(encoding="utf-8")):
            assert (page.parent / link).exists(), (page.name, link)
