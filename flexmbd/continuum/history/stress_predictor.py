"""Stresses as unknowns of their own in Newton's method, for slender bodies that bend a lot.

A step that bends a slender body also stretches it, by the square of the step; with its stiffness against stretching,
larger than that of bending by the square of its slenderness, that is a stress in which the tangent is that of another
body, and Newton's method creeps.  Where the stresses at the points of the rule are unknowns of their own, and
eliminated from the linear equations again, the tangent has in its geometric part the stresses that the step before
predicts, S + (dS/du) step, in the place of those at hand; residual and solution are the same (Magisano, Leonetti &
Garcea 2017, How to improve efficiency and robustness of the Newton method in geometrically non-linear structural
problem discretized via displacement-based finite elements, Computer Methods in Applied Mechanics and Engineering 313).

With S = J F^-1 sigma F^-T of a form's own Cauchy stress, E = (F^T F - 1) / 2 and D the excess of the prediction over S:

    tangent + integral of D : sym(grad du^T grad v),    force + integral of D : (F^T grad v).
"""

from __future__ import annotations

from typing import Any

import numpy as np
import ufl
from dolfinx import fem, la
from numpy.typing import NDArray

from flexmbd.continuum.contract.quadrature import point_element
from flexmbd.continuum.finite_elements import assembly
from flexmbd.continuum.history.point_history import History

FloatArray = NDArray[np.float64]

_DIFFERENCE = 1e-4  # of a step: over how much stresses are differenced; exact of quadratic ones


class PredictedStress:
    """The excess of predicted stresses over those at hand, of one group of cells. Constructing one may compile.

    Attributes:
        tangent: bilinear form, compiled.
        force: linear form, compiled.
    """

    def __init__(self, history: History, u: fem.Function) -> None:
        """No excess yet."""
        group, mesh = history.group, u.function_space.mesh
        form: Any = group.formulation
        f = ufl.Identity(3) + ufl.grad(u)
        back = ufl.inv(f)
        self._second = ufl.det(f) * back * form.stress(u, None, group.symbols) * back.T
        self._history = history
        element = point_element(mesh.topology.cell_name(), history.rule, (3, 3))
        self._excess = fem.Function(fem.functionspace(mesh, element))
        du, v = ufl.TrialFunction(u.function_space), ufl.TestFunction(u.function_space)
        along = ufl.sym(ufl.grad(du).T * ufl.grad(v))
        self.tangent = fem.form(assembly.integral((ufl.inner(self._excess, along), history.rule), group, mesh))
        virtual = ufl.inner(self._excess, f.T * ufl.grad(v))
        self.force = fem.form(assembly.integral((virtual, history.rule), group, mesh))
        self._places = self._excess.function_space.dofmap.list[group.cells]

    def at_hand(self) -> FloatArray:
        """(cells, points, 3, 3) Pa, second Piola-Kirchhoff stress of the trial displacement."""
        return self._history.evaluate(self._second)

    def set_excess(self, excess: FloatArray) -> None:
        """(cells, points, 3, 3) Pa."""
        values = self._excess.x.array.reshape(-1, 9)
        values[self._places] = excess.reshape(*self._places.shape, 9)


def can_be_predicted(history: History) -> bool:
    """Whether a group's stress is a function of its displacement from the initial shape alone."""
    group = history.group
    of_displacement = group.optional.state is None and not group.has_local_unknowns and history.mean is None
    return of_displacement and history.solved is None and group.formulation.REFERENCE == "INITIAL"


class StressPredictor:
    """Predicted stresses of a body, from one of Newton's iterates to the next."""

    def __init__(self, histories: list[History], u: fem.Function) -> None:
        """Of those groups that have a stress of their displacement alone. Collective, may compile."""
        self._u = u
        self._parts = [PredictedStress(history, u) for history in histories if can_be_predicted(history)]
        self._sum = fem.Function(u.function_space).x

    @property
    def tangent_forms(self) -> list[fem.Form]:
        """To be added to the tangent."""
        return [part.tangent for part in self._parts]

    def predict(self, before: FloatArray, after: FloatArray) -> FloatArray:
        """Set the excess of the prediction at one displacement, made at another one. Collective.

        Args:
            before: (local dofs including ghosts,) m, from the initial shape.
            after: the same, of the next iterate; the body stands there afterwards.

        Returns:
            (owned dofs,) N, forces by the excess.
        """
        states = []
        for place in (before - _DIFFERENCE * (after - before), before + _DIFFERENCE * (after - before), before, after):
            self._u.x.array[:] = place
            states.append([part.at_hand() for part in self._parts])
        self._sum.array[:] = 0.0
        for part, low, high, old, new in zip(self._parts, *states, strict=True):
            part.set_excess(old + (high - low) / (2.0 * _DIFFERENCE) - new)
            fem.assemble_vector(self._sum.array, part.force)
        self._sum.scatter_reverse(la.InsertMode.add)
        n = self._u.function_space.dofmap.index_map.size_local * self._u.function_space.dofmap.index_map_bs
        found: FloatArray = self._sum.array[:n].copy()
        return found
