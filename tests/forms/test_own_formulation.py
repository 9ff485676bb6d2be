"""The form file of the demo own_formulation: short, and its material that of a lamina whose fibres wind."""

import ast
from pathlib import Path

import numpy as np
import pytest

from flexmbd import meshes
from flexmbd.continuum import ContinuumModel, Interface
from flexmbd.continuum.contract import formulation
from flexmbd.reduction import craig_bampton

FILE = Path(__file__).parents[2] / "demos" / "own_formulation" / "wound_solid.py"
RADIUS, WALL = 0.02, 0.001


@pytest.fixture(scope="module")
def form():
    return formulation.load_form(FILE)


def test_it_has_sixty_lines():
    """Without blank lines and docstrings."""
    tree = ast.parse(FILE.read_text())
    kinds = (ast.Module, ast.ClassDef, ast.FunctionDef)
    texts = [node.body[0] for node in ast.walk(tree) if isinstance(node, kinds) and ast.get_docstring(node)]
    skipped = {number for text in texts for number in range(text.lineno, text.end_lineno + 1)}
    lines = enumerate(FILE.read_text().splitlines(), 1)
    assert len([line for number, line in lines if line.strip() and number not in skipped]) <= 60


def lamina(form, angle):
    return form.Parameters(E1=1.35e11, E2=9e9, G12=5e9, nu12=0.3, nu23=0.4, rho=1600.0, angle=angle)


def compliance(form, angle, length):
    """(6, 6) motion of a tube's end by forces on it."""
    mesh = meshes.tube(length, RADIUS + WALL / 2, RADIUS - WALL / 2, h=0.02, cell="hexahedron", degree=2)
    ends = [Interface("start"), Interface("end")]
    model = ContinuumModel(mesh, form, lamina(form, angle), degree=2, interfaces=ends)
    body = craig_bampton(model, modes=0, frame="start", geometric_stiffness=False)
    rows = body.interface("end").modes
    return rows @ (rows.T / body.stiffness[:, None])


@pytest.mark.parametrize("angle", [0.0, 0.4, -0.4, 1.2])
def test_a_thin_tube_answers_as_its_lamina(form, angle):
    """Per length, by tubes of two lengths, whose rigid ends do the same.

    The lamina's compliance is turned as a tensor of fourth order, and not by the formulas of the demo.
    """
    p = lamina(form, angle)
    plane = np.zeros((2, 2, 2, 2))
    plane[0, 0, 0, 0], plane[1, 1, 1, 1] = 1 / p.E1, 1 / p.E2
    plane[0, 0, 1, 1] = plane[1, 1, 0, 0] = -p.nu12 / p.E1
    for index in ((0, 1, 0, 1), (0, 1, 1, 0), (1, 0, 0, 1), (1, 0, 1, 0)):
        plane[index] = 1 / (4 * p.G12)
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[c, -s], [s, c]])
    plane = np.einsum("ia,jb,kc,ld,abcd->ijkl", turn, turn, turn, turn, plane) / (2 * np.pi * RADIUS * WALL)
    short, long = 0.25, 0.4
    found = (compliance(form, angle, long) - compliance(form, angle, short)) / (long - short)
    stretch = plane[0, 0, 0, 0]
    assert found[0, 0] == pytest.approx(stretch, rel=5e-3)
    assert found[3, 0] * RADIUS == pytest.approx(2 * plane[0, 1, 0, 0], rel=5e-3, abs=1e-6 * stretch)
    assert found[3, 3] * RADIUS**2 == pytest.approx(4 * plane[0, 1, 0, 1], rel=5e-3)


@pytest.mark.parametrize("values", [{"E1": -1.0}, {"rho": float("nan")}, {"nu23": 1.0}, {"nu12": 4.0}])
def test_values_out_of_range_are_refused(form, values):
    good = {"E1": 1e11, "E2": 1e10, "G12": 5e9, "nu12": 0.3, "nu23": 0.4, "rho": 1600.0, "angle": 0.1}
    with pytest.raises(ValueError, match="must be positive, and 2 nu12"):
        form.Parameters(**{**good, **values})
