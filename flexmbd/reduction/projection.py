"""From a basis of displacement shapes to the record of a reduced body."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from dolfinx import fem

from flexmbd.continuum import parallel
from flexmbd.continuum.blocks import FloatArray, inner, symmetric
from flexmbd.continuum.inertia import gram_matrix
from flexmbd.continuum.interface import RigidInterface
from flexmbd.continuum.model import ContinuumModel
from flexmbd.errors import ReductionError
from flexmbd.reduced import FRAME_DOFS, InterfaceFrame, ReducedBody
from flexmbd.reduction.normal_form import normal_form
from flexmbd.reduction.optional_groups import nodal_group, surface_group
from flexmbd.reduction.signs import determined_rotation

# Bound on what should vanish in the reduced matrices, relative to the diagonal.
_ORTHONORMAL = 1e-8


@dataclass(frozen=True, eq=False)
class Basis:
    """A Craig-Bampton basis in its own coordinates.

    Attributes:
        frame: the interface that carries the body frame; every shape vanishes there.
        moving: the other interfaces, six static shapes each, in B's axes.
        shapes: (owned dofs, n) static shapes, then fixed-interface modes, in the mesh's axes.
        forces: (owned dofs, n) K times the shapes.
        eigenvalues: (n - 6 moving,) of the fixed-interface modes, 1/s^2.
        projections: (n, fields) shapes^T M w for the rule of the signs.
    """

    frame: RigidInterface
    moving: tuple[RigidInterface, ...]
    shapes: FloatArray
    forces: FloatArray
    eigenvalues: FloatArray
    projections: FloatArray

    @property
    def names(self) -> tuple[str, ...]:
        """(n,) names of the coordinates."""
        static = [f"{interface.name}.{dof}" for interface in self.moving for dof in FRAME_DOFS]
        fixed = [f"fixed-interface {i + 1}" for i in range(len(self.eigenvalues))]
        return (*static, *fixed)


def project(
    model: ContinuumModel,
    basis: Basis,
    *,
    provenance: Mapping[str, str],
    keep_modes: bool,
    keep_surface: bool,
) -> ReducedBody:
    """Project the model on a basis and bring the result to normal form. Collective.

    The record is made on rank 0 and handed to the others bit for bit; the model remembers the modes
    (`ContinuumModel.bases`).

    Raises:
        ReductionError: on all ranks: the basis has lost its orthonormality.
    """
    frame = basis.frame
    gram = gram_matrix(model, basis.shapes, p=frame.p, R=frame.R)
    raw = inner(model.comm, basis.shapes, basis.forces)
    stiffness = symmetric(raw)

    def make() -> tuple[dict[str, Any], FloatArray]:
        n = len(stiffness)
        mass = np.einsum("iaja->ij", gram[4:, 4:].reshape(n, 3, n, 3))
        error = _check_orthonormality(raw, mass, basis.eigenvalues)
        k, x = normal_form(stiffness, mass)
        x = x @ determined_rotation(k, x.T @ basis.projections)
        k = np.einsum("ij,ij->j", x, stiffness @ x)
        parts = _parts(basis, _change_basis(gram, x), k, x)
        parts["provenance"] = {**provenance, "orthonormality error": f"{error:.1e}"}
        return parts, x

    parts, x = parallel.on_root(model.comm, make)
    modes = _with_ghosts(model, basis.shapes @ x)
    body = ReducedBody(
        **parts,
        modes=nodal_group(model, modes, p=frame.p, R=frame.R) if keep_modes else None,
        surface=surface_group(model, modes, p=frame.p, R=frame.R) if keep_surface else None,
    )
    model.bases[body.fingerprint()] = modes
    return body


def _check_orthonormality(
    stiffness: FloatArray, mass: FloatArray, eigenvalues: FloatArray
) -> float:
    """The largest error of what the basis should fulfil by construction."""
    n, static = len(mass), len(mass) - len(eigenvalues)
    if n == 0:
        return 0.0
    size = np.sqrt(np.diag(stiffness))
    relative = stiffness / np.outer(size, size)
    errors = {
        "asymmetry of the stiffness": abs(relative - relative.T),
        "mass of the fixed-interface modes": abs(mass[static:, static:] - np.eye(n - static)),
        "stiffness between modes": abs(relative - np.eye(n))[:, static:],
        "eigenvalues": abs(np.diag(stiffness)[static:] / eigenvalues - 1.0),
    }
    largest = {what: float(error.max(initial=0.0)) for what, error in errors.items()}
    worst = max(largest, key=lambda what: largest[what])
    if not largest[worst] <= _ORTHONORMAL:
        raise ReductionError(
            f"the basis has lost its orthonormality: error of the {worst} {largest[worst]:.1e}, bound "
            f"{_ORTHONORMAL:.0e}; the stiffness is badly conditioned: look for slivers in the mesh"
        )
    return largest[worst]


def _change_basis(gram: FloatArray, x: FloatArray) -> FloatArray:
    """The Gram matrix for the modes phi x."""
    n = len(x)
    change = np.eye(4 + 3 * n)
    change[4:, 4:] = np.kron(x, np.eye(3))
    changed = change.T @ gram @ change
    return symmetric(changed)


def _parts(basis: Basis, gram: FloatArray, k: FloatArray, x: FloatArray) -> dict[str, Any]:
    n = len(x)
    frame = basis.frame
    frames = [InterfaceFrame(frame.name, np.zeros(3), np.eye(3), np.zeros((6, n)))]
    for i, other in enumerate(basis.moving):
        # the static coordinates are the interface's own motion, in B's axes
        rows = x[6 * i : 6 * i + 6]
        frames.append(
            InterfaceFrame(other.name, frame.R.T @ (other.p - frame.p), frame.R.T @ other.R, rows)
        )
    return {
        "gram": gram,
        "stiffness": k,
        "damping": np.zeros((n, n)),
        "interfaces": tuple(frames),
        "frame": frame.name,
        "partition": x,
        "partition_names": basis.names,
    }


def _with_ghosts(model: ContinuumModel, block: FloatArray) -> FloatArray:
    """The block with the rows of this rank's ghosts below its own. Collective."""
    field = fem.Function(model.space)
    whole = np.empty((len(field.x.array), block.shape[1]), order="F")
    for i in range(block.shape[1]):
        field.x.array[: model.n_owned] = block[:, i]
        field.x.scatter_forward()
        whole[:, i] = field.x.array
    return whole
