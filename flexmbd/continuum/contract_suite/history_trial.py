"""A body of one cell of a form with history, driven by affine maps into the range where it keeps something."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any, cast

import numpy as np

from flexmbd.continuum.contract.entries import is_rate_dependent, optional_entries
from flexmbd.continuum.contract.formulation import Formulation
from flexmbd.continuum.contract_suite.trial import FloatArray
from flexmbd.continuum.contract_suite.trial_mesh import DIMENSION, distorted_mesh, tagged
from flexmbd.continuum.history.nonlinear_model import NonlinearModel

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
        mesh = distorted_mesh(cell, n=1, degree=degree if form.REFERENCE == "UPDATED" else 1)
        self.body = NonlinearModel(tagged(mesh), form, parameters, degree=degree, surfaces={})  # type: ignore[arg-type]
        self.x: FloatArray = self.body.layout.node_x.copy()
        self._rest = self.body.snapshot()

    def restart(self) -> None:
        """Back to rest."""
        self.body.restore(self._rest)

    def to(self, gradient: FloatArray, *, rotation: FloatArray | None = None, noise: float = 0.0) -> FloatArray:
        """The increment to the map R (1 + gradient) of the undeformed cell, m; random displacements on top."""
        moved = self.x + self.x @ gradient.T
        moved += noise * np.random.default_rng(7).uniform(-1, 1, self.x.shape)
        if rotation is not None:
            moved = moved @ rotation.T
        return np.asarray((moved - self.x).ravel() - self.body.displacement)

    def go(self, gradient: FloatArray, **more: Any) -> None:
        """One accepted step."""
        self.body.commit(self.to(gradient, **more), dt=self.dt)

    def force(self) -> FloatArray:
        """Internal forces where the body stands, N, before any time passes."""
        return self.body.force(np.zeros(self.x.size), dt=0.0)

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
        return float(abs(self.body.force(self.to(small * FIRST), dt=0.0)).max() * strain / small)

    @cached_property
    def strain(self) -> float | None:
        """Strain from which on the body does not come back to rest; None up to two percent."""
        strain = _SMALLEST
        while strain <= _LARGEST:
            left = self._left(strain, 1)
            # what comes of adding increments up becomes less with shorter ones, in proportion at least; a history stays
            if left > _ROUND_OFF / strain * self.elastic_force(strain) and self._left(strain, 4) > left / 2:
                return strain
            strain *= 2.0
        return None

    def _left(self, strain: float, steps: int) -> float:
        """The largest force, N, after a way out to a strain and back, each in so many steps."""
        self.restart()
        for share in (*np.linspace(0.0, 1.0, steps + 1)[1:], *np.linspace(1.0, 0.0, steps + 1)[1:]):
            self.body.commit(self.to(share * strain * FIRST), dt=self.dt / steps)
        return float(abs(self.force()).max())


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
