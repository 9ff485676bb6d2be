"""How a method's matrix is factored, in words, for ``explain``."""

from __future__ import annotations

import numpy as np

from flexmbd.integrate.alpha.generalized_alpha import GeneralizedAlpha
from flexmbd.integrate.discrete_gradient.energy_momentum import EnergyMomentum
from flexmbd.integrate.matrix_choice import alpha_matrix, dense_text, momentum_matrix, radau_matrix
from flexmbd.integrate.protocol import Integrator
from flexmbd.integrate.radau.radau_iia import RadauIIA
from flexmbd.multibody.kernels.tangent.diagonal_blocks import unknown_bounds
from flexmbd.multibody.plan.compiled_scene import CompiledScene


def matrix_text(method: Integrator, scene: CompiledScene) -> str:
    """A line on the matrix of an implicit method; nothing of others."""
    if isinstance(method, GeneralizedAlpha):
        return f"matrix of a step: {alpha_matrix(scene.plan, dense=scene.interiors is not None).text()}\n"
    if isinstance(method, RadauIIA):
        return f"matrix of a step: {radau_matrix(scene.plan).text()}\n"
    if isinstance(method, EnergyMomentum):
        choice = momentum_matrix(scene.plan)
        sizes = np.diff(unknown_bounds(choice.side_by_side, 1))
        return f"matrix of a step: {choice.text() if choice.sparse else dense_text(scene.plan, sizes)}\n"
    return ""
