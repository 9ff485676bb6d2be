"""Processor time in which the contacts of heaps of boxes are found.

Boxes of half sides 0.5, 0.4, 0.3 m lie about at random, some four contacts each, above a floor between walls.  The
median of several calls; the first one, which compiles, is not counted.

    ./run python benchmarks/contact_finding.py
"""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
from benchmark import Report
from scipy.spatial.transform import Rotation

import flexmbd as fm
from flexmbd import contact
from flexmbd.multibody.contact.shape_tables import shape_table
from flexmbd.multibody.kernels.contact.finding.find_contacts import TOO_SMALL, find_contacts, make_room
from flexmbd.multibody.kernels.contact.finding.shape_table import new_contact_points, new_finding_work

MINUTES = 1.0
PEERS = ()
SPACING = 1.0  # m: each box touches some four others
WALLS = (((0.0, 0.0, 0.0), (0, 0, 1)), ((0.0, 0.0, 0.0), (1, 0, 0)), ((0.0, 0.0, 0.0), (0, 1, 0)))


def measure(report: Report, count: int) -> None:
    """Say the row of a heap of so many boxes."""
    scene = fm.System()
    number = {id(scene.ground): -1}
    shapes: list[contact.Box | contact.HalfSpace] = []
    for k in range(count):
        body = scene.add(fm.RigidBody(1.0, (1.0, 1.0, 1.0)))
        number[id(body)] = k
        shapes.append(contact.Box(body.frame(), (1.0, 0.8, 0.6)))
    shapes += [contact.HalfSpace(scene.ground.frame(p=p), normal) for p, normal in WALLS]
    table = shape_table(shapes, body_of=lambda body: number[id(body)])
    random = np.random.default_rng(1)
    side = round(count ** (1.0 / 3.0) + 0.5)
    lattice = np.stack(np.meshgrid(*[np.arange(side)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)[:count]
    x = SPACING * (lattice + random.uniform(0.4, 0.6, (count, 3)))
    R = Rotation.random(count, random_state=random).as_matrix()
    v, w = 0.1 * random.standard_normal((2, count, 3))
    work, out = new_finding_work(table), new_contact_points(count)

    def timed(margin: float, kept: int) -> tuple[float, int]:
        nonlocal work, out
        times = []
        while len(times) < kept:
            start = time.process_time()
            found = find_contacts(table, x, R, v, w, 1e-3, margin, work, out)
            times.append(time.process_time() - start)
            if found == TOO_SMALL:
                work, out = make_room(table, work, out)
                times = []
        return float(np.median(times)), found

    timed(1e-3, 1)
    seconds, found = timed(1e-3, 15)
    pairs = int(work.needed[0])
    report.say(f"| {count} | {pairs} | {found} | {1e3 * seconds:.2f} |")


def run(report: Report, counts: tuple[int, ...]) -> None:
    """Measure heaps of so many boxes."""
    report.table("boxes", "near pairs", "points", "time (ms)")
    for count in counts:
        measure(report, count)


def quick(report: Report) -> None:
    run(report, (300, 1000))


def full(report: Report) -> None:
    run(report, (1000, 10_000, 100_000))


if __name__ == "__main__":
    full(Report(Path(".")))
