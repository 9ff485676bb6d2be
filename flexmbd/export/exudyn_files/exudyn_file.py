"""Reduced bodies for Exudyn (.npz of its ObjectFFRFreducedOrderInterface), and back.

Exudyn takes a body's inertia as arrays that are linear in the Gram matrix, and knows mesh nodes by their
displacements alone.  So a frame is told by four nodes without mass, on the corners of a tetrahedron about its
origin, that move as the rigid frame does: their mean is the origin, and their rotation the frame's.  One more
node moves as the centre of mass does; there weight acts as on the bent body.  See docs/export/exudyn.md.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import ExportError
from flexmbd.export.loss import Capabilities, check_body, check_losses, checked_writer
from flexmbd.files.archive import write_archive
from flexmbd.record.groups import FloatArray, InterfaceFrame
from flexmbd.record.point_masses import point_masses
from flexmbd.record.reduced_body import ReducedBody
from flexmbd.round_off import EQUAL

CAPABILITIES = Capabilities(damping=False, nodes=True)

#: What every such file holds; the keys that begin with "flexmbd " are ours, and Exudyn passes over them.
TYPE = "ObjectFFRFreducedOrderInterface"
_TETRAHEDRON = np.array([[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]])
# Exudyn rounds off what is smaller, relative to the largest entry of the reduced mass.
_NOISE = 1e-13


@dataclass(frozen=True)
class Rayleigh:
    """Damping a M + b K: `mass` a (1/s), `stiffness` b (s)."""

    mass: float
    stiffness: float


@checked_writer
def exudyn(body: ReducedBody, path: str | Path, *, lossy: bool = False) -> tuple[str, ...]:
    """Write a file that Exudyn's ``ObjectFFRFreducedOrderInterface.LoadFromFile`` reads. Not collective.

    The nodes are those of the mesh where the body has its group ``modes``, else fictitious ones of equal mass;
    then four a frame, one at the centre of mass, and the surface's vertices where they are not nodes.  No pickles.

    Args:
        body: an elastic body.
        path: destination, as a rule `*.npz`; Exudyn wants that ending.
        lossy: write although the damping is not a M + b K, which is all that Exudyn's loader applies.

    Returns:
        What Exudyn does not get from the file, a phrase each.

    Raises:
        ExportError: the body has no modes or no mass; its damping would be lost; the destination cannot be written.
    """
    check_body(body)
    arrays = exudyn_arrays(body)
    rayleigh = rayleigh_damping(body)
    losses = check_losses(
        body, replace(CAPABILITIES, damping=rayleigh is not None), kind="Exudyn's file of a reduced body", lossy=lossy
    )
    write_archive(path, arrays)
    if rayleigh is not None and (rayleigh.mass or rayleigh.stiffness):
        hint = f"massProportionalDamping={rayleigh.mass!r}, stiffnessProportionalDamping={rayleigh.stiffness!r}"
        losses += (f"the damping, unless Exudyn is told {hint}",)
    return losses


def rayleigh_damping(body: ReducedBody) -> Rayleigh | None:
    """The a and b of a damping matrix a M + b K; None where it is of another kind; n > 0."""
    n = body.n_modes
    columns = np.column_stack([np.ones(n), body.stiffness])
    scale = columns.max(axis=0)
    factors = np.linalg.lstsq(columns / scale, np.diag(body.damping), rcond=None)[0] / scale
    found = Rayleigh(*(float(factor) for factor in factors))
    rest = body.damping - np.diag(found.mass + found.stiffness * body.stiffness)
    return found if np.abs(rest).max() <= EQUAL * np.abs(body.damping).max() else None


def exudyn_arrays(body: ReducedBody) -> dict[str, Any]:
    """The members of the file by name.

    Raises:
        ExportError: the body has no modes or no mass.
    """
    n = body.n_modes
    if n == 0 or not body.mass > 0.0:
        raise ExportError(
            f"Exudyn's reduced bodies have modes and mass; this one has {n} modes and {body.mass:g} kg: make a rigid "
            "body there of its mass, centre and inertia"
        )
    nodes = _Nodes.of(body)
    return {
        "modeBasis": nodes.phi.reshape(-1, n),
        "xRef": nodes.x.ravel(),
        "trigList": nodes.triangles,
        # a text in which no 'matrix' is found, as in the empty dictionary that would need a pickle
        "postProcessingModes": np.array(""),
        "stiffnessMatrixReduced": np.diag(body.stiffness),
        "infoList": np.array([n, len(nodes.x), 3, 4, 7, 7 + n]),
        "rigidBodyNodeType": np.array("NodeType.RotationEulerParameters"),
        "fileVersion": np.array(1),
        "type": np.array(TYPE),
        **_inertia(body),
        "flexmbd masses": np.array(nodes.masses),
        "flexmbd mesh nodes": nodes.numbers,
        "flexmbd centre": np.array(nodes.centre),
        "flexmbd interface names": np.array([frame.name for frame in body.interfaces], dtype=str),
        "flexmbd interface nodes": nodes.frames,
        "flexmbd interface axes": np.reshape([frame.R_BI for frame in body.interfaces], (-1, 3, 3)),
        "flexmbd frame": np.array(body.frame or ""),
        "flexmbd damping": body.damping,
        "flexmbd partition": body.partition,
        "flexmbd partition names": np.array(body.partition_names, dtype=str),
        "flexmbd mesh position": body.p_MB_M,
        "flexmbd mesh axes": body.R_MB,
    }


def _inertia(body: ReducedBody) -> dict[str, FloatArray]:
    """Exudyn's inertia arrays: where a b' has the integral S, tilde(a)' tilde(b) has tr(S) 1 - S'."""
    n = body.n_modes
    mass = body.modal_mass()
    mass = np.where(np.abs(mass) < _NOISE * np.abs(mass).max(), 0.0, mass)
    linear = body.gram[0, 4:].reshape(n, 3)
    x_x = body.gram[1:4, 1:4]
    x_phi = body.gram[1:4, 4:].reshape(3, n, 3).swapaxes(0, 1)
    phi_phi = body.gram[4:, 4:].reshape(n, 3, n, 3).swapaxes(1, 2)
    return {
        "massMatrixReduced": mass,
        "totalMass": np.array(body.mass),
        "Mtt": body.mass * np.eye(3),
        "chiU": body.com,
        "chiUtilde": _skew(body.com),
        "inertiaLocal": _tilde_tilde(x_x),
        "mPhitTPsi": linear.T.copy(),
        "mPhitTPsiTilde": np.hstack(list(_skew(linear))),
        "mXRefTildePsi": _tilde(x_phi).T,
        "mXRefTildePsiTilde": np.hstack(list(_tilde_tilde(x_phi))),
        "mPsiTildePsi": _tilde(phi_phi).swapaxes(1, 2).reshape(3 * n, n),
        "mPsiTildePsiTilde": np.block([list(row) for row in _tilde_tilde(phi_phi)]),
    }


def _tilde(products: FloatArray) -> FloatArray:
    """(..., 3) integrals of tilde(a)' b = -a x b of the integrals (..., 3, 3) of a b'."""
    return np.stack([products[..., j, i] - products[..., i, j] for i, j in ((1, 2), (2, 0), (0, 1))], axis=-1)


def _tilde_tilde(products: FloatArray) -> FloatArray:
    """(..., 3, 3) integrals of tilde(a)' tilde(b) of the integrals (..., 3, 3) of a b'."""
    trace = np.trace(products, axis1=-2, axis2=-1)
    return trace[..., None, None] * np.eye(3) - np.swapaxes(products, -1, -2)


def _skew(v: FloatArray) -> FloatArray:
    """(..., 3, 3) matrices of v x."""
    out = np.zeros((*v.shape, 3))
    out[..., 0, 1], out[..., 0, 2], out[..., 1, 2] = -v[..., 2], v[..., 1], -v[..., 0]
    return out - np.swapaxes(out, -1, -2)


@dataclass(frozen=True, eq=False)
class _Nodes:
    """All nodes of a file: the first `masses` carry it, the others only move.

    Attributes:
        x: (k, 3) m, in B.
        phi: (k, 3, n) per mode.
        masses: number of the nodes that carry the mass.
        numbers: (masses,) of the mesh; empty where they are fictitious.
        frames: (b, 4) nodes of each frame.
        centre: node of the centre of mass.
        triangles: (t, 3) nodes of the surface.
    """

    x: FloatArray
    phi: FloatArray
    masses: int
    numbers: NDArray[np.int64]
    frames: NDArray[np.int64]
    centre: int
    triangles: NDArray[np.int64]

    @classmethod
    def of(cls, body: ReducedBody) -> _Nodes:
        if body.modes is not None:
            x, phi, numbers = body.modes.x, body.modes.phi, body.modes.node
        else:
            points = point_masses(body)
            x, phi, numbers = points.x, points.phi, np.zeros(0, dtype=np.int64)
        masses = len(x)
        size = np.sqrt(np.trace(body.inertia) / body.mass)
        corners = [_corners(frame, 0.02 * size) for frame in body.interfaces]
        xs = [x, *(corner[0] for corner in corners), body.com[None]]
        centre = (body.gram[0, 4:] / body.mass).reshape(1, -1, 3).swapaxes(1, 2)
        phis = [phi, *(corner[1] for corner in corners), centre]
        frames: NDArray[np.int64] = masses + np.arange(4 * len(corners)).reshape(-1, 4)
        triangles: NDArray[np.int64] = np.zeros((0, 3), dtype=np.int64)
        if body.surface is not None:
            known = np.column_stack([x, phi.reshape(masses, -1)])
            rows = np.column_stack([body.surface.x, body.surface.phi.reshape(len(body.surface.x), -1)])
            vertex, new = _places(known, rows, following=masses + 4 * len(corners) + 1)
            triangles = vertex[body.surface.triangle]
            xs.append(body.surface.x[new])
            phis.append(body.surface.phi[new])
        return cls(
            np.concatenate(xs), np.concatenate(phis), masses, numbers, frames, masses + frames.size, triangles
        )  # fmt: skip


def _corners(frame: InterfaceFrame, size: float) -> tuple[FloatArray, FloatArray]:
    """Four points that move with a frame as a rigid body does, (4, 3) m and (4, 3, n)."""
    arms = size * _TETRAHEDRON / np.sqrt(3.0)
    phi = frame.modes[:3] - _skew(arms) @ frame.modes[3:]
    return frame.p_BI_B + arms, phi


def _places(known: FloatArray, rows: FloatArray, *, following: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Where each row stands among the known ones, or behind them from `following` on; and which rows those are."""
    places = {row.tobytes(): number for number, row in enumerate(known)}
    found = [places.get(row.tobytes()) for row in rows]
    new = np.array([i for i, place in enumerate(found) if place is None], dtype=np.int64)
    behind = iter(range(following, following + len(new)))
    return np.array([next(behind) if place is None else place for place in found], dtype=np.int64), new
