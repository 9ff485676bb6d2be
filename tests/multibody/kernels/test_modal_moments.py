"""Moments of a deformed body against sums over its particles."""

from __future__ import annotations

import numpy as np
import pytest

from flexmbd.multibody.kernels.base.compiling import entry_kernel
from flexmbd.multibody.kernels.physics.modal_moments import (
    COUPLING,
    FORCE,
    RATES,
    add_pair_products,
    modal_moments,
    sum_couplings,
    sum_moving_pairs,
    sum_pairs,
)

GUARD = 7.0  # what stands where nothing is to be written


@entry_kernel
def whole_table(modal, n, q, qd, table):
    sum_moving_pairs(modal, 0, 9 * n * (n + 1), n, q, qd, table)


@entry_kernel
def pairs(modal, n, q, table, first):
    sum_pairs(modal, 0, n, q, table, first)


@entry_kernel
def couplings(modal, n, q, table, first):
    sum_couplings(modal, 0, n, q, table, first)


@entry_kernel
def products(modal, n, j, G, row):
    add_pair_products(modal, 0, n, j, (G[0], G[1], G[2], G[3], G[4], G[5], G[6], G[7], G[8]), row)


class Particles:
    """Masses m (k,), places x (k, 3) and modes phi (n, k, 3) of particles, and what a plan holds of them."""

    def __init__(self, n: int) -> None:
        random = np.random.default_rng(n)
        k = 2 * n + 3
        self.n, self.m, self.x = n, random.uniform(0.1, 1.0, k), random.normal(size=(k, 3))
        self.phi, self.q, self.qd = random.normal(size=(n, k, 3)), random.normal(size=n), random.normal(size=n)
        fields = np.hstack([np.ones((k, 1)), self.x, *self.phi])
        gram = fields.T @ (self.m[:, None] * fields)
        first = np.einsum("p,ipc->ci", self.m, self.phi)
        self.modal = np.concatenate([modal_moments(gram, n).ravel(), first.ravel()])

    def rows(self, u: np.ndarray) -> np.ndarray:
        """(9, n) moments of each mode with a field u (k, 3)."""
        outer = np.einsum("p,ipa,pb->iab", self.m, self.phi, u)
        symmetric = (0.5 * (outer + outer.transpose(0, 2, 1)))[:, *np.triu_indices(3)]
        skew = np.einsum("p,ipc->ic", self.m, np.cross(u, self.phi))
        return np.hstack([symmetric, skew]).T

    def field(self, q: np.ndarray) -> np.ndarray:
        """(k, 3) displacements by coordinates."""
        return np.einsum("i,ipc->pc", q, self.phi)


@pytest.mark.parametrize("wider", [0, 3])
@pytest.mark.parametrize("n", [1, 3, 4, 5, 8, 13])
def test_moments_are_sums_over_particles(n: int, wider: int) -> None:
    """In a table as wide as the body has modes, and in that of a machine in which another body has more."""
    body = Particles(n)
    table = np.full((15, n + wider), GUARD)
    whole_table(body.modal, n, body.q, body.qd, table)
    assert table[:9, :n] == pytest.approx(body.rows(body.x + body.field(body.q)), abs=1e-12)
    assert table[FORCE : FORCE + 3, :n] == pytest.approx(np.einsum("p,ipc->ci", body.m, body.phi), abs=1e-12)
    assert table[RATES:, :n] == pytest.approx(body.rows(body.field(body.qd))[6:], abs=1e-12)
    more = np.full((30, n + wider), GUARD)
    pairs(body.modal, n, body.q, more, 12)
    couplings(body.modal, n, body.qd, more, 3)
    assert more[12:21, :n] == pytest.approx(body.rows(body.field(body.q)), abs=1e-12)
    assert more[3:6, :n] == pytest.approx(body.rows(body.field(body.qd))[6:], abs=1e-12)
    assert (np.delete(more, [*range(3, 6), *range(12, 21)], axis=0) == GUARD).all()
    assert COUPLING == 6


@pytest.mark.parametrize("n", [1, 4, 7])
def test_products_of_pairs_are_sums_over_particles(n: int) -> None:
    body, G = Particles(n), np.random.default_rng(1).normal(size=(3, 3))
    wanted = np.einsum("p,jpa,ab,kpb->jk", body.m, body.phi, G, body.phi)
    for j in range(n):
        row = np.zeros(n)
        products(body.modal, n, j, G.ravel(), row)
        assert row == pytest.approx(wanted[j], abs=1e-12)
