"""From a frame of discrete elements to the record of a reduced body, which joins the machine like any other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmbd.beams.discrete_frame import DiscreteFrame
from flexmbd.beams.lumps import Lumping, gram
from flexmbd.errors import SceneError
from flexmbd.given import checked, is_list, shown
from flexmbd.record.held_modes import HeldModes, held_modes
from flexmbd.record.reduced_body import FRAME_DOFS, InterfaceFrame, ReducedBody
from flexmbd.round_off import EQUAL

FloatArray = NDArray[np.float64]



@checked("lumped", "interfaces", "modes")
def discrete_body(
    lumped: DiscreteFrame,
    *,
    interfaces: Sequence[str] = (),
    frame: str | None,
    modes: int | None = None,
    damping_ratio: float | Sequence[float] = 0.0,
    damping_held: Sequence[str] = (),
) -> ReducedBody:
    """The record of a frame of discrete elements, whole or reduced by Craig and Bampton's method.

    Without `modes` nothing is lost: the record's coordinates are those of all nodes in another basis. A
    floating frame of `Lumping.POINTS` is reduced to its lowest free modes.

    Args:
        lumped: the frame.
        interfaces: nodes that carry frames of the machine, along the frame's axes: loads and joints go
            there and nowhere else.
        frame: the interface that the body frame sits on; None: it floats on the mean axis.
        modes: number of fixed-interface modes (free ones without interfaces); None: all.
        damping_ratio: of the modes of the free frame, one for all or one for each, by which alone the method knows
            damping (Anthonis & Ramon 2003, section 4.2.2).
        damping_held: interfaces that do not move in these modes, as `flexmbd.reduction.ModalDamping` has them.

    Raises:
        SceneError: an interface is not a node, is given twice, or is not there; more modes than there are;
            ratios that are not numbers from 0 to 1.
    """
    if not is_list(damping_held) or not all(isinstance(name, str) for name in damping_held):
        raise SceneError(f"damping_held must be a list of interfaces' names, as ['root'], got {shown(damping_held)}")
    rows = _interface_nodes(lumped, interfaces, frame)
    basis = _basis(lumped, rows, floating=frame is None, modes=modes)
    x = lumped.mesh.x
    total = lumped.moments
    origin = x[rows[frame]] if frame is not None else _centre(x, total)
    shapes, k = basis.shapes, basis.stiffness
    mass = shapes.T @ lumped.M @ shapes
    stiffness, change = _normal_form(k, mass)
    motions = (shapes @ change).reshape(len(x), 6, -1)
    frames = [InterfaceFrame(name, x[node] - origin, np.eye(3), motions[node]) for name, node in rows.items()]
    integrals = gram(x - origin, total, motions)
    held = [_held(frames, name) for name in damping_held]
    return ReducedBody(
        gram=integrals,
        stiffness=stiffness,
        damping=_damping(damping_ratio, held_modes(integrals, stiffness, held)),
        interfaces=tuple(frames),
        frame=frame,
        partition=change,
        partition_names=basis.names,
        provenance={
            "reduction": "discrete elements" if modes is None else "discrete elements, Craig-Bampton",
            "lumps": lumped.lumping.name.lower(),
            "nodes": str(lumped.n_nodes),
            "nodal coordinates": " ".join(lumped.coordinates),
            "fixed-interface modes": str(basis.modes),
            "parameters": repr(dict(lumped.sections)),
        },
        p_MB_M=origin,
    )


@dataclass(frozen=True, eq=False)
class _Basis:
    """Shapes (6 nodes, n) of the coordinates, their stiffness (n, n), names, and how many are modes."""

    shapes: FloatArray
    stiffness: FloatArray
    names: tuple[str, ...]
    modes: int


def _interface_nodes(lumped: DiscreteFrame, interfaces: Sequence[str], frame: str | None) -> dict[str, int]:
    """Nodes of the interfaces, that of the body frame first."""
    for name in interfaces:
        if list(interfaces).count(name) > 1:
            raise SceneError(f"interface {name!r} is given twice; give each node once")
    if frame is not None and frame not in interfaces:
        known = ", ".join(map(repr, interfaces)) or "none"
        raise SceneError(f"the body frame's interface {frame!r} is not among the interfaces: {known}")
    order = [*([] if frame is None else [frame]), *(name for name in interfaces if name != frame)]
    return {name: lumped.node(name) for name in order}


def _centre(x: FloatArray, moments: FloatArray) -> FloatArray:
    """(3,) m, centre of mass."""
    first = (moments[:, 0, 0, None] * x + moments[:, 0, 1:]).sum(axis=0)
    centre: FloatArray = first / moments[:, 0, 0].sum()
    return centre


def _basis(lumped: DiscreteFrame, rows: dict[str, int], *, floating: bool, modes: int | None) -> _Basis:
    """Static shapes of the interfaces but the first, and modes with all of them held; all on 6 rows a node."""
    nodes = list(rows.values())
    if not nodes or (floating and (modes is None or lumped.lumping is Lumping.POINTS)):
        return _free_basis(lumped, modes)
    held = np.zeros(6 * lumped.n_nodes, dtype=bool)
    held[6 * nodes[0] : 6 * nodes[0] + 6] = True
    moving, lift = _without_massless(lumped, lumped.active & ~held)
    k, m = lift.T @ lumped.K @ lift, lift.T @ lumped.M @ lift
    kept = [dof for node in nodes[1:] for dof in range(6 * node, 6 * node + 6) if moving[dof]]
    names = [f"{name}.{FRAME_DOFS[dof]}" for name in list(rows)[1:] for dof in range(6) if moving[6 * rows[name] + dof]]
    at = np.flatnonzero(moving)
    border = np.isin(at, kept)
    inside = ~border
    count = int(inside.sum()) if modes is None else modes
    if not 0 <= count <= inside.sum():
        raise SceneError(f"{modes} modes were asked for, and the frame has {inside.sum()} with its interfaces held")
    shapes = np.zeros((len(at), len(kept) + count))
    shapes[border, : len(kept)] = np.eye(len(kept))
    k_ii, m_ii = k[np.ix_(inside, inside)], m[np.ix_(inside, inside)]
    if inside.any():
        shapes[inside, : len(kept)] = -_deflections(k_ii, k[np.ix_(inside, border)])
        shapes[inside, len(kept) :] = _normal_form(k_ii, m_ii)[1][:, :count]
    stiffness = np.asarray(shapes.T @ k @ shapes, dtype=np.float64)
    stiffness = 0.5 * (stiffness + stiffness.T)
    every = np.asarray(lift @ shapes, dtype=np.float64)
    if floating:
        rigid = _rigid_motions(lumped)
        image = lumped.M @ rigid
        every -= rigid @ np.linalg.solve(rigid.T @ image, image.T @ every)
        names = [f"{name} from {next(iter(rows))}" for name in names]
    names += [f"fixed-interface {i + 1}" for i in range(count)]
    return _Basis(every, stiffness, tuple(names), count)


def _without_massless(lumped: DiscreteFrame, free: NDArray[np.bool_]) -> tuple[NDArray[np.bool_], FloatArray]:
    """Coordinates that have mass (6 nodes,), and all coordinates per unit of them: the others follow statically."""
    size = len(free)
    moving = free.copy()
    if lumped.lumping is Lumping.POINTS:
        moving &= np.arange(size) % 6 < 3
    slaves = free & ~moving
    lift = np.zeros((size, int(moving.sum())))
    lift[moving] = np.eye(lift.shape[1])
    if slaves.any():
        k = lumped.K
        lift[slaves] = -_deflections(k[np.ix_(slaves, slaves)], k[np.ix_(slaves, moving)])
    return moving, lift


def _deflections(k: FloatArray, loads: FloatArray) -> FloatArray:
    """Solve with a stiffness whose rows, in N/m and N m/rad, are brought to one size first."""
    import scipy.linalg  # on need: few scenes have beams

    scale = 1.0 / np.sqrt(np.diag(k))
    solved: FloatArray = scipy.linalg.solve(k * np.outer(scale, scale), scale[:, None] * loads, assume_a="pos")
    return scale[:, None] * solved


def _rigid_motions(lumped: DiscreteFrame) -> FloatArray:
    """(6 nodes, r) rigid motions that the coordinates allow."""
    x = lumped.mesh.x - lumped.mesh.x.mean(axis=0)
    motions = np.zeros((len(x), 6, 6))
    motions[:] = np.eye(6)
    for i in range(3):
        motions[:, :3, 3 + i] = np.cross(np.eye(3)[i], x)
    columns = motions.reshape(-1, 6)
    lost = np.linalg.norm(columns[~lumped.active], axis=0)
    return columns[:, lost <= EQUAL * np.linalg.norm(columns, axis=0)]


def _free_basis(lumped: DiscreteFrame, modes: int | None) -> _Basis:
    """The elastic modes of the free frame, which are M-orthogonal to its rigid motions."""
    import scipy.linalg  # on need: few scenes have beams

    moving, lift = _without_massless(lumped, lumped.active)
    k, m = lift.T @ lumped.K @ lift, lift.T @ lumped.M @ lift
    elastic = scipy.linalg.null_space((m @ _rigid_motions(lumped)[moving]).T)
    values, x = _normal_form(elastic.T @ k @ elastic, elastic.T @ m @ elastic)
    count = len(values) if modes is None else modes
    if not 0 < count <= len(values):
        raise SceneError(f"{modes} modes were asked for, and the free frame has {len(values)}")
    names = tuple(f"free-free {i + 1}" for i in range(count))
    return _Basis(lift @ elastic @ x[:, :count], np.diag(values[:count]), names, count)


def _normal_form(k: FloatArray, m: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Eigenvalues (n,), ascending, and X with X^T m X = 1; each shape's largest entry is positive."""
    import scipy.linalg  # on need: few scenes have beams

    if len(k) == 0:
        return np.zeros(0), np.zeros((0, 0))
    scale = 1.0 / np.sqrt(np.diag(k))
    grid = np.outer(scale, scale)
    # mass by stiffness: what rounds is the mass of the highest modes, not the lowest frequency
    try:
        _, x = scipy.linalg.eigh(m * grid, k * grid)
    except scipy.linalg.LinAlgError as error:
        raise SceneError("the frame's stiffness is not positive definite: a part of it can move freely") from error
    x = scale[:, None] * x[:, ::-1]
    x /= np.sqrt(np.einsum("ij,ij->j", x, m @ x))
    x *= np.sign(x[abs(x).argmax(axis=0), np.arange(x.shape[1])])
    return np.einsum("ij,ij->j", x, k @ x), x


def _held(frames: Sequence[InterfaceFrame], name: str) -> InterfaceFrame:
    for one in frames:
        if one.name == name:
            return one
    known = ", ".join(repr(one.name) for one in frames) or "none"
    raise SceneError(f"damping_held: {shown(name)} is not among the interfaces: {known}")


def _damping(ratio: float | Sequence[float], modes: HeldModes) -> FloatArray:
    """(n, n) 1/s, symmetric."""
    try:
        ratios = np.asarray(ratio, dtype=np.float64)
    except (TypeError, ValueError):
        ratios = np.array(np.nan)
    if not ((ratios >= 0.0) & (ratios <= 1.0)).all():
        raise SceneError(f"a damping ratio must lie between 0 and 1 (0.02 is two per cent), got {ratio!r}")
    if ratios.shape not in ((), modes.period.shape):
        count = len(modes.period)
        raise SceneError(f"{ratios.size} damping ratios for {count} modes; give one for all, or one for each")
    damping = modes.damping(ratios)
    return 0.5 * (damping + damping.T)
