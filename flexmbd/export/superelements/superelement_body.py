"""From a superelement of another program to a reduced body.

Mass, centre, inertia, frequencies, statics and everything else of small motions are those of the matrices. What a
superelement does not say of large motions is chosen by `flexmbd.export.gram_completion`.
"""

from __future__ import annotations

import numpy as np
import scipy.linalg

from flexmbd.errors import ExportError
from flexmbd.export.gram_completion import completed_gram, rigid_body
from flexmbd.export.superelements.superelement import Superelement
from flexmbd.record.groups import FRAME_DOFS, FloatArray
from flexmbd.record.reduced_body import InterfaceFrame, ReducedBody
from flexmbd.round_off import EQUAL, SIX_DIGITS

_SUPPORT = "a support or a spring to the ground, or interfaces that lie elsewhere"
_EXTERNAL = "damping of the motion in space, as a share of the mass is: leave it out"


def reduced_body(element: Superelement, *, source: str) -> ReducedBody:
    """The record of a superelement.

    The body frame sits on the interface `element.frame`, with its axes, or floats on the mean axis with the common
    axes; the common axes are the record's mesh axes.

    Args:
        element: with finite numbers; its modes may be coupled in K, and be of any size.
        source: the file, for messages and the provenance.

    Raises:
        ExportError: the matrices are not symmetric, not those of a free body with these interfaces, or not positive.
    """
    try:
        with np.errstate(all="raise", under="ignore"):
            return _body(element, source)
    except ExportError as error:
        raise ExportError(f"{source}: {error}") from error
    except (FloatingPointError, np.linalg.LinAlgError, ValueError, OverflowError) as error:
        raise ExportError(f"{source}: its matrices are those of no elastic body: {error}") from error


def _body(element: Superelement, source: str) -> ReducedBody:
    K, M, D = (symmetrised(matrix, name) for matrix, name in ((element.K, "K"), (element.M, "M"), (element.D, "D")))
    p, R = _body_frame(element, M)
    motions = element.rigid_motions(p)
    rigid_mass = motions.T @ M @ motions
    stiffness, damping = (motions.T @ matrix @ motions for matrix in (K, D))
    unfree = {"stiffness": resistance(K, motions), "damping": resistance(D, motions)}
    # from here on positions and rows are B's
    turn = scipy.linalg.block_diag(*[R] * (2 * len(element.names)), np.eye(element.n_modes))
    motions = turn.T @ motions @ np.kron(np.eye(2), R)
    K, M, D = (turn.T @ matrix @ turn for matrix in (K, M, D))
    kept = _elastic_coordinates(element)
    shapes = np.eye(len(K))[:, kept]
    if element.frame is None:
        shapes = shapes - motions @ np.linalg.solve(motions.T @ M @ motions, motions.T @ M @ shapes)
    k, x = normal_form(K[np.ix_(kept, kept)], shapes.T @ M @ shapes)
    slowest = k[0] if len(k) else 1.0
    _check_free(unfree["stiffness"], _rates(stiffness, rigid_mass) / slowest, "stiffness", _SUPPORT)
    _check_free(unfree["damping"], _rates(damping, rigid_mass) / np.sqrt(slowest), "damping", _EXTERNAL)
    modes = shapes @ x
    field = np.hstack([motions, modes])
    gram = completed_gram(field.T @ M @ field)
    frames = [
        InterfaceFrame(name, R.T @ (place - p), R.T @ axes, modes[6 * i : 6 * i + 6])
        for i, (name, place, axes) in enumerate(zip(element.names, element.p, element.R, strict=True))
    ]
    n = len(k)
    return ReducedBody(
        gram=gram,
        stiffness=k,
        damping=x.T @ D[np.ix_(kept, kept)] @ x,
        interfaces=tuple(frames),
        frame=element.frame,
        partition=x,
        partition_names=_names(element),
        p_MB_M=p,
        R_MB=R,
        provenance={
            "reduction": "superelement of another program",
            "fixed-interface modes": str(n - 6 * (len(frames) - 1)),
            "inertia of large motions": "completed from the mass matrix at rest",
        },
    )


def symmetrised(matrix: FloatArray, name: str) -> FloatArray:
    """The symmetric matrix, once it is nearly so."""
    size = np.sqrt(abs(np.diag(matrix)))
    off = abs(matrix - matrix.T)
    bound = SIX_DIGITS * np.maximum(np.outer(size, size), abs(matrix))
    if not (off <= np.maximum(bound, EQUAL * abs(matrix).max(initial=0.0))).all():
        raise ExportError(f"matrix {name} is not symmetric: entries differ by up to {off.max():.1e}")
    return 0.5 * (matrix + matrix.T)


def _body_frame(element: Superelement, M: FloatArray) -> tuple[FloatArray, FloatArray]:
    """B's origin (3,) and axes (3, 3) in the common ones."""
    motions = element.rigid_motions(np.zeros(3))
    _, com, _ = rigid_body(motions.T @ M @ motions)
    if element.frame is None:
        return com, np.eye(3)
    at = element.names.index(element.frame)
    return element.p[at], element.R[at]


def resistance(matrix: FloatArray, motions: FloatArray) -> float:
    """The largest force of a rigid motion, as a share of what would come without cancellation.

    Args:
        matrix: (N, N) stiffness or damping, dense or sparse.
        motions: (N, 6).
    """
    forces = abs(matrix @ motions)
    bound = abs(matrix) @ abs(motions)
    # each row by itself, since forces and moments are of several sizes; but none by its own round-off
    return float((forces / np.maximum(bound, 1e-9 * bound.max(initial=0.0) + 1e-300)).max(initial=0.0))


def _rates(matrix: FloatArray, mass: FloatArray) -> float:
    """The largest eigenvalue of a rigid body's stiffness or damping, per mass."""
    size = 1.0 / np.sqrt(np.diag(mass).clip(min=1e-300))
    grid = np.outer(size, size)
    return float(abs(scipy.linalg.eigvals(matrix * grid, mass * grid)).max())


def _check_free(share: float, rate: float, what: str, remedy: str) -> None:
    """Refuse a matrix that resists rigid motions, both beside its entries and beside the slowest deformation."""
    if not min(share, rate) <= SIX_DIGITS:
        raise ExportError(
            f"the {what} resists rigid motions by {share:.1e} of its entries, and a free body's does not; it may hold "
            f"{remedy}"
        )


def _elastic_coordinates(element: Superelement) -> list[int]:
    """Rows of the coordinates that deform the body while the body frame's interface rests."""
    rest = 0 if element.frame is None else element.names.index(element.frame)
    return [row for row in range(len(element.K)) if row // 6 != rest]


def _names(element: Superelement) -> tuple[str, ...]:
    rest = element.names[0] if element.frame is None else element.frame
    others = [name for name in element.names if name != rest]
    tail = f" from {rest}" if element.frame is None else ""
    static = [f"{name}.{dof}{tail}" for name in others for dof in FRAME_DOFS]
    return (*static, *(f"fixed-interface {i + 1}" for i in range(element.n_modes)))


def normal_form(stiffness: FloatArray, mass: FloatArray) -> tuple[FloatArray, FloatArray]:
    """k (n,) ascending and X (n, n) with X^T mass X = 1 and X^T stiffness X = diag(k)."""
    if len(stiffness) == 0:
        return np.zeros(0), np.zeros((0, 0))
    diagonal = np.diag(stiffness)
    if not (diagonal > 0.0).all():
        raise ExportError("its stiffness is not positive: some coordinate is held by nothing, or is zero everywhere")
    scale = 1.0 / np.sqrt(diagonal)
    grid = np.outer(scale, scale)
    # mass by stiffness: the error then sits in the highest modes
    _, x = scipy.linalg.eigh(mass * grid, stiffness * grid)
    x = scale[:, None] * x[:, ::-1]
    sizes = np.einsum("ij,ij->j", x, mass @ x)
    if not (sizes > 0.0).all():
        raise ExportError("its mass is not positive definite: some deformation has no mass")
    x /= np.sqrt(sizes)
    # the signs depend on no eigensolver
    x *= np.sign(x[np.argmax(abs(x), axis=0), np.arange(len(x))])
    return np.einsum("ij,ij->j", x, stiffness @ x), x

