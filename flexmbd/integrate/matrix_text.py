"""How a method's matrix is factored, in words, for ``explain``."""

from __future__ import annotations

from flexmbd.integrate.alpha.generalized_alpha import GeneralizedAlpha
from flexmbd.integrate.matrix_choice import alpha_matrix, radau_matrix
from flexmbd.integrate.protocol import Integrator
from flexmbd.integrate.radau.radau_iia import RadauIIA
from flexmbd.multibody.plan.compiled_scene import CompiledScene


def matrix_text(method: Integrator, scene: CompiledScene) -> str:
    """A line on the matrix of generalized-alpha or Radau IIA; nothing of other methods."""
    if isinstance(method, GeneralizedAlpha):
        return f"matrix of a step: {alpha_matrix(scene.plan, dense=scene.interiors is not None).text()}\n"
    if isinstance(method, RadauIIA):
        return f"matrix of a step: {radau_matrix(scene.plan).text()}\n"
    return ""
