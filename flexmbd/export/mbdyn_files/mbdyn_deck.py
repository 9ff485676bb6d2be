"""A complete input deck for MBDyn: a reduced body that swings as a pendulum."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from flexmbd.errors import ExportError
from flexmbd.export.mbdyn_files.mbdyn_file import check_label, check_modes, number, vector
from flexmbd.files.whole_file import write_file
from flexmbd.given import checked, is_number
from flexmbd.record.groups import FloatArray
from flexmbd.record.reduced_body import ReducedBody
from flexmbd.round_off import SAME_PLACE

#: Labels in the deck: the modal node, the modal joint and the hinge; interfaces' nodes follow on the modal node.
MODAL_NODE, MODAL_JOINT, HINGE = 1, 10, 20


@dataclass(frozen=True)
class MbdynPendulum:
    """What a deck says, for whoever builds the same machine elsewhere; the world's axes are those of B at the start.

    Attributes:
        hinge: the interface that hangs.
        axis: (3,) unit vector of the hinge, through that interface's origin.
        gravity: (3,) m/s^2.
        rate: rad/s, about the axis, at the start.
        nodes: label of each interface's structural node; of the body frame's interface the modal node.
    """

    hinge: str
    axis: FloatArray
    gravity: FloatArray
    rate: float
    nodes: dict[str, int]


@checked("body", "fem", "path", "hinge", "axis", "invariants", error=ExportError)
def mbdyn_deck(
    body: ReducedBody,
    fem: str | Path,
    path: str | Path,
    *,
    hinge: str | None = None,
    axis: Sequence[float] = (0.0, 1.0, 0.0),
    rate: float = 2.0,
    gravity: float = 9.81,
    end: float = 1.0,
    step: float = 1e-3,
    invariants: bool = False,
) -> MbdynPendulum:
    """Write an input deck (.mbd) of a pendulum that MBDyn runs as it is, in the folder of the deck.

    The body hangs from a hinge at an interface, its centre of mass below the hinge, and starts with an angular
    velocity: in this state a rigid body has no angular acceleration, so that MBDyn's start, which does not solve for
    accelerations, costs no order.

    Take a body that floats (``frame=None`` of the reduction): MBDyn's iteration does not converge where the body frame
    is an interface and the body bends by more than a few per cent (docs/export/mbdyn.md).

    Args:
        body: with an interface.
        fem: the file that `mbdyn` wrote; the deck names it relative to its own folder.
        path: of the deck.
        hinge: name of the interface that hangs; default: the one that carries the body frame, else the first.
        axis: of the hinge, in B, through that interface's origin.
        rate: rad/s about it at the start.
        gravity: m/s^2.
        end: s.
        step: s.
        invariants: whether the file was written so.

    Raises:
        ExportError: the body has no interface; the axis has no direction or runs through the centre of mass; a name or
            number is none for MBDyn; the destination cannot be written.
        InterfaceError: the body has no interface of that name.
    """
    check_modes(body)
    for frame in body.interfaces:
        check_label(frame.name)
    name = os.path.relpath(fem, Path(path).parent)
    if any(mark in name for mark in '"\\\n\r'):
        raise ExportError(
            f"the file name {name!r} cannot stand in a deck of MBDyn: rename it without quotes, \\ and line ends"
        )
    if not all(map(is_number, (rate, gravity, step, end))) or not 0.0 < step <= end:
        raise ExportError(
            f"rate {rate!r} and gravity {gravity!r} must be numbers, and step {step!r} no longer than end {end!r}"
        )
    if not body.interfaces:
        raise ExportError("the pendulum hangs at an interface, and this body has none: name one in the reduction")
    hung = body.interface((body.frame or body.interfaces[0].name) if hinge is None else hinge)
    turning, down = _directions(body, hung.p_BI_B, axis)
    frames = [frame for frame in body.interfaces if frame.name != body.frame]
    nodes = {frame.name: label for label, frame in enumerate(frames, start=MODAL_NODE + 1)}
    if body.frame is not None:
        nodes[body.frame] = MODAL_NODE
    pendulum = MbdynPendulum(hung.name, turning, gravity * down, float(rate), nodes)
    write_file(path, "\n".join(_lines(body, name, pendulum, times=(end, step), invariants=invariants)) + "\n")
    return pendulum


def _directions(body: ReducedBody, place: FloatArray, axis: Sequence[float]) -> tuple[FloatArray, FloatArray]:
    """Unit vectors of the hinge at a place and of gravity, for which the body hangs at rest."""
    given = np.asarray(axis, dtype=np.float64)
    length = float(np.linalg.norm(given))
    if given.shape != (3,) or not (np.isfinite(length) and length > 0.0):
        raise ExportError(f"the axis {axis!r} has no direction: give three numbers, not all zero")
    turning = np.asarray(given / length, dtype=np.float64)
    below = body.com - place
    arm: FloatArray = below - turning * (turning @ below)
    distance = float(np.linalg.norm(arm))
    if not distance > SAME_PLACE * np.sqrt(np.trace(body.inertia) / body.mass):
        raise ExportError(f"the hinge's axis {tuple(axis)} runs through the centre of mass: choose another one")
    return turning, np.asarray(arm / distance, dtype=np.float64)


def _lines(
    body: ReducedBody, fem: str, pendulum: MbdynPendulum, *, times: tuple[float, float], invariants: bool
) -> Iterator[str]:
    others = [body.interface(name) for name, label in pendulum.nodes.items() if label != MODAL_NODE]
    names = "".join(f", {pendulum.nodes[frame.name]} is {frame.name}" for frame in others)
    at = body.interface(pendulum.hinge).p_BI_B
    spin = pendulum.rate * pendulum.axis
    yield "# A reduced elastic body as a pendulum; SI units. Run it in this folder: mbdyn -f <this file>"
    yield f"# Nodes: {MODAL_NODE} is the body frame{names}; the hinge is at {pendulum.hinge}"
    yield from _settings(1 + len(others), end=times[0], step=times[1], differentiated=invariants)
    yield "begin: nodes;"
    yield "    # position, orientation, velocity, angular velocity"
    yield f"    structural: {MODAL_NODE}, modal, null, eye, {vector(np.cross(spin, -at))}, {vector(spin)};"
    for frame in others:
        # all nodes have the orientation of the modal node: the file's rotations count from it
        place, speed = vector(frame.p_BI_B), vector(np.cross(spin, frame.p_BI_B - at))
        yield f"    structural: {pendulum.nodes[frame.name]}, static, {place}, eye, {speed}, {vector(spin)};"
    yield "end: nodes;"
    yield ""
    yield "begin: elements;"
    yield f"    joint: {MODAL_JOINT}, modal, {MODAL_NODE},"
    yield f"        {body.n_modes},"
    yield "        from file,"
    yield "        damping from file," if np.any(body.damping) else "        no damping,"
    yield f'        "{fem}",'
    ends = [f"        {len(others)}"]
    ends += [f'            "{frame.name}", {pendulum.nodes[frame.name]}, null' for frame in others]
    if not invariants:  # of files that have them MBDyn takes them all, and knows no such words
        ends.append("        use invariant 9")
    yield ",\n".join(ends) + ";"
    yield ""
    yield from _hinge_and_weight(pendulum, at)
    yield "end: elements;"


def _settings(nodes: int, *, end: float, step: float, differentiated: bool) -> tuple[str, ...]:
    # MBDyn stiffens by loads in the modal joint of automatic differentiation alone
    differentiation = ("    use automatic differentiation;",) if differentiated else ()
    return (
        "begin: data;",
        "    problem: initial value;",
        "end: data;",
        "",
        "begin: initial value;",
        "    initial time: 0.;",
        f"    final time: {number(end)};",
        f"    time step: {number(step)};",
        "    method: ms, 0.6;",
        "    tolerance: 1.e-6;",
        "    max iterations: 50;",
        "    derivatives tolerance: 1.e-4;",
        "    derivatives max iterations: 50;",
        "    derivatives coefficient: auto;",
        "end: initial value;",
        "",
        "begin: control data;",
        f"    structural nodes: {nodes};",
        "    joints: 2;",
        "    gravity;",
        *differentiation,
        "    output precision: 16;",
        "    default orientation: orientation matrix;",
        "end: control data;",
        "",
    )


def _hinge_and_weight(pendulum: MbdynPendulum, at: FloatArray) -> tuple[str, ...]:
    """The hinge, of the interface's own node, at its place in the world; gravity."""
    across = np.cross(pendulum.axis, np.eye(3)[int(np.argmin(np.abs(pendulum.axis)))])
    axes = f"orientation, 3, {vector(pendulum.axis)}, 2, {vector(across / np.linalg.norm(across))}"
    strength = float(np.linalg.norm(pendulum.gravity))
    down = pendulum.gravity / strength if strength else np.array([0.0, 0.0, -1.0])
    return (
        f"    joint: {HINGE}, revolute pin, {pendulum.nodes[pendulum.hinge]},",
        "            position, null,",
        f"            {axes},",
        f"        position, {vector(at)},",
        f"        {axes};",
        "",
        f"    gravity: uniform, {vector(down)}, const, {number(strength)};",
    )
