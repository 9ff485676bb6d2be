"""Pseudo-rigid bodies: a homogeneous deformation besides the motion of a rigid body."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmbd.brief import brief
from flexmbd.errors import SceneError
from flexmbd.given import checked, is_number, numbers, refuse_no_truth
from flexmbd.multibody.bodies.body import Frame, marker, refuse_change
from flexmbd.multibody.bodies.homogeneous import HomogeneousEnergy, mode_tensors
from flexmbd.multibody.bodies.shape import Shape, refuse_no_shape
from flexmbd.multibody.bodies.solid import Solid
from flexmbd.overflow import looked_at
from flexmbd.record.reduced_body import ReducedBody, Surface
from flexmbd.round_off import EQUAL

FloatArray = NDArray[np.float64]


@checked("solid", "material", "name")
@dataclass(eq=False)
class PseudoRigidBody:
    """A body that moves by x = r + F (X - C), F(t) the same throughout (Zienkiewicz, Taylor & Fox, eq. 8.1-8.2).

    By the polar decomposition F = R U it turns with its body frame by R and stretches by U, symmetric and positive; the
    machine's coordinates are the frame's, and six modal ones of U - 1.

    Attributes:
        solid: its mass integrals; its axes are the body's.
        material: ``StVenantKirchhoff``, or a ``CompiledEnergy``.
        damping: modal damping ratio of the stretches about F = 1, the same for all; 0 for none.
        rigid: hold all stretches at one, exactly (eq. 8.4-8.5): what remains is a rigid body.
        stretch: (3, 3) U at the start, in body axes.
        stretch_rate: (3, 3) 1/s, its rate at the start, symmetric.
        name: given by ``System.add``.
        shape: what pictures show, deforming as the body does, in place of the solid's outline.

    Raises:
        SceneError: a stretch that is not symmetric and positive definite, a rate that is not symmetric, either of them
            with ``rigid``, a negative damping, or a material that is not stiff against every stretch.
    """

    solid: Solid
    material: HomogeneousEnergy
    damping: float = field(default=0.0, kw_only=True)
    rigid: bool = field(default=False, kw_only=True)
    stretch: ArrayLike = field(default_factory=lambda: np.eye(3), kw_only=True)
    stretch_rate: ArrayLike = field(default_factory=lambda: np.zeros((3, 3)), kw_only=True)
    name: str = field(default="", kw_only=True)
    shape: Shape | None = field(default=None, kw_only=True)

    __repr__ = brief

    def __setattr__(self, name: str, value: object) -> None:
        refuse_change(self, name, ("solid", "material", "damping", "rigid"))
        refuse_no_shape(name, value, "a pseudo-rigid body")
        super().__setattr__(name, value)

    def __post_init__(self) -> None:
        if not (is_number(self.damping) and self.damping >= 0.0):
            raise SceneError(f"pseudo-rigid body: damping must not be negative, got {self.damping}")
        refuse_no_truth(rigid=self.rigid)
        self._record = _damped(self.material.record(self.solid), self.damping)
        self.start()

    @property
    def mass(self) -> float:
        """Mass (kg)."""
        return self.solid.mass

    @cached_property
    def modes(self) -> FloatArray:
        """(6, 3, 3) the modes H_k, symmetric, kg^(-1/2)/m: U = 1 + sum q_k H_k."""
        return mode_tensors(self._record)

    def frame(self, p: ArrayLike = (0.0, 0.0, 0.0), *, R: ArrayLike | None = None) -> Frame:
        """Return a marker at the material point ``p`` (m) with axes ``R`` (3, 3), both in the undeformed body's axes.

        Its origin goes with the deformation, as the material does; its axes turn with the body frame, that is by the
        rotation R of F = R U, and not by the stretch.
        """
        found = marker(self, p, R, self.name or "pseudo-rigid body")
        arm = found.p_BF_B - self.solid.com
        if self.rigid or not arm.any():
            return found
        with looked_at():
            rows = np.vstack([(self.modes @ arm).T, np.zeros((3, 6))])
        if not np.isfinite(rows).all():
            raise SceneError(f"{found.label}: a frame at p = {found.p_BF_B} is so far away that motions there overflow")
        return Frame(self, found.p_BF_B, found.R_BF, rows, found.label)

    def moments(self) -> tuple[FloatArray, FloatArray]:
        """First and second moments of mass of the undeformed body about the body frame."""
        com = self.solid.com
        return self.mass * com, self.solid.second + self.mass * np.outer(com, com)

    def reduced(self) -> ReducedBody | None:
        """The record of the stretches; None where they are held."""
        return None if self.rigid else self._record

    @property
    def surface(self) -> Surface | None:
        """The shape or the solid's outline with the stretches' displacements, for pictures; where held without any."""
        if self.shape is not None:
            x, triangles = self.shape.points, self.shape.triangles
        elif self.solid.outline is not None:
            x, triangles = self.solid.outline.x, self.solid.outline.triangles
        else:
            return None
        phi = np.einsum("kab,vb->vak", self.modes[:0] if self.rigid else self.modes, x - self.solid.com)
        return Surface(x, triangles, phi)

    @checked()
    def stretch_of(self, q: ArrayLike) -> FloatArray:
        """U (..., 3, 3), in body axes, of modal coordinates (..., 6)."""
        if np.shape(q)[-1:] != (len(self.modes),):
            raise SceneError(f"q must be modal coordinates (..., {len(self.modes)}), got shape {np.shape(q)}")
        return np.asarray(np.eye(3) + np.tensordot(np.asarray(q, np.float64), self.modes, axes=1))

    @checked()
    def coordinates_of(self, stretch: ArrayLike) -> FloatArray:
        """Modal coordinates (..., 6) of stretches U (..., 3, 3); of a rate of U those of U plus one."""
        U = np.asarray(stretch, dtype=np.float64)
        if U.shape[-2:] != (3, 3):
            raise SceneError(f"stretch must be of shape (..., 3, 3), got {U.shape}")
        H = U - np.eye(3)
        # M_qq = 1: q_k = tr(H_k J H)
        return np.asarray(np.einsum("kab,bc,...ac->...k", self.modes, self.solid.second, H))

    def start(self) -> tuple[FloatArray, FloatArray]:
        """Modal coordinates (6,) and their rates at the start.

        Raises:
            SceneError: as for the body.
        """
        label = f"pseudo-rigid body {self.name!r}" if self.name else "pseudo-rigid body"
        U, rate = (numbers(values) for values in (self.stretch, self.stretch_rate))
        for what, values in (("stretch", U), ("stretch_rate", rate)):
            if values.shape != (3, 3) or not np.isfinite(values).all():
                raise SceneError(f"{label}: {what} must be finite numbers of shape (3, 3), got {values!r}")
            if abs(values - values.T).max() > EQUAL * abs(values).max():
                raise SceneError(f"{label}: {what} must be symmetric; of a deformation gradient take fm.polar(F)[1]")
        least = np.linalg.eigvalsh(U)[0]
        if least <= 0.0:
            raise SceneError(f"{label}: stretch must be positive definite (det F > 0), its least value is {least:.6g}")
        if self.rigid and (abs(U - np.eye(3)).max() > 0.0 or rate.any()):
            raise SceneError(f"{label}: it is rigid, so that stretch must be one and stretch_rate zero")
        return self.coordinates_of(U), self.coordinates_of(np.eye(3) + rate)


def _damped(record: ReducedBody, ratio: float) -> ReducedBody:
    if ratio == 0.0:
        return record
    return replace(record, damping=np.diag(2.0 * ratio * np.sqrt(record.stiffness)))
