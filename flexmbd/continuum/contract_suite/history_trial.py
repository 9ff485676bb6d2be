"""A body of one cell of a form with history, driven by affine maps into the range where it keeps something.

What the unknown holds beside displacements, as a damage or a potential, is solved for at each of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuation.newton import SETTLED, Correction, newton
from flexmbd.continuum.contract.entries import is_layered, is_rate_dependent, optional_entries
from flexmbd.continuum.contract.formulation import Formulation
from flexmbd.continuum.contract_suite.trial import FloatArray
from flexmbd.continuum.contract_suite.trial_mesh import DIMENSION, distorted_mesh, tagged
from flexmbd.continuum.history.nonlinear_model import NonlinearModel
from flexmbd.errors import ConvergenceError

# Corrections of further unknowns at given displacements.
_MOST = 25

# Part of a strain, at which what a way to it has changed is looked for.
_PART = 0.25

# Strains at which it is looked for.
_SMALLEST, _LARGEST = 1e-5, 0.02

# Round-off of a strain, and what a form makes of it.
_ROUND_OFF = 1e3 * float(np.finfo(float).eps)

# A strain by which a body flows in all its points, and another one on top of it.
FIRST = np.array([[1.0, 0.3, -0.2], [0.1, -0.6, 0.4], [-0.3, 0.2, -0.3]])
SECOND = np.array([[0.8, -0.4, 0.1], [0.2, -0.3, 0.5], [0.3, 0.4, -0.5]])


class HistoryTrial:
    """One form with history and one set of parameters, on one distorted cell.

    Attributes:
        form: with `state`.
        parameters: that leave a history at strains of one percent.
        body: at rest between checks, on this rank alone.
        x: (nodes, 3) m, its nodes.
        dt: s, length of a step; 0 where the stress depends on no rates.
    """

    def __init__(self, form: Formulation, cell: str, degree: int, *, parameters: Any) -> None:
        """Not collective; compiles."""
        self.form, self.parameters, self.dt = form, parameters, trial_step(form)
        mesh = distorted_mesh(
            cell, n=1, degree=degree if form.REFERENCE == "UPDATED" else 1, layered=is_layered(form)
        )
        self.body = NonlinearModel(tagged(mesh), form, parameters, degree=degree, surfaces={})  # type: ignore[arg-type]
        self.x: FloatArray = self.body.layout.node_x.copy()
        self._rest = self.body.snapshot()

    def restart(self) -> None:
        """Back to rest."""
        self.body.restore(self._rest)

    @cached_property
    def displaced(self) -> NDArray[np.int32]:
        """(3 nodes,) dofs of the displacement, node by node."""
        return self.body.layout.displacement_dofs.reshape(-1)

    @cached_property
    def further(self) -> NDArray[np.int64]:
        """The other dofs."""
        return np.setdiff1d(np.arange(self.body.layout.n_local), self.displaced)

    def still(self) -> FloatArray:
        """(dofs,) no increment."""
        return np.zeros(self.body.layout.n_local)

    def to(self, gradient: FloatArray, *, rotation: FloatArray | None = None, noise: float = 0.0) -> FloatArray:
        """The increment to the map R (1 + gradient) of the undeformed cell, m; random displacements on top.

        What is no displacement does not change.
        """
        moved = self.x + self.x @ gradient.T
        moved += noise * np.random.default_rng(7).uniform(-1, 1, self.x.shape)
        if rotation is not None:
            moved = moved @ rotation.T
        increment = self.still()
        increment[self.displaced] = (moved - self.x).ravel() - self.body.displacement[self.displaced]
        return increment

    def settled(self, increment: FloatArray, *, dt: float) -> FloatArray:
        """An increment with its displacements, and the further unknowns in balance with them.

        Raises:
            ConvergenceError: Newton's method does not find them.
        """
        if not self.further.size:
            return increment
        found = newton(_FurtherUnknowns(self, dt), increment, most=_MOST, close=SETTLED)
        if not found.is_solution:
            raise ConvergenceError(
                "what the unknown holds beside displacements was not found at given displacements of one cell: "
                f"Newton's method did not converge in {found.iterations} steps"
            )
        return found.place

    def commit(self, increment: FloatArray, *, dt: float) -> None:
        """One accepted step, with the further unknowns in balance."""
        self.body.commit(self.settled(increment, dt=dt), dt=dt)

    def go(self, gradient: FloatArray, **more: Any) -> None:
        """One accepted step to a map of the undeformed cell."""
        self.commit(self.to(gradient, **more), dt=self.dt)

    def force(self, increment: FloatArray | None = None) -> FloatArray:
        """Forces on the displacements after an increment in no time, as it is, N; None: where the body stands."""
        return self.body.force(self.still() if increment is None else increment, dt=0.0)[self.displaced]

    def dense_tangent(self, at: FloatArray, *, dt: float) -> FloatArray:
        """(dofs, dofs)."""
        rows = np.arange(self.body.layout.n_local, dtype=np.int32)
        return np.asarray(self.body.tangent(at, dt=dt).getValues(rows, rows))

    @property
    def history(self) -> FloatArray:
        """(points, components), accepted."""
        return self.body.history()[0].copy()

    @property
    def stress(self) -> FloatArray:
        """(points, 3, 3) Pa, where the body stands."""
        return self.body.stress()[0].reshape(-1, 3, 3)

    def elastic_force(self, strain: float) -> float:
        """Largest force of such a strain from rest, N, were it elastic."""
        self.restart()
        small = 1e-3 * _SMALLEST
        return float(abs(self.force(self.to(small * FIRST))).max() * strain / small)

    @cached_property
    def strain(self) -> float | None:
        """Strain from which on the body does not come back to what it was at rest; None up to two percent."""
        strain = _SMALLEST
        while strain <= _LARGEST:
            left = self._left(strain, 1)
            # what comes of adding increments up becomes less with shorter ones, in proportion at least; a history stays
            if left > _ROUND_OFF / strain * self.elastic_force(strain) and self._left(strain, 4) > left / 2:
                return strain
            strain *= 2.0
        return None

    def _left(self, strain: float, steps: int) -> float:
        """The largest change of a force, N, by a way out to a strain and back, each in so many steps.

        At rest, where what flowed leaves forces, and at a part of the strain, where what is damaged yields more.
        """
        self.restart()
        begun = self._answer(strain)
        for share in (*np.linspace(0.0, 1.0, steps + 1)[1:], *np.linspace(1.0, 0.0, steps + 1)[1:]):
            self.commit(self.to(share * strain * FIRST), dt=self.dt / steps)
        rest, loaded = (after - before for after, before in zip(self._answer(strain), begun, strict=True))
        return float(max(abs(rest).max(), abs(loaded - rest).max()))

    def _answer(self, strain: float) -> tuple[FloatArray, FloatArray]:
        return self.force(), self.force(self.to(_PART * strain * FIRST))


class _FurtherUnknowns:
    """Those of one cell at given displacements, as a problem for Newton's method."""

    def __init__(self, trial: HistoryTrial, dt: float) -> None:
        self._trial, self._dt = trial, dt

    def is_solved(self, here: FloatArray, *, close: bool) -> bool:
        return close

    def correction(self, here: FloatArray) -> Correction[FloatArray]:
        """Sizes are square roots of the work on the tangent's diagonal, whatever the units of an unknown are."""
        trial, rows = self._trial, self._trial.further
        tangent = trial.dense_tangent(here, dt=self._dt)
        d = np.sqrt(abs(np.diag(tangent)))
        d[d == 0.0] = 1.0
        left = trial.body.force(here, dt=self._dt)[rows] / d[rows]
        change = trial.still()
        scaled = (tangent / d[:, None] / d)[np.ix_(rows, rows)]
        change[rows] = np.linalg.lstsq(scaled, -left, rcond=None)[0] / d[rows]
        whole = np.linalg.norm(d * (trial.body.displacement + here + change))
        return Correction(change, float(np.linalg.norm(d * change)), scale=float(whole))

    def moved(self, here: FloatArray, correction: Correction[FloatArray], *, close: bool) -> FloatArray:
        return here + correction.change


def trial_step(form: Formulation) -> float:
    """`reference().dt`, s; 0 where the stress depends on no rates."""
    return float(cast(Any, form.reference()).dt) if is_rate_dependent(form) else 0.0


def keeps_strains(form: Formulation) -> bool:
    """Whether it is a solid with history; what a beam or a shell remembers may be its rotation."""
    return optional_entries(form).state is not None and all(DIMENSION[cell] == 3 for cell in form.CELLS)


def history_place(places: Sequence[tuple[str, int]]) -> tuple[str, int]:
    """The cell and degree on which yielding is tried: of those of the lowest degree the last."""
    lowest = min(degree for _, degree in places)
    return [place for place in places if place[1] == lowest][-1]


def history_trials(form: Formulation, cell: str, degree: int) -> list[HistoryTrial]:
    """One with each material that yields; not collective."""
    return [HistoryTrial(form, cell, degree, parameters=p) for p in yielding_parameters(form)]


def yielding_parameters(form: Formulation) -> list[Any]:
    """`reference().yielding`; where there is none, the parameters of the reference itself."""
    reference = form.reference()
    return list(getattr(reference, "yielding", (reference.parameters,)))
