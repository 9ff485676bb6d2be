"""A body frame off the body, on an interface whose origin lies there, is a rigid hub."""

from mpi4py import MPI

import pytest

import flexmbd as fm
from flexmbd import forms, meshes
from flexmbd.continuum import ContinuumModel, Interface
from flexmbd.reduction import craig_bampton

OMEGA, HUB = 40.0, 0.1


def spinning(origin, **options):
    """Frequencies (Hz) of a blade of 1 m on a hub: a rigid body, or in part the rigid arm of the blade's interface."""
    section = forms.beam_timoshenko.Parameters.rectangle(
        7e10, 0.3, 3000.0, width=0.02, height=0.01, orientation=(0, 1.0, 0)
    )
    line = meshes.line(1.0, divisions=10, comm=MPI.COMM_SELF)
    root = Interface("start", origin=(origin, 0.0, 0.0))
    model = ContinuumModel(line, forms.beam_timoshenko, section, degree=2, interfaces=[root])
    record = craig_bampton(model, modes=6, frame="start", **options)
    scene = fm.System()
    hub = scene.add(fm.RigidBody(1.0, (1.0, 1.0, 1.0)), name="hub")
    blade = scene.add(fm.FlexibleBody(record), name="blade")
    turn = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), hub.frame())
    scene.connect(fm.joint.Fixed(), hub.frame(p=(HUB + origin, 0, 0)), blade.frame("start"))
    turn.prescribe(lambda t: (OMEGA * t, OMEGA, 0.0))
    return scene.linearize(about=scene.equilibrium()).frequencies()


@pytest.mark.parametrize("stretch", [False, True])
def test_an_arm_of_the_interface_is_as_good_as_one_of_the_hub(stretch):
    exact = spinning(0.0, geometric_stiffness=stretch)
    for origin in (-HUB, -10 * HUB, 0.4):
        assert spinning(origin, geometric_stiffness=stretch) == pytest.approx(exact, rel=1e-9)
