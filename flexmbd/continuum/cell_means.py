"""Means over cells, which forms take against volumetric locking."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from dolfinx import fem
from numpy.typing import NDArray

from flexmbd.continuum.history import History

FloatArray = NDArray[np.float64]


class CellMeans:
    """The means of all groups whose formulations have them. Constructing one compiles."""

    def __init__(self, histories: Sequence[History], *, moves: bool) -> None:
        """Collective.

        Args:
            histories: of the groups.
            moves: whether the mesh moves, so that the cells' sizes change.
        """
        self._moves = moves
        self._forms = [
            (history.mean, *map(fem.form, history.mean_forms())) for history in histories if history.mean is not None
        ]
        self._undeformed_sizes: dict[fem.Form, FloatArray] = {}

    def evaluate(self) -> None:
        """For the trial displacement, on the mesh as it stands; not collective."""
        for mean, averaged, measure in self._forms:
            values = np.zeros(len(mean.x.array))
            fem.assemble_vector(values, averaged)
            sizes = self._undeformed_sizes.get(measure)
            if sizes is None:
                sizes = np.zeros(len(values))
                fem.assemble_vector(sizes, measure)
                if not self._moves:
                    self._undeformed_sizes[measure] = sizes
            np.divide(values, sizes, out=mean.x.array, where=sizes != 0.0)
