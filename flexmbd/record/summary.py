"""The readable summary of a reduced body, printed by `ReducedBody.inspect` and `flexmbd inspect`.

The same record gives the same text, before and after it was saved.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from itertools import groupby
from typing import Protocol

import numpy as np

from flexmbd.record.file_kind import RECORD
from flexmbd.record.groups import (
    FRAME_DOFS,
    ContactPatches,
    DistributedLoads,
    FloatArray,
    FurtherUnknowns,
    GeometricStiffness,
    Gyroscopic,
    Heat,
    InterfaceFrame,
    ModalStretch,
    NodalInterfaces,
    NodalModes,
    NonlinearStiffness,
    Ports,
    RecordGroup,
    StressModes,
    Surface,
)
from flexmbd.record.held_modes import held_modes
from flexmbd.rotation import to_quaternion
from flexmbd.round_off import EQUAL, SEVEN_DIGITS

_MARGIN = 16
# Damping ratios that are shown of a body in one state.
_FIRST = 3
# as in "tip.rx", or "tip.rx from root" where the body frame floats
_INTERFACE_DOF = re.compile(rf"(.+)\.(?:{'|'.join(FRAME_DOFS)})((?: from .+)?)")

# as in "weld.17.x"
_NODE_DOF = re.compile(r"(.+)\.\d+\.[xyz]()")

# Where a record's provenance has the loads of the state that it is about.
_PRESTRESS = "prestress"

_PURPOSE = {
    "modes": "displacements at the mesh's nodes, stress pictures of a loaded record, nodal exports",
    "nodal": "interfaces whose nodes move by themselves, coupled by programs of finite elements",
    "unknowns": "the same of forms with rotations or pressures",
    "surface": "pictures and films without the mesh",
    "geometric": "stiffening and softening by motion and load, in other programs",
    "stretch": "the same in a machine here; without it a spinning slender body is too soft",
    "nonlinear": "the strain energy of large displacements",
    "gyroscopic": "forces of rotors inside the body",
    "loads": "pressures and tractions that a machine scales",
    "ports": "efforts that a machine sets and flows that answer, as electrodes' voltage and charge",
    "heat": "stress from the model where a warm body cannot expand",
    "stress": "stress at the nodes without the model",
    "contact": "patches that may be touched, and the flexibility there that the modes leave out",
}


class _Record(Protocol):
    """What the summary reads of a `ReducedBody`, whose `inspect` calls it."""

    @property
    def frame(self) -> str | None: ...
    @property
    def interfaces(self) -> tuple[InterfaceFrame, ...]: ...
    @property
    def gram(self) -> FloatArray: ...
    @property
    def stiffness(self) -> FloatArray: ...
    @property
    def damping(self) -> FloatArray: ...
    @property
    def partition_names(self) -> tuple[str, ...]: ...
    @property
    def provenance(self) -> Mapping[str, str]: ...
    @property
    def p_MB_M(self) -> FloatArray: ...
    @property
    def R_MB(self) -> FloatArray: ...
    @property
    def n_modes(self) -> int: ...
    @property
    def mass(self) -> float: ...
    @property
    def com(self) -> FloatArray: ...
    @property
    def inertia(self) -> FloatArray: ...
    def fingerprint(self) -> str: ...
    def frequencies(self) -> FloatArray: ...
    def mass_matrix(self) -> FloatArray: ...
    def modal_mass(self) -> FloatArray: ...


def summary(body: _Record) -> str:
    """The summary, with a newline at its end; see `ReducedBody.inspect`."""
    sections = (
        _title(body),
        _mass(body),
        _interfaces(body),
        _modes(body),
        _partition(body),
        _groups(body),
        _provenance(body),
    )
    return "\n\n".join("\n".join(lines) for lines in sections) + "\n"


def _title(body: _Record) -> Iterable[str]:
    yield f"reduced body: {body.n_modes} modes, {_count(len(body.interfaces), 'interface')}, SI units"
    yield _entry("file format", f"version {RECORD.version}")
    yield _entry("fingerprint", body.fingerprint())


def _mass(body: _Record) -> Iterable[str]:
    second = body.gram[1:4, 1:4] / body.mass
    size = float(np.sqrt(np.trace(second)))
    yield _entry("body frame B", _frame_text(body))
    if _PRESTRESS in body.provenance:
        yield _entry("prestressed", "at q = 0 the loads below are in balance; a machine must not apply them again")
        yield from (_entry("", text) for text in body.provenance[_PRESTRESS].splitlines())
    place = _vector(body.p_MB_M, scale=size + float(np.linalg.norm(body.p_MB_M)))
    yield _entry("in the mesh", f"origin of B at {place} m; {_turn_text(body.R_MB, whose='the mesh')}")
    yield _entry("mass", f"{_number(body.mass)} kg")
    yield _entry("centre of mass", f"{_vector(body.com, scale=size)} m from B, in B's axes")
    moments, axes = np.linalg.eigh(body.inertia)
    # of a mass that is all in one point nothing is left but round-off
    scale = body.mass * size**2
    yield _entry("inertia", f"{_vector(moments, scale=scale)} kg m^2 about the centre, principal")
    for moment, axis in zip(moments, axes.T, strict=True):
        alike = int(np.sum(abs(moments - moment) <= SEVEN_DIGITS * moments[-1]))
        yield _entry("", f"{_number(moment, scale=scale):>12} about {_axis_text(axis, alike=alike)}")


def _frame_text(body: _Record) -> str:
    if body.frame is None:
        return "floating on the mean axis of the undeformed body"
    return f"on interface {body.frame}, where every mode vanishes (in the mean, if it is averaged)"


def _axis_text(axis: FloatArray, *, alike: int) -> str:
    if alike == 3:
        return "any axis"
    if alike == 2:
        return "any axis across the third"
    sign = np.sign(axis[np.argmax(abs(axis) > 0.5 * abs(axis).max())])
    return _vector(sign * axis, scale=1.0)


def _interfaces(body: _Record) -> Iterable[str]:
    more = "" if body.frame is None else "; static stiffness along and about I's axes"
    yield f"interfaces: place of I from B (m) and turn of I's axes from B's{more}"
    if body.frame is not None:
        yield "(N/m, N m/rad), each with B held and everything else free"
    if not body.interfaces:
        yield _entry("", "none")
    size = max((float(np.linalg.norm(frame.p_BI_B)) for frame in body.interfaces), default=0.0)
    for frame in body.interfaces:
        yield _entry(frame.name, f"{_vector(frame.p_BI_B, scale=size)}; {_turn_text(frame.R_BI, whose='B')}")
        if body.frame is not None and frame.name != body.frame:
            stiffness = _static_stiffness(body, frame)
            yield _entry("", "   ".join(f"{dof} {k}" for dof, k in zip(FRAME_DOFS, stiffness, strict=True)))


def _turn_text(R: FloatArray, *, whose: str) -> str:
    w, *xyz = to_quaternion(R)
    sine = float(np.linalg.norm(xyz))
    angle = np.degrees(2.0 * np.arctan2(sine, abs(w)))
    if angle < 1e-9:
        return f"{whose}'s axes"
    return f"turned {angle:.6g} deg about {_vector(np.copysign(1.0, w) * np.array(xyz) / sine, scale=1.0)}"


def _static_stiffness(body: _Record, frame: InterfaceFrame) -> Iterable[str]:
    """Load along one direction of the interface over the displacement there, all else free but B."""
    turned = np.vstack([frame.R_BI.T @ frame.modes[:3], frame.R_BI.T @ frame.modes[3:]])
    parts = turned**2 / body.stiffness
    flexibility = parts.sum(axis=1)
    for row, total in enumerate(flexibility):
        like = flexibility[:3] if row < 3 else flexibility[3:]
        yield _number(1.0 / total) if total > EQUAL**2 * like.max() and total > 0.0 else "rigid"


def _modes(body: _Record) -> Iterable[str]:
    if body.n_modes == 0:
        yield "modes: none, the body is rigid"
        return
    free = [f"{frequency:.6g}" for frequency in body.frequencies()]
    ratios = [f"{ratio:.4g}" for ratio in held_modes(body.gram, body.stiffness).ratios(body.damping)]
    if body.frame is None:
        yield "modes: frequencies (Hz) of the free body, damping ratio; no mode moves with B's origin or axes"
        yield _row("mode", ["free", "damping"])
        yield from (_row(str(i), row) for i, row in enumerate(zip(free, ratios, strict=True), start=1))
    else:
        yield "modes: frequencies (Hz), damping ratios of the body free and with B held; effective mass along B's axes"
        yield "and effective inertia about them (% of the body's, motion of B as base)"
        yield _row("mode", ["free", "damping", "B held", "damping"], FRAME_DOFS)
        held = [f"{frequency:.6g}" for frequency in np.sqrt(body.stiffness) / (2.0 * np.pi)]
        there = [f"{ratio:.4g}" for ratio in np.diag(body.damping) / (2.0 * np.sqrt(body.stiffness))]
        shares = _effective_shares(body)
        for i, row in enumerate(zip(free, ratios, held, there, strict=True)):
            yield _row(str(i + 1), row, [f"{100.0 * share:.2f}" for share in shares[i]])
        yield _row("sum", [""] * 4, [f"{100.0 * share:.2f}" for share in shares.sum(axis=0)])
    yield from ratio_lines(body)
    coupling = _coupling(body.damping)
    if coupling > EQUAL:
        yield f"the damping couples modes: largest D_ij / sqrt(D_ii D_jj) = {coupling:.2g}"


def damping_ratios(body: _Record) -> dict[str, FloatArray]:
    """(n,) damping ratios of the modes, by the interface that is held; of the free body by an empty name."""
    states: list[tuple[str, tuple[InterfaceFrame, ...]]] = [("", ())]
    states += [(frame.name, (frame,)) for frame in body.interfaces]
    return {name: held_modes(body.gram, body.stiffness, held).ratios(body.damping) for name, held in states}


def ratio_lines(body: _Record) -> Iterable[str]:
    """The first damping ratios of the free body and with each interface held; nothing of a body without damping."""
    if not body.damping.any():
        return
    yield "damping ratios of the first modes"
    for name, ratios in damping_ratios(body).items():
        more = ", ..." if len(ratios) > _FIRST else ""
        state = f"with {name} held" if name else "of the free body"
        yield _entry(state, ", ".join(f"{ratio:.4g}" for ratio in ratios[:_FIRST]) + more)


def _effective_shares(body: _Record) -> FloatArray:
    """(n, 6) squared participation in a motion of B, over the body's mass or inertia in that motion."""
    matrix = body.mass_matrix()
    whole = np.diag(matrix)[:6]
    # about the axis of a bar there is no inertia, and so no share of it
    there = whole > EQUAL * np.repeat([whole[:3].max(), whole[3:].max()], 3)
    squares = matrix[6:, :6] ** 2 / body.modal_mass().diagonal()[:, None]
    shares: FloatArray = np.where(there, squares / np.where(there, whole, 1.0), 0.0)
    return shares


def _coupling(damping: FloatArray) -> float:
    size = np.sqrt(abs(np.diag(damping)))
    size[size == 0.0] = np.sqrt(abs(damping).max(initial=0.0)) or 1.0
    off = damping / np.outer(size, size)
    np.fill_diagonal(off, 0.0)
    return float(abs(off).max(initial=0.0))


def _partition(body: _Record) -> Iterable[str]:
    yield "partition: the Craig-Bampton coordinates behind the modes, q_cb = partition @ q"
    if not body.partition_names:
        yield _entry("", "none")
    stems = [_stem(name) for name in body.partition_names]
    for stem, run in groupby(range(len(stems)), key=stems.__getitem__):
        names = [body.partition_names[i] for i in run]
        span = names[0] if len(names) == 1 else f"{names[0]} .. {names[-1]}"
        yield _entry(str(len(names)), f"{span}{'' if '.' not in stem else ' (m, rad)'}")


def _stem(name: str) -> str:
    """What the names of coordinates of one kind have in common, with a point in those of interfaces alone."""
    interface = _INTERFACE_DOF.fullmatch(name) or _NODE_DOF.fullmatch(name)
    return "{}.{}".format(*interface.groups()) if interface else name.rstrip("0123456789").replace(".", "")


def _groups(body: _Record) -> Iterable[str]:
    yield "optional groups"
    for name, purpose in _PURPOSE.items():
        group = getattr(body, name)
        yield _entry(name, f"{'absent' if group is None else _group_text(group)}; for {purpose}")
        if isinstance(group, GeometricStiffness):
            yield from _geometric_lines(group, body.stiffness)
        elif isinstance(group, DistributedLoads):
            yield from _load_lines(group)
        elif isinstance(group, ContactPatches):
            yield from _contact_lines(group)
        elif isinstance(group, Ports):
            yield from _port_lines(group)


def _group_text(group: RecordGroup) -> str:
    match group:
        case NodalModes() | NodalInterfaces() | StressModes():
            return _count(len(group.node), "node")
        case FurtherUnknowns():
            return _count(len(group.dof), "dof")
        case Surface():
            return f"{_count(len(group.triangle), 'triangle')} on {_count(len(group.x), 'vertex', 'vertices')}"
        case GeometricStiffness():
            return _count(len(group.loads), "load")
        case ModalStretch():
            return _count(len(group.strain), "membrane strain")
        case NonlinearStiffness():
            terms = f"{len(group.cubic)} cubic and {len(group.quartic)} quartic terms"
            return f"{terms}, compared with the full model up to {group.energy[0]:.4g} J"
        case Gyroscopic():
            return f"angular momentum {_vector(group.momentum, scale=float(np.linalg.norm(group.momentum)))} N m s"
        case ContactPatches():
            return _count(len(group.area), "patch", "patches")
        case DistributedLoads():
            return _count(len(group.names), "load")
        case Ports():
            return _count(len(group.names), "port")
        case Heat():
            return f"{_count(len(group.names), 'temperature')} at {_count(len(group.node), 'node')}"


def _geometric_lines(group: GeometricStiffness, stiffness: FloatArray) -> Iterable[str]:
    """For each load its largest relative change of the stiffness, per unit: c times that near 1 is much."""
    size = np.sqrt(stiffness)
    for load, matrix in zip(group.loads, group.K, strict=True):
        values = np.linalg.eigvalsh(matrix / np.outer(size, size)) if len(size) else np.zeros(1)
        yield _entry("", f"{load}: from {values[0]:.4g} to {values[-1]:.4g} of the stiffness per unit load")


def _load_lines(group: DistributedLoads) -> Iterable[str]:
    for name, force, moment in zip(group.names, group.force, group.moment, strict=True):
        forces = _vector(force, scale=float(np.linalg.norm(force)))
        moments = _vector(moment, scale=float(np.linalg.norm(moment)))
        yield _entry("", f"{name}: force {forces} N, moment {moments} N m about B, per unit factor")


def _port_lines(group: Ports) -> Iterable[str]:
    texts = group.names, group.efforts, group.effort_units, group.flow_units
    for name, effort, unit, per, own in zip(*texts, np.diag(group.capacity), strict=True):
        yield _entry("", f"{name}: {effort} in {unit}, {own:.4g} {per}/{unit} beside the modes")


def _contact_lines(group: ContactPatches) -> Iterable[str]:
    """For each surface its patches, and the residual flexibility of each under its own load."""
    flexibility = np.diag(group.G).reshape(-1, 3)
    for i, name in enumerate(group.names):
        own = group.surface == i
        area, normal, across = (
            f"{part.min():.4g} to {part.max():.4g}"
            for part in (group.area[own], flexibility[own, 0], flexibility[own, 1:])
        )
        patches = _count(int(own.sum()), "patch", "patches")
        yield _entry(
            "", f"{name}: {patches}, {area} m^2; beside the modes {normal} m/N along the normals, {across} across"
        )


def _provenance(body: _Record) -> Iterable[str]:
    yield "provenance"
    if not body.provenance:
        yield _entry("", "none")
    # HDF5 keeps no order of insertion
    keys = sorted(body.provenance.keys() - {_PRESTRESS})
    width = max(map(len, keys), default=0)
    for key in keys:
        first, *further = body.provenance[key].splitlines() or [""]
        yield f"  {key:<{width}}  {first}".rstrip()
        yield from (f"  {'':<{width}}  {line}".rstrip() for line in further)


def _entry(name: str, text: str) -> str:
    return f"  {name:<{_MARGIN}}{'' if len(name) < _MARGIN else ' '}{text}"


def _row(first: str, wide: Sequence[str], narrow: Sequence[str] = ()) -> str:
    return f"  {first:>5}" + "".join(f"{figure:>12}" for figure in wide) + "".join(f"{figure:>9}" for figure in narrow)


def _count(number: int, one: str, several: str = "") -> str:
    return f"{number} {one if number == 1 else several or one + 's'}"


def _number(value: float, *, scale: float = 0.0) -> str:
    # the sum turns -0 into 0
    return f"{0.0 if abs(value) <= EQUAL * scale else float(value) + 0.0:.6g}"


def _vector(values: FloatArray, *, scale: float) -> str:
    return f"({', '.join(_number(value, scale=scale) for value in values)})"
