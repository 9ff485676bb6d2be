"""The matrices of a flexible body's equations of motion as Taylor series in q, and a body from them.

With s the place of a point, f_j mode j and all integrals over mass, in the body frame's axes, the equations are
(Wallrapp 1994, Standardization of flexible body modeling in multibody system codes, Mech. Struct. Mach. 22;
Schwertassek & Wallrapp 1999, Dynamik flexibler Mehrkoerpersysteme)

    m a + dw x mdCM + Ct^T q''                      = f - w x (w x mdCM) - 2 w x (Ct^T q')
    mdCM x a + J dw + Cr^T q''                      = t - sum_j q'_j Gr_j w - w x J w
    Ct a + Cr dw + Me q'' + ksigma + Ke q + De q'   = h - sum_j q'_j Ge_j w - Oe [w w]

with a the acceleration less gravity and [w w] = (w1 w1, w2 w2, w3 w3, w1 w2, w2 w3, w1 w3). Every block is constant
plus linear in q, which is all of it but for J: its second order is left out, though it could be had from m1 of Gr. All
of them are integrals of products of two of the fields {1, s, f_1, f_2, ...}, that is entries of a Gram matrix, which
can be had back from them (`mass_integrals`).
Stiffening by load adds to Ct, Cr and Oe what makes K_l q c_l in the third line, with c_l the components of a, dw
and the products of w.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from flexmbd.errors import ExportError
from flexmbd.record.groups import FloatArray, IntArray, load_stiffness
from flexmbd.record.inertia_loads import (
    ACCELERATIONS,
    ANGULAR_ACCELERATIONS,
    CENTRIFUGAL,
    SPIN_PRODUCTS,
    centrifugal_forces,
)
from flexmbd.record.reduced_body import GeometricStiffness, ReducedBody
from flexmbd.round_off import TEN_DIGITS

#: Blocks of a body in the order of a file.
BLOCKS = ("mdCM", "J", "Ct", "Cr", "Me", "Gr", "Ge", "Oe", "ksigma", "Ke", "De")

# Rows of J: components of a symmetric tensor.
_INERTIA = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
# Columns of Oe: which of the record's products of angular velocities; and of the record's, which of the columns.
_SPIN = [SPIN_PRODUCTS.index(pair) for pair in ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2))]
_UNSPUN = [_SPIN.index(k) for k in range(len(_SPIN))]

_CROSS = np.zeros((3, 3, 3))
for _a, _b, _c in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
    _CROSS[_a, _b, _c], _CROSS[_a, _c, _b] = 1.0, -1.0

#: What blocks may differ by that say the same, relative to the largest entry.
AGREE = 0.03
# Stiffness by spinning is of the size of the inertia; less than this part of it is the file's rounding.
_NO_STIFFENING = 1e-8


@dataclass(frozen=True, eq=False)
class Taylor:
    """A matrix that is linear in q.

    Attributes:
        m0: (rows, columns) at q = 0.
        m1: (rows, n, columns) per unit of each q, or None where there is no such term.
    """

    m0: FloatArray
    m1: FloatArray | None = None


@dataclass(frozen=True, eq=False)
class Integrals:
    """Mass integrals of the fields 1, s and f_j.

    Attributes:
        mass: kg.
        s: (3,) of s_a.
        ss: (3, 3) of s_a s_b.
        f: (n, 3) of f_jb.
        sf: (3, n, 3) of s_a f_jb.
        ff: (n, 3, n, 3) of f_ia f_jb.
    """

    mass: float
    s: FloatArray
    ss: FloatArray
    f: FloatArray
    sf: FloatArray
    ff: FloatArray

    def gram(self) -> FloatArray:
        """(4 + 3 n, 4 + 3 n), as in `ReducedBody`."""
        n = len(self.f)
        gram = np.empty((4 + 3 * n, 4 + 3 * n))
        gram[0, 0], gram[0, 1:4], gram[0, 4:] = self.mass, self.s, self.f.ravel()
        gram[1:4, 1:4], gram[1:4, 4:] = self.ss, self.sf.reshape(3, 3 * n)
        gram[4:, 4:] = self.ff.reshape(3 * n, 3 * n)
        gram[1:, 0], gram[4:, 1:4] = gram[0, 1:], gram[1:4, 4:].T
        return 0.5 * (gram + gram.T)


def taylor_blocks(body: ReducedBody) -> dict[str, Taylor]:
    """The blocks of a body by name, with what its `geometric` group says of stiffening by its frame's motion."""
    n, gram = body.n_modes, body.gram
    f, sf = gram[0, 4:].reshape(n, 3), gram[1:4, 4:].reshape(3, n, 3)
    ff = gram[4:, 4:].reshape(n, 3, n, 3)
    turning = _turning(np.einsum("ajb->jba", sf))
    crossed = np.einsum("cab,kalb->lkc", _CROSS, ff)
    stiffening = {name: _stiffening(body.geometric, loads) for name, loads in _LOADS.items()}
    return {
        "mdCM": Taylor(gram[0, 1:4, None].copy(), f.T[:, :, None].copy()),
        "J": Taylor(
            _components(_inertia(gram[1:4, 1:4]), _INERTIA)[:, None],
            _components(_inertia(sf.swapaxes(0, 1) + np.einsum("ajb->jba", sf)), _INERTIA).T[:, :, None],
        ),
        "Ct": Taylor(f.copy(), stiffening["Ct"]),
        "Cr": Taylor(np.einsum("cab,alb->lc", _CROSS, sf), _sum(crossed, stiffening["Cr"])),
        "Me": Taylor(np.eye(n)),
        "Gr": Taylor(
            -2.0 * turning.swapaxes(0, 1).reshape(3, 3 * n),
            -2.0 * np.einsum("kjrc->rkjc", _turning(np.einsum("jrkc->kjrc", ff))).reshape(3, n, 3 * n),
        ),
        "Ge": Taylor(2.0 * crossed.reshape(n, 3 * n)),
        "Oe": Taylor(_spinning(sf), _sum(_spinning_of_modes(ff), stiffening["Oe"])),
        "ksigma": Taylor(np.zeros((n, 1))),
        "Ke": Taylor(np.diag(body.stiffness)),
        "De": Taylor(body.damping.copy()),
    }


# For each block the loads whose stiffness is its term in q, column by column.
_LOADS = {
    "Ct": ACCELERATIONS,
    "Cr": ANGULAR_ACCELERATIONS,
    "Oe": tuple(CENTRIFUGAL[k] for k in _SPIN),
}


def _stiffening(group: GeometricStiffness | None, loads: tuple[str, ...]) -> FloatArray | None:
    """(n, n, columns), or None."""
    found = [load_stiffness(group, load) for load in loads]
    known = [K for K in found if K is not None]
    if not known:
        return None
    return np.stack([np.zeros_like(known[0]) if K is None else K for K in found], axis=2)


def _sum(a: FloatArray, b: FloatArray | None) -> FloatArray:
    return a if b is None else a + b


def _inertia(second: FloatArray) -> FloatArray:
    """Inertia tensors (..., 3, 3) of second moments, and second moments times -1 plus half the trace of tensors."""
    return np.trace(second, axis1=-2, axis2=-1)[..., None, None] * np.eye(3) - second


def _second(inertia: FloatArray) -> FloatArray:
    """Second moments (..., 3, 3) of inertia tensors."""
    return 0.5 * np.trace(inertia, axis1=-2, axis2=-1)[..., None, None] * np.eye(3) - inertia


def _turning(products: FloatArray) -> FloatArray:
    """Integrals of skew(a) skew(b) of those of b_r a_c, (..., 3, 3)."""
    return products - np.trace(products, axis1=-2, axis2=-1)[..., None, None] * np.eye(3)


def _unturned(turning: FloatArray) -> FloatArray:
    """Integrals of b_r a_c of those of skew(a) skew(b), (..., 3, 3)."""
    return turning - 0.5 * np.trace(turning, axis1=-2, axis2=-1)[..., None, None] * np.eye(3)


def _components(tensor: FloatArray, order: tuple[tuple[int, int], ...]) -> FloatArray:
    """(..., 6) of symmetric tensors (..., 3, 3)."""
    return np.stack([tensor[..., a, b] for a, b in order], axis=-1)


def _tensor(components: FloatArray, order: tuple[tuple[int, int], ...]) -> FloatArray:
    """Symmetric tensors (..., 3, 3) of their components (..., 6)."""
    tensor = np.empty((*components.shape[:-1], 3, 3))
    for k, (a, b) in enumerate(order):
        tensor[..., a, b] = tensor[..., b, a] = components[..., k]
    return tensor


def _spinning(levers: FloatArray) -> FloatArray:
    """(..., 6) columns of Oe by integrals (3, ..., 3) of r_a phi_b: the centrifugal force on the left-hand side."""
    return -np.moveaxis(centrifugal_forces(levers)[_SPIN], 0, -1)


def _spinning_of_modes(ff: FloatArray) -> FloatArray:
    """(n, n, 6) linear part of Oe, the displacement by a mode k in the place of r: row l, then k."""
    return _spinning(np.einsum("kalb->alkb", ff))


def mass_integrals(mass: float, blocks: Mapping[str, Taylor], *, tolerance: float = AGREE) -> Integrals:
    """The mass integrals that blocks of right shapes come from.

    s f is half in Cr and half in the linear part of J, and once more in Gr. f f is in the linear part of Gr; where that
    is left out, as most programs do, its symmetric part is in the linear part of Oe, unless stiffening by spinning
    is added there, and the rest in Ge, or else in the linear part of Cr. Where blocks differ, those count that make the
    linear motion: Ct, Cr and Me.

    Args:
        mass: kg.
        blocks: by name.
        tolerance: by what part of their size blocks may differ that say the same.

    Raises:
        ExportError: blocks contradict each other, or do not say enough.
    """
    n = len(blocks["Me"].m0)
    blocks = _arranged(blocks, n)
    f, inertia = blocks["Ct"].m0, blocks["J"]
    lever = np.einsum("cab,lc->lab", _CROSS, blocks["Cr"].m0)
    second = None if inertia.m1 is None else _second(_tensor(inertia.m1[:, :, 0].T, _INERTIA))
    if "Gr" in blocks:
        levers = _levers(blocks["Gr"].m0, n)
        both = levers + levers.swapaxes(1, 2)
        _same("Gr and Cr", levers - levers.swapaxes(1, 2), lever, size=levers, tolerance=tolerance)
        second = both if second is None else second
        _same("Gr and m1 of J", both, second, size=levers, tolerance=tolerance)
    if second is None:
        raise ExportError("it has neither Gr nor m1 of J: how the modes change the inertia is not known")
    if blocks["mdCM"].m1 is not None:
        _same("Ct and m1 of mdCM", f, blocks["mdCM"].m1[:, :, 0].T, size=f, tolerance=tolerance)
    ff = _products_of_modes(blocks, n, tolerance)
    modal = np.einsum("iaja->ij", ff)
    _same("Me and the products of modes in Gr or Oe", modal, blocks["Me"].m0, size=modal, tolerance=tolerance)
    return Integrals(
        mass=mass,
        s=blocks["mdCM"].m0[:, 0],
        ss=_second(_tensor(inertia.m0[:, 0], _INERTIA)),
        f=f,
        sf=0.5 * (second + lever).swapaxes(0, 1),
        ff=_with_mass(ff, blocks["Me"].m0),
    )


def mode_by_mode(block: Taylor, n: int) -> Taylor:
    """A block of 3 n columns, those of an axis together, with those of a mode together."""
    return _ordered(block, np.arange(3 * n).reshape(3, n).T.ravel())


def axis_by_axis(block: Taylor, n: int) -> Taylor:
    """A block of 3 n columns, those of a mode together, with those of an axis together."""
    return _ordered(block, np.arange(3 * n).reshape(n, 3).T.ravel())


def _ordered(block: Taylor, columns: IntArray) -> Taylor:
    return Taylor(block.m0[:, columns], None if block.m1 is None else block.m1[:, :, columns])


def _levers(gyration: FloatArray, n: int) -> FloatArray:
    """Integrals (n, 3, 3) of s_a f_jb by m0 of Gr."""
    return _unturned(-0.5 * gyration.reshape(3, n, 3).swapaxes(0, 1)).swapaxes(1, 2)


def _arranged(blocks: Mapping[str, Taylor], n: int) -> Mapping[str, Taylor]:
    """The blocks with three columns a mode in Gr and Ge; SIMPACK's FEMBS has the columns of an axis together.

    Which it is follows from Cr, which has no such choice.
    """
    if "Gr" not in blocks:
        return blocks
    lever = np.einsum("cab,lc->lab", _CROSS, blocks["Cr"].m0)
    turned = {name: mode_by_mode(blocks[name], n) for name in ("Gr", "Ge") if name in blocks}
    apart = []
    for gyration in (blocks["Gr"].m0, turned["Gr"].m0):
        levers = _levers(gyration, n)
        apart.append(np.abs(levers - levers.swapaxes(1, 2) - lever).max(initial=0.0))
    return {**blocks, **turned} if apart[1] < 0.5 * apart[0] else blocks


def _with_mass(ff: FloatArray, mass: FloatArray) -> FloatArray:
    """f f with the modal mass that is said; what a unit matrix leaves out of a nearly unit one stays."""
    more = mass - np.einsum("iaja->ij", ff)
    if np.abs(more).max(initial=0.0) <= TEN_DIGITS * np.abs(mass).max(initial=0.0):
        return ff
    return ff + np.einsum("ij,ab->iajb", more, np.eye(3) / 3.0)


def _products_of_modes(blocks: Mapping[str, Taylor], n: int, tolerance: float) -> FloatArray:
    """(n, 3, n, 3)."""
    gyration, spin = blocks.get("Gr"), blocks.get("Oe")
    if gyration is not None and gyration.m1 is not None:
        half = -0.5 * gyration.m1.reshape(3, n, n, 3)
        ff = np.einsum("kjrc->jrkc", _unturned(np.einsum("rkjc->kjrc", half)))
    else:
        if spin is None or spin.m1 is None:
            raise ExportError("neither Gr nor Oe has a term m1: the velocity forces of the deformed body are not known")
        crossed = _crossed(blocks, n)
        spinning = _tensor(spin.m1 * np.array([1.0, 1.0, 1.0, 0.5, 0.5, 0.5]), tuple(SPIN_PRODUCTS[k] for k in _SPIN))
        # with nothing added its trace is minus twice the modal mass
        more = 0.5 * np.trace(spinning, axis1=2, axis2=3) + blocks["Me"].m0
        if np.abs(more).max(initial=0.0) > tolerance * np.abs(blocks["Me"].m0).max(initial=0.0):
            raise ExportError(
                "m1 of Oe has stiffening by spinning added, and without m1 of Gr it cannot be told from the inertia: "
                "have the file written without geometric stiffness; if it is, read it with a larger tolerance"
            )
        dyads = _unturned(spinning) + 0.5 * np.einsum("cba,lkc->lkab", _CROSS, crossed)
        ff = np.einsum("lkab->lakb", dyads)
    return ff


def _crossed(blocks: Mapping[str, Taylor], n: int) -> FloatArray:
    """(n, n, 3) integrals of f_k x f_l, l first."""
    rates, turning = blocks.get("Ge"), blocks["Cr"].m1
    if rates is not None:
        crossed = 0.5 * rates.m0.reshape(n, n, 3)
        return 0.5 * (crossed - crossed.swapaxes(0, 1))
    if turning is None:
        raise ExportError("neither Ge is there nor a term m1 of Cr: gyroscopic forces between modes are not known")
    return 0.5 * (turning - turning.swapaxes(0, 1))


def _same(what: str, found: FloatArray, expected: FloatArray, *, size: FloatArray, tolerance: float) -> None:
    worst = np.abs(found - expected).max(initial=0.0)
    largest = max(np.abs(size).max(initial=0.0), np.abs(expected).max(initial=0.0))
    if worst > tolerance * largest:
        raise ExportError(
            f"{what} contradict each other by {worst / largest:.1e} of their size: other conventions hold in this "
            "file, its nodes have rotary inertia of their own, or its blocks were lumped differently; with a larger "
            "tolerance Ct, Cr and Me, which make the linear motion, are believed"
        )


def stiffening_loads(blocks: Mapping[str, Taylor], ff: FloatArray) -> tuple[list[str], list[FloatArray]]:
    """Names of the loads and their (n, n) stiffness that blocks hold beside the inertia: `GeometricStiffness`."""
    rest = {
        "Ct": blocks["Ct"].m1,
        "Cr": None if blocks["Cr"].m1 is None else 0.5 * (blocks["Cr"].m1 + blocks["Cr"].m1.swapaxes(0, 1)),
    }
    if "Gr" in blocks and blocks["Gr"].m1 is not None and "Oe" in blocks and blocks["Oe"].m1 is not None:
        rest["Oe"] = blocks["Oe"].m1 - _spinning_of_modes(ff)
    names: list[str] = []
    stiffness: list[FloatArray] = []
    for block, K in rest.items():
        size = 0.0 if block == "Ct" else np.abs(ff).max(initial=0.0)
        if K is None or np.abs(K).max(initial=0.0) <= _NO_STIFFENING * size:
            continue
        order = _UNSPUN if block == "Oe" else [0, 1, 2]
        names += [_LOADS[block][k] for k in order]
        stiffness += [0.5 * (K[:, :, k] + K[:, :, k].T) for k in order]
    return names, stiffness
