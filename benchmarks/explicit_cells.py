"""Microseconds of processor time a cell and explicit step: cells one by one, several at a time, in threads.

    ./run python benchmarks/explicit_cells.py [--cells 10000] [--rounds 5] [--threads 2]

Of a block that yields all over: the pass over the cells (forces, history, means), the whole step of the body by itself,
and the energies, which a machine asks for at each step.  "one by one" is the loop that small bodies take, with FFCx's
kernels; both take turns in one run and give the same numbers to the bit, which is checked.  Of threads the time on the
clock is told too, which means something on a machine that does nothing else.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np

from flexmbd import meshes
from flexmbd.continuum import NonlinearModel, plane_form
from flexmbd.continuum.interior.nodal_motion import NodalMotion
from flexmbd.forms import hencky_plasticity as hencky
from flexmbd.forms import j2_plasticity as j2
from flexmbd.forms import updated_lagrangian

STEEL: dict[str, Any] = {"E": 2.1e11, "nu": 0.3, "rho": 7850.0, "yield_stress": 2.5e8}
HARDENING = j2.LinearHardening(8e8)


@dataclass(eq=False)
class Case:
    """A body in motion, whose cells are evaluated in one way or another."""

    motion: NodalMotion
    h: float

    @property
    def history(self) -> Any:
        """Of the body's one group."""
        return self.motion.body._histories[0]

    def evaluate(self, blocks: Any) -> np.ndarray[Any, Any]:
        """One pass, by blocks or (None) one by one."""
        body, history = self.motion.body, self.history
        forces = body.vector().array
        kept, history._pass._blocks = history._pass._blocks, blocks
        history._begin_locally()  # else the last solution would be the first guess
        with body.present_mesh():
            history.run(forces)
        history._pass._blocks = kept
        return np.asarray(forces)

    def step(self, blocks: Any) -> None:
        """One step."""
        kept, self.history._pass._blocks = self.history._pass._blocks, blocks
        self.motion.advance(self.h)
        self.history._pass._blocks = kept

    def energies(self, blocks: Any) -> None:
        """Energies as a machine asks for them; by DOLFINx where there are no blocks."""
        kept = self.history._totals
        self.history.__dict__["_totals"] = kept if blocks is not None else None
        self.motion.energies()
        self.history.__dict__["_totals"] = kept


def bodies(cells: int) -> dict[str, tuple[Any, int]]:
    """Bodies by name, and their numbers of cells."""
    n = round((cells / 0.6) ** (1 / 3))
    divisions = (n, n, max(1, round(0.6 * n)))
    found: dict[str, tuple[Any, int]] = {}
    for form in (j2, updated_lagrangian, hencky):
        mesh = meshes.block(1.0, 1.0, 0.6, divisions=divisions)
        body = NonlinearModel(mesh, form, form.Parameters(**STEEL, hardening=HARDENING), degree=1)
        found[f"{form.__name__.rpartition('.')[2]}, bricks"] = body, int(np.prod(divisions))
    n = round(cells**0.5)
    for name, form, strain in (("j2, plane stress", j2, False), ("hencky, plane strain", hencky, True)):
        made = plane_form(form, plane_strain=strain)
        p = made.Parameters(form.Parameters(**STEEL, hardening=HARDENING), 0.01)
        found[name] = NonlinearModel(meshes.sheet(1.0, 1.0, divisions=(n, n)), made, p, degree=1), n * n
    return found


def turns(tasks: dict[str, Callable[[], object]], rounds: int) -> dict[str, list[float]]:
    """Processor times (s) of tasks that take turns."""
    found: dict[str, list[float]] = {name: [] for name in tasks}
    for _ in range(rounds):
        for name, task in tasks.items():
            begin = time.process_time()
            task()
            found[name].append(time.process_time() - begin)
    return found


def measure(name: str, body: NonlinearModel, cells: int, *, rounds: int, threads: int) -> None:
    """Print the rows of one body."""
    motion = NodalMotion(body)
    motion.begin(np.zeros(3), np.eye(3), np.zeros(3))
    motion.v[:] = motion.inertia.plane.in_plane(100.0 * motion.x * [1.0, -0.5, -0.3])
    case = Case(motion, 0.5 * motion.limit)
    blocks = case.history._pass._blocks
    if blocks is None:
        raise SystemExit("too few cells: they are evaluated one by one")
    for _ in range(10):
        case.step(blocks)
    if not np.array_equal(case.evaluate(None), case.evaluate(blocks)):
        raise SystemExit(f"{name}: the forces differ")
    case.energies(blocks)
    case.energies(None)
    for task, run in (("pass", case.evaluate), ("step", case.step), ("energies", case.energies)):
        spent = turns({"old": lambda run=run: run(None), "new": lambda run=run: run(blocks)}, rounds)  # type: ignore[misc]
        old, new = (1e6 * min(spent[kind]) / cells for kind in ("old", "new"))
        ratios = [one / other for one, other in zip(spent["old"], spent["new"], strict=True)]
        print(
            f"| {name} | {task} | {old:.2f} | {new:.2f} | {old / new:.1f} ({min(ratios):.1f} to {max(ratios):.1f}) |",
            flush=True,
        )
    for count in (1, threads):
        blocks.threads = count
        case.evaluate(blocks)
        begin = time.perf_counter()
        for _ in range(rounds):
            case.evaluate(blocks)
        clock = 1e6 * (time.perf_counter() - begin) / rounds / cells
        print(f"| {name} | pass, {count} threads, on the clock | | {clock:.2f} | |", flush=True)
    blocks.threads = 1


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cells", type=int, default=10_000, help="about how many")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--threads", type=int, default=2)
    given = parser.parse_args()
    print("| body | | one by one, us a cell | several, us a cell | times |\n|---|---|---|---|---|")
    for name, (body, cells) in bodies(given.cells).items():
        measure(name, body, cells, rounds=given.rounds, threads=given.threads)


if __name__ == "__main__":
    main()
