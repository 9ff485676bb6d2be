"""First steps of soft bodies with history: whatever the length of the run, the load, the step and the units."""

import pytest

import flexmbd as fm
from flexmbd import meshes
from flexmbd.continuum import ImplicitContinuum, Interface, NonlinearModel
from flexmbd.forms import neo_hookean


@pytest.mark.parametrize("unit", [1.0, 1e-3], ids=["m", "mm"])
def test_a_first_step_does_not_hang_on_the_length_of_the_run(unit):
    """A soft bar that begins to fall about a hinge: equations are solved as closely as round-off lets them be.

    The far end falls freely, by g t^2 / 2, until the bending that begins at the hinge arrives.
    """
    bar = meshes.block(0.2 / unit, 0.03 / unit, 0.03 / unit, divisions=(6, 1, 1))
    soft = neo_hookean.Parameters(E=1.4e7 * unit, nu=0.4, rho=1100.0 * unit**3)
    model = NonlinearModel(bar, neo_hookean, soft, degree=2, interfaces=[Interface("x_min"), Interface("x_max")])
    body = fm.ContinuumBody(ImplicitContinuum(model))
    for g, h in ((1e-3, 1e-3), (1e-3, 1e-4), (9.81, 1e-4)):
        ends = []
        for t_end in (10 * h, 1e5 * h):
            scene = fm.System(gravity=(0.0, 0.0, -g / unit))
            scene.add(body, name="bar")
            scene.connect(fm.joint.Revolute(axis="y"), scene.ground.frame(), body.frame("x_min"))
            soon = fm.Event(lambda now, h=h: now.t - 3.5 * h, stop=True)
            run = scene.simulate(t_end, h=h, events=[soon], integrator=fm.GeneralizedAlpha())
            ends.append(run.position(body.frame("x_max"))[-1, 2] * unit)
        assert ends[1] == pytest.approx(ends[0], rel=1e-7)
        assert ends[0] == pytest.approx(-0.5 * g * (3.5 * h) ** 2, rel=0.03)
