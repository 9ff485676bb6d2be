"""The lowest modes where the stiffness is inverted nearly: Davidson's method with blocks.

Block Lanczos wants K^-1 to twelve digits in each of its steps, some ten solutions with an approximate inverse B^-1.
Davidson's method wants B^-1 once: it widens its basis by B^-1 r, r = K x - theta M x the residuals of Ritz vectors,
and takes Ritz values of K itself (Davidson 1975, doi:10.1016/0021-9991(75)90065-0; Morgan & Scott 1986,
doi:10.1137/0907054).  With B = K the basis is that of Lanczos.  The size of B^-1 r beside x in the norm of the mass
is that of the residual of K^-1 M, by which block Lanczos judges convergence.
"""

from __future__ import annotations

from petsc4py import PETSc

import numpy as np

from flexmbd.continuum import parallel
from flexmbd.continuum.matrices.blocks import FloatArray, inner, multiply
from flexmbd.continuum.matrices.eigen import TOLERANCE, BlockOperator, Modes
from flexmbd.continuum.matrices.lanczos_basis import LanczosBasis
from flexmbd.errors import ConvergenceError
from flexmbd.reduction.static_shapes.stiffness_round_off import MARGIN

# Ritz vectors whose residuals widen the basis in one step: at most so many.
_WIDTH = 8
# Basis vectors a mode that is wanted, and besides, from which on the basis is brought down to its lowest Ritz vectors.
_VECTORS, _BESIDE = 4, 64
# Directions a basis vector of the limit, before it is given up: a cycle of multigrid needs some twenty a mode.
_PATIENCE = 6
# Relative change by which a Ritz value that had converged shows that a lower one came in.
_MOVED = 1e-9


class DavidsonSearch:
    """A `ModeSearch` with an approximate inverse of the stiffness; its calls are collective.

    Attributes:
        eigenvalues: (k,) ascending, 1/s^2: the lowest, as many as have converged.
        exhausted: whether the basis spans all modes, so that there are no more.
    """

    def __init__(
        self,
        stiffness: BlockOperator,
        mass: PETSc.Mat,
        precondition: BlockOperator,
        noise: BlockOperator,
        deformation: BlockOperator,
        *,
        start: FloatArray,
        size: int,
        limit: int,
    ) -> None:
        """Begin a search. Collective.

        Args:
            stiffness: K times a block (owned rows, k).
            mass: M, positive definite.
            precondition: nearly K^-1 times a block; symmetric positive definite.
            noise: sizes of the round-off of K times a block.
            deformation: a block less rigid motions, where nothing holds the body.
            start: (owned rows, b) start block.
            size: number of modes there are.
            limit: number of basis vectors that would do with an exact inverse.
        """
        self.eigenvalues: FloatArray = np.zeros(0)
        self.exhausted = False
        self._stiffness, self._mass, self._precondition, self._noise = stiffness, mass, precondition, noise
        self._deformation = deformation
        self._comm = mass.comm.tompi4py()
        self._size, self._most, self._taken = size, _PATIENCE * limit, 0
        self._basis = LanczosBasis(mass, len(start))
        self._projected: FloatArray = np.zeros((0, 0))
        self._values: FloatArray = np.zeros(0)
        self._vectors: FloatArray = np.zeros((0, 0))
        self._worst = self._least = np.inf
        self._fresh = precondition(multiply(mass, start))

    def find(self, count: int, *, spare: int = 0) -> None:
        """As in `ModeSearch`."""
        while len(self.eigenvalues) < count + spare and not self.exhausted:
            self._advance(count + spare)
        if len(self.eigenvalues) < count:
            self._fail(count)

    def find_beyond(self, eigenvalue: float, *, most: int) -> None:
        """As in `ModeSearch`."""
        while not (self.exhausted or np.any(self.eigenvalues > eigenvalue) or self.count_below(eigenvalue) > most):
            self._advance(len(self.eigenvalues) + 1)

    def search_below(self, eigenvalue: float, number: int) -> None:
        """As in `ModeSearch`."""
        while np.sum(self.eigenvalues < eigenvalue) < number:
            if self.exhausted:
                self._fail(number)
            self._fresh = np.hstack([self._fresh, self._random()])
            self._advance(number)

    def search_again(self) -> None:
        """As in `ModeSearch`."""
        self._fresh = np.hstack([self._fresh, self._random()])
        self.find(0, spare=min(len(self.eigenvalues) + 2, self._size))

    def count_below(self, eigenvalue: float) -> int:
        """As in `ModeSearch`: Ritz values are not below the eigenvalues they stand for (Cauchy)."""
        return int(np.sum(self._values < eigenvalue))

    def products(self, block: FloatArray, count: int) -> FloatArray:
        """As in `ModeSearch`."""
        return self._basis.products(block)[:, : len(self._vectors)] @ self._vectors[:, :count]

    def modes(self, count: int) -> Modes:
        """As in `ModeSearch`."""
        return Modes(self.eigenvalues[:count], self._basis.combine(self._vectors[:, :count]))

    def _advance(self, wanted: int) -> None:
        """Widen the basis, and look at the lowest of the wanted modes that have not converged. Collective."""
        self._restart(wanted)
        self._widen(wanted)
        before = self.eigenvalues
        self._ritz()
        # a prefix that a lower Ritz value has moved is looked at again
        known = min(len(before), len(self._values))
        moved = abs(self._values[:known] - before[:known]) > _MOVED * before[:known]
        known = int(self._comm.bcast(np.argmax(moved) if moved.any() else known))
        if self._basis.size >= self._size:
            self.eigenvalues, self.exhausted = self._values, True
            return
        # one more than is wanted, which shows that there is none between
        chosen = slice(known, min(known + _WIDTH, max(wanted, known) + 1))
        theta, shapes = self._values[chosen], self._basis.combine(self._vectors[:, chosen])
        rest = np.asfortranarray(self._stiffness(shapes) - multiply(self._mass, shapes) * theta)
        self._fresh = self._precondition(rest)
        sizes = self._lengths(self._fresh)
        converged = sizes <= TOLERANCE
        least, last = float(sizes[~converged].min(initial=np.inf)), self._least
        self._least = least
        if np.sqrt(TOLERANCE) > least > 0.5 * last:
            # it does not fall any more
            signs = np.random.default_rng((self._basis.size, self._comm.rank)).choice([-1.0, 1.0], size=rest.shape)
            terms = self._basis.term_sizes(self._vectors[:, chosen])
            floor = self._lengths(self._precondition(np.asfortranarray(signs * self._noise(terms))))
            converged = sizes <= np.maximum(TOLERANCE, np.minimum(MARGIN * floor, np.sqrt(TOLERANCE)))
        converged = self._comm.bcast(converged)
        self._worst = float(sizes.max(initial=0.0))
        more = int(np.sum(np.logical_and.accumulate(converged)))
        self.eigenvalues = self._values[: known + more]
        going = ~converged
        self._fresh = np.asfortranarray((self._fresh / np.where(sizes > 0.0, sizes, 1.0))[:, going])

    def _widen(self, count: int) -> None:
        """Take the fresh directions into the basis, or others where these bring nothing. Collective."""
        none = np.zeros((len(self._fresh), 0), order="F")
        for directions in (self._fresh, None):
            fresh = self._random() if directions is None else directions
            if fresh.shape[1] == 0:
                continue
            room = self._size - self._basis.size
            block, image = self._basis.beside(none, none, np.asfortranarray(fresh))
            deformed = self._deformation(block)
            if deformed is not block:
                # of directions that bring little new, round-off's rigid motions have become large
                block, image = self._basis.beside(none, none, deformed)
            block, image = block[:, :room], image[:, :room]
            if block.shape[1] == 0:
                continue
            self._taken += block.shape[1]
            if self._taken > self._most:
                self._fail(count)
            last = self._basis.size
            self._basis.append(np.asfortranarray(block), np.asfortranarray(image))
            onto = self._basis.products(self._stiffness(np.asfortranarray(block)))
            size = self._basis.size
            projected = np.zeros((size, size))
            projected[:last, :last] = self._projected
            projected[last:] = onto
            projected[:last, last:] = onto[:, :last].T
            self._projected = projected
            return
        self._fail(count)

    def _restart(self, wanted: int) -> None:
        """Bring a basis that has grown large down to its lowest Ritz vectors (Stathopoulos & Saad 1998). Collective."""
        if self._basis.size + _WIDTH <= min(self._size, _VECTORS * wanted + _BESIDE):
            return
        kept = min(self._basis.size, wanted + 2 * _WIDTH)
        shapes = self._basis.combine(self._vectors[:, :kept])
        self._basis = LanczosBasis(self._mass, len(shapes))
        self._basis.append(shapes, multiply(self._mass, shapes))
        self._projected = np.diag(self._values[:kept])
        self._values, self._vectors = self._values[:kept], np.eye(kept)

    def _ritz(self) -> None:
        """Collective."""
        half = 0.5 * (self._projected + self._projected.T)
        self._values, self._vectors = parallel.on_root(self._comm, lambda: tuple(np.linalg.eigh(half)))

    def _random(self) -> FloatArray:
        """Generic directions, smoothed. Collective."""
        rng = np.random.default_rng((self._basis.size, self._comm.rank))
        block = np.asfortranarray(rng.normal(size=(_WIDTH, len(self._fresh))).T)
        fresh = self._precondition(multiply(self._mass, block))
        return np.asfortranarray(fresh / self._lengths(fresh))

    def _lengths(self, block: FloatArray) -> FloatArray:
        """(k,) in the norm of the mass. Collective."""
        return np.sqrt(np.diag(inner(self._comm, block, multiply(self._mass, block))))

    def _fail(self, count: int) -> None:
        raise ConvergenceError(
            f"the eigensolver (Davidson's method) found {len(self.eigenvalues)} of {count} fixed-interface modes to a "
            f"relative residual of {TOLERANCE:.0e} with {self._basis.size} vectors; the worst is at {self._worst:.1e}; "
            "ask for fewer modes, or take solver=Solver.DIRECT"
        )
