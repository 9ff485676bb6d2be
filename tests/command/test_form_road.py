"""Every form of the package goes the road to a machine that `flexmbd check` tries."""

import pkgutil

import pytest

import flexmbd.forms
from flexmbd.command.form_road import LOADED, REDUCED, road_checks
from flexmbd.continuum import Verdict, load_form

FORMS = [info.name for info in pkgutil.iter_modules(flexmbd.forms.__path__) if info.name[0] != "_"]


@pytest.mark.parametrize("name", FORMS)
def test_it_reduces_or_is_loaded_and_moves(name):
    form = load_form(name)
    found = {line.name: line.verdict for line in road_checks(form)}
    checks = LOADED if "residual" in vars(form) else REDUCED
    # of what is loaded slowly alone nothing moves by itself
    expected = [Verdict.PASS] * len(checks) if name != "beam_exact" else [Verdict.PASS, Verdict.SKIP]
    assert found == dict(zip([check.name for check in checks], expected, strict=True))
