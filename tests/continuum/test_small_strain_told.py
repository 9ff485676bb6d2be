"""Frame indifference is asked of forms of finite strain, and not of a law of the small strain, linear or not."""

import pytest

from flexmbd.continuum import Verdict, load_form
from flexmbd.continuum.contract_suite.checks import frame_indifference
from flexmbd.continuum.contract_suite.outcome import Remark
from flexmbd.continuum.contract_suite.trial import Trial

FORM = """
from flexmbd.forms.solid_linear import *
from flexmbd.forms import solid_linear as _linear
import ufl
CELLS, ORDER, REFERENCE = ("hexahedron",), {1: 2}, "INITIAL"

def strain_energy(u, p):
    ((_, rule),) = _linear.strain_energy(u, p)
    STRAIN
    return [(p.E * (ufl.inner(e, e) / 2 + 50 * ufl.inner(e, e) ** 2), rule)]
"""


def checked(tmp_path, strain):
    path = tmp_path / "law.py"
    path.write_text(FORM.replace("STRAIN", strain))
    return frame_indifference(Trial(load_form(path), "hexahedron", 1))


def test_a_law_of_the_small_strain_is_not_turned_though_it_is_not_linear(tmp_path):
    found = checked(tmp_path, "e = ufl.sym(ufl.grad(u))")
    assert isinstance(found, Remark)
    assert found.verdict is Verdict.SKIP
    assert "small strain alone" in found.text


@pytest.mark.parametrize(
    ("strain", "sound"),
    [
        ("h = ufl.grad(u); e = (h + h.T + h.T * h) / 2", True),
        ("h = ufl.grad(u); e = (h + h.T + h * h) / 2", False),  # a slip: h h for h^T h
    ],
)
def test_what_is_not_of_the_small_strain_is_turned(tmp_path, strain, sound):
    figures = checked(tmp_path, strain)
    assert all(figure.passed for figure in figures) == sound
