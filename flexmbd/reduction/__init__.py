"""Reductions: from a continuum model to a `flexmbd.reduced.ReducedBody`."""

from flexmbd.reduction.condensation import CondensedMatrices as CondensedMatrices
from flexmbd.reduction.condensation import static_condensation as static_condensation
from flexmbd.reduction.craig_bampton import craig_bampton as craig_bampton
from flexmbd.reduction.guyan import guyan as guyan
