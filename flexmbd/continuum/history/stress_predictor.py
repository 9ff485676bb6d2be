"""Stresses as unknowns of their own in Newton's method, for slender bodies that bend a lot.

A step that bends a slender body also stretches it, by the square of the step; with its stiffness against stretching,
larger than that of bending by the square of its slenderness, that is a stress in which the tangent is that of another
body, and Newton's method creeps.  Where the stresses at the points of the rules are unknowns of their own, and
eliminated from the linear equations again, the tangent has in its geometric part the stresses that the step before
predicts, S + (dS/du) step, in the place of those at hand; residual and solution are the same (Magisano, Leonetti &
Garcea 2017, How to improve efficiency and robustness of the Newton method in geometrically non-linear structural
problem discretized via displacement-based finite elements, Computer Methods in Applied Mechanics and Engineering 313).

Virtual work P : grad du is S : dE of E = (F^T F - 1) / 2 with S = F^-1 P, at the points of each of its rules.  Fields
of one cell follow the displacement, S with them, and the geometric part is not theirs.  With D the excess of the
prediction over S

    tangent + integral of D : sym(grad du^T grad v),    force + integral of D : (F^T grad v).

S is symmetric where the body's stress turns with it; where it is not along a step, as of small strain, there is no
geometric part.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import ufl
from dolfinx import fem, la
from numpy.typing import NDArray

from flexmbd.continuum.contract.formulation import IntegralTerm
from flexmbd.continuum.contract.quadrature import point_element, points_and_weights
from flexmbd.continuum.finite_elements import assembly
from flexmbd.continuum.history.point_history import History
from flexmbd.round_off import SEVEN_DIGITS

FloatArray = NDArray[np.float64]

_DIFFERENCE = 0.01  # of a step: over how much stresses are differenced; exact of quadratic ones


class PredictedStress:
    """The excess of predicted stresses over those at hand, of one group's terms of one rule. Constructing may compile.

    Attributes:
        tangent: bilinear form, compiled.
        force: linear form, compiled.
    """

    def __init__(self, history: History, terms: Sequence[IntegralTerm], u: fem.Function) -> None:
        """No excess yet.

        Args:
            history: of the group.
            terms: of its virtual work, whose rule is the same.
            u: the displacement.
        """
        group, mesh, rule = history.group, u.function_space.mesh, terms[0][1]
        cell = mesh.topology.cell_name()
        points, _ = points_and_weights(cell, rule)
        first = _first_stress(sum(density for density, _ in terms), history)
        n = mesh.geometry.dim
        gradient = ufl.as_matrix([[ufl.grad(history.unknown)[i, j] for j in range(n)] for i in range(n)])
        self._pair = fem.Expression(ufl.as_tensor([first, gradient]), points)
        self._mesh, self._cells, self._fill = mesh, group.cells, history.fill_unknown
        self._shape = (len(group.cells), len(points), 2, n, n)
        self._excess = fem.Function(fem.functionspace(mesh, point_element(cell, rule, (n, n))))
        du, v = ufl.TrialFunction(u.function_space), ufl.TestFunction(u.function_space)
        along = ufl.sym(ufl.grad(du).T * ufl.grad(v))
        self.tangent = fem.form(assembly.integral((ufl.inner(self._excess, along), rule), group, mesh))
        virtual = ufl.inner(self._excess, (ufl.Identity(n) + ufl.grad(u)).T * ufl.grad(v))
        self.force = fem.form(assembly.integral((virtual, rule), group, mesh))
        self._places = self._excess.function_space.dofmap.list[group.cells]

    def at_hand(self) -> FloatArray:
        """(cells, points, 3, 3) Pa, F^-1 P of what was evaluated last."""
        self._fill()
        first, h = np.moveaxis(self._pair.eval(self._mesh, self._cells).reshape(self._shape), 2, 0)
        return np.linalg.solve(np.eye(h.shape[-1]) + h, first)

    def set_excess(self, excess: FloatArray) -> None:
        """(cells, points, 3, 3) Pa."""
        n = excess.shape[-1]
        values = self._excess.x.array.reshape(-1, n * n)
        values[self._places] = excess.reshape(*self._places.shape, n * n)


def can_be_predicted(history: History) -> bool:
    """Whether a group's stress is a function of its displacement from the initial shape alone."""
    group = history.group
    of_displacement = group.optional.state is None and not group.has_local_unknowns and history.mean is None
    return of_displacement and group.formulation.REFERENCE == "INITIAL"


class StressPredictor:
    """Predicted stresses of a body, from one of Newton's iterates to the next."""

    def __init__(self, histories: list[History], u: fem.Function, evaluate: Callable[[FloatArray], None]) -> None:
        """Of those groups that have a stress of their displacement alone. Collective, may compile.

        Args:
            histories: of the body's groups.
            u: the displacement on trial.
            evaluate: brings the body to an increment (local dofs including ghosts,), with what follows it.
        """
        self._u, self._evaluate = u, evaluate
        self._parts = [
            PredictedStress(history, terms, u)
            for history in histories if can_be_predicted(history) for terms in _by_rule(history.work)
        ]  # fmt: skip
        self._sum = fem.Function(u.function_space).x

    @property
    def tangent_forms(self) -> list[fem.Form]:
        """To be added to the tangent."""
        return [part.tangent for part in self._parts]

    def predict(self, before: FloatArray, after: FloatArray) -> FloatArray:
        """Set the excess of the prediction at one increment, made at another one. Collective.

        Args:
            before: (local dofs including ghosts,) m, since the last accepted step.
            after: the same, of the next iterate; the body stands there afterwards.

        Returns:
            (owned dofs,) N, forces by the excess.
        """
        states = []
        for place in (before - _DIFFERENCE * (after - before), before + _DIFFERENCE * (after - before), after):
            self._evaluate(place)
            states.append([part.at_hand() for part in self._parts])
        self._sum.array[:] = 0.0
        turns = self._turn(states)
        for part, turn, low, high, new in zip(self._parts, turns, *states, strict=True):
            part.set_excess(_linear(low, high, new) - new if turn else np.zeros_like(new))
            fem.assemble_vector(self._sum.array, part.force)
        self._sum.scatter_reverse(la.InsertMode.add)
        n = self._u.function_space.dofmap.index_map.size_local * self._u.function_space.dofmap.index_map_bs
        found: FloatArray = self._sum.array[:n].copy()
        return found

    def _turn(self, states: Sequence[Sequence[FloatArray]]) -> NDArray[np.bool_]:
        """(parts,) whether stresses turn with the body, by all states of a step, the small ones with them. Collective.

        ``states``: of each part S, (cells, points, 3, 3) Pa.
        """
        sums = np.array([[((s - s.swapaxes(-1, -2)) ** 2).sum(), (s**2).sum()] for state in states for s in state])
        every = self._u.function_space.mesh.comm.allreduce(sums.reshape(len(states), -1, 2).sum(axis=0))
        return np.asarray(every[:, 0] <= SEVEN_DIGITS**2 * every[:, 1])


def _linear(low: FloatArray, high: FloatArray, new: FloatArray) -> FloatArray:
    """The first two terms S + S' of a quadratic S + S' x + S'' x^2 / 2 by its values at -d, d and 1."""
    middle, slope = 0.5 * (low + high), (high - low) / (2.0 * _DIFFERENCE)
    curved = (new - slope - middle) / (1.0 - _DIFFERENCE**2)
    return np.asarray(middle - _DIFFERENCE**2 * curved + slope)


def _by_rule(terms: Sequence[IntegralTerm]) -> list[list[IntegralTerm]]:
    """Terms whose rules are the same."""
    found: dict[tuple[int, str], list[IntegralTerm]] = {}
    for term in terms:
        found.setdefault((term[1].degree, term[1].scheme), []).append(term)
    return list(found.values())


def _first_stress(work: ufl.core.expr.Expr, history: History) -> ufl.core.expr.Expr:
    """P of virtual work P : grad v + ... of the displacement's variation v, Pa."""
    v, expanded = history.variation, ufl.algorithms.expand_derivatives(work)
    n = v.ufl_function_space().mesh.geometry.dim
    rows = int(np.prod(v.ufl_shape))

    def part(i: int, j: int) -> ufl.core.expr.Expr:
        unit = ufl.as_matrix([[1.0 if (k, m) == (i, j) else 0.0 for m in range(n)] for k in range(rows)])
        return ufl.replace(expanded, {ufl.grad(v): unit, v: ufl.zero(v.ufl_shape)})

    return ufl.as_matrix([[part(i, j) for j in range(n)] for i in range(n)])
