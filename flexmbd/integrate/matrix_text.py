"""How a method's matrix is factored, in words, for ``explain``."""

from __future__ import annotations

import numpy as np

from flexmbd.integrate.alpha.generalized_alpha import GeneralizedAlpha
from flexmbd.integrate.discrete_gradient.energy_momentum import EnergyMomentum
from flexmbd.integrate.matrix_choice import alpha_matrix, dense_text, radau_matrix
from flexmbd.integrate.protocol import Integrator
from flexmbd.integrate.radau.radau_iia import RadauIIA
from flexmbd.multibody.kernels.tangent.diagonal_blocks import diagonal_blocks, unknown_bounds
from flexmbd.multibody.plan.compiled_scene import CompiledScene


def matrix_text(method: Integrator, scene: CompiledScene) -> str:
    """A line on the matrix of an implicit method; nothing of others."""
    if isinstance(method, GeneralizedAlpha):
        return f"matrix of a step: {alpha_matrix(scene.plan, dense=scene.interiors is not None).text()}\n"
    if isinstance(method, RadauIIA):
        return f"matrix of a step: {radau_matrix(scene.plan).text()}\n"
    if isinstance(method, EnergyMomentum):
        sizes = np.diff(unknown_bounds(diagonal_blocks(scene.plan), 1))
        return f"matrix of a step: {dense_text(scene.plan, sizes)}\n"
    return ""
