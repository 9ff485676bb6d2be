"""What counts as nothing, as the same, or as no pivot in computations with doubles; for all rooms, kernels included.

Each is a share: of the sizes of what was summed, of a value, or of an extent.  It never stands beside what has another
unit.  What is no round-off, as how far an iteration is to go or a model to be trusted, stands where it is decided.
"""

EPSILON = 2.0**-52
"""The unit in the last place of 1."""

ROUND_OFF = 1e-14
"""Of the sizes of what was summed: what is left of a sum that is zero; some tens of units in the last place."""

EQUAL = 1e-12
"""Of a value: by how much two ways to it may differ, each a chain of sums as through a tree or products of matrices."""

TEN_DIGITS = 1e-9
"""Of a value: by how much it may differ from another if both have ten digits, as people, files and iterations leave."""

SAME_PLACE = TEN_DIGITS
"""Of an extent: how far apart one place, or one motion, may be found."""

SEVEN_DIGITS = 1e-6
"""Of a value that a person or a program wrote with seven or eight digits: what rounding leaves."""

SIX_DIGITS = 1e-5
"""The same of six digits, as programs write at least."""

WORTHLESS_PIVOT = 1e-12
"""Of what a pivot, or a singular value, was summed of: below it too few of its digits are right to divide by it."""

SQUARED = 1e-8
"""Of a size that was found by its square, as lengths by energies: half of the digits are left."""

STALLED = 1e-6
"""Of a size: what an iteration no longer halves below this is round-off of badly scaled equations, and good."""

NO_LENGTH = 1e-150
"""m: a length that is none; its square is still a number."""


def of_solver(n: int) -> float:
    """Of the largest of n eigenvalues, singular values or pivots: what is left of one that is zero."""
    return 4.0 * n * EPSILON
