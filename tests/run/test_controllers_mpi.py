"""Sampled controllers on several ranks: one law rules, all get its samples and its errors."""

from mpi4py import MPI

import numpy as np
import pytest

import flexmbd as fm
from flexmbd.continuum import MpiTeam

pytestmark = pytest.mark.mpi


@pytest.mark.parametrize("collective", [False, True])
def test_rank_0_rules(collective):
    comm = MPI.COMM_WORLD
    scene = fm.System(team=MpiTeam(comm, collective_functions=collective))
    body = scene.add(fm.RigidBody(mass=2.0, inertia=(1.0, 1.0, 1.0)), name="cart")
    slide = scene.connect(fm.joint.Prismatic(axis="x"), scene.ground.frame(), body.frame(), name="slide")
    push = fm.Signal("push")
    scene.add_force(fm.force.JointForce(slide, push))
    calls = []

    def law(t, y, total):
        calls.append(t)
        if t > 0.75:
            raise ValueError("no more")
        return 1.0 - y[0] + 1e-3 * comm.rank, total + 1.0

    controller = scene.add_controller(
        law, period=0.1, measurements=[fm.output.Position(slide)], inputs=[push], state=[0.0], name="governor"
    )
    with pytest.raises(fm.SimulationError, match=r"'governor' at t = 0\.8 s: ValueError: no more") as caught:
        scene.simulate(1.0)
    run = caught.value.trajectory
    samples = run.sampled(controller)
    everyone = comm.allgather((run.x, samples.inputs, samples.states, run.drive(slide)))
    for theirs in everyone:
        for ours, other in zip(everyone[0], theirs, strict=True):
            np.testing.assert_array_equal(ours, other)
    assert samples.inputs[0] == 1.0
    assert len(calls) == (9 if collective or comm.rank == 0 else 0)
