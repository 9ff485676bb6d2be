"""The CalculiX block: another program's condensed matrices and frequencies (tests/data/calculix_block)."""

from itertools import product
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest
import scipy.linalg
from full_model import FullModel

from flexmbd import meshes
from flexmbd.continuum import ContinuumModel
from flexmbd.forms import solid_linear
from flexmbd.reduction import static_condensation

DATA = Path(__file__).parents[1] / "data" / "calculix_block"

STEEL = solid_linear.Parameters(E=2.1e11, nu=0.3, rho=7850.0)

# As CalculiX prints them, Hz: a frequency and how often it comes.
FREE = [
    (620.6715, 2),
    (1610.433, 1),
    (1668.565, 2),
    (2598.190, 1),
    (3183.976, 2),
    (3260.649, 1),
    (4990.931, 1),
]
CLAMPED = [
    *[(100.0459, 2), (608.5650, 2), (802.7393, 1), (1306.773, 1), (1648.371, 2)],
    *[(2428.061, 1), (3116.942, 1)],
]
CORNERS_FIXED = [
    *[(531.3198, 2), (1431.633, 2), (1585.230, 1), (2039.671, 1), (2717.458, 2)],
    *[(3208.370, 1), (4186.650, 1)],
]
GUYAN = [(776.0067, 2), (1782.345, 1), (2777.088, 2), (3239.261, 1)]


@pytest.fixture(scope="module")
def block():
    mesh = meshes.block(1.0, 0.1, 0.1, divisions=(10, 2, 2), comm=MPI.COMM_WORLD)
    return FullModel(ContinuumModel(mesh, solid_linear, STEEL, degree=1))


@pytest.fixture(scope="module")
def corners(block):
    at_end = abs(block.x[:, 0] - 0.5) > 0.49
    found = np.flatnonzero(at_end & (abs(block.x[:, 1:]) > 0.04).all(axis=1))
    return found[np.lexsort(block.x[found].round(6).T[::-1])]


@pytest.fixture(scope="module")
def condensed(block, corners):
    return static_condensation(block.model, product(corners.tolist(), "xyz"))


def difference(found, name):
    expected = np.loadtxt(DATA / name, delimiter=",")
    return abs(found - expected).max() / abs(expected).max()


@pytest.mark.mpi
def test_condensed_matrices(condensed):
    assert difference(condensed.K, "h8_Kguyan_ccx223.csv") < 1e-9
    assert difference(condensed.M, "h8_Mguyan_from_ccx_matrices.csv") < 1e-9


def assert_as_printed(found, expected):
    """Equal to half a unit of the last of seven printed digits."""
    wanted = np.repeat([f for f, _ in expected], [times for _, times in expected])
    digits = 6 - np.floor(np.log10(wanted))
    assert (abs(found[: len(wanted)] - wanted) <= 0.501 * 10.0**-digits).all()


@pytest.mark.parametrize(
    ("fixed", "expected"),
    [(None, FREE), ("face", CLAMPED), ("corners", CORNERS_FIXED)],
)
def test_frequencies(block, corners, fixed, expected):
    held = np.zeros(len(block.x), dtype=bool)
    if fixed == "face":
        held = block.x[:, 0] < 0.01
    elif fixed == "corners":
        held[corners] = True
    found = block.frequencies(block.bound([])[:, ~np.repeat(held, 3)], 20)
    assert_as_printed(found, expected)


def test_guyan_frequencies(condensed):
    eigenvalues = scipy.linalg.eigh(condensed.K, condensed.M, eigvals_only=True)
    assert abs(eigenvalues[:6]).max() < 1e-8 * eigenvalues[6]
    assert_as_printed(np.sqrt(eigenvalues[6:]) / (2 * np.pi), GUYAN)
