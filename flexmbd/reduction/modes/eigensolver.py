"""The eigensolvers of a reduction, and the protocol of a search for modes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, TypeAlias

from flexmbd.continuum.matrices.blocks import FloatArray
from flexmbd.continuum.matrices.eigen import Modes
from flexmbd.errors import ReductionError
from flexmbd.given import checked


@dataclass(frozen=True)
class BlockMethod:
    """Block Lanczos on the factor that the static shapes need anyway (`flexmbd.continuum.matrices.eigen`).

    Without a whole factor Davidson's method in blocks (`flexmbd.reduction.modes.davidson`), averaged interfaces apart.
    """


@checked(error=ReductionError)
@dataclass(frozen=True)
class KrylovSchur:
    """SLEPc's Krylov-Schur method with shift and invert at zero, on the factor of the static shapes.

    From one start vector, with twice as many basis vectors as modes unless PETSc's options say otherwise.

    Attributes:
        prefix: of the options, as in `-flexmbd_eps_ncv 80`; they come from the command line, from PETSC_OPTIONS or
            from `PETSc.Options()`. The spectral transformation's own (`st_`) are not read.
    """

    prefix: str = "flexmbd_"


@checked(error=ReductionError)
@dataclass(frozen=True)
class SpectrumSlicing:
    """SLEPc's spectrum slicing: all modes of an interval, counted by the inertia of factors of their own.

    For rigid interfaces or none, and displacements or rotations as the only unknowns.  How far the interval has to
    reach is found by `KrylovSchur`.

    Attributes:
        prefix: as for `KrylovSchur`.
    """

    prefix: str = "flexmbd_"


#: A choice of method.
Eigensolver: TypeAlias = BlockMethod | KrylovSchur | SpectrumSlicing


def chosen_eigensolver(choice: object) -> Eigensolver:
    """The choice, or the default for None; not collective.

    Raises:
        ReductionError: it is none.
    """
    if choice is None:
        return BlockMethod()
    if not isinstance(choice, Eigensolver):
        raise ReductionError(
            f"eigensolver must be BlockMethod(), KrylovSchur(), SpectrumSlicing() or None, got {choice!r}"
        )
    return choice


class ModeSearch(Protocol):
    """A search for the lowest modes of K x = lambda M x that can be gone on with; its calls are collective.

    Attributes:
        eigenvalues: (k,) ascending, 1/s^2: the lowest, as many as have been found.
        exhausted: whether these are all there are.
    """

    eigenvalues: FloatArray
    exhausted: bool

    def find(self, count: int, *, spare: int = 0) -> None:
        """Go on until the `count` lowest are found, and `spare` more as far as there are more.

        Raises:
            ConvergenceError: on all ranks: it did not get there.
        """

    def find_beyond(self, eigenvalue: float, *, most: int) -> None:
        """Go on until one above an eigenvalue is found, or more than `most` below it.

        Raises:
            ConvergenceError: as `find`.
        """

    def search_below(self, eigenvalue: float, number: int) -> None:
        """Go on from other directions until so many are found below an eigenvalue, where some had been missed.

        Raises:
            ConvergenceError: as `find`.
        """

    def search_again(self) -> None:
        """Go on from generic directions until two more modes are found, and with them any that were missed below.

        Raises:
            ConvergenceError: as `find`.
        """

    def count_below(self, eigenvalue: float) -> int:
        """A lower bound on the number of eigenvalues below one."""

    def products(self, block: FloatArray, count: int) -> FloatArray:
        """Block^T times the shapes of the `count` lowest modes, (s, count)."""

    def modes(self, count: int) -> Modes:
        """The `count` lowest of those that were found."""
