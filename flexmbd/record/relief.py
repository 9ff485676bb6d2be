"""How much strain energy the shapes that a body has not would relieve: what shows that it locks.

In a state q that its load holds, the forces along the further shapes are r. Newton's step of all coordinates from there
on, of the stiffness T(q, 0), would give the energy [0, r]^T T^-1 [0, r] / 2 away. A body that locks against a load
barely moves under it and stores little; it is the condensed stiffness of the shapes that is small then.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import scipy.linalg

from flexmbd.record.groups import FloatArray, IntArray, NonlinearStiffness
from flexmbd.record.strain_polynomial import StrainPolynomial, monomials, places

# Products of coordinates at once: 8 MB.
_CHUNK = 2**20
# Of the strain energy, what the forces along a shape would relieve of it with the stiffness at rest: less is not looked
# at. It is a relief of a hundredth in a direction in which the body is a million times too stiff.
_SMALL = 1e-8
# By which factor these grow until a state is looked at again.
_GROWN = 1.2
# Of the largest eigenvalue of a stiffness: what round-off leaves.
_ROUND_OFF = 1e-13


@dataclass(eq=False)
class Relief:
    """The energy that further shapes would relieve; looks at the states in which their forces are larger than before.

    Attributes:
        stiffness: (n,) of the body.
        nonlinear: its group.
    """

    stiffness: FloatArray
    nonlinear: NonlinearStiffness
    _seen: FloatArray = field(init=False)
    _polynomial: StrainPolynomial = field(init=False)
    _products: tuple[IntArray, IntArray] = field(init=False)
    _by_products: tuple[FloatArray, FloatArray] = field(init=False)

    def __post_init__(self) -> None:
        own, group = len(self.stiffness), self.nonlinear
        count = len(group.relief_stiffness)
        self._seen = np.full(count, _SMALL)
        every = np.concatenate([self.stiffness, group.relief_stiffness])
        self._polynomial = StrainPolynomial(every, group.relief_cubic, group.relief_quartic)
        self._products = monomials(own, 2), monomials(own, 3)
        # the terms that are linear in one of the shapes
        self._by_products = _linear(group.relief_cubic, self._products[0], own=own, count=count), _linear(
            group.relief_quartic, self._products[1], own=own, count=count
        )

    def first(self, q: FloatArray, energy: FloatArray) -> tuple[int, float] | None:
        """The first of the states q (k, n), of strain energies (k,) J, in which more than the share would be relieved.

        Returns:
            Its number, and the share; None: there is none.
        """
        if len(self._seen) == 0:
            return None
        at_rest, row = 0.5 * self._forces(q) ** 2 / self.nonlinear.relief_stiffness, 0
        while True:
            larger = np.flatnonzero((at_rest[row:] > self._seen * energy[row:, None]).any(axis=1))
            if len(larger) == 0:
                return None
            row += int(larger[0])
            share = self.energy(q[row]) / float(energy[row])
            if share > float(self.nonlinear.relief_share[0]):
                return row, share
            self._seen = np.maximum(self._seen, _GROWN * at_rest[row] / energy[row])
            row += 1

    def energy(self, q: FloatArray) -> float:
        """J in the state q (n,)."""
        n = len(self.stiffness)
        state = np.concatenate([q, np.zeros(len(self._seen))])
        force = self._polynomial.force(state)
        force[:n] = 0.0
        scale = 1.0 / np.sqrt(self._polynomial.stiffness)
        values, vectors = scipy.linalg.eigh(self._polynomial.tangent(state) * np.outer(scale, scale))
        part = vectors.T @ (scale * force)
        return float(0.5 * np.sum(part**2 / np.maximum(np.abs(values), _ROUND_OFF * np.abs(values).max())))

    def _forces(self, q: FloatArray) -> FloatArray:
        """(k, h) J."""
        found = np.zeros((len(q), len(self._seen)))
        rows = max(1, _CHUNK // len(self._products[1]))
        for first in range(0, len(q), rows):
            part = q[first : first + rows]
            for index, coefficients in zip(self._products, self._by_products, strict=True):
                found[first : first + rows] += part[:, index].prod(axis=2) @ coefficients.T
        return found


def _linear(coefficients: FloatArray, index: IntArray, *, own: int, count: int) -> FloatArray:
    """(h, products) those of one further coordinate times products (products, degree) of the body's own."""
    found = np.zeros((count, len(index)))
    for i in range(count):
        found[i] = coefficients[places(np.column_stack([np.full(len(index), own + i), index]))]
    return found
