"""Every form of the package goes the road to a machine that `flexmbd check` tries."""

import pkgutil

import pytest

import flexmbd.forms
from flexmbd.command.form_road import FULL, REDUCED, road_checks
from flexmbd.continuum import Verdict, load_form

FORMS = [info.name for info in pkgutil.iter_modules(flexmbd.forms.__path__) if info.name[0] != "_"]


# Unknowns that turn with the body: full bodies of them move by implicit steps alone.
TURNING = {"beam_exact", "beam_timoshenko", "plane_stress", "plate_mitc", "solid_micropolar"}


@pytest.mark.parametrize("name", FORMS)
def test_it_goes_as_far_as_its_unknowns_allow(name):
    form = load_form(name)
    found = {line.name: line.verdict for line in road_checks(form)}
    reduced = [] if "residual" in vars(form) else REDUCED
    explicit = Verdict.SKIP if name in TURNING else Verdict.PASS
    expected = [Verdict.PASS] * (len(reduced) + 2) + [explicit]
    assert found == dict(zip([check.name for check in (*reduced, *FULL)], expected, strict=True))
