"""A material law that is a compiled function, as the contract sees it: its history, and how it follows u.

The local unknowns z of such a form are what the law returns at a quadrature point, in this order: its strain (6,), its
stress (6,) and its state (n,), which are the history at the step's end; then the stress (6,) that does work on the
strain of the displacement, and that strain (6,).  Both strains and both stresses are the same but for the logarithmic
strain.  Vectors of strain are xx, yy, zz, yz, xz, xy with twice the tensor's shears, those of stress the tensor's.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import ufl
from numpy.typing import NDArray
from ufl.core.expr import Expr

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class PointLaw:
    """A law compiled to a C function of one point: ``void f(double *made, double *given, double *constants, ...)``.

    It is given the strain of the displacement (6,) and the history at the step's begin (12 + n,), and makes z
    (24 + n,), the derivative of the stress by the strain of the displacement (6, 6) and a number that says what is
    wrong (`FAULTS`, counted from 1), or 0.  Its constants are the step's length and the parameters.

    Attributes:
        address: of the C function.
        keep: what is kept alive for it.
        begin: (12 + n,) history at rest.
        strain: (u) strain of the displacement, (6,).
        constants: (p) the parameters it takes, as symbols or numbers.
    """

    address: int
    keep: Any
    begin: FloatArray
    strain: Callable[[Expr], Expr]
    constants: Callable[[Any], Sequence[Any]]

    @property
    def kept(self) -> int:
        """Components of the history, 12 + n."""
        return len(self.begin)

    @property
    def size(self) -> int:
        """Components of z, 24 + n."""
        return self.kept + 12

    def at_rest(self) -> Expr:
        """z at rest."""
        return ufl.as_vector([*map(float, self.begin), *[0.0] * 12])

    def working_stress(self, z: Expr) -> Expr:
        """(6,) Pa, the stress in z that does work on the strain of the displacement."""
        return ufl.as_vector([z[self.kept + i] for i in range(6)])

    def following(self, z: Expr, slopes: Expr, u: Expr) -> Expr:
        """z whose working stress follows the displacement, by the slopes (6, 6) of the point where z was made."""
        strain, k = self.strain(u), self.kept
        change = [strain[j] - z[k + 6 + j] for j in range(6)]
        stress = [z[k + i] + sum(slopes[i, j] * change[j] for j in range(6)) for i in range(6)]
        return ufl.as_vector([*(z[i] for i in range(k)), *stress, *(strain[j] for j in range(6))])

    def linearised(self, u: Expr, p: Any) -> Expr:
        """z of a step from rest by the slopes at rest, in no time, which is exact where the law is linear."""
        slopes = ufl.as_matrix(self.evaluate(np.zeros(6), self.begin, constants=self.values(p))[1].tolist())
        return self.following(self.at_rest(), slopes, u)

    def values(self, p: Any) -> FloatArray:
        """The constants for a step of no time, of parameters whose values are known."""
        values = [value if isinstance(value, float) else float(value.value) for value in self.constants(p)]
        return np.array([0.0, *values])

    def evaluate(
        self, strain: FloatArray, history: FloatArray, *, constants: FloatArray
    ) -> tuple[FloatArray, FloatArray, int]:
        """z (24 + n,), the slopes (6, 6) and the fault at one point."""
        made = np.zeros(self.size + 37)
        given = np.concatenate([strain, history])
        null = [None] * 4
        self.keep.ctypes(made.ctypes.data, given.ctypes.data, constants.ctypes.data, *null)
        return made[: self.size], made[self.size : -1].reshape(6, 6), int(made[-1])


FAULTS = (
    "the law raised an error",
    "the stress is not of the shape (6,)",
    "the tangent is not of the shape (6, 6)",
    "the state is not of the shape that the law begins with",
    "the strain is not finite, or the cell is turned inside out",
    "the stress is not finite",
    "the tangent is not finite",
    "the state is not finite",
)
"""What a compiled law says of itself; the first four are errors of the law's text, the others of a step."""

WRITING_FAULTS = 4
