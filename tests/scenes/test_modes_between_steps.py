"""Between the steps: modes that these do not resolve stay within what they are at the steps."""

import numpy as np
import pytest

import flexmbd as fm
from flexmbd import forms, meshes
from flexmbd.continuum import ContinuumModel, Interface
from flexmbd.reduction import craig_bampton


@pytest.fixture(scope="module")
def machine():
    """The slider-crank of README, started nearly upright."""
    steel = forms.solid_linear.Parameters(E=2.1e11, nu=0.3, rho=7850.0)
    ends = [Interface("big_end"), Interface("small_end")]
    mesh = meshes.connecting_rod(length=0.3, h=12e-3)
    model = ContinuumModel(mesh, forms.solid_linear, steel, degree=2, interfaces=ends)
    scene = fm.System(gravity=(0.0, -9.81, 0.0))
    crank = scene.add(fm.RigidBody(0.9, (4e-4, 6e-4, 8e-4), (0.02, 0.0, 0.0)), name="crank")
    rod = scene.add(fm.FlexibleBody(craig_bampton(model, modes=8, frame="big_end")), name="rod")
    piston = scene.add(fm.RigidBody(0.5, (2e-4, 2e-4, 2e-4)), name="piston")
    turn = fm.joint.Revolute("z")
    drive = scene.connect(turn, scene.ground.frame(), crank.frame())
    scene.connect(turn, crank.frame(p=(0.08, 0.0, 0.0)), rod.frame("big_end"))
    scene.connect(turn, rod.frame("small_end"), piston.frame())
    scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(), piston.frame())
    scene.add_force(fm.force.JointTorque(drive, 5.0))
    drive.position, drive.velocity = 1.57, 50.0
    return scene, rod, scene.simulate(0.05, rtol=1e-3, integrator=fm.ExplicitRungeKutta())


IMPLICIT = [fm.RadauIIA(), fm.GeneralizedAlpha(), fm.EnergyMomentum()]


@pytest.mark.parametrize("integrator", IMPLICIT, ids=lambda m: m.name)
def test_deformation_between_the_steps_is_as_good_as_at_them(machine, integrator):
    """In the norm of the elastic energy, which says what becomes of stresses, against an explicit run."""
    scene, rod, fine = machine
    run = scene.simulate(0.05, rtol=1e-3, integrator=integrator)
    own = np.sqrt(rod.record.stiffness)
    between = np.linspace(0.0, 0.05, 501)
    at_steps, everywhere = (np.abs(own * (run.q(rod, t=t) - fine.q(rod, t=t))).max() for t in (run.t, between))
    assert everywhere < 1.5 * at_steps
