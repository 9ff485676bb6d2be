"""Runs of bodies that yield, which keep checkpoints, and may kill their own process half-way.

    python half_way.py KIND FILE     runs with checkpoints in FILE until it kills itself
"""

from __future__ import annotations

import os
import signal
import sys
from pathlib import Path

from mpi4py import MPI

import numpy as np

import flexmbd as fm
from flexmbd import meshes
from flexmbd.continuum import (
    ExplicitContinuum,
    ExplicitRun,
    ImplicitContinuum,
    Interface,
    MpiTeam,
    NonlinearModel,
    RegularCheckpoints,
    RigidPlane,
)
from flexmbd.continuum.history.body_memory import BodyMemory
from flexmbd.continuum.history.displacement_newton import Convergence
from flexmbd.continuum.history.history_file import load_body, save_body
from flexmbd.continuum.slow_loading.static_path import follow, prescribed_dofs
from flexmbd.forms import hencky_plasticity, j2_plasticity

PART = fm.RigidBody(30.0, np.array([[1.0, 0.1, 0.0], [0.1, 1.5, -0.2], [0.0, -0.2, 2.0]]), (0.2, -0.05, 0.1))

# End and time between checkpoints, s, and calls of what moves the body until it is killed.
TIMES = {
    "explicit": (0.08, 0.01, 14), "implicit": (0.02, 0.004, 13), "alone": (0.06, 0.011, 12), "static": (4.0, 1.0, 5),
}  # fmt: skip


def bar(form, comm, *, names=(), yield_stress=1e4):
    mesh = meshes.block(1.0, 0.3, 0.4, divisions=(4, 2, 2), comm=comm)
    material = form.Parameters(1e6, 0.3, 1000.0, yield_stress, hardening=j2_plasticity.LinearHardening(1e5))
    return NonlinearModel(mesh, form, material, degree=1, interfaces=[Interface(name) for name in names])


def machine(kind, comm):
    """The scene, its tip, the interior, and the integrator's arguments."""
    scene = fm.System(gravity=(0.0, 0.0, -9.81), team=MpiTeam(comm))
    if kind == "explicit":
        body = bar(j2_plasticity, comm, names=("x_max",))
        planes = [RigidPlane((-0.02, 0.0, 0.0), (1.0, 0.0, 0.0), friction=0.2)]
        interior = ExplicitContinuum(body, rigid_parts={"x_max": PART}, planes=planes)
        part = scene.add(fm.ContinuumBody(interior), name="part")
        frame = part.frame("x_max")
        free = scene.connect(fm.joint.Free(), scene.ground.frame(p=interior.frames[0].p_BI_B), frame)
        free.velocity = [-3.0, 0.0, 0.5, 1.0, -2.0, 3.0]
        return scene, frame, interior, {"integrator": fm.CentralDifference()}
    body = bar(hencky_plasticity, comm, names=("x_min", "x_max"), yield_stress=2e3)
    interior = ImplicitContinuum(body, rigid_parts={"x_max": PART})
    part = scene.add(fm.ContinuumBody(interior), name="part")
    hinge = scene.connect(fm.joint.Revolute(axis="y"), scene.ground.frame(), part.frame("x_min"))
    hinge.velocity = 5.0
    # what is compared to 1e-9 must be solved to less
    return scene, part.frame("x_max"), interior, {"integrator": fm.GeneralizedAlpha(), "h": 1e-3, "rtol": 1e-10}


def kill_after(owner, name, calls):
    """Let the process be killed in a call of a method."""
    move, count = getattr(owner, name), iter(range(calls))

    def moved(*args, **options):
        if next(count, None) is None and MPI.COMM_WORLD.rank == 0:
            os.kill(os.getpid(), signal.SIGKILL)
        return move(*args, **options)

    setattr(owner, name, moved)


def stretches(comm, file, *, restart, killed):
    """A slow pull, with a file after each stretch of two steps."""
    body = bar(hencky_plasticity, comm)
    if killed:
        kill_after(body, "commit", TIMES["static"][2])
    reached = load_body(body, file) if restart else 0.0
    held = prescribed_dofs(body, {"x_min": "xyz", "x_max": "x"})
    pulled = (body.layout.node_x.reshape(-1)[held] > 0.5).astype(float)
    for end in np.arange(reached + 1.0, TIMES["static"][0] + 1.0):
        path = follow(
            body, [end - 0.5, end], prescribed=held, displacement=lambda t: 0.01 * t * pulled, reached=end - 1.0,
            convergence=Convergence(1e-11),
        )  # fmt: skip
        if end < TIMES["static"][0]:
            save_body(body, file, t=end)
    pull = comm.allreduce(float(path.steps[-1].reactions[pulled > 0.0].sum()))
    return {"pull": np.array(pull), **body.energies(), **BodyMemory(body).gather(body.snapshot())}


def run(kind, comm, file, *, restart=False, killed=False):
    """What there is at the end of a run: arrays by name, of the whole body."""
    t_end, every, calls = TIMES[kind]
    if kind == "alone":
        planes = [RigidPlane((-0.02, 0.0, 0.0), (1.0, 0.0, 0.0))]
        alone = ExplicitRun(bar(hencky_plasticity, comm), velocity=(-3.0, 0.0, 1.0), planes=planes)
        if killed:
            kill_after(alone.motion, "advance", calls)
        saves = RegularCheckpoints(file, every)
        account = alone.simulate(t_end, outputs=4, checkpoints=saves, restart=file if restart else None)
        energies = np.array([[*row.values(), work] for row, work in zip(account.rows, account.internal, strict=True)])
        places = [alone.motion.memory.gather_nodes(x) for x in alone.places]
        account_of = {"t": np.array(account.t), "rows": energies, "places": np.array(places)}
        return {**account_of, **alone.motion.energies(), **alone.motion.snapshot()}
    if kind == "static":
        return stretches(comm, file, restart=restart, killed=killed)
    scene, tip, interior, how = machine(kind, comm)
    if killed:
        kill_after(interior, {"explicit": "advance", "implicit": "commit"}[kind], calls)
    start = fm.Checkpoint.load(file) if restart else None
    found = scene.simulate(t_end, checkpoint_file=file, checkpoint_every=every, restart=start, **how)
    ends = {name: getattr(found, name)(tip)[-3:] for name in ("position", "rotation", "velocity")}
    return {"t": found.t[-3:], **ends, **interior.energies(), **interior.snapshot()}


if __name__ == "__main__":
    run(sys.argv[1], MPI.COMM_WORLD, Path(sys.argv[2]), killed=True)
