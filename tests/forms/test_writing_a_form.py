"""The document on writing a form: its example keeps the contract, and the sheet it shows is the example's."""

import re
from pathlib import Path

import pytest

from flexmbd import meshes
from flexmbd.cli import main
from flexmbd.continuum import ContinuumModel
from flexmbd.continuum.contract import entries, formulation
from flexmbd.continuum.contract import results as contract_results
from flexmbd.continuum.contract import terms as contract_terms
from flexmbd.continuum.contract import violations as contract
from flexmbd.continuum.contract_suite.checks import CHECKS

ROOT = Path(__file__).parents[2]
TEXT = (ROOT / "docs" / "writing_a_form.md").read_text()


def block(language):
    (found,) = re.findall(rf"```{language}\n(.*?)```", TEXT, re.DOTALL)
    return found


@pytest.fixture
def example(tmp_path):
    path = tmp_path / "my_form.py"
    path.write_text(block("python"))
    return path


def without_figures(sheet):
    return re.sub(r"\d[\d.e-]*", "#", sheet)


def test_the_example_keeps_the_contract_and_its_sheet_is_shown(example, capsys):
    assert main(["check", str(example)]) == 0
    printed = capsys.readouterr().out.replace(f"{example.parent}/", "")
    assert without_figures(printed) == without_figures(block("text"))
    assert "FAIL" not in printed


def test_the_example_makes_a_body(example):
    """In tension along x, free across: Young's modulus of Lamé's constants, by one cube of unit size."""
    form = formulation.load_form(example)
    mu, lam = 3.0e9, 4.5e9
    block = meshes.block(1.0, 1.0, 1.0, divisions=(1, 1, 1))
    model = ContinuumModel(block, form, form.Parameters(mu=mu, lam=lam, rho=1000.0), degree=1)
    stretch = model.node_x * [1.0, -lam / (2 * (lam + mu)), -lam / (2 * (lam + mu))]
    u = model.K.createVecRight()
    u.array[:] = stretch.ravel()
    assert u.dot(model.K * u) == pytest.approx(mu * (3 * lam + 2 * mu) / (lam + mu), rel=1e-12)
    u.array[:] = [1.0, 0.0, 0.0] * len(stretch)
    assert u.dot(model.M * u) == pytest.approx(1000.0, rel=1e-12)


def test_every_name_of_the_contract_is_explained():
    names = [*entries.CONSTANTS, *entries.REQUIRED, *entries.OPTIONAL]
    listed = [line.split(" | ")[0] for line in TEXT.splitlines() if line.startswith("| `")]
    assert [name for name in names if not re.search(rf"`{name}[`(]", " ".join(listed))] == []
    assert all(name in TEXT for name in contract.CELLS)


def test_messages_and_files_that_it_names_are_there():
    for part in (contract_terms._ONE_RULE, contract_results._ARITHMETIC):
        assert part[:50] in TEXT
    failing = re.findall(r"FAIL `([a-z ]+)`", TEXT)
    assert len(failing) >= 3
    assert set(failing) <= {check.name for check in CHECKS}
    paths = re.findall(r"`((?:forms|demos|flexmbd)/[\w/]+\.py)`", TEXT)
    assert len(paths) >= 4
    assert [path for path in paths if not (ROOT / path).exists()] == []
