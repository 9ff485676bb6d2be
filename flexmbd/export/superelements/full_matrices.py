"""Full stiffness and mass matrices of another program, reduced to a body by Craig and Bampton's method.

Scipy alone: what comes from elsewhere needs no DOLFINx. For meshes of our own there is `flexmbd.reduction`, which is
quicker, runs on several ranks and knows the material.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmbd.coupling import Coupling
from flexmbd.errors import ExportError
from flexmbd.export.superelements.constrained_basis import BoundFrame, basis
from flexmbd.export.superelements.matrix_text import blocks, coordinates, triplets
from flexmbd.export.superelements.superelement import Superelement, rigid_motion
from flexmbd.export.superelements.superelement_body import reduced_body, resistance
from flexmbd.export.superelements.unit_system import SI, unit_system
from flexmbd.files.whole_file import read_text
from flexmbd.given import checked, refuse_no_truth
from flexmbd.record.groups import FloatArray, NodalModes
from flexmbd.record.reduced_body import ReducedBody
from flexmbd.round_off import TEN_DIGITS

#: A scipy.sparse matrix; scipy comes without types.
Sparse = Any

# Singular values of an interface's nodes about their centre, relative to the largest: below it they lie in a line.
_LINE = 1e-8
# Forces of a rigid motion relative to those of its parts.
_FREE = 1e-6


@checked(error=ExportError)
@dataclass(frozen=True, eq=False)
class NodeSet:
    """Nodes that move as one rigid frame, or whose mean motion a frame is.

    Attributes:
        nodes: their numbers in the node table; three or more, not in one line.
        origin: (3,) m or the units of the table, the frame's origin in the table's axes; the nodes' mean by default.
        axes: (3, 3) rotation from the frame's axes to the table's.
        coupling: RIGID, or AVERAGED (RBE3): the frame is the mean of the nodes, which stay free; of full matrices.
        weights: of the nodes in an average, as the parts of a face's area; equal by default.
    """

    nodes: ArrayLike
    origin: ArrayLike | None = None
    axes: ArrayLike = field(default_factory=lambda: np.eye(3))
    coupling: Coupling = Coupling.RIGID
    weights: ArrayLike | None = None


@checked(error=ExportError)
def reduce_matrices(
    K: Sparse,
    M: Sparse,
    nodes: ArrayLike,
    *,
    interfaces: Mapping[str, NodeSet],
    modes: int,
    frame: str | None,
    D: Sparse | None = None,
    keep_modes: bool = False,
    units: str = SI,
) -> ReducedBody:
    """Reduce a free body given by matrices over its nodes' displacements. Not collective.

    Args:
        K: (3 k, 3 k) sparse, N/m; rows of each node x, y, z, nodes as the table has them.
        M: (3 k, 3 k) sparse, kg. Where it is one matrix for all three components, as that of every consistent or
            lumped solid is, all inertia integrals are exact; else those of large motions are completed
            (`flexmbd.export.gram_completion`), which the record's provenance says.
        nodes: (k, 4) table: number, x, y, z (m).
        interfaces: the frames by name.
        modes: number of fixed-interface modes.
        frame: the interface that carries the body frame; None: it floats on the mean axis.
        D: (3 k, 3 k) sparse, N s/m.
        keep_modes: whether the record holds the modes at the nodes.
        units: of the matrices, of the node table and of the frames' origins, as length-mass-time, "mm-t-s".

    Raises:
        ExportError: no such units; sizes that do not fit, unknown or shared nodes, a supported or singular stiffness.
    """
    system = unit_system(units)
    numbers, x = node_table(nodes)
    x = system.length * x
    refuse_no_truth(ExportError, keep_modes=keep_modes)
    K, M = (_symmetric(matrix, name, 3 * len(x)) for matrix, name in ((K, "K"), (M, "M")))
    K, M = system.mass / system.time**2 * K, system.mass * M
    frames = frames_of(interfaces, numbers, x, length=system.length)
    if frame is not None and frame not in frames:
        raise ExportError(f"there is no interface {frame!r} for the body frame; there are {', '.join(frames)}")
    _check_free(K, x)
    shapes = basis(K, M, x, frames, modes)
    stiffness, mass = (shapes.T @ (matrix @ shapes) for matrix in (K, M))
    damping = np.zeros_like(mass)
    if D is not None:
        damping = system.mass / system.time * (shapes.T @ (_symmetric(D, "D", 3 * len(x)) @ shapes))
    element = Superelement(
        names=tuple(frames),
        p=np.array([one.p for one in frames.values()]),
        R=np.array([one.R for one in frames.values()]),
        K=0.5 * (stiffness + stiffness.T),
        M=0.5 * (mass + mass.T),
        D=0.5 * (damping + damping.T),
        frame=frame,
    )
    body = reduced_body(element, source="the matrices")
    moved = shapes @ _coordinates(body, len(shapes.T) - 6 * len(frames))
    phi = np.einsum("ba,kbn->kan", body.R_MB, moved.reshape(len(x), 3, -1))
    positions = (x - body.p_MB_M) @ body.R_MB
    provenance = {**body.provenance, "reduction": "Craig-Bampton, of another program's matrices"}
    changes: dict[str, Any] = {"provenance": provenance}
    scalar = _scalar_mass(M)
    if scalar is not None:
        fields = np.hstack([np.ones((len(x), 1)), positions, np.swapaxes(phi, 1, 2).reshape(len(x), -1)])
        gram = fields.T @ (scalar @ fields)
        changes["gram"] = 0.5 * (gram + gram.T)
        del provenance["inertia of large motions"]
    if keep_modes:
        order = np.argsort(numbers)
        changes["modes"] = NodalModes(numbers[order], positions[order], phi[order])
    return replace(body, **changes)


@checked(error=ExportError)
def read_matrix_market(path: str | Path) -> Sparse:
    """A sparse real matrix from a file of MatrixMarket's kind, as Ansys, Exudyn and scipy write it. Not collective.

    Scipy's own reader does not come back from some damaged files.

    Raises:
        ExportError: the file is damaged, or holds no real matrix.
    """
    text = read_text(path)
    try:
        return _matrix_market(text)
    except (ValueError, OverflowError) as error:
        raise ExportError(f"{path} is no MatrixMarket file that can be read: {error}") from error


def _matrix_market(text: str) -> Sparse:
    import scipy.sparse

    first, _, rest = text.partition("\n")
    head = first.lower().split()
    if len(head) != 5 or head[:2] != ["%%matrixmarket", "matrix"] or head[2] not in ("coordinate", "array"):
        raise ValueError(f"it begins with {first[:60]!r}")
    if head[3] not in ("real", "double", "integer") or head[4] not in ("general", "symmetric"):
        raise ValueError(f"it is {head[3]} and {head[4]}; read are real ones, general or symmetric")
    lines = [line for line in rest.splitlines() if line.strip() and not line.startswith("%")]
    if not lines or not all(word.isdigit() and len(word) < 10 for word in lines[0].split()):
        raise ValueError("it has no line of sizes")
    sizes = [int(word) for word in lines[0].split()]
    sparse = head[2] == "coordinate"
    if len(sizes) != (3 if sparse else 2) or max(sizes) > 10**8:
        raise ValueError(f"its sizes are {sizes}")
    words = " ".join(lines[1:]).split()
    if not sparse:
        return scipy.sparse.csr_array(_array(words, sizes, symmetric=head[4] == "symmetric"))
    rows, columns, count = sizes
    if len(words) != 3 * count:
        raise ValueError(f"it claims {count} entries, and has {len(words)} numbers")
    table = np.array(words, dtype=np.float64).reshape(count, 3)
    places, values = table[:, :2], table[:, 2]
    if not np.isfinite(table).all() or (places != places.round()).any() or (places < 1).any():
        raise ValueError("it holds rows, columns or values that are none")
    if (places > 1e9).any():
        raise ValueError("it holds rows or columns that are too large")
    i, j = places.astype(np.int64).T - 1
    if count and (i.max() >= rows or j.max() >= columns):
        raise ValueError(f"it has entries outside its {rows} rows and {columns} columns")
    if head[4] == "symmetric":
        off = i != j
        i, j, values = np.append(i, j[off]), np.append(j, i[off]), np.append(values, values[off])
    return scipy.sparse.csr_array((values, (i, j)), shape=(rows, columns))


def _array(words: list[str], sizes: list[int], *, symmetric: bool) -> FloatArray:
    """A dense matrix, by columns; of a symmetric one the lower triangle."""
    rows, columns = sizes
    count = rows * (rows + 1) // 2 if symmetric else rows * columns
    if len(words) != count or (symmetric and rows != columns):
        raise ValueError(f"it claims {sizes}, and has {len(words)} numbers")
    values = np.array(words, dtype=np.float64)
    if not np.isfinite(values).all():
        raise ValueError("it holds values that are not finite")
    if not symmetric:
        return values.reshape((rows, columns), order="F")
    matrix = np.zeros((rows, rows))
    matrix[np.triu_indices(rows)] = values
    return matrix + np.triu(matrix, 1).T


@checked(error=ExportError)
def read_triplets(path: str | Path, nodes: ArrayLike) -> Sparse:
    """A full matrix from lines ``node, component, node, component, value``, rows as a node table has them.

    Abaqus writes such files by *MATRIX OUTPUT, FORMAT=MATRIX INPUT. Lines ``row column value``, as by
    FORMAT=COORDINATE, count three rows a node from 1 on, nodes by their numbers.

    Args:
        path: the file.
        nodes: (k, 4) table: number, x, y, z.

    Raises:
        ExportError: the file is damaged, or names nodes that are not in the table, or components other than 1 to 3.
    """
    import scipy.sparse

    numbers, x = node_table(nodes)
    rows = {int(number): 3 * i - 1 for i, number in enumerate(numbers)}
    try:
        lines = next(blocks(read_text(path))).lines
        if lines and len(lines[0].replace(",", " ").split()) == 3:
            row, column, values = coordinates(lines, 3 * len(x))
            order = (3 * np.argsort(numbers)[:, None] + np.arange(3)).ravel()
            return scipy.sparse.csr_array((values, (order[row], order[column])), shape=(3 * len(x), 3 * len(x)))
        entries = triplets(lines)
        for (node, component), _ in entries:
            if node not in rows or component not in (1, 2, 3):
                raise ValueError(f"component {component} of node {node} is none of the table's displacements")
    except (ValueError, OverflowError) as error:
        raise ExportError(f"{path}: {error}") from error
    i = [rows[row[0]] + row[1] for row, _ in entries]
    j = [rows[column[0]] + column[1] for _, column in entries]
    return scipy.sparse.csr_array((list(entries.values()), (i, j)), shape=(3 * len(x), 3 * len(x)))


def node_table(nodes: ArrayLike) -> tuple[NDArray[np.int64], FloatArray]:
    """Numbers (k,) and places (k, 3) of a node table.

    Raises:
        ExportError: it is none.
    """
    table = np.asarray(nodes, dtype=np.float64)
    if table.ndim != 2 or table.shape[1] != 4 or not np.isfinite(table).all():
        raise ExportError(f"the node table has the shape {table.shape}; rows of number, x, y, z are needed")
    numbers = table[:, 0].astype(np.int64)
    if not np.array_equal(numbers, table[:, 0]) or len(np.unique(numbers)) < len(numbers):
        raise ExportError("the node table's first column is not of whole numbers, each once")
    return numbers, table[:, 1:]


def _symmetric(matrix: Sparse, name: str, size: int) -> Sparse:
    import scipy.sparse

    try:
        whole = scipy.sparse.csr_array(matrix, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ExportError(
            f"matrix {name} must be one of numbers, full or of scipy.sparse, got {matrix!r:.100}"
        ) from error
    if whole.shape != (size, size):
        raise ExportError(f"matrix {name} is {whole.shape}; the node table asks for {(size, size)}, three rows a node")
    off = abs(whole - whole.T)
    if not np.isfinite(whole.data).all() or (off.nnz and not off.max() <= TEN_DIGITS * abs(whole).max()):
        raise ExportError(f"matrix {name} is not symmetric, or not finite; give both triangles")
    return whole


def _check_free(K: Sparse, x: FloatArray) -> None:
    centre = x.mean(axis=0)
    share = resistance(K, np.vstack([rigid_motion(place - centre)[:3] for place in x]))
    if not share <= _FREE:
        raise ExportError(
            f"the stiffness resists rigid motions by {share:.1e} of its entries; take the matrix without supports, in "
            "the axes and the order of the node table"
        )


def frames_of(
    interfaces: Mapping[str, NodeSet], numbers: NDArray[np.int64], x: FloatArray, *, length: float
) -> dict[str, BoundFrame]:
    """The frames of sets of nodes at x (k, 3) m with these numbers; a unit of given origins is ``length`` m.

    Raises:
        ExportError: there are none, nodes are unknown, in one line or of two sets, or axes are no rotation.
    """
    if not interfaces:
        raise ExportError("no interfaces are named; one at least is needed")
    frames: dict[str, BoundFrame] = {}
    place = {int(number): i for i, number in enumerate(numbers)}
    taken: dict[int, str] = {}
    for name, one in interfaces.items():
        chosen = [int(number) for number in np.asarray(one.nodes).ravel()]
        unknown = [number for number in chosen if number not in place]
        if unknown:
            raise ExportError(f"interface {name!r}: node {unknown[0]} is not in the node table")
        shared = [number for number in chosen if taken.setdefault(number, name) != name]
        if shared:
            raise ExportError(f"node {shared[0]} is of two interfaces, {taken[shared[0]]!r} and {name!r}; choose one")
        rows = np.array(sorted({place[number] for number in chosen}), dtype=np.int64)
        if len(rows) < 3:
            raise ExportError(f"interface {name!r} has {len(rows)} nodes; a frame needs three, not in one line")
        spread = np.linalg.svd(x[rows] - x[rows].mean(axis=0), compute_uv=False)
        if spread[1] <= _LINE * spread[0]:
            raise ExportError(f"interface {name!r}: its nodes lie in one line, so nothing turns about that")
        R = np.asarray(one.axes, dtype=np.float64)
        p = x[rows].mean(axis=0) if one.origin is None else length * np.asarray(one.origin, dtype=np.float64)
        if p.shape != (3,) or R.shape != (3, 3) or not abs(R.T @ R - np.eye(3)).max() < 1e-6 or np.linalg.det(R) < 0.0:
            raise ExportError(f"interface {name!r}: its origin is not a point (3,), or its axes are no rotation (3, 3)")
        frames[name] = BoundFrame(p, R, rows, _weights(name, one, chosen, [int(numbers[row]) for row in rows]))
    return frames


def _weights(name: str, one: NodeSet, chosen: list[int], kept: list[int]) -> FloatArray | None:
    """Of an averaged interface's nodes, as they are kept; None of a rigid one."""
    if one.coupling is Coupling.RIGID:
        if one.weights is not None:
            raise ExportError(f"interface {name!r} has weights and is rigid: Coupling.AVERAGED takes weights")
        return None
    given = np.ones(len(chosen)) if one.weights is None else np.asarray(one.weights, dtype=np.float64)
    if given.shape != (len(chosen),) or not (np.isfinite(given).all() and (given > 0.0).all()):
        raise ExportError(f"interface {name!r}: weights must be positive numbers, one a node, {len(chosen)} of them")
    by_number = dict(zip(chosen, given, strict=True))
    return np.array([by_number[number] for number in kept])


def _coordinates(body: ReducedBody, modes: int) -> FloatArray:
    """(6 b + m, n) interface motions along the table's axes, and amplitudes of the fixed-interface modes."""
    turn = np.kron(np.eye(2), body.R_MB)
    rows = [turn @ frame.modes for frame in body.interfaces]
    return np.vstack([*rows, body.partition[len(body.partition) - modes :]])


def _scalar_mass(M: Sparse) -> Sparse | None:
    """The mass of one component, where all three have the same and nothing couples them."""
    parts = [[M[a::3][:, b::3] for b in range(3)] for a in range(3)]
    bound = TEN_DIGITS * abs(M).max()
    off = [parts[a][b] for a in range(3) for b in range(3) if a != b]
    off += [parts[a][a] - parts[0][0] for a in (1, 2)]
    if any(part.nnz and abs(part).max() > bound for part in off):
        return None
    return parts[0][0]
