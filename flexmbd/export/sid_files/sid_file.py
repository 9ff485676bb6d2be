"""SID_FEM: a flexible body's Taylor blocks, for SIMPACK, DLR's FlexibleBodies, EMBSlib (docs/export/sid.md)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from enum import Enum
from pathlib import Path
from urllib.parse import unquote

import numpy as np

from flexmbd.errors import ExportError, RecordError
from flexmbd.export.loss import Capabilities, check_body, check_losses, checked_writer
from flexmbd.export.sid_files.sid_text import SidModal, SidNode, parse_sid, sid_text
from flexmbd.export.sid_files.taylor_blocks import (
    AGREE,
    BLOCKS,
    Taylor,
    axis_by_axis,
    mass_integrals,
    stiffening_loads,
    taylor_blocks,
)
from flexmbd.files.whole_file import write_file
from flexmbd.given import checked
from flexmbd.record.groups import FRAME_DOFS, FloatArray, GeometricStiffness, InterfaceFrame, NodalModes, load_stiffness
from flexmbd.record.reduced_body import ReducedBody

CAPABILITIES = Capabilities(stiffening=True)

# The first line may not hold a keyword, since readers look for them anywhere in a line, nor be longer than theirs.
_KEYWORDS = ("refmod", "frame", "part", "modal", "ksigma")
_PLAIN = frozenset("abcdefghijklmnopqrstuvwxyz0123456789_-.")
_LONGEST = 480
_NAMES = "flexmbd, interfaces "

# What a file of twelve digits leaves of a zero.
_ROUNDING = 1e-11


class SidColumns(Enum):
    """The order of the 3 n columns of Gr and Ge, which programs do not agree on."""

    BY_MODE = "x, y, z of the first mode, then of the next: EMBSlib, welib"
    BY_AXIS = "x of all modes, then y, then z: SIMPACK's FEMBS and what reads its files, as DLR's FlexibleBodies"


@checked_writer
def sid(
    body: ReducedBody,
    path: str | Path,
    *,
    nodes: Sequence[int] = (),
    columns: SidColumns = SidColumns.BY_MODE,
    lossy: bool = False,
) -> tuple[str, ...]:
    """Write a body's SID_FEM file. Not collective.

    Nodes 1, 2, ... are the interface frames in the record's order, the first line has their names. Numbers have 17
    digits; the units are those of the body. Stiffening by load (the record's `geometric` group) stands in m1 of Ct,
    Cr, Oe and of phi and psi of the interfaces.

    Args:
        body: any reduced body.
        path: destination.
        nodes: numbers of mesh nodes (`NodalModes.node`) that are written as nodes too, after the interfaces.
        columns: the order of the columns of Gr and Ge.
        lossy: as of all formats; this one loses little.

    Returns:
        The parts that are not in the file, a phrase each.

    Raises:
        ExportError: the destination cannot be written, or a node is not in the record.
    """
    check_body(body)
    every = body.modes is not None and bool(np.isin(body.modes.node, nodes).all())
    lost = [*check_losses(body, replace(CAPABILITIES, nodes=every), kind="SID_FEM", lossy=lossy)]
    if body.stretch is not None:
        lost.append("stretch (stiffening is in the file load by load)" if body.geometric else "stretch")
    title = _NAMES + " ".join(_hidden(frame.name) for frame in body.interfaces)
    if len(title) > _LONGEST:
        title = "flexmbd"
        lost.append(f"the names of the interfaces, which are the nodes 1 to {len(body.interfaces)}")
    frames = [_interface(body, frame, i) for i, frame in enumerate(body.interfaces, start=1)]
    blocks = taylor_blocks(body)
    if columns is SidColumns.BY_AXIS:
        blocks |= {name: axis_by_axis(blocks[name], body.n_modes) for name in ("Gr", "Ge")}
    modal = SidModal(
        title=title,
        mass=body.mass,
        nodes=(*frames, *_mesh_nodes(body, nodes)),
        blocks=blocks,
        n_modes=body.n_modes,
        frequencies=np.sqrt(body.stiffness) / (2.0 * np.pi),
    )
    write_file(path, sid_text(modal))
    return tuple(lost)


def _interface(body: ReducedBody, frame: InterfaceFrame, number: int) -> SidNode:
    phi, psi = frame.modes[:3], frame.modes[3:]
    K = [load_stiffness(body.geometric, f"{frame.name}.{dof}") for dof in FRAME_DOFS]
    n = body.n_modes
    # a force c on a node does phi^T c on the modes, and K_l q c on the side of the stiffness
    rows = [np.zeros((n, n)) if one is None else -one.T for one in K]
    loaded = [any(one is not None for one in K[part]) for part in (slice(3), slice(3, 6))]
    turned = np.einsum("cab,aq,bd->cqd", _SKEW, psi, frame.R_BI)
    blocks = {
        "origin": Taylor(frame.p_BI_B[:, None], phi[:, :, None]),
        "phi": Taylor(phi, np.stack(rows[:3]) if loaded[0] else None),
        "psi": Taylor(psi, np.stack(rows[3:]) if loaded[1] else None),
        "AP": Taylor(frame.R_BI, turned),
    }
    return SidNode(number, blocks)


# skew(w)_cb = sum_a _SKEW_cab w_a
_SKEW = np.zeros((3, 3, 3))
for _c, _a, _b in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
    _SKEW[_c, _a, _b], _SKEW[_c, _b, _a] = 1.0, -1.0


def _mesh_nodes(body: ReducedBody, nodes: Sequence[int]) -> list[SidNode]:
    if len(nodes) == 0:
        return []
    if body.modes is None:
        raise ExportError(
            "the record has no modes at the mesh's nodes: reduce the body with keep=Keep(modes=True), "
            "or leave nodes out"
        )
    unknown = np.setdiff1d(nodes, body.modes.node)
    if len(unknown) > 0:
        raise ExportError(f"the record has no mesh node {unknown[0]}; its {len(body.modes.node)} are in modes.node")
    written = []
    for number, at in enumerate(np.searchsorted(body.modes.node, nodes), start=len(body.interfaces) + 1):
        x, phi = body.modes.x[at], body.modes.phi[at]
        blocks = {
            "origin": Taylor(x[:, None], phi[:, :, None]),
            "phi": Taylor(phi),
            "psi": Taylor(np.zeros_like(phi)),
            "AP": Taylor(np.eye(3)),
        }
        written.append(SidNode(number, blocks))
    return written


def _hidden(name: str) -> str:
    """A name that holds no keyword: what is not a small letter is written %xx, and so is a keyword's first letter."""
    plain = "".join(c if c in _PLAIN else "".join(f"%{byte:02x}" for byte in c.encode()) for c in name)
    for word in _KEYWORDS:
        plain = plain.replace(word, f"%{ord(word[0]):02x}{word[1:]}")
    return plain


@checked(error=ExportError)
def read_sid(path: str | Path, *, tolerance: float = AGREE) -> ReducedBody:
    """Read a SID_FEM file, ours or another program's. Not collective.

    The mass integrals come back from the blocks, see `flexmbd.export.sid_files.taylor_blocks`. Modes that are not
    normalised are brought to the record's normal form; its `partition` leads back to the file's. Nodes are
    interfaces, called as the first line says in files of ours, else node_<number>; nodes that it does not name are
    `modes`. The frame is the interface that B rests on: at the origin, with B's axes, not moved by the modes.

    Args:
        path: the file.
        tolerance: by what part of their size blocks may differ that say the same, as they do where masses are
            lumped; Ct, Cr and Me are believed.

    Raises:
        ExportError: the file is missing, damaged, no SID_FEM file, or does not hold all of a body: it says what.
    """
    modal = parse_sid(path)
    try:
        return _body(modal, tolerance)
    except (ExportError, RecordError) as error:
        raise ExportError(f"{path}: {error}") from error


def _body(modal: SidModal, tolerance: float) -> ReducedBody:
    n, blocks = modal.n_modes, _checked(modal)
    parts = mass_integrals(modal.mass, blocks, tolerance=tolerance)
    loads, K = stiffening_loads(blocks, parts.ff)
    frames, points = _frames(modal)
    for node, frame in zip(modal.nodes, frames, strict=False):
        names, matrices = _interface_loads(node, frame.name)
        loads, K = loads + names, K + matrices
    stiffness, T = _normal_form(blocks["Me"].m0, blocks["Ke"].m0)
    fields = np.eye(4 + 3 * n)
    fields[4:, 4:] = np.kron(T, np.eye(3))
    gram = fields.T @ parts.gram() @ fields
    _refuse_no_mass(gram, tolerance)
    return ReducedBody(
        gram=gram,
        stiffness=stiffness,
        damping=T.T @ blocks["De"].m0 @ T,
        interfaces=tuple(replace(frame, modes=frame.modes @ T) for frame in frames),
        frame=_resting(frames),
        partition=T,
        partition_names=tuple(f"mode {i}" for i in range(1, n + 1)),
        provenance={"source": "SID_FEM", "title": modal.title},
        modes=None if points is None else replace(points, phi=points.phi @ T),
        geometric=GeometricStiffness(tuple(loads), np.stack([T.T @ one @ T for one in K])) if loads else None,
    )


def _checked(modal: SidModal) -> dict[str, Taylor]:
    """The blocks, of right shapes, with those that may be left out."""
    n, blocks = modal.n_modes, dict(modal.blocks)
    shapes = {
        "mdCM": (3, 1), "J": (6, 1), "Ct": (n, 3), "Cr": (n, 3), "Me": (n, n), "Gr": (3, 3 * n), "Ge": (n, 3 * n),
        "Oe": (n, 6), "ksigma": (n, 1), "Ke": (n, n), "De": (n, n),
    }  # fmt: skip
    blocks.setdefault("De", Taylor(np.zeros((n, n))))
    missing = [name for name in BLOCKS if name not in blocks and name not in ("Gr", "Ge", "Oe", "ksigma")]
    if missing:
        raise ExportError(f"it has no block {', '.join(missing)}, without which there is no body")
    for name, block in blocks.items():
        if block.m0.shape != shapes[name]:
            raise ExportError(f"block {name} is {block.m0.shape[0]} x {block.m0.shape[1]}, expected {shapes[name]}")
    if "ksigma" in blocks and blocks["ksigma"].m0.any():
        raise ExportError("ksigma is not zero: the body is stressed where it is not deformed, which no record holds")
    return blocks


def _frames(modal: SidModal) -> tuple[list[InterfaceFrame], NodalModes | None]:
    """Interface frames of the nodes; of a file of ours the nodes after the interfaces' are points of the mesh."""
    names = [f"node_{node.number}" for node in modal.nodes]
    n_frames = len(names)
    if modal.title.startswith(_NAMES.rstrip()):
        names_in_title = [unquote(word) for word in modal.title.removeprefix(_NAMES.rstrip()).split()]
        if len(names_in_title) <= len(names):
            names, n_frames = names_in_title, len(names_in_title)
    frames = [_frame(node, name, modal.n_modes) for node, name in zip(modal.nodes, names, strict=False)]
    points = [_frame(node, "", modal.n_modes) for node in modal.nodes[n_frames:]]
    if not points:
        return frames, None
    numbers = np.arange(len(points))
    modes = NodalModes(numbers, np.stack([one.p_BI_B for one in points]), np.stack([one.modes[:3] for one in points]))
    return frames, modes


def _frame(node: SidNode, name: str, n: int) -> InterfaceFrame:
    where = f"node {node.number}"
    origin = _shaped(node.blocks.get("origin"), (3, 1), f"origin of {where}")
    if origin is None:
        raise ExportError(f"{where} has no origin")
    phi = _shaped(node.blocks.get("phi"), (3, n), f"phi of {where}")
    if phi is None:
        phi = Taylor(np.zeros((3, n)) if origin.m1 is None else origin.m1[:, :, 0])
    psi = _shaped(node.blocks.get("psi"), (3, n), f"psi of {where}")
    axes = _shaped(node.blocks.get("AP"), (3, 3), f"AP of {where}")
    R = np.eye(3) if axes is None else axes.m0
    if np.abs(R.T @ R - np.eye(3)).max() > 1e-6 or np.linalg.det(R) < 0.0:
        raise ExportError(f"AP of {where} is not a rotation")
    rotations = np.zeros((3, n)) if psi is None else psi.m0
    return InterfaceFrame(name, origin.m0[:, 0], R, np.vstack([phi.m0, rotations]))


def _shaped(block: Taylor | None, shape: tuple[int, int], what: str) -> Taylor | None:
    if block is not None and block.m0.shape != shape:
        raise ExportError(f"{what} is {block.m0.shape[0]} x {block.m0.shape[1]}, expected {shape[0]} x {shape[1]}")
    return block


def _interface_loads(node: SidNode, name: str) -> tuple[list[str], list[FloatArray]]:
    """Loads of a node and the stiffness that they add."""
    names: list[str] = []
    stiffness: list[FloatArray] = []
    for block, dofs in (("phi", FRAME_DOFS[:3]), ("psi", FRAME_DOFS[3:])):
        if block in node.blocks and (m1 := node.blocks[block].m1) is not None and m1.any():
            names += [f"{name}.{dof}" for dof in dofs]
            stiffness += [-0.5 * (one + one.T) for one in m1]
    return names, stiffness


def _normal_form(mass: FloatArray, stiffness: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(n,) squared frequencies, ascending, and (n, n) T with T^T mass T = I and T^T stiffness T diagonal."""
    n = len(mass)
    squares = np.diag(stiffness)
    if np.array_equal(mass, np.eye(n)) and np.array_equal(stiffness, np.diag(squares)):
        order = np.argsort(squares, kind="stable")
        T, values = np.eye(n)[:, order], squares[order]
    else:
        try:
            inverse = np.linalg.inv(np.linalg.cholesky(0.5 * (mass + mass.T)))
        except np.linalg.LinAlgError as error:
            raise ExportError("the modal mass Me is not positive definite: modes depend on each other") from error
        values, vectors = np.linalg.eigh(inverse @ (0.5 * (stiffness + stiffness.T)) @ inverse.T)
        T = inverse.T @ vectors
    if not (values > 0.0).all():
        raise ExportError(
            f"the stiffness Ke is not positive definite ({values.min():.2e} is its least value): the modes contain "
            "motions without deformation, which belong to the body's frame"
        )
    return values, T


def _refuse_no_mass(gram: FloatArray, tolerance: float) -> None:
    """Refuse integrals that no distribution of mass has."""
    size = np.sqrt(np.maximum(np.diag(gram), np.finfo(float).tiny))
    size[1:] = np.repeat(np.sqrt(np.sum(size[1:].reshape(-1, 3) ** 2, axis=1)), 3)
    scaled = gram / np.outer(size, size)
    least = np.linalg.eigvalsh(scaled)[0] if np.isfinite(scaled).all() else -np.inf
    if least < -tolerance:
        raise ExportError(f"its blocks are the integrals of no distribution of mass (relative eigenvalue {least:.1e})")


def _resting(frames: Sequence[InterfaceFrame]) -> str | None:
    """The interface that the body frame sits on, to the rounding of a file."""
    largest = max((float(np.abs(one.modes).max(initial=0.0)) for one in frames), default=0.0)
    length = max((float(np.abs(one.p_BI_B).max()) for one in frames), default=0.0)
    for frame in frames:
        moved = np.abs(frame.modes).max(initial=0.0) > _ROUNDING * largest
        away = np.abs(frame.p_BI_B).max() > _ROUNDING * length
        if not (moved or away or np.abs(frame.R_BI - np.eye(3)).max() > _ROUNDING):
            return frame.name
    return None
