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

SAME_PLACE = 1e-9
"""Of an extent or a size: how far apart one place, or one motion, may be found; people and files write ten digits."""

WORTHLESS_PIVOT = 1e-12
"""Of what a pivot, or a singular value, was summed of: below it too few of its digits are right to divide by it."""

SQUARED = 1e-8
"""Of a size that was found by its square, as lengths by energies: half of the digits are left."""


def of_solver(n: int) -> float:
    """Of the largest of n eigenvalues, singular values or pivots: what is left of one that is zero."""
    return 4.0 * n * EPSILON
