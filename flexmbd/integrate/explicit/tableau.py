"""Butcher tableaus of explicit Runge-Kutta methods and their embedded error estimates."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmbd.errors import SceneError
from flexmbd.given import checked
from flexmbd.integrate.explicit.order_conditions import MOST, order_of
from flexmbd.multibody.kernels.base.array_struct import ArrayStruct

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class TableauArrays(ArrayStruct):
    """Arrays of one method of s stages.

    a: (s + 1, s) strictly lower; its last row are the weights of the step's end.  nodes: (s + 1,).
    estimates: (2, s + 1) weights of two error estimates, zero where a method has fewer; the last
    column weighs the derivative at the step's end.  estimates_error: whether there is one, 0 or 1.
    """

    a: FloatArray
    nodes: FloatArray
    estimates: FloatArray
    estimates_error: int


@checked()
@dataclass(frozen=True, eq=False)
class Tableau:
    """An explicit Runge-Kutta method of one's own, for ``fm.ExplicitRungeKutta``.

    Its order is checked by the conditions that rooted trees make (Butcher 1963).

    Attributes:
        label: how ``explain`` and checkpoints call it.
        order: of the solution that is carried on, 1 to 8.
        a: (s, s) strictly lower, weights of the stages' derivatives in each stage, per step.
        b: (s,) those of the step's end.
        embedded: (s,) or (s + 1,) those of another solution of lower order, by whose distance the error is estimated;
            the last of s + 1 weighs the derivative at the step's end, which the next step begins with.  None: there is
            no estimate, steps are given.

    Raises:
        SceneError: arrays do not fit, a stage hangs on itself or later ones, or the order is lower.
    """

    label: str
    order: int
    a: ArrayLike
    b: ArrayLike
    embedded: ArrayLike | None = None
    tableau: TableauArrays = field(init=False, repr=False)
    exponent: float = field(init=False, repr=False)  # of the step over its error

    def __post_init__(self) -> None:
        a, b = np.array(self.a, dtype=np.float64), np.array(self.b, dtype=np.float64)
        _refuse_order(self.label, self.order, a, b)
        lower, difference = _estimate(self.label, a, b, self.embedded)
        arrays = TableauArrays(
            np.concatenate([a, b[None]]), np.append(a.sum(axis=1), 1.0), np.stack([difference, np.zeros(b.size + 1)]),
            int(self.embedded is not None),
        )  # fmt: skip
        object.__setattr__(self, "tableau", arrays)
        object.__setattr__(self, "exponent", 1.0 / (min(lower, self.order) + 1.0))

    @property
    def estimates_error(self) -> bool:
        """Whether the step can follow a tolerance."""
        return self.embedded is not None


def _refuse_order(label: str, order: int, a: FloatArray, b: FloatArray) -> None:
    """Raise SceneError where a and b are no explicit method of that order."""
    if b.ndim != 1 or b.size == 0 or a.shape != (b.size, b.size):
        raise SceneError(
            f"{label}: b (s,) and a (s, s) must be of one number of stages, got {b.shape} and {a.shape}"
        )
    if np.triu(a).any():
        raise SceneError(f"{label}: a must be strictly lower: in an explicit method a stage hangs on those before")
    if not 1 <= order <= MOST:
        raise SceneError(f"{label}: order must lie between 1 and {MOST}, got {order}")
    shown = order_of(a, b)
    if shown < order:
        raise SceneError(f"{label} says order {order}, but fulfils the conditions of order {shown} alone")


def _estimate(label: str, a: FloatArray, b: FloatArray, embedded: ArrayLike | None) -> tuple[int, FloatArray]:
    """The order of the embedded solution, and the weights (s + 1,) of its distance.

    Raises:
        SceneError: it is none.
    """
    s = b.size
    if embedded is None:
        return 0, np.zeros(s + 1)
    weights = np.array(embedded, dtype=np.float64)
    if weights.shape not in ((s,), (s + 1,)):
        raise SceneError(f"{label}: embedded must have {s} or {s + 1} weights, got {weights.shape}")
    weights = np.append(weights, np.zeros(s + 1 - weights.size))
    stages, whole = np.zeros((s + 1, s + 1)), np.append(b, 0.0)
    stages[:s, :s], stages[s, :s] = a, b
    lower = order_of(stages, weights)
    if lower < 1 or not (whole != weights).any():
        raise SceneError(f"{label}: embedded must be another solution, of order 1 at least, whose weights sum to 1")
    return lower, whole - weights


def _tableau(
    *,
    stages: int,
    nodes: Sequence[float],
    rows: Sequence[Mapping[int, float]],
    weights: Mapping[int, float],
    estimates: Sequence[Mapping[int, float]] = (),
) -> TableauArrays:
    table = TableauArrays(
        np.zeros((stages + 1, stages)), np.array([*nodes, 1.0]), np.zeros((2, stages + 1)), int(len(estimates) > 0)
    )
    for into, row in (
        *zip(table.a, (*rows, weights), strict=True),
        *zip(table.estimates, estimates, strict=False),
    ):
        into[list(row)] = list(row.values())
    return table


_FOUR = _tableau(
    stages=4,
    nodes=(0.0, 0.5, 0.5, 1.0),
    rows=({}, {0: 0.5}, {1: 0.5}, {2: 1.0}),
    weights={0: 1 / 6, 1: 1 / 3, 2: 1 / 3, 3: 1 / 6},
)

_FIVE = _tableau(
    stages=6,
    nodes=(0.0, 1 / 5, 3 / 10, 4 / 5, 8 / 9, 1.0),
    rows=(
        {},
        {0: 1 / 5},
        {0: 3 / 40, 1: 9 / 40},
        {0: 44 / 45, 1: -56 / 15, 2: 32 / 9},
        {0: 19372 / 6561, 1: -25360 / 2187, 2: 64448 / 6561, 3: -212 / 729},
        {0: 9017 / 3168, 1: -355 / 33, 2: 46732 / 5247, 3: 49 / 176, 4: -5103 / 18656},
    ),
    weights={0: 35 / 384, 2: 500 / 1113, 3: 125 / 192, 4: -2187 / 6784, 5: 11 / 84},
    estimates=(
        {0: 71 / 57600, 2: -71 / 16695, 3: 71 / 1920, 4: -17253 / 339200, 5: 22 / 525, 6: -1 / 40},
    ),
)

_EIGHT = _tableau(
    stages=12,
    nodes=(
        0.0,
        0.05260015195876773,
        0.0789002279381516,
        0.1183503419072274,
        0.2816496580927726,
        0.3333333333333333,
        0.25,
        0.3076923076923077,
        0.6512820512820513,
        0.6,
        0.8571428571428571,
        1.0,
    ),
    rows=(
        {},
        {0: 0.05260015195876773},
        {0: 0.0197250569845379, 1: 0.0591751709536137},
        {0: 0.02958758547680685, 2: 0.08876275643042054},
        {0: 0.2413651341592667, 2: -0.8845494793282861, 3: 0.924834003261792},
        {0: 0.037037037037037035, 3: 0.17082860872947386, 4: 0.12546768756682242},
        {0: 0.037109375, 3: 0.17025221101954405, 4: 0.06021653898045596, 5: -0.017578125},
        {0: 0.03709200011850479, 3: 0.17038392571223998, 4: 0.10726203044637328,
            5: -0.015319437748624402, 6: 0.008273789163814023},
        {0: 0.6241109587160757, 3: -3.3608926294469414, 4: -0.868219346841726, 5: 27.59209969944671,
            6: 20.154067550477894, 7: -43.48988418106996},
        {0: 0.47766253643826434, 3: -2.4881146199716677, 4: -0.590290826836843, 5: 21.230051448181193,
            6: 15.279233632882423, 7: -33.28821096898486, 8: -0.020331201708508627},
        {0: -0.9371424300859873, 3: 5.186372428844064, 4: 1.0914373489967295, 5: -8.149787010746927,
            6: -18.52006565999696, 7: 22.739487099350505, 8: 2.4936055526796523, 9: -3.0467644718982196},
        {0: 2.273310147516538, 3: -10.53449546673725, 4: -2.0008720582248625, 5: -17.9589318631188,
            6: 27.94888452941996, 7: -2.8589982771350235, 8: -8.87285693353063, 9: 12.360567175794303,
            10: 0.6433927460157636},
    ),
    weights={0: 0.054293734116568765, 5: 4.450312892752409, 6: 1.8915178993145003, 7: -5.801203960010585,
        8: 0.3111643669578199, 9: -0.1521609496625161, 10: 0.20136540080403034,
        11: 0.04471061572777259},
    estimates=(
        {0: 0.01312004499419488, 5: -1.2251564463762044, 6: -0.4957589496572502, 7: 1.6643771824549864,
            8: -0.35032884874997366, 9: 0.3341791187130175, 10: 0.08192320648511571,
            11: -0.022355307863886294},
        {0: -0.18980075407240762, 5: 4.450312892752409, 6: 1.8915178993145003, 7: -5.801203960010585,
            8: -0.4226823213237919, 9: -0.1521609496625161, 10: 0.20136540080403034,
            11: 0.02265179219836082},
    ),
)


class Pair(Enum):
    """A method, and the embedded one that estimates its error.

    Sources: Kutta 1901; Dormand & Prince 1980 (RK5(4)7M); Hairer, Norsett & Wanner 1993, section
    II.10 (DOP853, whose error estimate combines those of orders 5 and 3).
    """

    CLASSICAL_4 = "classical, order 4"
    DORMAND_PRINCE_5 = "Dormand-Prince 5(4)"
    DORMAND_PRINCE_8 = "Dormand-Prince 8(5,3)"

    @property
    def tableau(self) -> TableauArrays:
        """The coefficients."""
        return {Pair.CLASSICAL_4: _FOUR, Pair.DORMAND_PRINCE_5: _FIVE, Pair.DORMAND_PRINCE_8: _EIGHT}[self]

    @property
    def order(self) -> int:
        """Order of the solution that is carried on."""
        return {Pair.CLASSICAL_4: 4, Pair.DORMAND_PRINCE_5: 5, Pair.DORMAND_PRINCE_8: 8}[self]

    @property
    def estimates_error(self) -> bool:
        """Whether the step can follow a tolerance."""
        return bool(self.tableau.estimates_error)

    @property
    def exponent(self) -> float:
        """Of the step over its error."""
        return 1.0 / (8.0 if self is Pair.DORMAND_PRINCE_8 else 5.0)

    @property
    def label(self) -> str:
        """How ``explain`` calls it."""
        return self.value
