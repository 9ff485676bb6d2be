"""A user's law of a point, compiled with numba behind a C function that looks at what it returns."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from flexmbd.continuum.laws.logarithmic_strain import logarithmic_strain, pulled_back
from flexmbd.multibody.kernels.base.law_function import law_function, law_part


class PointStep(NamedTuple):
    """The arguments of a law for a step at a quadrature point.

    Strains are xx, yy, zz, yz, xz, xy with twice the tensor's shears; stresses are in the same order.

    Attributes:
        strain: (6,) at the step's begin.
        increment: (6,) of the strain in the step.
        stress: (6,) Pa, at the step's begin.
        state: (n,) at the step's begin.
        dt: s, length of the step; 0: no time passes.
    """

    strain: Any
    increment: Any
    stress: Any
    state: Any
    dt: Any


@law_part
def _same_strain(strain):  # type: ignore[no-untyped-def]
    """In place of `logarithmic_strain`."""
    return strain, np.ones(3), np.eye(3)


@law_part
def _same_stress(stress, tangent, squares, vectors):  # type: ignore[no-untyped-def]
    """In place of `pulled_back`."""
    return stress, tangent


def compiled_law(law: Callable[..., Any], *, names: Sequence[str], n: int, logarithmic: bool) -> Any:
    """The C function of `point_law.PointLaw`; its ``address`` is good as long as it lives.

    Args:
        law: (step, p) -> stress, tangent, state, of a `PointStep` and a named tuple of parameters.
        names: of the parameters.
        n: components of the state.
        logarithmic: whether the law is one in logarithmic strain.

    Raises:
        FormulationError: numba cannot compile it, or it does not return three arrays.
    """
    measure, pull_back = (logarithmic_strain, pulled_back) if logarithmic else (_same_strain, _same_stress)
    return law_function(law, step=PointStep, names=names, n=n, measure=measure, pull_back=pull_back)
