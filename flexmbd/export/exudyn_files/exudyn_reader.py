"""Reduced bodies from Exudyn's files: ours, and those that Exudyn wrote itself."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import ExportError, RecordError
from flexmbd.export.normal_modes import normal_modes
from flexmbd.files.archive import read_archive
from flexmbd.files.whole_file import finite
from flexmbd.given import checked
from flexmbd.record.groups import FloatArray, InterfaceFrame, NodalModes, Surface
from flexmbd.record.reduced_body import ReducedBody

_NEEDED = (
    "infoList", "modeBasis", "xRef", "trigList", "massMatrixReduced", "stiffnessMatrixReduced", "totalMass", "chiU",
    "inertiaLocal", "mPhitTPsi", "mXRefTildePsiTilde", "mPsiTildePsiTilde",
)  # fmt: skip
_OURS = (
    "flexmbd masses", "flexmbd mesh nodes", "flexmbd interface names", "flexmbd interface nodes",
    "flexmbd interface axes", "flexmbd frame", "flexmbd damping", "flexmbd partition", "flexmbd partition names",
    "flexmbd mesh position", "flexmbd mesh axes",
)  # fmt: skip
# No body of ours has more, and their squares are allocated.
_MOST_MODES = 5000


@checked(error=ExportError)
def read_exudyn(path: str | Path, *, interfaces: Mapping[str, Sequence[int]] | None = None) -> ReducedBody:
    """Read a reduced body of Exudyn (.npz). Not collective.

    The Gram matrix follows from Exudyn's inertia arrays; frames, damping and partition from what `exudyn` adds to the
    file.  A file that Exudyn wrote itself has neither: its frames are told by their nodes here, and move as
    Exudyn's MarkerSuperElementRigid of these nodes with equal weights; its damping is zero.  Modes that are not in
    normal form are brought to it, by an exact change of basis that the partition tells.

    Args:
        path: a file of the type ObjectFFRFreducedOrderInterface.
        interfaces: node numbers of each frame by its name, three at least and not on one line; the axes are B's.

    Raises:
        ExportError: the file is missing, damaged, or holds something else; its arrays are not of one body; a frame's
            nodes are not in it, or too few.
    """
    arrays = read_archive(path, requested={*_NEEDED, *_OURS})
    try:
        with np.errstate(all="raise", under="ignore"):
            return _body(path, arrays, interfaces or {})
    except ExportError:
        raise
    except (LookupError, ValueError, TypeError, ArithmeticError, np.linalg.LinAlgError, RecordError) as error:
        raise ExportError(f"{path} does not hold the arrays of one reduced body of Exudyn: {error}") from error


def _body(path: str | Path, arrays: Mapping[str, Any], groups: Mapping[str, Sequence[int]]) -> ReducedBody:
    missing = [key for key in _NEEDED if key not in arrays]
    if missing:
        raise ExportError(f"{path} is not a reduced body of Exudyn: it lacks {', '.join(missing)}")
    n, k = (int(number) for number in arrays["infoList"][:2])
    if not (0 < n <= _MOST_MODES and k > 0):
        raise ExportError(f"{path} claims {n} modes and {k} nodes; from 1 to {_MOST_MODES} modes are read")

    def real(key: str, *shape: int) -> FloatArray:
        array = arrays[key]
        if array.shape != shape or array.dtype.kind not in "fiu":
            raise ExportError(f"{path}: {key} is {array.dtype} {array.shape}, expected numbers {shape}")
        return finite(array.astype(np.float64), path=path, what=key)

    gram = _gram(
        float(real("totalMass")),
        real("chiU", 3),
        real("inertiaLocal", 3, 3),
        real("mPhitTPsi", 3, n),
        real("mXRefTildePsiTilde", 3, 3 * n),
        real("mPsiTildePsiTilde", 3 * n, 3 * n),
    )
    x = real("xRef", 3 * k).reshape(k, 3)
    phi = real("modeBasis", 3 * k, n).reshape(k, 3, n)
    stiffness, basis = normal_modes(path, real("stiffnessMatrixReduced", n, n), mass=real("massMatrixReduced", n, n))
    change = np.eye(4 + 3 * n)
    change[4:, 4:] = np.kron(basis, np.eye(3))
    shapes = phi @ basis
    ours = all(key in arrays for key in _OURS)
    frames = _frames(path, arrays, x, shapes) if ours else ()
    return ReducedBody(
        gram=change.T @ gram @ change,
        stiffness=stiffness,
        damping=basis.T @ real("flexmbd damping", n, n) @ basis if ours else np.zeros((n, n)),
        interfaces=(*frames, *(_frame(path, name, nodes, np.eye(3), x, shapes) for name, nodes in groups.items())),
        frame=(str(arrays["flexmbd frame"]) or None) if ours else None,
        partition=real("flexmbd partition", n, n) @ basis if ours else basis,
        partition_names=tuple(map(str, arrays["flexmbd partition names"]))
        if ours
        else tuple(f"mode {number + 1}" for number in range(n)),
        provenance={"read from": "Exudyn's ObjectFFRFreducedOrderInterface"},
        p_MB_M=real("flexmbd mesh position", 3) if ours else np.zeros(3),
        R_MB=real("flexmbd mesh axes", 3, 3) if ours else np.eye(3),
        modes=_modes(arrays, ours, x, shapes),
        surface=_surface(path, arrays["trigList"], x, shapes),
    )


def _gram(
    mass: float, com: FloatArray, inertia: FloatArray, linear: FloatArray, x_phi: FloatArray, phi_phi: FloatArray
) -> FloatArray:
    """The Gram matrix: a block T, of tilde(a)' tilde(b), is that of tr(T)/2 1 - T', of a b'."""
    n = linear.shape[1]
    gram = np.zeros((4 + 3 * n, 4 + 3 * n))
    gram[0, 0] = mass
    gram[0, 1:4] = mass * com
    gram[0, 4:] = linear.T.ravel()
    blocks = np.zeros((1 + n, 1 + n, 3, 3))
    blocks[0, 0] = inertia
    blocks[0, 1:] = x_phi.reshape(3, n, 3).swapaxes(0, 1)
    blocks[1:, 1:] = phi_phi.reshape(n, 3, n, 3).swapaxes(1, 2)
    half = 0.5 * np.trace(blocks, axis1=-2, axis2=-1)
    products = half[..., None, None] * np.eye(3) - np.swapaxes(blocks, -1, -2)
    gram[1:, 1:] = products.swapaxes(1, 2).reshape(3 + 3 * n, 3 + 3 * n)
    whole: FloatArray = np.triu(gram) + np.triu(gram, 1).T
    return whole


def _frames(path: str | Path, arrays: Mapping[str, Any], x: FloatArray, phi: FloatArray) -> tuple[InterfaceFrame, ...]:
    names, nodes, axes = (arrays[f"flexmbd interface {what}"] for what in ("names", "nodes", "axes"))
    if nodes.shape != (len(names), 4) or axes.shape != (len(names), 3, 3):
        raise ExportError(f"{path}: {len(names)} frames have nodes {nodes.shape} and axes {axes.shape}")
    return tuple(
        _frame(path, str(name), four.tolist(), np.asarray(R, dtype=np.float64), x, phi)
        for name, four, R in zip(names, nodes, axes, strict=True)
    )


def _frame(
    path: str | Path, name: str, nodes: Sequence[int], R: FloatArray, x: FloatArray, phi: FloatArray
) -> InterfaceFrame:
    """The frame of the mean motion of some nodes: rotation by least squares, as inertia would have it."""
    numbers = np.asarray(nodes, dtype=np.int64)
    if numbers.size < 3 or numbers.min() < 0 or numbers.max() >= len(x):
        raise ExportError(
            f"{path}: frame {name!r} wants three nodes or more from 0 to {len(x) - 1}, and has {list(nodes)}"
        )
    origin = x[numbers].mean(axis=0)
    arms = x[numbers] - origin
    second = arms.T @ arms
    inertia = np.trace(second) * np.eye(3) - second
    if not np.linalg.cond(inertia) < 1e10:
        raise ExportError(f"{path}: the nodes {list(nodes)} of frame {name!r} lie on one line and tell no rotation")
    mean = phi[numbers].mean(axis=0)
    moment = np.cross(arms[:, None], np.swapaxes(phi[numbers] - mean, 1, 2)).sum(axis=0)
    return InterfaceFrame(name, origin, R, np.vstack([mean, np.linalg.solve(inertia, moment.T)]))


def _modes(arrays: Mapping[str, Any], ours: bool, x: FloatArray, phi: FloatArray) -> NodalModes | None:
    numbers: NDArray[np.int64] = arrays["flexmbd mesh nodes"] if ours else np.arange(len(x))
    if numbers.size == 0:
        return None
    return NodalModes(numbers, x[: numbers.size], phi[: numbers.size])


def _surface(path: str | Path, triangles: NDArray[Any], x: FloatArray, phi: FloatArray) -> Surface | None:
    """The triangles with their vertices alone; those of six nodes by their corners."""
    if triangles.size == 0:
        return None
    if triangles.ndim != 2 or triangles.shape[1] not in (3, 6) or triangles.dtype.kind not in "iu":
        raise ExportError(f"{path}: trigList is {triangles.dtype} {triangles.shape}, expected three nodes a triangle")
    corners = triangles[:, :3].astype(np.int64)
    if corners.min() < 0 or corners.max() >= len(x):
        raise ExportError(f"{path}: trigList names nodes {corners.min()} to {corners.max()}, and there are {len(x)}")
    used, renumbered = np.unique(corners, return_inverse=True)
    return Surface(x[used], renumbered.reshape(corners.shape), phi[used])
