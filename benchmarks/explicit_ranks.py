"""A crash tube stepped explicitly on ranks: what each rank does in its processor time, and what a step sends.

    ./run python benchmarks/explicit_ranks.py [--cells 20000] [--steps 100]     # one rank and two; a picture

The tube of demos/frontal_impact.py with more bricks, recorded 60 times a millisecond as there. Parts of a step are
timed one by one and without what they call, by processor time, so that other work on the machine does little harm;
"exchange" is all of MPI, and what a rank waits there for a slower one. Messages, bytes and collectives are those that
each rank sends (`count_messages.c`), of a step by the difference between a run of all steps and one of half of them
without a recording.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from benchmark import Report

MINUTES = 3.0
TIMED = False
PEERS: tuple[str, ...] = ()
MARK = "explicit ranks: "
HERE = Path(__file__).resolve().parent
CELLS, STEPS, EVERY = 20_000, 100, 1e-3 / 60
RANKS = (1, 2)
PARTS = ("cells", "nodes", "stable step", "energies", "recording", "machine", "exchange")
Row = dict[str, Any]


class Clock:
    """Processor time by parts, of each without what it calls."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = defaultdict(float)
        self._inside: list[str] = []
        self._since = 0.0

    def times(self, part: str, function: Callable[..., Any]) -> Callable[..., Any]:
        """The function, timed as a part."""

        def timed(*values: Any, **named: Any) -> Any:
            self._turn()
            self._inside.append(part)
            try:
                return function(*values, **named)
            finally:
                self._turn()
                self._inside.pop()

        return timed

    def _turn(self) -> None:
        now = time.process_time()
        if self._inside:
            self.seconds[self._inside[-1]] += now - self._since
        self._since = now

    def watch(self, part: str, owner: type, *names: str) -> None:
        """Time methods of a class as a part."""
        for name in names:
            setattr(owner, name, self.times(part, getattr(owner, name)))


def simulate(cells: int, steps: int, *, is_recorded: bool, folder: Path) -> None:
    """One run on the ranks of this program; rank 0 prints what each of them did."""
    from mpi4py import MPI

    from dolfinx import la

    import flexmbd as fm
    from flexmbd import forms, meshes
    from flexmbd.continuum import ExplicitContinuum, Interface, MpiTeam, NonlinearModel, RigidPlane, Support
    from flexmbd.continuum.interior.nodal_motion import NodalMotion
    from flexmbd.run.recording_file import Recorder

    clock = Clock()

    class Timed(MPI.Intracomm):
        """A communicator whose collectives are timed."""

    for name in ("allgather", "allreduce", "bcast", "gather", "reduce", "Allreduce", "Bcast", "Allgather", "Ibarrier"):
        setattr(Timed, name, clock.times("exchange", getattr(MPI.Intracomm, name)))
    comm = Timed(MPI.COMM_WORLD)
    across, along = tube_divisions(cells)
    mesh = meshes.crash_tube(0.06, 0.003, 0.12, divisions=(along // 8, across, along), fold=0.022, dent=5e-4, comm=comm)
    steel = forms.hencky_plasticity.Parameters(
        E=2.1e11, nu=0.3, rho=7850.0, yield_stress=2.5e8, hardening=forms.j2_plasticity.LinearHardening(8e8)
    )
    solid = NonlinearModel(mesh, forms.hencky_plasticity, steel, degree=1, interfaces=[Interface("z_max")])
    interior = ExplicitContinuum(
        solid,
        rigid_parts={"z_max": fm.RigidBody(10.0, (0.1, 0.1, 0.1))},
        planes=[RigidPlane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), friction=0.2, name="wall")],
        supports=[Support("x_min", x=True), Support("y_min", y=True)],
    )
    scene = fm.System(team=MpiTeam(comm))
    tube = scene.add(fm.ContinuumBody(interior), name="tube")
    place = scene.ground.frame(p=interior.frames[0].p_BI_B)
    scene.connect(fm.joint.Prismatic(axis="z"), place, tube.frame("z_max")).velocity = -35.0
    scene.simulate(5.0 * interior.motion.limit, integrator=fm.CentralDifference())  # compiles
    type(solid).comm = property(lambda _: comm)  # type: ignore[misc,assignment]
    clock.watch("exchange", la.Vector, "scatter_forward", "scatter_reverse")
    clock.watch("cells", NonlinearModel, "step")
    clock.watch("energies", NodalMotion, "energies")
    clock.watch("stable step", NodalMotion, "renew_limit")
    clock.watch("nodes", NodalMotion, "advance")
    clock.watch("recording", Recorder, "watch", "write", "end", "__init__")
    recording = fm.Recording(folder / "fields.h5", every=EVERY) if is_recorded else None
    run = clock.times("machine", scene.simulate)(
        steps * interior.motion.limit, integrator=fm.CentralDifference(), recording=recording
    )
    mine = {"cells": len(solid.groups[0].cells), "seconds": dict(clock.seconds)}
    instants = len(run.recorded(tube).t) if is_recorded and comm.rank == 0 else 0  # the file is rank 0's
    every = comm.gather(mine)
    if every is not None:
        print(MARK + json.dumps({"steps": run.stats.steps, "instants": instants, "ranks": every}))


def tube_divisions(cells: int) -> tuple[int, int]:
    """Bricks across the wall and along the tube, of about so many in all; an eighth of those along is half a side."""
    across = 3 if cells >= 4000 else 2
    along = 8 * max(2, round(np.sqrt(cells / (2 * across) * 8) / 8))
    return across, along


def ran(ranks: int, cells: int, steps: int, *, is_recorded: bool, counter: Path | None = None) -> tuple[Row, list[Row]]:
    """One run in other processes: what its rank 0 printed, and what each rank sent."""
    command = [sys.executable, __file__, "--cells", str(cells), "--steps", str(steps), "--one"]
    command += ["--recorded"] if is_recorded else []
    around = dict(os.environ)
    if ranks > 1:
        loaded = [] if counter is None else ["-x", f"LD_PRELOAD={counter}"]
        command = ["mpirun", "--oversubscribe", "-n", str(ranks), *loaded, *command]
    done = subprocess.run(command, capture_output=True, text=True, check=True, env=around)
    told = next(line for line in done.stdout.splitlines() if line.startswith(MARK))
    counted = re.findall(
        r"rank (\d+): (\d+) messages, (\d+) bytes, (\d+) collectives, (\d+) bytes", done.stdout + done.stderr
    )
    names = ("rank", "messages", "bytes", "collectives", "shared")
    sent = sorted((dict(zip(names, map(int, one), strict=True)) for one in counted), key=lambda one: one["rank"])
    return json.loads(told.removeprefix(MARK)), sent


def built_counter(folder: Path) -> Path | None:
    """The library that counts messages, where MPI's compiler is installed."""
    library = folder / "count_messages.so"
    try:
        showme = ["mpicc", "-showme:compile", "-showme:link"]
        flags = [
            word
            for kind in showme[1:]
            for word in subprocess.run([showme[0], kind], capture_output=True, text=True, check=True).stdout.split()
        ]
        source = HERE / "count_messages.c"
        subprocess.run(["gcc", "-shared", "-fPIC", "-O2", source, "-o", library, *flags], check=True)
    except (OSError, subprocess.CalledProcessError):
        return None
    return library


def sizes(report: Report, cells: int, steps: int) -> None:
    """Shares a rank, and what a step sends."""
    rows = {ranks: ran(ranks, cells, steps, is_recorded=True)[0] for ranks in RANKS}
    report.table("ranks", "rank", "cells", *(f"{part}, s" for part in PARTS), "all, s")
    for ranks, row in rows.items():
        for k, one in enumerate(row["ranks"]):
            spent = [one["seconds"].get(part, 0.0) for part in PARTS]
            told = " | ".join(f"{value:.2f}" for value in spent)
            report.say(f"| {ranks} | {k} | {one['cells']} | {told} | {sum(spent):.2f} |")
    row = rows[RANKS[-1]]
    report.say(f"{row['steps']} steps, {row['instants']} instants recorded.")
    with tempfile.TemporaryDirectory() as folder:
        counter = built_counter(Path(folder))
        if counter is None:
            report.say("Messages are not counted: there is no mpicc.")
        else:
            half, whole = (ran(2, cells, n, is_recorded=False, counter=counter) for n in (steps // 2, steps))
            taken = whole[0]["steps"] - half[0]["steps"]
            recorded = ran(2, cells, steps, is_recorded=True, counter=counter)
            for k, (less, more, kept) in enumerate(zip(half[1], whole[1], recorded[1], strict=True)):
                step = {name: (more[name] - less[name]) / taken for name in more}
                instant = sum(kept[name] - more[name] for name in ("shared", "bytes")) / recorded[0]["instants"]
                report.say(
                    f"Rank {k} sends in a step {step['messages']:.1f} messages of {step['bytes'] / 1e3:.1f} kB in all, "
                    f"and brings {step['shared'] / 1e3:.2f} kB to {step['collectives']:.1f} collectives; for a "
                    f"recorded instant {instant / 1e6:.2f} MB."
                )
    report.picture("explicit_ranks.png", lambda path: draw(rows, path))


def draw(rows: dict[int, Row], path: Path) -> None:
    """Bars of each rank, the parts one on the other."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.0, 3.6), layout="constrained")
    axes = figure.subplots()
    bars = [
        (f"{ranks} ranks, rank {k}" if ranks > 1 else "one rank", row["steps"], one)
        for ranks, row in rows.items()
        for k, one in enumerate(row["ranks"])
    ]
    colours = ("#4c72b0", "#8fa8d0", "#b5c7e3", "#55a868", "#c44e52", "#8c8c8c", "#dd9d52")
    left = np.zeros(len(bars))
    for part, colour in zip(PARTS, colours, strict=True):
        width = np.array([1e3 * one["seconds"].get(part, 0.0) / steps for _, steps, one in bars])
        axes.barh([name for name, _, _ in bars], width, left=left, label=part, color=colour)
        left += width
    axes.invert_yaxis()
    cells = sum(one["cells"] for one in rows[RANKS[0]]["ranks"])
    axes.set_xlabel(f"processor time of a step, ms ({cells} bricks)")
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    figure.legend(loc="outside upper center", ncols=len(PARTS), fontsize="small", frameon=False)
    figure.savefig(path, dpi=150)


def quick(report: Report) -> None:
    """A coarse tube, a few steps."""
    sizes(report, 1000, 10)


def full(report: Report) -> None:
    """Twenty thousand bricks."""
    sizes(report, CELLS, STEPS)


def main() -> None:
    """One run on the ranks of this program, or all of them into a folder."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cells", type=int, default=CELLS)
    parser.add_argument("--steps", type=int, default=STEPS)
    parser.add_argument("--folder", type=Path, default=Path("out_explicit_ranks"), help="of the picture")
    parser.add_argument("--one", action="store_true", help="a run on the ranks of this program")
    parser.add_argument("--recorded", action="store_true", help="of --one: record fields")
    given = parser.parse_args()
    if given.one:
        with tempfile.TemporaryDirectory() as folder:
            simulate(given.cells, given.steps, is_recorded=given.recorded, folder=Path(folder))
        return
    given.folder.mkdir(exist_ok=True)
    sizes(Report(given.folder), given.cells, given.steps)


if __name__ == "__main__":
    main()
