"""Tables of functions of time and of springs: what they are before their first point and after their last."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline, PchipInterpolator, PPoly

import flexmbd as fm
from flexmbd.errors import SceneError, TableWarning

INERTIA = 0.25  # kg m^2


def wheel():
    scene = fm.System()
    disc = scene.add(fm.RigidBody(1.0, (INERTIA, INERTIA, INERTIA)), name="disc")
    return scene, scene.connect(fm.joint.Revolute("x"), scene.ground.frame(), disc.frame(), name="hinge")


@pytest.mark.parametrize("monotone", [False, True])
@pytest.mark.parametrize("beyond", fm.Beyond)
def test_a_motion_beyond_its_points(beyond, monotone):
    """Held, gone on straight, or by the cubics of scipy's interpolators."""
    t, y = np.array([0.25, 0.5, 0.75]), np.array([0.0, 0.1, 0.4])
    inner = (PchipInterpolator if monotone else CubicSpline)(t, y)
    wanted = {
        fm.Beyond.HOLD: lambda at: inner(np.clip(at, *t[[0, -1]])),
        fm.Beyond.LINEAR: lambda at: inner(np.clip(at, *t[[0, -1]]))
        + inner(np.clip(at, *t[[0, -1]]), 1) * (at - np.clip(at, *t[[0, -1]])),
        fm.Beyond.EXTRAPOLATE: inner,
    }[beyond]
    scene, hinge = wheel()
    hinge.prescribe(fm.Table(t, y, monotone=monotone, beyond=beyond))
    run = scene.simulate(1.5, h=0.0625)
    assert run.t[0] == 0.0
    np.testing.assert_allclose(run.beta(hinge), wanted(run.t), atol=1e-14)
    late = run.t > t[-1]
    rate = {fm.Beyond.HOLD: 0.0, fm.Beyond.LINEAR: inner(t[-1], 1), fm.Beyond.EXTRAPOLATE: inner(run.t[late], 1)}
    np.testing.assert_allclose(run.beta_rate(hinge)[late], rate[beyond] * np.ones(late.sum()), atol=1e-13)


def test_a_table_holds_by_default():
    scene, hinge = wheel()
    hinge.prescribe(fm.Table([0.0, 0.25, 0.5], [0.0, 0.1, 0.4]))
    assert scene.simulate(5.0).beta(hinge)[-1] == pytest.approx(0.4, abs=1e-15)


@pytest.mark.parametrize("size", [1e-6, 1.0, 1e6])
def test_a_saturating_spring_does_not_turn_round(size):
    """Beyond its points a saturating spring keeps its last force; the energy is the integral of that."""
    deflection = size * np.array([-2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0])
    force = np.array([-10.0, -10.0, -8.0, 0.0, 8.0, 10.0, 10.0])
    scene = fm.System()
    block = scene.add(fm.RigidBody(2.0, (1.0, 1.0, 1.0)), name="block")
    slide = scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(), block.frame(), name="slide")
    scene.add_force(fm.force.JointSpring(slide, fm.Table(deflection, force)))
    stored = []
    for place in (3.0 * size, 50.0 * size, -50.0 * size):
        slide.position = place
        assert scene.start().a[0] == pytest.approx(-5.0 * np.sign(place), rel=1e-13)
        stored.append(scene.simulate(1e-9).energy().spring[0])
    assert stored[1] - stored[0] == pytest.approx(10.0 * 47.0 * size, rel=1e-9)
    assert stored[2] == pytest.approx(stored[1], rel=1e-12)


@pytest.mark.parametrize(
    ("function", "fault"),
    [
        (fm.Table([0.0, 1.0], [0.0, 1.0], beyond="hold"), "a table's beyond must be fm.Beyond.HOLD, LINEAR or EXTR"),
        (fm.Table([0.0, 1.0], ["a", "b"]), "a table needs numbers t and y, of one length"),
        (PPoly([[1.0, 2.0]], [0.0, 1.0, 2.0], extrapolate=False), "this one has extrapolate=False"),
        (CubicSpline([0.0, 1.0, 2.0], [0.0, 1.0, 0.0], bc_type="periodic"), "this one has extrapolate='periodic'"),
    ],
    ids=["text", "no numbers", "nowhere else", "periodic"],
)
def test_what_does_not_go_on(function, fault):
    _, hinge = wheel()
    with pytest.raises(SceneError, match=fault):
        hinge.prescribe(function)


def test_swings_beside_a_jump_are_told():
    """A torque of 5 N m that becomes -20 within a microsecond swings to a quarter of a million."""
    t, y = [0.0, 0.01, 0.010001, 0.03], [5.0, 5.0, -20.0, 30.0]
    sampled = CubicSpline(t, y)(np.linspace(0.0, 0.03, 100_001))
    scene, hinge = wheel()
    scene.add_force(fm.force.JointTorque(hinge, fm.Table(t, y)))
    with pytest.warns(TableWarning, match="between -20 and 30, swings to .*monotone=True") as told:
        scene.simulate(1e-3, h=1e-3)
    assert told[0].filename == __file__
    swing = float(str(told[0].message).split("swings to ")[1].split()[0])
    assert abs(swing) == pytest.approx(abs(sampled).max(), rel=1e-5)


@pytest.mark.parametrize("width", [1e-2, 1e-4, 1e-6])
def test_a_steep_pulse_gives_its_impulse(width):
    """100 N for 10 ms between far points: a spline swings to 1e7 N.  The ramps are S-shaped, of half their width."""
    scene = fm.System()
    body = scene.add(fm.RigidBody(1.0, (1.0, 1.0, 1.0)))
    rail = scene.connect(fm.joint.Prismatic("z"), scene.ground.frame(), body.frame())
    t = [0.0, 1.0 - width, 1.0, 1.01, 1.01 + width, 3.0]
    scene.add_force(fm.force.JointForce(rail, fm.Table(t, [0.0, 0.0, 100.0, 100.0, 0.0, 0.0])))
    with pytest.warns(TableWarning, match="it is taken as"):
        run = scene.simulate(3.0, rtol=1e-6, max_steps=2000)
    assert run.beta_rate(rail).ravel()[-1] == pytest.approx(100.0 * (0.01 + width), rel=1e-5)


@pytest.mark.parametrize("unit", [1e-9, 1.0, 1e9])
@pytest.mark.parametrize("monotone", [False, True])
def test_points_of_a_smooth_function_and_monotone_tables_are_not_told(monotone, unit, recwarn):
    t = np.linspace(0.0, 1.0, 9)
    jump = [0.0, 1.0, 1.0 + 1e-6, 2.0]
    tables = [fm.Table(t, unit * np.sin(9.0 * t), monotone=monotone), fm.Table(t, unit * np.ones(9), monotone=monotone)]
    tables += [fm.Table(jump, unit * np.array([5.0, 5.0, -20.0, 30.0]), monotone=True)]
    for table in tables:
        scene, hinge = wheel()
        scene.add_force(fm.force.JointTorque(hinge, table))
        scene.compile()
    assert not [told for told in recwarn if told.category is TableWarning]
