"""The page on bodies that yield: its example runs, and its table of rates is what the forms do."""

import re
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq

import flexmbd.forms

TEXT = (Path(__file__).parents[2] / "docs" / "plasticity.md").read_text()


def test_the_example_runs(capsys):
    (code,) = re.findall(r"```python\n(.*?)```", TEXT, re.DOTALL)
    names = {}
    exec(code, names)
    printed = capsys.readouterr().out
    assert re.fullmatch(r"\{'elastic': [\d.]+, 'plastic': [\d.]+\}\n", printed)
    # of a stretch with nothing across, on 3 cm^3 of copper: the return by a scalar's root
    h, mu, kappa, volume = np.log(1.02), 117e9 / 2.7, 117e9 / 0.9, 3e-6

    def growth(z):
        return 1e8 * (1 - np.exp(-8.0 * z)) + 5e7 * z

    z = brentq(lambda z: 3 * mu * z + 4e8 + growth(z) - 2 * mu * h, 0.0, 1.0, xtol=1e-16)
    elastic = volume * (kappa / 2 * h**2 + (4e8 + growth(z)) ** 2 / (6 * mu))
    plastic = volume * (4e8 * z + quad(growth, 0.0, z)[0])
    assert names["body"].energies() == pytest.approx({"elastic": elastic, "plastic": plastic}, rel=1e-9)


def test_the_table_of_rates():
    rows = re.findall(r"^\| ([\d.]+) \| ([\d.]+) \(([\d.]+)\) \| ([\d.]+) \(([\d.]+)\)", TEXT, re.MULTILINE)
    assert [float(row[0]) for row in rows] == [0.1, 1.0, 2.0, 8.0]
    for row in rows:
        gamma, *told = map(float, row)
        h, length = np.arcsinh(gamma / 2), np.sqrt(4 + gamma**2)
        assert told == pytest.approx([gamma, gamma**2, 4 * h / length, 2 * h * gamma / length], rel=1e-3)


def test_forms_that_it_names_are_there():
    table = [line for line in TEXT.splitlines() if line.startswith("| `")]
    names = [name for line in table for name in re.findall(r"`(\w+)`", line.split(" | ")[0])]
    assert len(names) == 5
    assert all(hasattr(flexmbd.forms, name) for name in names)
