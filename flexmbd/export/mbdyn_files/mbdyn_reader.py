"""Reduced bodies from data files (.fem) of MBDyn's modal joint, ours and others'."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from flexmbd.errors import ExportError, RecordError
from flexmbd.export.gram_completion import completed_gram
from flexmbd.export.mbdyn_files.mbdyn_file import OURS
from flexmbd.export.mbdyn_files.mbdyn_groups import RecordGroups
from flexmbd.export.mbdyn_files.mbdyn_invariants import AGREE, Invariants, RigidInertia, gram_of, stiffening_loads
from flexmbd.export.mbdyn_files.mbdyn_invariants import shapes as shapes_of_groups
from flexmbd.export.mbdyn_files.rigid_modes import SplitModes, split_modes
from flexmbd.export.normal_modes import normal_modes
from flexmbd.files.whole_file import finite, read_text
from flexmbd.given import checked
from flexmbd.multibody.bodies.body import RigidBody
from flexmbd.record.groups import FloatArray, GeometricStiffness, Gyroscopic, InterfaceFrame, NodalModes
from flexmbd.record.held_modes import mass_matrix
from flexmbd.record.reduced_body import ReducedBody
from flexmbd.round_off import EQUAL, SEVEN_DIGITS, TEN_DIGITS

BoolArray = npt.NDArray[np.bool_]



@checked(error=ExportError)
def read_mbdyn(
    path: str | Path,
    *,
    interfaces: Sequence[str] | None = None,
    rigid: RigidBody | None = None,
    uncoupled: bool = False,
    momentum_alone: bool = False,
) -> ReducedBody:
    """Read a data file of MBDyn's modal joint. Not collective.

    The Gram matrix follows from the nodes' masses, moments of inertia and shapes (group 11) or from the invariants
    (groups 14 to 18); group 12, the rigid inertia, goes before what the nodes have of it.  With group 12 alone the
    modes have no momentum, as MBDyn takes them: those of a free body have none.  RecordGroups 3 and 4 are passed over.
    Frames are nodes, with the axes of B where the file does not tell others.  Modes that are not in normal form are
    brought to it; the partition tells how.  The part of a damping matrix that is not symmetric takes no power and is
    `gyroscopic`; stiffening by loads (group 19) is `geometric`.

    Args:
        path: a .fem file.
        interfaces: labels of the nodes that become frames, in the order in which the joint has them where the file has
            a group 19; by default those without mass, of a file with invariants all, of one with neither none.
        rigid: mass, centre and inertia of the body at the file's origin, where the file has none.
        uncoupled: take modes of a body that is held at a node as ones without momentum, where the file says nothing of
            it: right where that node rests.
        momentum_alone: take of nodal masses the momentum of the modes, and group 9 as it is, where the two are of
            unlike modal masses; MBDyn does so.

    Raises:
        ExportError: the file is missing, damaged, or holds something else; it has no inertia, or that of another body
            than its modal mass; a mode has no mass; a label is not known.
    """
    try:
        with np.errstate(all="raise", under="ignore"):
            groups = RecordGroups.of(path, read_text(path))
            chosen = _Choices(rigid, uncoupled, momentum_alone)
            return _body(path, groups, interfaces, chosen)
    except ExportError as error:
        raise error if str(path) in str(error) else ExportError(f"{path}: {error}") from error
    except (LookupError, ValueError, TypeError, ArithmeticError, np.linalg.LinAlgError, RecordError) as error:
        raise ExportError(f"{path} does not hold the modal data of one body: {error}") from error


@dataclass(frozen=True, eq=False)
class _Choices:
    """What the caller says of inertia, as `read_mbdyn`."""

    rigid: RigidBody | None
    uncoupled: bool
    momentum_alone: bool


def _body(path: str | Path, groups: RecordGroups, interfaces: Sequence[str] | None, chosen: _Choices) -> ReducedBody:
    k, n = groups.nodes, groups.modes
    labels = groups.labels()
    x = np.column_stack([groups.numbers(group, k) for group in (5, 6, 7)])
    shapes = np.moveaxis(groups.numbers(8, n, k, 6), 0, -1)
    mass = groups.numbers(9, n, n)
    massless = [str(mode) for mode, m in enumerate(np.diag(mass), start=1) if m == 0.0]
    if massless:
        raise ExportError(
            f"{path}: modes {', '.join(massless[:8])} have no mass in group 9, and a machine's modes have some: write "
            "the file without them, or give the nodes that they move a mass"
        )
    held = groups.numbers(10, n, n)
    split = split_modes(held, mass, x=x, shapes=shapes)
    gram, known = _inertia(path, groups, x, shapes, mass=mass, chosen=chosen, split=split)
    if split is None:
        stiffness, basis = normal_modes(path, held, mass=mass)
        partition, partition_names = basis, tuple(f"mode {number + 1}" for number in range(n))
    else:
        basis = split.elastic
        stiffness = np.einsum("ij,ik,kj->j", basis, held, basis)
        partition = np.eye(len(stiffness))
        partition_names = tuple(f"elastic mode {number + 1}" for number in range(len(stiffness)))
    damping = basis.T @ (groups.numbers(13, n, n) if 13 in groups.words else np.zeros((n, n))) @ basis
    if len(gram) == 4 + 3 * n:
        change = np.zeros((4 + 3 * n, 4 + 3 * len(stiffness)))
        change[:4, :4], change[4:, 4:] = np.eye(4), np.kron(basis, np.eye(3))
        gram = change.T @ gram @ change
    shapes = shapes @ basis
    names = _frame_names(groups, labels) if interfaces is None else interfaces
    unknown = [name for name in names if name not in labels]
    if unknown:
        raise ExportError(f"{path} has no node {unknown[0]!r}; its nodes begin with {', '.join(labels[:8])}")
    comments = dict(_comments(groups.ours))
    resting = _resting(shapes)
    frames = tuple(
        InterfaceFrame(
            name, x[row], _axes(path, comments.get(f"axes {name}")), np.where(resting[row], 0.0, shapes[row])
        )
        for name, row in ((name, labels.index(name)) for name in names)
    )
    carrier = _frame(frames, comments)
    return ReducedBody(
        gram=gram,
        stiffness=stiffness,
        damping=0.5 * (damping + damping.T),
        interfaces=frames,
        frame=carrier,
        partition=partition,
        partition_names=partition_names,
        provenance={"read from": "modal data file of MBDyn", "inertia of the modes": known},
        p_MB_M=_numbers(path, comments.get("mesh position"), 3, default=np.zeros(3)),
        R_MB=_axes(path, comments.get("mesh axes")),
        modes=None if groups.ours else _nodal_modes(labels, x, shapes),
        geometric=_geometric(groups, frames, carrier, basis),
        gyroscopic=_gyroscopic(damping, stiffness),
    )


def _inertia(
    path: str | Path,
    groups: RecordGroups,
    x: FloatArray,
    shapes: FloatArray,
    *,
    mass: FloatArray,
    chosen: _Choices,
    split: SplitModes | None,
) -> tuple[FloatArray, str]:
    """The Gram matrix, of the file's modes or of the elastic ones among them, and where it is from."""
    n = groups.modes
    whole = _rigid(groups, chosen.rigid)
    found = {
        attribute: groups.numbers(group, *shape)
        for group, (attribute, shape) in shapes_of_groups(n).items()
        if group in groups.words
    }
    if 11 in groups.words:
        if found:
            raise ExportError(
                f"{path} has nodal masses (group 11) and invariants (groups 14 to 18), which MBDyn adds to each other: "
                "leave one of them out"
            )
        gram = _gram(x, shapes, groups.nodal_inertia())
        if whole is not None:
            whole.fill(gram)
        if not gram[0, 0] > 0.0:
            raise ExportError(f"{path}: none of its nodes has a mass in group 11, and it has no group 12")
        if not chosen.momentum_alone:
            _check_modal_mass(path, np.einsum("iaja->ij", gram[4:, 4:].reshape(n, 3, n, 3)), mass)
            return gram, "of nodes"
        at_rest = mass_matrix(gram)
        at_rest[6:, 6:] = mass
        levers = gram[1:4, 4:].reshape(3, n, 3)
        return completed_gram(at_rest, levers=levers), "momentum of nodes, completed to the modal mass"
    if split is not None and not found:
        at_rest = np.eye(6 + split.elastic.shape[1])
        at_rest[:6, :6] = split.mass
        return completed_gram(at_rest), "rigid motions among the modes"
    if whole is None:
        raise ExportError(
            f"{path} has neither group 11, nodal masses, nor group 12, rigid inertia, so the body's mass is not known: "
            "give it by rigid=fm.RigidBody(mass, inertia, com)"
        )
    if not {"i3", "i4", "i8"} & set(found) and not chosen.uncoupled:
        held = np.flatnonzero(_resting(shapes).all(axis=(1, 2)))
        if len(held):
            raise ExportError(
                f"{path} has a group 12, rigid inertia, and nothing of the modes' momentum, which is zero in a free "
                f"body; its modes rest at node {groups.labels()[held[0]]!r}, so they are of a body that is held there. "
                "Write groups 11 or 14 to 18 too, or take it so for a body that is fixed in the machine: uncoupled=True"
            )
    gram = gram_of(whole, Invariants(**found), mass)
    return gram, "invariants" if found else "rigid inertia alone: modes without momentum"


def _rigid(groups: RecordGroups, given: RigidBody | None) -> RigidInertia | None:
    if 12 in groups.words:
        if given is not None:
            raise ExportError(f"{groups.path} has a group 12, rigid inertia: leave rigid= out")
        numbers = groups.numbers(12, 13)
        told = numbers[4:].reshape(3, 3)
        return RigidInertia(float(numbers[0]), numbers[1:4], 0.5 * (told + told.T))
    if given is None:
        return None
    inertia: FloatArray = np.asarray(given.inertia, dtype=np.float64)
    if inertia.ndim == 1:
        inertia = np.diag(inertia)
    return RigidInertia(float(given.mass), np.asarray(given.com, dtype=np.float64), inertia)


def _check_modal_mass(path: str | Path, nodal: FloatArray, mass: FloatArray) -> None:
    """Refuse a group 9 that is not of the nodes' masses, naming the mode that is farthest off."""
    size = np.sqrt(abs(np.diag(mass)))
    apart = abs(nodal - mass) / np.outer(size, size)
    worst = float(apart.max())
    if not worst <= AGREE:
        mode = int(np.argmax(apart.max(axis=1)))
        raise ExportError(
            f"{path}: the modal mass of group 9 and that of the nodes' masses in group 11 are {worst:.1e} apart (mode "
            f"{mode + 1}: {mass[mode, mode]:.6g} and {nodal[mode, mode]:.6g}), so they are of two bodies: lump the "
            "mass first and compute the modes from it, or take group 9 and of the nodes the momentum of the modes "
            "alone, as MBDyn does: momentum_alone=True"
        )


def _frame_names(groups: RecordGroups, labels: list[str]) -> list[str]:
    """Nodes without mass; of a file with invariants alone all, since they are there for joints."""
    if 11 in groups.words:
        return [label for label, m in zip(labels, groups.nodal_inertia()[:, 0], strict=True) if m == 0.0]
    return labels if groups.words.keys() & {14, 15, 16, 17, 18, 19} else []


def _resting(shapes: FloatArray) -> BoolArray:
    """(nodes, 6, n) whether a displacement or a rotation is none, beside the largest of its kind."""
    moved = abs(shapes)
    largest = np.maximum(moved[:, :3].max(axis=(0, 1)), 0.0), np.maximum(moved[:, 3:].max(axis=(0, 1)), 0.0)
    bound = EQUAL * np.stack([largest[0]] * 3 + [largest[1]] * 3)
    rests: BoolArray = moved <= bound
    return rests & rests.all(axis=(1, 2), keepdims=True)


def _geometric(
    groups: RecordGroups, frames: tuple[InterfaceFrame, ...], carrier: str | None, basis: FloatArray
) -> GeometricStiffness | None:
    moving = [frame.name for frame in frames if frame.name != carrier]
    matrices = groups.stiffening(len(moving))
    if not matrices:
        return None
    names = stiffening_loads(moving)
    K = np.array([basis.T @ (0.5 * (matrices[at] + matrices[at].T)) @ basis for at in sorted(matrices)])
    return GeometricStiffness(tuple(names[at] for at in sorted(matrices)), K)


def _gyroscopic(damping: FloatArray, stiffness: FloatArray) -> Gyroscopic | None:
    """The skew part of a damping matrix, where it is more than round-off in the scale of the damping ratios."""
    skew = 0.5 * (damping - damping.T)
    scale = np.sqrt(np.sqrt(np.outer(stiffness, stiffness)))
    if not (abs(skew) > SEVEN_DIGITS * abs(damping / scale).max(initial=0.0) * scale).any():
        return None
    n = len(stiffness)
    return Gyroscopic(np.zeros(3), np.zeros((3, n)), skew)


def _gram(x: FloatArray, shapes: FloatArray, inertia: FloatArray) -> FloatArray:
    """Mass integrals of nodes with mass, and with moments of inertia J about the axes.

    A node's second moment along axis a is s_a = tr(J)/2 - J_a; a particle at e_a from the node has the fields e_a
    and r x e_a, of the rotation r.
    """
    k, _, n = shapes.shape
    fields = np.ones((k, 4 + 3 * n))
    fields[:, 1:4] = x
    fields[:, 4:] = shapes[:, :3].swapaxes(1, 2).reshape(k, 3 * n)
    gram: FloatArray = fields.T @ (inertia[:, :1] * fields)
    turning = np.flatnonzero(inertia[:, 3:].any(axis=1))
    for axis in range(3):
        along = np.zeros((len(turning), 4 + 3 * n))
        along[:, 1 + axis] = 1.0
        turned = np.cross(shapes[turning, 3:], np.eye(3)[axis], axisa=1, axisb=0, axisc=1)
        along[:, 4:] = turned.swapaxes(1, 2).reshape(len(turning), 3 * n)
        second = 0.5 * inertia[turning, 3:].sum(axis=1) - inertia[turning, 3 + axis]
        gram += along.T @ (second[:, None] * along)
    return 0.5 * (gram + gram.T)


def _comments(ours: tuple[str, ...]) -> Iterator[tuple[str, str]]:
    """(what, its words) of our lines."""
    for line in ours:
        what, _, rest = line.partition(" ")
        if what in ("mesh", "axes"):
            second, _, rest = rest.partition(" ")
            what = f"{what} {second}"
        yield what, rest.strip()


def _numbers(path: str | Path, words: str | None, count: int, *, default: FloatArray) -> FloatArray:
    if words is None:
        return default
    values = np.array(words.split(), dtype=np.float64)
    if values.shape != (count,):
        raise ExportError(f"{path}: a line beginning with {OURS!r} has {values.size} numbers, expected {count}")
    return finite(values, path=path, what=f"a line beginning with {OURS!r}")


def _axes(path: str | Path, words: str | None) -> FloatArray:
    axes = _numbers(path, words, 9, default=np.eye(3).ravel()).reshape(3, 3)
    if np.abs(axes.T @ axes - np.eye(3)).max() > TEN_DIGITS:
        raise ExportError(f"{path}: axes in a line beginning with {OURS!r} are not at right angles")
    return axes


def _frame(frames: tuple[InterfaceFrame, ...], comments: dict[str, str]) -> str | None:
    """The interface that carries B: as told, else the first node at the origin that no mode moves."""
    if "frame" in comments:
        return comments["frame"] if any(frame.name == comments["frame"] for frame in frames) else None
    return next((frame.name for frame in frames if not (frame.p_BI_B.any() or frame.modes.any())), None)


def _nodal_modes(labels: list[str], x: FloatArray, shapes: FloatArray) -> NodalModes:
    """The nodes by their labels where these are numbers, else in their order."""
    whole = all(label.isascii() and label.isdigit() and len(label) < 10 for label in labels)
    numbers = np.array([int(label) for label in labels] if whole else range(len(labels)), dtype=np.int64)
    order = np.argsort(numbers, kind="stable")
    return NodalModes(numbers[order], x[order], shapes[order, :3])
