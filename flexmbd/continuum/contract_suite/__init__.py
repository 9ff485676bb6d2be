"""The contract of a form file, tried on small meshes; see docs/writing_a_form.md."""

from flexmbd.continuum.contract_suite.check_report import FormReport as FormReport
from flexmbd.continuum.contract_suite.check_report import check_form as check_form
