"""The contract of a form file, tried on small meshes; see docs/writing_a_form.md."""

from flexmbd.continuum.contract_suite.sheet import Sheet as Sheet
from flexmbd.continuum.contract_suite.sheet import check_form as check_form
