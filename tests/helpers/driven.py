"""A body of one brick or a few whose nodes are all driven by one affine map; (3, 3) maps, from the undeformed body."""

from __future__ import annotations

from typing import Any

import numpy as np
from assembled import cube

from flexmbd.continuum.contract_suite.trial_mesh import tagged
from flexmbd.continuum.history.nonlinear_model import NonlinearModel


class Driven:
    """The body, and what its first point sees."""

    def __init__(
        self,
        form: Any,
        parameters: Any,
        *,
        cell: str = "hexahedron",
        n: int = 1,
        degree: int = 1,
        amplitude: float = 0.0,
        means: bool = True,
    ) -> None:
        mesh = tagged(cube(cell, n=n, degree=degree, amplitude=amplitude))
        self.body = NonlinearModel(mesh, form, parameters, degree=degree, cell_means=means)
        self.x = self.body.layout.node_x.copy()

    def increment(self, stretch: np.ndarray) -> np.ndarray:
        return (self.x @ np.asarray(stretch).T - self.x).ravel() - self.body.displacement

    def go(self, stretch: np.ndarray) -> np.ndarray:
        """One step; the stress at its end."""
        self.body.commit(self.increment(stretch))
        return self.stress

    def pull(self, axial: float) -> np.ndarray:
        """The map with this stretch along x, and those across that leave no stress; not a step yet."""
        d = np.zeros_like(self.x)
        d[:, 1:] = self.x[:, 1:]
        d, across = d.ravel(), 1.0
        for _ in range(30):
            increment = self.increment(np.diag([axial, across, across]))
            slope = self._times(increment, d)
            change = -(d @ self.body.force(increment)) / (d @ slope)
            across += change
            if abs(change) < 1e-15:
                break
        return np.diag([axial, across, across])

    def work(self, begin: float, end: float) -> float:
        """Of the forces on a pull between two stretches, one step; by Gauss' rule of eight points."""
        points, weights = np.polynomial.legendre.leggauss(8)
        d = np.zeros_like(self.x)
        d[:, 0] = self.x[:, 0]
        total = 0.0
        for point, weight in zip(points, weights, strict=True):
            stretch = begin + (end - begin) * (point + 1) / 2
            force = self.body.force(self.increment(self.pull(stretch)))
            total += weight / 2 * (end - begin) * (d.ravel() @ force)
        return float(total)

    def tangent(self, increment: np.ndarray) -> np.ndarray:
        return dense(self.body.tangent(increment))

    def _times(self, increment: np.ndarray, d: np.ndarray) -> np.ndarray:
        matrix = self.body.tangent(increment)
        x, y = matrix.createVecs()
        x.array[:] = d
        matrix.mult(x, y)
        return y.array.copy()

    @property
    def stress(self) -> np.ndarray:
        return self.body.stress()[0][0, 0]

    @property
    def alpha(self) -> float:
        return float(self.body.history()[0][0, 6])


def dense(matrix: Any) -> np.ndarray:
    """A PETSc matrix of one rank."""
    start, columns, values = matrix.getValuesCSR()
    full = np.zeros(matrix.getSize())
    full[np.repeat(np.arange(len(full)), np.diff(start)), columns] = values
    return full


def turn(axis: Any, angle: float) -> np.ndarray:
    """Rotation matrix, by Rodrigues' formula."""
    k = np.asarray(axis, dtype=float) / np.linalg.norm(axis)
    cross = np.cross(np.eye(3), -k)
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
