"""Homogeneous deformation F = R U: polar decomposition, energies W(F), and the record of the six stretches.

A body that deforms homogeneously moves by x = r + F (X - C) (Zienkiewicz, Taylor & Fox, eq. 8.1); with the polar
decomposition F = R U (eq. 8.3) and U = 1 + H this is the floating frame formulation, exactly: the body frame turns with
R, and the symmetric H = sum_k q_k H_k are six modes, linear in the position.  Their mass integrals follow from Euler's
tensor J of the solid, M_jk = tr(H_j J H_k).  St Venant-Kirchhoff's energy is a quadratic form in the Green-Lagrange
strain E = H + H^2 / 2, itself quadratic in q: the stretch of a reduced body's modes (`ModalStretch`) has just this
form, so that it is exact as well, for any size of H.
"""

from __future__ import annotations

import ctypes
from dataclasses import dataclass, field
from typing import Any, Protocol, runtime_checkable

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from flexmbd.errors import SceneError
from flexmbd.given import is_number, numbers, shaped_numbers
from flexmbd.multibody.bodies.solid import Solid
from flexmbd.overflow import looked_at
from flexmbd.record.reduced_body import ModalStretch, ReducedBody
from flexmbd.round_off import TEN_DIGITS

FloatArray = NDArray[np.float64]

#: Names of the components of a symmetric tensor, as in the record's partition.
STRETCHES = ("U_xx", "U_yy", "U_zz", "U_yz", "U_xz", "U_xy")
_PAIRS = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))



def symmetric_basis() -> FloatArray:
    """(6, 3, 3): unit changes of the components of ``STRETCHES``."""
    basis = np.zeros((6, 3, 3))
    for k, (i, j) in enumerate(_PAIRS):
        basis[k, i, j] = basis[k, j, i] = 1.0
    return basis


def polar(F: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Rotations R (..., 3, 3) and stretches U (..., 3, 3), symmetric and positive, with F = R U (eq. 8.3).

    Raises:
        SceneError: not finite, not of shape (..., 3, 3), or det F <= 0, which no deformation of a body has.
    """
    f = numbers(F)
    if f.shape[-2:] != (3, 3) or not np.isfinite(f).all():
        raise SceneError(f"a deformation gradient must be finite numbers of shape (..., 3, 3), got shape {f.shape}")
    least = np.linalg.det(f).min(initial=np.inf)
    if least <= 0.0:
        raise SceneError(f"det F = {least:.6g} must be positive: F turns the body inside out or presses it flat")
    left, size, right = np.linalg.svd(f)
    U = np.einsum("...ji,...j,...jk->...ik", right, size, right)
    return left @ right, U


@runtime_checkable
class HomogeneousEnergy(Protocol):
    """A strain energy per initial volume as a function of the deformation gradient."""

    def record(self, solid: Solid) -> ReducedBody:
        """The record of a solid's six stretches, in normal form.

        Raises:
            SceneError: the body is not stiff against every stretch.
        """

    @property
    def address(self) -> int:
        """Of a C function that adds to the record's energy what it does not have; 0 where that has all."""


@dataclass(frozen=True)
class StVenantKirchhoff:
    """W = lambda / 2 tr(E)^2 + mu E : E with E = (F^T F - 1) / 2, compiled into the machine.

    Attributes:
        E: Young's modulus, Pa, positive.
        nu: Poisson's ratio, between -1 and 0.5.

    Raises:
        SceneError: values that no stable material has.
    """

    E: float
    nu: float

    def __post_init__(self) -> None:
        if not (is_number(self.E) and self.E > 0.0):
            raise SceneError(f"St Venant-Kirchhoff: E must be positive (Pa), got {self.E}")
        if not (is_number(self.nu) and -1.0 < self.nu < 0.5):
            raise SceneError(f"St Venant-Kirchhoff: nu must lie between -1 and 0.5, got {self.nu}")

    @property
    def lame(self) -> tuple[float, float]:
        """lambda and mu (Pa)."""
        return self.E * self.nu / ((1 + self.nu) * (1 - 2 * self.nu)), self.E / (2 * (1 + self.nu))

    @property
    def address(self) -> int:
        """None: the record has all."""
        return 0

    def record(self, solid: Solid) -> ReducedBody:
        """Six modes, each a strain to which its part of the Green-Lagrange strain belongs."""
        basis = symmetric_basis()
        stress = self._stress(basis)
        k, modes = _normal(solid, solid.volume * np.einsum("iab,jab->ij", stress, basis))
        # V stress(H_k) : (H_i H_j + H_j H_i) / 2, of modes of the same energy
        product = np.einsum("iab,jbc->ijac", modes, modes)
        P = solid.volume * np.einsum("kac,ijac->kij", self._stress(modes), product)
        size = np.sqrt(k)
        stretch = ModalStretch(np.diag(size), 0.5 * (P + P.transpose(0, 2, 1)) / size[:, None, None])
        return _record(solid, k, modes, stretch, "St Venant-Kirchhoff")

    def _stress(self, strain: FloatArray) -> FloatArray:
        """(..., 3, 3) Pa, lambda tr(E) 1 + 2 mu E."""
        lam, mu = self.lame
        trace = np.trace(strain, axis1=-2, axis2=-1)[..., None, None]
        with looked_at():  # _normal refuses what is not finite
            return np.asarray(lam * trace * np.eye(3) + 2.0 * mu * strain)


@dataclass(frozen=True, eq=False)
class CompiledEnergy:
    """A strain energy W(F) per initial volume behind the address of a C function.

    The function is void f(double *out, const double *w, const double *F, const double *x, const int *e, const uint8_t
    *p, void *c), of which out and F are used: F (3, 3) row by row; out gets W (J/m^3), dW/dF (9) and its derivative
    (81), Pa, added to zeros.  ``flexmbd.continuum.finite_elements.homogeneous_energy`` makes one of UFL.

    Attributes:
        address: of the function.
        name: in messages.
        keep: what must live as long as the function does.

    Raises:
        SceneError: the values at F = 1 are not finite, or W changes as the body turns.
    """

    address: int
    name: str
    keep: object = field(default=None, repr=False)

    def __post_init__(self) -> None:
        at_rest = self.evaluate(np.eye(3))
        if not all(np.isfinite(part).all() for part in at_rest):
            raise SceneError(f"energy {self.name}: W or its derivatives are not finite at F = 1")
        U = np.array([[1.1, 0.05, -0.02], [0.05, 0.95, 0.03], [-0.02, 0.03, 1.02]])
        R = polar(np.array([[0.6, -0.7, 0.1], [0.8, 0.5, -0.3], [0.2, 0.4, 0.9]]))[0]
        still, turned = self.evaluate(U)[1], self.evaluate(R @ U)[1]
        if not abs(R.T @ turned - still).max() <= TEN_DIGITS * (abs(still).max() + abs(at_rest[1]).max()):
            raise SceneError(f"energy {self.name}: it changes as the body turns; W(R F) must be W(F)")

    def __deepcopy__(self, memo: object) -> CompiledEnergy:
        """Itself: it never changes."""
        return self

    def __reduce__(self) -> tuple[Any, ...]:
        """Raise SceneError: the function is code of this process."""
        raise SceneError(
            f"energy {self.name} is compiled for this process and cannot be pickled; pickle the arrays of a result, or "
            "copy it with copy.deepcopy"
        )

    def evaluate(self, F: ArrayLike) -> tuple[float, FloatArray, FloatArray]:
        """W (J/m^3), dW/dF (3, 3) and its derivative (3, 3, 3, 3), Pa, at F (3, 3).

        Raises:
            SceneError: F is not (3, 3) finite numbers.
        """
        f, out, none = np.array(shaped_numbers(F, (3, 3), "F"), order="C"), np.zeros(91), np.zeros(12)
        call = ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * 7)(self.address)
        call(out.ctypes.data, None, f.ctypes.data, none.ctypes.data, None, None, None)
        return float(out[0]), out[1:10].reshape(3, 3).copy(), out[10:].reshape(3, 3, 3, 3).copy()

    def record(self, solid: Solid) -> ReducedBody:
        """Six modes with the stiffness at F = 1; the machine adds the rest of the energy."""
        basis = symmetric_basis()
        tangent = self.evaluate(np.eye(3))[2]
        stiffness = solid.volume * np.einsum("iab,abcd,jcd->ij", basis, tangent, basis)
        try:
            k, modes = _normal(solid, 0.5 * (stiffness + stiffness.T))
        except SceneError as reason:
            raise SceneError(f"energy {self.name}: {reason}") from reason
        return _record(solid, k, modes, None, self.name)


def mode_tensors(record: ReducedBody) -> FloatArray:
    """(6, 3, 3) the modes H_k of a record of stretches, kg^(-1/2)/m: H = sum q_k H_k."""
    return np.einsum("ck,cab->kab", record.partition, symmetric_basis())


def _normal(solid: Solid, stiffness: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Eigenvalues (6,), ascending, and modes H_k (6, 3, 3), for a stiffness (6, 6) in the symmetric basis."""
    basis = symmetric_basis()
    mass = np.einsum("iab,bc,jac->ij", basis, solid.second, basis)
    if not (np.isfinite(stiffness).all() and np.isfinite(mass).all()):
        raise SceneError("the body's stiffness or its second moments of mass are beyond what numbers hold")
    try:
        k, x = scipy.linalg.eigh(stiffness, mass)
    except scipy.linalg.LinAlgError as error:
        raise SceneError(f"the body's stiffness or its second moments of mass make no sense: {error}") from error
    if not np.isfinite(k).all():
        raise SceneError("the body's stiffness over its second moments of mass is beyond what numbers hold")
    if not k[0] > 0.0:
        raise SceneError(f"a body must be stiff against every stretch; the least squared frequency is {k[0]:.3g} 1/s^2")
    x *= np.sign(x[abs(x).argmax(axis=0), np.arange(6)])
    return k, np.einsum("ck,cab->kab", x, basis)


def _record(
    solid: Solid, k: FloatArray, modes: FloatArray, stretch: ModalStretch | None, name: str
) -> ReducedBody:
    """The record of modes H_k (X - C)."""
    gram = np.zeros((22, 22))
    gram[0, 0] = solid.mass
    gram[0, 1:4] = gram[1:4, 0] = solid.mass * solid.com
    gram[1:4, 1:4] = solid.second + solid.mass * np.outer(solid.com, solid.com)
    moved = modes @ solid.second  # integral of rho (H_k Y) Y^T
    gram[4:, 1:4] = moved.reshape(18, 3)
    gram[1:4, 4:] = gram[4:, 1:4].T
    pairs = np.einsum("iab,jcb->iajc", moved, modes).reshape(18, 18)
    gram[4:, 4:] = 0.5 * (pairs + pairs.T)
    partition = np.array([[mode[i, j] for mode in modes] for i, j in _PAIRS])
    return ReducedBody(
        gram=gram,
        stiffness=k,
        damping=np.zeros((6, 6)),
        interfaces=(),
        frame=None,
        partition=partition,
        partition_names=STRETCHES,
        provenance={"form": "homogeneous deformation", "energy": name},
        stretch=stretch,
    )
