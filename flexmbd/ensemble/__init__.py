"""Many runs of one machine with other values: samples, workers, outputs streamed to a file; docs/ensembles.md.

Users enter by `CompiledMachine.ensemble`.
"""

from flexmbd.ensemble.results import Ensemble as Ensemble
from flexmbd.ensemble.results import Failure as Failure
from flexmbd.ensemble.sampled import Sampled as Sampled
from flexmbd.ensemble.variants import VariantOutput as VariantOutput
from flexmbd.room import public_names as _public_names

__all__ = _public_names(globals())
