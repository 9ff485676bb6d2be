"""A driven double pendulum with parameters, for ensembles; by itself it is a process that can be killed.

    python varied_machine.py FILE         runs an ensemble on two processes into FILE, and prints how many it ran
    python varied_machine.py FILE threads                                       the same on two threads
    mpirun -n 3 python -m mpi4py.futures varied_machine.py FILE mpi     the same on MPI workers
"""

from __future__ import annotations

import os
import sys
import time
from concurrent.futures import Executor, ProcessPoolExecutor
from multiprocessing import get_context
from typing import Any

import numpy as np

import flexmbd as fm
from flexmbd.ensemble import Ensemble

COUNT = 60
TIMES = np.linspace(0.0, 0.3, 7)
NAP = 0.03  # s, so that there is time to kill a process


def double_pendulum() -> tuple[fm.CompiledMachine, dict[str, Any]]:
    """The machine, and what is asked of it: an angle, a path."""
    scene = fm.System(gravity=(0.0, -9.81, 0.0))
    arms = [scene.add(fm.RigidBody(1.0, (0.01, 0.03, 0.03), (0.3, 0.0, 0.0)), name=name) for name in ("in", "out")]
    pin = arms[0].frame((0.6, 0.0, 0.0))
    hinge = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), arms[0].frame())
    elbow = scene.connect(fm.joint.Revolute("z"), pin, arms[1].frame())
    elbow.velocity = 0.0
    spring = scene.add_force(fm.force.JointSpring(elbow, 5.0))
    machine = scene.compile(
        parameters={
            "mass": fm.parameter.Mass(arms[1]),
            "length": fm.parameter.FrameOrigin(pin),
            "k": fm.parameter.OfForce(spring, "stiffness"),
            "rate": fm.parameter.InitialVelocity(elbow),
        }
    )
    outputs = {
        "angle": lambda run: run.beta(hinge)[-1],
        "path": lambda run: run.position(pin, t=TIMES),
    }
    return machine, outputs


def samples(count: int = COUNT) -> dict[str, np.ndarray]:
    """Random values; every seventh mass is none."""
    rng = np.random.default_rng(3)
    mass = rng.uniform(0.5, 2.0, count)
    mass[3::7] = -1.0
    length = np.column_stack([rng.uniform(0.5, 0.7, count), np.zeros((count, 2))])
    return {"mass": mass, "length": length, "k": rng.uniform(0.0, 9.0, count), "rate": rng.uniform(-3.0, 3.0, count)}


def study(executor: Executor | None = None, count: int = COUNT, *, nap: float = 0.0, **options: Any) -> Ensemble:
    """The ensemble of ``count`` variants, each of which takes at least ``nap`` seconds."""
    machine, outputs = double_pendulum()
    if nap:
        angle = outputs["angle"]

        def late(run: fm.Trajectory) -> Any:
            time.sleep(nap)
            return angle(run)

        outputs["angle"] = late
    method = fm.ExplicitRungeKutta()
    return machine.ensemble(
        samples(count), outputs, t_end=0.3, integrator=method, executor=executor, workers=2, **options
    )


def main() -> None:
    file, *how = sys.argv[1:]
    if how == ["mpi"]:
        from mpi4py.futures import MPIPoolExecutor

        with MPIPoolExecutor(main=False) as pool, study(pool, file=file) as found:
            print(int(found.done.sum()), pool.num_workers)
        return
    if how == ["threads"]:
        with study(file=file, nap=NAP) as found:
            print(found)
        return
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool, study(pool, file=file, nap=NAP) as found:
        print(int(found.done.sum()))


if __name__ == "__main__":
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    main()
