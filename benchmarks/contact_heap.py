"""A heap of boxes by Moreau's and Jean's method and by MuJoCo: what a step takes, how deep contacts overlap.

Boxes of half sides 0.5, 0.4, 0.3 m and 2000 kg/m^3 fall askew into a walled box, mu = 0.5.  Both take the same steps
of 5 ms from the same start; MuJoCo by implicitfast with elliptic cones, otherwise as it comes.  Told are the processor
time of a step, and over the second half of the time the contacts, the deepest overlap and its root mean square, and the
largest excess of friction over mu N as a share of the largest N; over the whole of it the largest growth of energy
in a step, as a share of what the heap loses; at the end the kinetic energy.

    ./run python -m pip install mujoco
    ./run python benchmarks/contact_heap.py
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from benchmark import Report
from numpy.typing import NDArray

import flexmbd as fm
from flexmbd import contact

MINUTES = 20.0
PEERS = ("mujoco",)
FloatArray = NDArray[np.float64]

_SIDES, _DENSITY, _MU, _H = np.array([1.0, 0.8, 0.6]), 2000.0, 0.5, 5e-3
_MASS = float(_DENSITY * np.prod(_SIDES))
_RTOL = 0.3


@dataclass(frozen=True, eq=False)
class Heap:
    """Where n boxes start: (n, 3) m and (n, 4) quaternions; the walls' sides (m)."""

    places: FloatArray
    turns: FloatArray
    width: float


@dataclass(frozen=True)
class Told:
    """What a program makes of a heap."""

    program: str
    step: float
    contacts: float
    deepest: float
    mean: float
    excess: float
    growth: float
    kinetic: float


def heap(count: int, across: int) -> Heap:
    """So many boxes in layers of ``across`` squared, without overlaps."""
    random = np.random.default_rng(1)
    k = np.arange(count)
    grid = np.stack([k % across, k // across % across, k // across**2], axis=1)
    places = 1.5 * grid + [0.75, 0.75, 0.9] + random.uniform(-0.03, 0.03, (count, 3))
    turns = np.array([1.0, 0.0, 0.0, 0.0]) + 0.3 * random.normal(size=(count, 4))
    return Heap(places, turns / np.linalg.norm(turns, axis=1, keepdims=True), 1.5 * across)


def by_flexmbd(given: Heap, end: float) -> Told:
    """The heap by ``fm.MoreauJean``."""
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    squares, shapes = np.square(_SIDES), []
    for k, (place, turn) in enumerate(zip(given.places, given.turns, strict=True)):
        body = scene.add(fm.RigidBody(_MASS, tuple(_MASS / 12.0 * (squares.sum() - squares))), name=f"box {k}")
        free = scene.connect(fm.joint.Free(), scene.ground.frame(), body.frame())
        free.position = (*place, *turn)
        shapes.append(contact.Box(body.frame(), _SIDES))
    w, ground = given.width, scene.ground
    walls = [contact.HalfSpace(ground.frame(), axis) for axis in ("z", "x", "y")]
    walls += [contact.HalfSpace(ground.frame(p=(w, w, 0.0)), axis) for axis in ((-1, 0, 0), (0, -1, 0))]
    law = contact.Hard(mu=_MU)
    pairs = (*scene.touch(shapes, walls, law), *scene.touch(shapes, shapes, law))
    scene.simulate(2.0 * _H, h=_H, rtol=_RTOL)  # compiled
    begin = time.process_time()
    run = scene.simulate(end, h=_H, rtol=_RTOL)
    step = (time.process_time() - begin) / run.stats.steps
    found = run.contacts(pairs, rtol=_RTOL)
    late = [one.row > len(run.t) // 2 for one in found]
    gaps = np.concatenate([one.gap[own] for one, own in zip(found, late, strict=True)])
    normal = np.concatenate([one.normal_force[own] for one, own in zip(found, late, strict=True)])
    friction = np.concatenate([one.friction[own] for one, own in zip(found, late, strict=True)])
    rows = len(run.t) - 1 - len(run.t) // 2
    held = normal > 0.0
    energy = run.energy()
    return _told(
        "flexmbd", step, held.sum() / rows, gaps[held], normal, friction, energy.total, float(energy.kinetic[-1])
    )


def by_mujoco(given: Heap, end: float) -> Told:
    """The heap by MuJoCo."""
    import mujoco  # which is not there everywhere

    half = " ".join(f"{0.5 * side:g}" for side in _SIDES)
    boxes = "".join(
        f'<body pos="{p[0]} {p[1]} {p[2]}" quat="{q[0]} {q[1]} {q[2]} {q[3]}"><freejoint/>'
        f'<geom type="box" size="{half}" density="{_DENSITY}" friction="{_MU} 0 0" condim="3"/></body>'
        for p, q in zip(given.places, given.turns, strict=True)
    )
    w = given.width
    ends = [("0 0 0", "0 0 1"), ("0 0 0", "1 0 0"), ("0 0 0", "0 1 0"), (f"{w} 0 0", "-1 0 0"), (f"0 {w} 0", "0 -1 0")]
    walls = "".join(
        f'<geom type="plane" size="0 0 1" pos="{p}" zaxis="{n}" friction="{_MU} 0 0" condim="3"/>' for p, n in ends
    )
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><option timestep="{_H}" integrator="implicitfast" cone="elliptic" gravity="0 0 -9.81">'
        '<flag energy="enable"/></option>'
        f'<size memory="2G"/><worldbody>{walls}{boxes}</worldbody></mujoco>'
    )
    data, steps = mujoco.MjData(model), round(end / _H)
    spent, wrench, count = 0.0, np.zeros(6), 0
    gaps: list[float] = []
    forces: list[FloatArray] = []
    total: list[float] = []
    for k in range(steps):
        begin = time.process_time()
        mujoco.mj_step(model, data)
        spent += time.process_time() - begin
        total.append(float(data.energy.sum()))  # at the step's begin
        if k >= steps // 2:
            for i in range(data.ncon):
                mujoco.mj_contactForce(model, data, i, wrench)
                if wrench[0] > 0.0:
                    gaps.append(data.contact[i].dist)
                    forces.append(wrench[:3].copy())
            count += 1
    mujoco.mj_energyVel(model, data)
    pushed = np.array(forces)
    return _told(
        f"MuJoCo {mujoco.__version__}", spent / steps, len(gaps) / count, np.array(gaps), pushed[:, 0], pushed[:, 1:],
        np.array(total), float(data.energy[1]),
    )  # fmt: skip


def _told(
    program: str, step: float, contacts: float, gaps: FloatArray, normal: FloatArray, friction: FloatArray,
    total: FloatArray, kinetic: float,
) -> Told:
    depth = np.maximum(0.0, -gaps)
    excess = np.linalg.norm(friction, axis=1) - _MU * normal
    mean = float(np.sqrt(np.mean(depth**2)))
    growth = float(np.diff(total).max() / (total[0] - total[-1]))
    return Told(
        program, step, contacts, float(depth.max()), mean, float(excess.max() / normal.max()), growth, kinetic
    )


def run(report: Report, count: int, across: int, end: float) -> None:
    """One heap by all programs that are there."""
    report.say(f"\n{count} boxes, {end:g} s in steps of {1e3 * _H:g} ms\n")
    report.table(
        "program", "step (ms)", "contacts", "deepest overlap (mm)", "root mean square (mm)", "friction over mu N",
        "growth of energy", "kinetic energy (J)",
    )  # fmt: skip
    programs = [by_flexmbd, *([by_mujoco] if find_spec("mujoco") else [])]
    for program in programs:
        one = program(heap(count, across), end)
        report.say(
            f"| {one.program} | {1e3 * one.step:.3g} | {one.contacts:.0f} | {1e3 * one.deepest:.3g} "
            f"| {1e3 * one.mean:.3g} | {one.excess:.1e} | {one.growth:.1e} | {one.kinetic:.3g} |"
        )


def quick(report: Report) -> None:
    run(report, 36, 3, 1.0)


def full(report: Report) -> None:
    run(report, 1000, 8, 2.0)


if __name__ == "__main__":
    full(Report(Path(".")))
