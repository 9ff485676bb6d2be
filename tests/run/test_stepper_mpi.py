"""Steppers on several ranks: rank 0's arguments count, all get the outputs, the state and the errors."""

from mpi4py import MPI

import numpy as np
import pytest

import flexmbd as fm
from flexmbd.continuum import MpiTeam
from flexmbd.errors import SceneError

pytestmark = pytest.mark.mpi


def crank(team):
    """A four-bar in a plane, whose crank a signal turns, and a Python function that fails after 0.5 s."""
    scene = fm.System(gravity=(0.0, -9.81, 0.0), team=team)
    bars = [scene.add(fm.RigidBody(1.0, (0.01, 0.01, 0.01), (0.5, 0.0, 0.0)), name=f"bar {k}") for k in range(3)]
    z = fm.joint.Revolute("z")
    first = scene.connect(z, scene.ground.frame(), bars[0].frame())
    scene.connect(z, bars[0].frame((1.0, 0.0, 0.0)), bars[1].frame())
    scene.connect(z, bars[1].frame((1.0, 0.0, 0.0)), bars[2].frame())
    scene.connect(z, bars[2].frame((1.0, 0.0, 0.0)), scene.ground.frame((1.2, 0.0, 0.0)))
    first.position = 1.2
    torque = fm.Signal("torque")
    scene.add_force(fm.force.JointTorque(first, torque))
    scene.add_force(fm.force.JointTorque(first, lambda t: 1.0 / max(0.0, 0.5 - t)))
    return scene, first, torque


@pytest.mark.parametrize("collective", [False, True])
def test_rank_0_rules(collective):
    comm = MPI.COMM_WORLD
    scene, first, torque = crank(MpiTeam(comm, collective_functions=collective))
    outputs = {"angle": fm.output.Position(first), "tip": lambda now: now.position(scene.ground.frame())}
    stepper = scene.stepper(h=1e-3, inputs=[torque], outputs=outputs)
    seen = [stepper.step(0.05, 3.0 + comm.rank)]  # rank 0's counts
    kept, twin = stepper.snapshot(), stepper.copy()
    seen.append(stepper.step_to(0.1, {"torque": -2.0}))
    seen.append(twin.step(0.05, -2.0))
    assert seen[1]["angle"] == seen[2]["angle"]
    assert stepper.inputs == {"torque": -2.0}
    now = stepper.now
    with pytest.raises(SceneError, match="forward alone"):
        stepper.step_to(0.05)
    with pytest.raises(SceneError, match="no input 'push'"):
        stepper.step(0.05, {"push": 1.0})
    with pytest.raises(fm.SimulationError, match="ZeroDivisionError") as caught:
        stepper.step(1.0)
    assert caught.value.trajectory.t[-1] == stepper.t > 0.45
    stepper.restore(kept)
    assert stepper.t == 0.05
    again = stepper.step_to(0.1, -2.0)
    assert again["angle"] == seen[1]["angle"]
    if comm.size > 1:
        with pytest.raises(SceneError, match="cannot be pickled"):
            stepper.__reduce__()
    everyone = comm.allgather([now.x, now.v, now.a, [stepper.t], [one["angle"] for one in seen]])
    for theirs in everyone:
        for ours, other in zip(everyone[0], theirs, strict=True):
            np.testing.assert_array_equal(ours, other)
    alone, own, its = crank(MpiTeam(MPI.COMM_SELF))
    by_itself = alone.stepper(h=1e-3, inputs=[its], outputs=[fm.output.Position(own)])
    by_itself.step(0.05, 3.0)
    by_itself.snapshot()
    assert by_itself.step_to(0.1, -2.0)[0] == seen[1]["angle"]
