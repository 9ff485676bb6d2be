"""Rigid interface frames as the machine sees them: which a body has, the mass that moves with each, and their paths.

The nodes on an interface and the rigid part there have one constant mass matrix, about the interface's origin
(Ambrosio & Nikravesh 1992, eq. 47-51, 56).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from flexmbd.continuum.finite_elements.interface import FoundInterface, RigidInterface
from flexmbd.errors import InterfaceError
from flexmbd.multibody.bodies.body import RigidBody
from flexmbd.multibody.bodies.continuum_body import FrameMotion, InteriorFrame

FloatArray = NDArray[np.float64]

# Inertia about an axis, relative to that about all, below which there is none.
_NO_INERTIA = 1e-9


def check_frames(
    interfaces: Sequence[FoundInterface], rigid_parts: Mapping[str, RigidBody], *, may_average: bool = False
) -> None:
    """Refuse interfaces that cannot be frames in a machine, or rigid parts without one. Not collective.

    Raises:
        InterfaceError: no interface, a rigid part of another name, or an averaged one where none may be.
    """
    names = [found.name for found in interfaces]
    averaged = [found.name for found in interfaces if not isinstance(found, RigidInterface)]
    if averaged and not may_average:
        raise InterfaceError(
            f"interfaces {averaged} are averaged: a body that steps explicitly needs Coupling.RIGID; a body that is "
            "solved for (ImplicitContinuum) may have them"
        )
    if not names or not set(rigid_parts) <= set(names):
        raise InterfaceError(
            f"rigid parts {sorted(rigid_parts)} on interfaces {names}: a body in a machine needs an interface, and a "
            "rigid part the name of one"
        )


def mass_of_points(masses: FloatArray, arms: FloatArray) -> FloatArray:
    """(6, 6) rigid mass matrix of masses (n,) kg at arms (n, 3) m from the origin, in the arms' axes."""
    return _rigid_mass(float(masses.sum()), masses @ arms, (masses[:, None] * arms).T @ arms)


def mass_of_part(part: RigidBody, R: FloatArray) -> FloatArray:
    """(6, 6) mass matrix of a rigid part about the interface's origin, in the axes that R (3, 3) turns its to."""
    first, second = part.moments()
    return _rigid_mass(part.mass, R @ first, R @ second @ R.T)


def interface_frame(found: FoundInterface, mass: FloatArray) -> InteriorFrame:
    """An interface as a frame with its mass. Not collective.

    Args:
        found: the interface.
        mass: (6, 6) of all that moves with it, about its origin, in the mesh's axes.

    Raises:
        InterfaceError: that mass has no inertia about an axis.
    """
    m, R = float(mass[0, 0]), found.R
    s = mass[3:, :3] / m
    com = np.array([s[2, 1], s[0, 2], s[1, 0]])
    inertia = R.T @ (mass[3:, 3:] + m * s @ s) @ R
    inertia = (inertia + inertia.T) / 2
    if np.linalg.eigvalsh(inertia)[0] <= _NO_INERTIA * np.trace(inertia):
        raise InterfaceError(
            f"interface {found.name!r}: its frame has no inertia about an axis; give it a rigid part, take more "
            "nodes, or lump the rotations"
        )
    return InteriorFrame(found.name, found.p, R, m, R.T @ com, inertia)


def path_of_frames(start: FrameMotion, end: FrameMotion, *, h: float, steps: int) -> Iterator[FrameMotion]:
    """The frames at the ends of equal parts of a step h (s), carried there with constant accelerations.

    Their positions and rotations; the rest is as at the end of the whole step.
    """
    a = 2.0 * (end.p - start.p - h * start.v) / h**2
    turn = Rotation.from_matrix(end.R @ start.R.transpose(0, 2, 1)).as_rotvec()
    alpha = 2.0 * (turn - h * start.w) / h**2
    for i in range(1, steps):
        s = i * (h / steps)
        turned = Rotation.from_rotvec(s * start.w + s * s / 2 * alpha).as_matrix() @ start.R
        yield end._replace(p=start.p + s * start.v + s * s / 2 * a, R=turned)
    yield end


def _rigid_mass(m: float, first: FloatArray, second: FloatArray) -> FloatArray:
    mass = np.zeros((6, 6))
    mass[:3, :3] = m * np.eye(3)
    mass[3:, :3] = [[0.0, -first[2], first[1]], [first[2], 0.0, -first[0]], [-first[1], first[0], 0.0]]
    mass[:3, 3:] = mass[3:, :3].T
    mass[3:, 3:] = np.trace(second) * np.eye(3) - second
    return mass
