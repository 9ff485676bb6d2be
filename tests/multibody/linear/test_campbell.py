"""Campbell diagrams against the closed forms of rotors: frequencies, critical speeds, branches through crossings."""

from dataclasses import replace

import numpy as np
import pytest

import flexmbd as fm
from flexmbd.errors import PictureError, SceneError

MASS, HUB = 5.0, 0.2  # kg
POLAR, ACROSS, OF_HUB = 0.09, 0.05, 1e-3  # kg m^2
SIDE, TILT, DRAG = 2e5, 900.0, 1.5  # N/m, N m/rad, N m s/rad
SPEEDS = np.linspace(0.0, 400.0, 17)


def rotor(*, polar=POLAR, drag=0.0):
    """A disc that spins about x in a hub held by springs against shifts and tilts; what linearises it at a speed."""
    scene = fm.System()
    hub = scene.add(fm.RigidBody(HUB, (OF_HUB, OF_HUB, OF_HUB)), name="hub")
    disc = scene.add(fm.RigidBody(MASS, (polar, ACROSS, ACROSS)), name="disc")
    scene.connect(fm.joint.Free(), scene.ground.frame(), hub.frame())
    spin = scene.connect(fm.joint.Revolute("x"), hub.frame(), disc.frame(), name="spin")
    stiffness = np.diag([50 * SIDE, SIDE, SIDE, 50 * TILT, TILT, TILT])
    damping = np.diag([0.0, 0.0, 0.0, 0.0, drag, drag])
    scene.add_force(fm.force.Bushing(scene.ground.frame(), hub.frame(), stiffness, damping))

    def at(speed):
        spin.velocity = speed
        return scene.linearize()

    return at


def tilts(speed, *, polar=POLAR, drag=0.0):
    """Forward and backward whirl: (Id) phi'' + (c - i Ip speed) phi' + k phi = 0, phi the complex tilt."""
    roots = np.roots([ACROSS + OF_HUB, drag - 1j * polar * speed, TILT])
    return sorted(np.where(roots.imag > 0, roots, roots.conj()), key=lambda one: one.imag)


@pytest.mark.parametrize("drag", [0.0, DRAG])
def test_forward_and_backward_whirl(drag):
    diagram = fm.campbell(rotor(drag=drag), SPEEDS)
    assert np.isfinite(diagram.eigenvalues).all()
    sideways = np.sqrt(SIDE / (MASS + HUB))
    for speed, values in zip(SPEEDS, diagram.eigenvalues, strict=True):
        expected = [*tilts(speed, drag=drag), 1j * sideways, 1j * sideways]
        for one in expected:
            assert min(abs(values - one)) < 1e-7 * abs(one)
    assert (diagram.damping_ratios < 1.0).all()


def test_branches_cross():
    """The forward tilt passes the sideways vibration and goes on as what it was, the backward one falls for good."""
    diagram = fm.campbell(rotor(), SPEEDS)
    sideways = np.sqrt(SIDE / (MASS + HUB)) / (2 * np.pi)
    low, high = np.array([tilts(speed) for speed in SPEEDS]).imag.T / (2 * np.pi)
    assert high[0] < sideways < high[-1]
    for expected in (low, high, np.full(len(SPEEDS), sideways)):
        nearest = np.abs(diagram.frequencies - expected[:, None]).max(axis=0).min()
        assert nearest < 1e-7 * sideways


def test_a_crossing_at_a_speed_of_the_list():
    """There the shapes of the two are any mixture; the speed after tells them apart by the one before."""
    sideways = np.sqrt(SIDE / (MASS + HUB))
    meeting = ((ACROSS + OF_HUB) * sideways**2 - TILT) / (POLAR * sideways)
    speeds = np.sort(np.append(SPEEDS, meeting))
    diagram = fm.campbell(rotor(), speeds)
    high = np.array([tilts(speed)[1].imag for speed in speeds]) / (2 * np.pi)
    assert np.abs(diagram.frequencies - high[:, None]).max(axis=0).min() < 1e-7 * high[0]


@pytest.mark.parametrize("polar", [POLAR, 0.03])
def test_critical_speeds(polar):
    """Id w^2 -+ Ip w speed = k at w = order speed; a disc (Ip > Id) has no forward one of unbalance."""
    diagram = fm.campbell(rotor(polar=polar), SPEEDS, orders=[1, 2])
    expected = [np.sqrt(SIDE / (MASS + HUB)) / order for order in (1, 2) for _ in range(2)]
    for order in (1, 2):
        for sign in (1, -1):
            square = TILT / ((ACROSS + OF_HUB) * order**2 + sign * polar * order)
            expected += [np.sqrt(square)] if 0.0 < square < SPEEDS[-1] ** 2 else []
    np.testing.assert_allclose([one.speed for one in diagram.critical], np.sort(expected), rtol=1e-7)
    for one in diagram.critical:
        assert one.frequency == pytest.approx(one.order * one.speed / (2 * np.pi))
        assert abs(one.damping_ratio) < 1e-9


def test_the_number_of_speeds_does_not_matter():
    few, many = (fm.campbell(rotor(), np.linspace(0.0, 400.0, n)) for n in (9, 33))
    np.testing.assert_allclose(few.eigenvalues, many.eigenvalues[::4], rtol=1e-8, atol=1e-6)
    np.testing.assert_allclose([c.speed for c in few.critical], [c.speed for c in many.critical], rtol=1e-8)


def test_a_vibration_that_ends():
    """A damper that grows with the speed, until above 10 rad/s nothing swings."""

    def at(speed):
        scene = fm.System()
        arm = scene.add(fm.RigidBody(1.0, (1.0, 1.0, 1.0)), name="arm")
        lever = scene.connect(fm.joint.Revolute("x"), scene.ground.frame(), arm.frame())
        scene.add_force(fm.force.JointSpring(lever, 100.0, 0.0, 2.0 * speed))
        return scene.linearize()

    diagram = fm.campbell(at, [0.0, 6.0, 8.0, 11.0, 12.0])
    np.testing.assert_allclose(diagram.frequencies[:3, 0], np.array([10.0, 8.0, 6.0]) / (2 * np.pi), rtol=1e-9)
    np.testing.assert_allclose(diagram.damping_ratios[:3, 0], [0.0, 0.6, 0.8], atol=1e-12)
    assert np.isnan(diagram.frequencies[3:]).all()
    (one,) = diagram.critical
    assert one.speed == pytest.approx(np.sqrt(50.0))
    assert one.damping_ratio == pytest.approx(np.sqrt(0.5))


def test_bad_input():
    at = rotor()
    for speeds in ([1.0], [2.0, 1.0], [0.0, np.nan], [[0.0, 1.0]]):
        with pytest.raises(SceneError, match="speeds must be two or more finite numbers"):
            fm.campbell(at, speeds)
    for orders in ([0.0], [-1.0], [np.inf]):
        with pytest.raises(SceneError, match="engine orders must be"):
            fm.campbell(at, SPEEDS, orders=orders)

    def other(speed):
        scene = fm.System()
        arm = scene.add(fm.RigidBody(1.0, (1.0, 1.0, 1.0)), name="arm" if speed < 2.0 else "lever")
        scene.connect(fm.joint.Revolute("x"), scene.ground.frame(), arm.frame(), name=f"hinge at {speed:g}")
        return scene.linearize()

    with pytest.raises(SceneError, match="at 1 rad/s the machine has other states than at 0 rad/s"):
        fm.campbell(other, [0.0, 1.0])

    def unsteady(speed):
        scene = fm.System(gravity=(0.0, -9.81, 0.0))
        arm = scene.add(fm.RigidBody(1.0, (1.0, 1.0, 1.0), (1.0, 0.0, 0.0)), name="arm")
        scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), arm.frame())
        return scene.linearize()

    with pytest.raises(SceneError, match="at 0 rad/s: the motion is not steady"):
        fm.campbell(unsteady, [0.0, 1.0])


def test_picture(tmp_path):
    diagram = fm.campbell(rotor(), SPEEDS, orders=[1, 2])
    figure = fm.visual.plot_campbell(diagram, path=tmp_path / "campbell.png", title="a rotor")
    assert (tmp_path / "campbell.png").stat().st_size > 5000
    axes = figure.axes[0]
    dots = next(line for line in axes.lines if line.get_label() == "critical speed")
    np.testing.assert_allclose(dots.get_xdata(), [c.speed * 60 / (2 * np.pi) for c in diagram.critical])
    with pytest.raises(PictureError, match="nothing vibrates"):
        fm.visual.plot_campbell(replace(diagram, eigenvalues=np.full((len(SPEEDS), 1), complex(np.nan, np.nan))))
    with pytest.raises(PictureError, match="highest"):
        fm.visual.plot_campbell(diagram, highest=-1.0)


def test_picture_with_names(tmp_path):
    """Vibrations by their names; of the crossings those that nothing excites are hollow."""
    diagram = fm.campbell(rotor(), SPEEDS, orders=[1, 2])
    count = diagram.frequencies.shape[1]
    excited = [k % 2 == 0 for k in range(count)]
    names = [f"kind {k}" for k in range(count)]
    figure = fm.visual.plot_campbell(diagram, path=tmp_path / "named.png", names=names, excited=excited, highest=1e4)
    lines = {line.get_label(): line for line in figure.axes[0].lines}
    assert set(names) < set(lines)
    hollow = lines["crossing, not excited"]
    assert hollow.get_markerfacecolor() == "white"
    assert len(hollow.get_xdata()) == sum(one.branch % 2 for one in diagram.critical) > 0
    assert len(lines["critical speed"].get_xdata()) + len(hollow.get_xdata()) == len(diagram.critical)
    for wrong in ({"names": names[1:]}, {"excited": [True]}, {"names": "axial"}, {"excited": 1}):
        with pytest.raises(PictureError, match=next(iter(wrong))):
            fm.visual.plot_campbell(diagram, **wrong)
