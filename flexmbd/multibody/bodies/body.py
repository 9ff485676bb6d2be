"""Bodies of a machine: their interface; rigid and reduced ones.

A body is constant data: its mass integrals about its own frame B and, where it is flexible, its
modes.  ``Frame`` is a marker on a body, the thing that joints connect and results are asked of.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from math import isfinite
from pathlib import Path
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmbd.brief import brief
from flexmbd.errors import SceneError
from flexmbd.given import checked, is_number, numbers, refuse_no_name, refuse_no_truth, refuse_other
from flexmbd.multibody.bodies.port import Port
from flexmbd.multibody.bodies.shape import Shape, refuse_no_shape
from flexmbd.multibody.bodies.solid import Solid, principal_axes
from flexmbd.overflow import looked_at
from flexmbd.record.reduced_body import InterfaceFrame, ReducedBody
from flexmbd.rotation import check_rotation

FloatArray = NDArray[np.float64]

_UNIT = np.eye(3)


@dataclass(frozen=True, eq=False)
class Frame:
    """A marker F on a body.

    Attributes:
        body: the body that carries it.
        p_BF_B: (3,) m, position in the undeformed body.
        R_BF: (3, 3) rotation from F's axes to B's.
        modes: (6, n) displacement and small rotation of F in B's axes per unit modal
            coordinate, or None where F does not deform against B. (12, n) on the face of a body with
            `NonlinearStiffness`: then its strain S as well, and F turns by the face's polar rotation.
        label: how messages and plots call it.
        interface: the interface of the body's record whose frame it is; None of other markers.
    """

    body: Body
    p_BF_B: FloatArray
    R_BF: FloatArray
    modes: FloatArray | None
    label: str
    interface: str | None = None

    def __repr__(self) -> str:
        """Its label and place."""
        place = ", ".join(f"{value:.6g}" for value in self.p_BF_B)
        return f"Frame({self.label!r}, p_BF_B=({place}))"


@runtime_checkable
class Body(Protocol):
    """The interface of every kind of body."""

    name: str

    @property
    def mass(self) -> float:
        """Mass (kg)."""

    def moments(self) -> tuple[FloatArray, FloatArray]:
        """First (3,) and second (3, 3) moments of mass about B, in B (kg m, kg m^2)."""

    @property
    def shape(self) -> Shape | None:
        """Its shape in pictures, in body axes; None: its own surface, or symbols."""

    def reduced(self) -> ReducedBody | None:
        """The flexible part, or None for a rigid body."""


def marker(body: Body, p: ArrayLike, R: ArrayLike | None, name: str) -> Frame:
    """A frame of a body called ``name`` at ``p`` (3,) m with axes ``R`` (3, 3), by default the body's.

    Raises:
        SceneError: not three finite numbers, or no rotation.
    """
    label = f"{name}{_place(p)}"
    position = numbers(p)
    if position.shape != (3,) or not np.isfinite(position).all():
        raise SceneError(f"frame {label}: p must be three finite numbers (m), got {p!r}")
    rotation = np.eye(3) if R is None else check_rotation(R, f"frame {label}: R")
    return Frame(body, position.copy(), rotation.copy(), None, label)


def interface_frame(body: Body, record: ReducedBody, interface: InterfaceFrame, label: str) -> Frame:
    """The frame of an interface of a body's record, as a marker."""
    modes = interface.modes if interface.modes.any() else None
    if record.nonlinear is not None and modes is not None:
        modes = np.vstack([modes, record.nonlinear.face_strain[record.interfaces.index(interface)]])
    return Frame(body, interface.p_BI_B, interface.R_BI, modes, label)


def refuse_change(body: object, name: str, fixed: tuple[str, ...]) -> None:
    """Raise SceneError where an attribute out of ``fixed`` of a body that has it already is given anew."""
    if name in fixed and name in vars(body):
        what = getattr(body, "name", "") or "without a name"
        raise SceneError(
            f"{type(body).__name__} {what}: its {name} cannot be changed, as its frames follow from it; make a new body"
        )


@dataclass(eq=False)
class Ground:
    """The inertial frame, as a body that does not move; its ``shape`` is drawn in pictures, as a floor."""

    name: str = "ground"
    mass: float = 0.0
    shape: Shape | None = field(default=None, kw_only=True)

    def __setattr__(self, name: str, value: object) -> None:
        refuse_no_shape(name, value, "the ground")
        super().__setattr__(name, value)

    def frame(self, p: ArrayLike = (0.0, 0.0, 0.0), *, R: ArrayLike | None = None) -> Frame:
        """Return a marker at ``p`` (m) with axes ``R`` (3, 3), both in the inertial frame."""
        return marker(self, p, R, "ground")

    def moments(self) -> tuple[FloatArray, FloatArray]:
        """Zero: the ground takes no part in the dynamics."""
        return np.zeros(3), np.zeros((3, 3))

    def reduced(self) -> None:
        """The ground does not deform."""
        return None


def moments_about_frame(mass: ArrayLike, com: FloatArray, tensor: FloatArray) -> tuple[FloatArray, FloatArray]:
    """First (..., 3) and second moments (..., 3, 3) about a body's frame, by its inertia (..., 3, 3) about its centre.

    Args:
        mass: (...,) kg.
        com: (..., 3) m, its centre of mass.
        tensor: (3, 3) kg m^2.
    """
    m = np.asarray(mass)
    with looked_at():  # the plan refuses what is not finite
        about_centre = 0.5 * tensor.trace() * _UNIT - tensor
        return m[..., None] * com, about_centre + m[..., None, None] * (com[..., :, None] * com[..., None, :])


@dataclass(eq=False)
class RigidBody:
    """A rigid body.

    Attributes may be changed later: a scene takes their values when it is compiled.

    Attributes:
        mass: kg, positive.
        inertia: (3, 3) or its diagonal (3,), kg m^2, about the centre of mass, in body axes.
        com: (3,) m, centre of mass from the body frame, in body axes.
        name: given by ``System.add``.
        shape: drawn in pictures, in body axes; without one they show symbols.
        as_measured: take an inertia that no distribution of mass has, one principal inertia above the sum of the other
            two, as identified from a machine's motions.  It must be positive all the same.

    Raises:
        SceneError: values that no rigid body can have, each named.
    """

    mass: float
    inertia: ArrayLike
    com: Sequence[float] = (0.0, 0.0, 0.0)
    name: str = field(default="", kw_only=True)
    shape: Shape | None = field(default=None, kw_only=True)
    as_measured: bool = field(default=False, kw_only=True)

    def __setattr__(self, name: str, value: object) -> None:
        refuse_no_shape(name, value, "a rigid body")
        super().__setattr__(name, value)

    def __post_init__(self) -> None:
        if self.name != "":
            refuse_no_name(self.name, "a rigid body's name")
        refuse_no_truth(as_measured=self.as_measured)
        self.inertias()

    def inertias(self) -> tuple[FloatArray, FloatArray]:
        """Centre of mass (3,), m, and inertia (3, 3), kg m^2, about it, as they are now.

        Raises:
            SceneError: as for the body.
        """
        com, given = numbers(self.com), numbers(self.inertia)
        is_diagonal = given.shape == (3,)
        tensor = given
        if is_diagonal:
            tensor = np.zeros((3, 3))
            tensor.flat[::4] = given
        faults = []
        if not (is_number(self.mass) and self.mass > 0.0):
            faults.append(f"mass must be positive, got {self.mass!r}")
        if com.shape != (3,) or not all(map(isfinite, map(float, com))):
            faults.append(f"com must be three finite numbers (m), got {self.com!r}")
        if tensor.shape != (3, 3) or not all(map(isfinite, tensor.ravel().tolist())):
            faults.append(f"inertia must be (3,) or (3, 3) and finite, got {self.inertia!r}")
        elif not is_diagonal and np.abs(tensor - tensor.T).max() > 1e-12 * np.abs(tensor).max():
            faults.append("inertia must be symmetric")
        else:
            low, mid, high = sorted(map(float, given if is_diagonal else np.linalg.eigvalsh(tensor)))
            none = low < -1e-12 * high or (self.as_measured and low <= 0.0)
            if none or (low + mid < high * (1.0 - 1e-9) and not self.as_measured):
                faults.append(
                    f"principal inertias {low:.4g}, {mid:.4g}, {high:.4g} kg m^2 belong to no "
                    "body: none may be negative nor exceed the sum of the other two"
                    + ("" if none else "; as_measured=True takes them as they are")
                )
        if faults:
            raise SceneError(f"rigid body{f' {self.name!r}' if self.name else ''}: " + "; ".join(faults))
        return com, tensor

    @classmethod
    @checked()
    def from_solid(cls, solid: Solid) -> RigidBody:
        """A rigid body of a solid's mass and outline, its frame in the axes that the solid was given in."""
        shape = None if solid.outline is None else Shape.of_solid(solid)
        return cls(solid.mass, solid.inertia, tuple(map(float, solid.com)), shape=shape)

    @classmethod
    def from_shape(cls, shape: Shape, *, density: float) -> RigidBody:
        """A homogeneous rigid body of a shape, density kg/m^3, its frame in the shape's axes.

        Raises:
            SceneError: a part of the shape is not closed, or encloses no volume; the message names edges.
        """
        refuse_other(shape, Shape, "shape", wanted="a Shape as fm.Shape.box((0.1, 0.1, 0.1))")
        body = cls.from_solid(shape.solid(density=density))
        body.shape = shape
        return body

    @classmethod
    def from_surface(cls, points: ArrayLike, triangles: ArrayLike, *, density: float) -> RigidBody:
        """The solid inside a closed surface, as a rigid body in the points' axes; see ``Solid.from_surface``."""
        return cls.from_solid(Solid.from_surface(points, triangles, density=density))

    def principal_axes(self) -> tuple[FloatArray, FloatArray]:
        """Principal inertias (3,), kg m^2, ascending, and R_BP (3, 3) from their axes to the body's."""
        return principal_axes(self.inertias()[1])

    def frame(self, p: ArrayLike = (0.0, 0.0, 0.0), *, R: ArrayLike | None = None) -> Frame:
        """Return a marker at ``p`` (m) with axes ``R`` (3, 3), both in body axes."""
        return marker(self, p, R, self.name or "rigid body")

    def moments(self) -> tuple[FloatArray, FloatArray]:
        """First and second moments of mass about the body frame."""
        com, tensor = self.inertias()  # which refuses a mass that is none
        return moments_about_frame(np.float64(self.mass), com, tensor)

    def reduced(self) -> None:
        """A rigid body has no modes."""
        return None


@dataclass(eq=False)
class FlexibleBody:
    """A reduced elastic body in its floating frame.

    Attributes:
        record: the reduced body.
        name: given by ``System.add``.
        shape: drawn in pictures with the body frame, in place of the record's surface.
    """

    record: ReducedBody
    name: str = field(default="", kw_only=True)
    shape: Shape | None = field(default=None, kw_only=True)

    __repr__ = brief

    def __setattr__(self, name: str, value: object) -> None:
        refuse_change(self, name, ("record",))
        refuse_no_shape(name, value, "a flexible body")
        super().__setattr__(name, value)

    def __post_init__(self) -> None:
        refuse_other(self.record, ReducedBody, "a flexible body's record", wanted="a ReducedBody")
        if self.name != "":
            refuse_no_name(self.name, "a flexible body's name")
        self._q: FloatArray | None = None
        self._q_rate: FloatArray | None = None
        self._ports: dict[str, Port] = {}

    @property
    def q(self) -> FloatArray | None:
        """(n,) initial modal coordinates (m kg^(1/2)); None: not set, so zero unless loops cannot close without them.

        Those that are set stay, unless nothing else closes the loops.
        """
        return self._q

    @q.setter
    def q(self, values: ArrayLike) -> None:
        self._q = self._modal(values, "q")

    @property
    def q_rate(self) -> FloatArray | None:
        """(n,) initial rates of the modal coordinates (m kg^(1/2)/s); None: not set, as for ``q``."""
        return self._q_rate

    @q_rate.setter
    def q_rate(self, values: ArrayLike) -> None:
        self._q_rate = self._modal(values, "q_rate")

    def _modal(self, values: ArrayLike, what: str) -> FloatArray:
        vector = numbers(values).copy()
        if vector.shape != (self.record.n_modes,) or not np.isfinite(vector).all():
            label = f"flexible body {self.name!r}" if self.name else "flexible body"
            raise SceneError(
                f"{label}: {what} takes {self.record.n_modes} finite number(s), one a mode, got {values!r}"
            )
        return vector

    @property
    def mass(self) -> float:
        """Mass (kg)."""
        return self.record.mass

    def frame(self, name: str | None = None) -> Frame:
        """Return the interface frame ``name``, or the body frame without one.

        Raises:
            InterfaceError: no interface has that name; the message lists those there are.
        """
        label = self.name or "flexible body"
        if name is None:
            return Frame(self, np.zeros(3), np.eye(3), None, label)
        interface = self.record.interface(name)
        return replace(interface_frame(self, self.record, interface, f"{label}.{name}"), interface=name)

    def port(self, name: str) -> Port:
        """The port ``name`` of the record: an electrode, whose voltage is given and whose charge is asked for.

        Raises:
            SceneError: the body has no such port; the message lists those there are.
        """
        refuse_no_name(name, "the name of a port")
        if self.record.ports is None:
            raise SceneError(
                f"body {self.name!r} has no ports; they are electrodes of the model that was reduced: "
                f'ContinuumModel(..., conditions=[Electrode("top")])'
            )
        if name not in self._ports:
            self._ports[name] = Port(self, self.record.ports, name)
        return self._ports[name]

    def show(
        self,
        *,
        mode: int | None = None,
        amplitude: float = 0.1,
        path: str | Path | None = None,
        size: tuple[int, int] = (1280, 720),
        view: ArrayLike | None = None,
    ) -> Path | None:
        """Show the body or one of its modes; see ``ReducedBody.show``, with the same errors."""
        return self.record.show(mode=mode, amplitude=amplitude, path=path, size=size, view=view)

    def moments(self) -> tuple[FloatArray, FloatArray]:
        """First and second moments of mass of the undeformed body about the body frame."""
        gram = self.record.gram
        return gram[0, 1:4].copy(), gram[1:4, 1:4].copy()

    def reduced(self) -> ReducedBody:
        """The record."""
        return self.record


def _place(p: ArrayLike) -> str:
    values = numbers(p).ravel()
    return "" if not values.any() else "(" + ", ".join(f"{v:g}" for v in values) + ")"
