"""Laws that switch on several ranks: rank 0's numbers rule, and a failure on one rank is one of all."""

from mpi4py import MPI

import numpy as np
import pytest
from damped_contact import CONTACT

import flexmbd as fm
from flexmbd.continuum import MpiTeam

pytestmark = pytest.mark.mpi

STIFFNESS, DAMPING, RADIUS = CONTACT.stiffness, CONTACT.damping, CONTACT.radius


def ball(when, *, collective):
    scene = fm.System(gravity=(0.0, -9.81, 0.0), team=MpiTeam(MPI.COMM_WORLD, collective_functions=collective))
    body = scene.add(fm.RigidBody(CONTACT.mass, (1e-3,) * 3), name="ball")
    drop = scene.connect(fm.joint.Prismatic("y"), scene.ground.frame(), body.frame(), name="drop")
    drop.position = CONTACT.height

    def law(t, y, v, side):
        return 0.0 if side > 0.0 else -STIFFNESS * (y - RADIUS) - DAMPING * v

    scene.add_force(fm.force.JointLaw(drop, fm.Switched(law, when=when)))
    return scene, drop


@pytest.mark.parametrize("collective", [False, True])
def test_rank_0_switches(collective):
    comm = MPI.COMM_WORLD
    scene, drop = ball(lambda t, y, v: y - RADIUS - 1e-3 * comm.rank, collective=collective)
    run = scene.simulate(0.2, rtol=1e-6)
    assert run.stats.switches == 2
    assert max(CONTACT.errors(run, drop)) < 1e-5
    for theirs in comm.allgather(run.x):
        np.testing.assert_array_equal(theirs, run.x)


def test_a_failure_on_one_rank_is_told_on_all():
    comm = MPI.COMM_WORLD

    def when(t, y, v):
        if y < 0.08 and comm.rank == comm.size - 1:
            raise ValueError("no more")
        return y - RADIUS

    scene, _ = ball(when, collective=True)
    with pytest.raises(fm.SimulationError, match="the switch of JointLaw on joint 'drop'"):
        scene.simulate(0.2, rtol=1e-6)
