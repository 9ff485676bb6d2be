"""Paths of equilibria: closed forms of snap-through and buckling of rigid machines, and what is refused."""

from types import SimpleNamespace

import numpy as np
import pytest

import flexmbd as fm
from flexmbd.continuation.follow import follow
from flexmbd.continuation.request import Bounds
from flexmbd.continuation.space import PathDirection
from flexmbd.continuation.station import Station
from flexmbd.errors import ConvergenceError, SceneError
from flexmbd.multibody.kernels.base.arrays import new_work
from flexmbd.multibody.linear.balance import balance
from flexmbd.multibody.linear.stability import has_potential

STIFFNESS, HEIGHT = 1000.0, 0.3
SLANT = np.hypot(1.0, HEIGHT)


def truss(load=lambda t: -t, *, gravity=0.0):
    """Von Mises' truss: two springs from (+-1, 0) hold an apex that slides along y, HEIGHT above them."""
    scene = fm.System(gravity=(0.0, -gravity, 0.0))
    apex = scene.add(fm.RigidBody(1.0, (1e-2,) * 3), name="apex")
    slide = scene.connect(fm.joint.Prismatic("y"), scene.ground.frame(), apex.frame(), name="slide")
    slide.position = HEIGHT
    for side in (-1.0, 1.0):
        foot = scene.ground.frame(p=(side, 0.0, 0.0))
        scene.add_force(fm.force.SpringDamper(foot, apex.frame(), STIFFNESS, SLANT))
    if load is not None:
        scene.add_force(fm.force.FrameForce(apex.frame(), (0.0, load, 0.0)))
    return scene, slide


def load_of_truss(y):
    """N, downwards, that holds the apex at y (m)."""
    length = np.hypot(1.0, y)
    return -2.0 * STIFFNESS * (length - SLANT) / length * y


SNAP = np.sqrt(SLANT ** (2.0 / 3.0) - 1.0)  # m, where the load is largest: length^3 = SLANT


def test_snap_through_of_a_truss():
    scene, slide = truss()
    path = scene.equilibrium(path=fm.Continuation(to=30.0))
    y = path.beta(slide)
    assert path.end is fm.PathEnd.REACHED
    assert path.factors[-1] == 30.0
    assert path.factors == pytest.approx(load_of_truss(y), abs=1e-9)
    assert (path.unstable == (abs(y) < SNAP)).all()
    up, down = path.critical
    assert [up.kind, down.kind] == [fm.CriticalKind.LIMIT] * 2
    assert [up.t, down.t] == pytest.approx([load_of_truss(SNAP), -load_of_truss(SNAP)], rel=1e-10)
    assert [up.beta(slide), down.beta(slide)] == pytest.approx([SNAP, -SNAP], abs=1e-6)
    assert repr(up) == f"<CriticalPoint: limit point at the factor {up.t:.9g}>"
    assert "limit point at 9.9" in repr(path)


def test_a_constant_load_does_not_scale():
    """Under its weight the truss snaps when the rest is applied."""
    scene, slide = truss(gravity=4.0)
    path = scene.equilibrium(path=fm.Continuation(to=20.0))
    assert path.factors + 4.0 == pytest.approx(load_of_truss(path.beta(slide)), abs=1e-9)
    assert path.critical[0].t == pytest.approx(load_of_truss(SNAP) - 4.0, rel=1e-9)
    sets_out = scene.equilibrium()
    assert sets_out.beta(slide) == pytest.approx(path.beta(slide)[0], abs=1e-12)


def test_a_prescribed_motion_leads_it_through():
    """At given places of the apex there is no limit."""
    scene, slide = truss(load=None)
    slide.prescribe(lambda t: (HEIGHT - t, -1.0, 0.0))
    other = scene.add(fm.RigidBody(1.0, (1e-2,) * 3), name="other")
    spring = scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(), other.frame(), name="spring")
    scene.add_force(fm.force.JointSpring(spring, 50.0, 0.0, 0.0))
    scene.add_force(fm.force.SpringDamper(other.frame(), slide.child, 200.0, 0.0))
    path = scene.equilibrium(path=fm.Continuation(to=2.0 * HEIGHT))
    assert path.critical == ()
    assert path.beta(slide) == pytest.approx(HEIGHT - path.factors, abs=1e-12)
    assert path.beta(spring) == pytest.approx(0.0, abs=1e-12)
    assert (path.unstable == 0).all()


def test_a_path_that_turns_back_is_kept_and_told():
    scene, slide = truss()
    with pytest.warns(fm.PathWarning, match=r"turned at the factor 9\.9\d+, came back to -5 .* never reached 30"):
        path = scene.equilibrium(path=fm.Continuation(to=30.0, back_to=-5.0))
    assert path.end is fm.PathEnd.TURNED_BACK
    assert path.factors[-1] == -5.0
    assert path.factors == pytest.approx(load_of_truss(path.beta(slide)), abs=1e-9)
    with pytest.warns(fm.PathWarning, match=r"broken off after 3 points at the factor .* on the way to 30"):
        path = scene.equilibrium(path=fm.Continuation(to=30.0, most_points=3))
    assert path.end is fm.PathEnd.POINTS
    assert len(path.points) == 3
    # and goes on from where it ended
    rest = scene.equilibrium(about=path.points[-1], path=fm.Continuation(to=30.0))
    assert rest.factors[0] == path.factors[-1]
    assert len(rest.critical) == 2


def test_a_path_goes_on_beyond_a_limit_point():
    """Where the factor falls it goes on away from what is asked for; towards it is the way back."""
    scene, slide = truss()
    path = scene.equilibrium(path=fm.Continuation(to=30.0))
    falling = next(one for one in path.points if one.unstable)
    on = scene.equilibrium(about=falling, path=fm.Continuation(to=30.0, back_to=-30.0, side=-1))
    assert on.end is fm.PathEnd.REACHED
    assert [one.kind for one in on.critical] == [fm.CriticalKind.LIMIT]
    assert on.beta(slide)[-1] == pytest.approx(path.beta(slide)[-1], abs=1e-9)
    with pytest.warns(fm.PathWarning, match="came back to -30"):
        back = scene.equilibrium(about=falling, path=fm.Continuation(to=30.0, back_to=-30.0))
    assert back.beta(slide)[-1] > HEIGHT


def test_a_loop_snaps_through():
    """A knee of two rigid bars, its far end on a slider with a spring: P = 4 k L tan(a) (cos(a) - cos(a0))."""
    scene, length, rise = fm.System(), 0.5, 0.4
    bars = [scene.add(fm.RigidBody(1.0, (1e-2,) * 3), name=name) for name in ("near", "far")]
    block = scene.add(fm.RigidBody(1.0, (1e-2,) * 3), name="block")
    hinge = fm.joint.Revolute("z")
    near = scene.connect(hinge, scene.ground.frame(), bars[0].frame(), name="near")
    knee = scene.connect(hinge, bars[0].frame(p=(length, 0, 0)), bars[1].frame(), name="knee")
    span = 2.0 * length * np.cos(rise)
    slide = scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(), block.frame(), name="slide")
    scene.connect(hinge, bars[1].frame(p=(length, 0, 0)), block.frame(), name="end")
    near.position, knee.position, slide.position = rise, -2.0 * rise, span
    scene.add_force(fm.force.JointSpring(slide, 800.0, span, 0.0))
    scene.add_force(fm.force.FrameForce(bars[1].frame(), (0.0, lambda t: -t, 0.0)))
    path = scene.equilibrium(path=fm.Continuation(to=100.0))
    angle = path.beta(near)
    assert path.factors == pytest.approx(4 * 800 * length * np.tan(angle) * (np.cos(angle) - np.cos(rise)), abs=1e-8)
    top = np.arccos(np.cos(rise) ** (1.0 / 3.0))
    assert [one.beta(near) for one in path.critical] == pytest.approx([top, -top], abs=1e-6)
    assert (path.unstable == (abs(angle) < top)).all()


def bar(spring):
    """An upright rigid bar of 1 m on a hinge, pressed from above by t; ``spring`` holds it."""
    scene = fm.System()
    rod = scene.add(fm.RigidBody(1.0, (0.1,) * 3, com=(0.0, 0.5, 0.0)), name="rod")
    foot = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), rod.frame(), name="foot")
    top = rod.frame(p=(0.0, 1.0, 0.0))
    scene.add_force(fm.force.FrameForce(top, (0.0, lambda t: -t, 0.0)))
    spring(scene, foot, top)
    return scene, foot


@pytest.mark.parametrize("side", [1, -1])
def test_a_bar_on_a_turning_spring_buckles_and_bears_more(side):
    """P sin(a) = k a, stable."""
    scene, foot = bar(lambda scene, foot, top: scene.add_force(fm.force.JointSpring(foot, 10.0, 0.0, 0.0)))
    straight = scene.equilibrium(path=fm.Continuation(to=20.0))
    (critical,) = straight.critical
    assert critical.kind is fm.CriticalKind.BIFURCATION
    assert critical.t == pytest.approx(10.0, abs=1e-5)
    assert abs(straight.beta(foot)).max() == 0.0
    assert (straight.unstable == (straight.factors > 10.0)).all()
    bent = scene.equilibrium(about=critical, path=fm.Continuation(to=20.0, side=side))
    angle = bent.beta(foot)[1:]
    assert (np.sign(angle) == side).all()
    assert bent.factors[1:] == pytest.approx(10.0 * angle / np.sin(angle), rel=1e-9)
    assert (bent.unstable[1:] == 0).all()
    # each point is good for linearising: the tangent stiffness over the inertia about the hinge
    half = bent.points[len(angle) // 2]
    a = float(half.beta(foot))
    (square,) = {round(float(value.imag) ** 2, 6) for value in scene.linearize(about=half).eigenvalues()}
    assert square == pytest.approx((10.0 - half.t * np.cos(a)) / (0.1 + 0.25), rel=1e-6)


def test_a_bar_that_a_spring_guides_buckles_and_bears_less():
    """P = k cos(a) with a spring that stays level: the branch falls, unstable, to nothing."""

    def spring(scene, foot, top):
        collar = scene.add(fm.RigidBody(0.1, (1e-3,) * 3), name="collar")
        scene.connect(fm.joint.Prismatic("y"), scene.ground.frame(), collar.frame(), name="post").position = 1.0
        slide = scene.connect(fm.joint.Prismatic("x"), collar.frame(), scene.add(
            fm.RigidBody(0.1, (1e-3,) * 3), name="ring").frame(), name="slide")
        scene.add_force(fm.force.JointSpring(slide, 10.0, 0.0, 0.0))
        scene.connect(fm.joint.Spherical(), top, slide.child, name="eye")

    scene, foot = bar(spring)
    straight = scene.equilibrium(path=fm.Continuation(to=15.0))
    (critical,) = straight.critical
    assert critical.t == pytest.approx(10.0, abs=1e-5)
    with pytest.warns(fm.PathWarning, match="never reached 15"):
        bent = scene.equilibrium(about=critical, path=fm.Continuation(to=15.0, back_to=2.0))
    assert bent.factors == pytest.approx(10.0 * np.cos(bent.beta(foot)), rel=1e-7)
    assert bent.factors[-1] == 2.0
    assert (bent.unstable[1:] == 1).all()


def post_on_an_arm():
    """A post of 2 m on an arm that turns under the load; a spring to the ground, 10 N m, holds the post upright.

    Its angle is the sum of two coordinates, so that the mode in which it gives way is not normal to the path.
    """
    scene = fm.System()
    arm = scene.add(fm.RigidBody(1.0, (1.0, 1.0, 1.0)), name="arm")
    post = scene.add(fm.RigidBody(1.0, (1.0, 1.0, 1.0)), name="post")
    root = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), arm.frame(), name="root")
    foot = scene.connect(fm.joint.Revolute("z"), arm.frame(p=(1.0, 0.0, 0.0)), post.frame(), name="foot")
    scene.add_force(fm.force.JointSpring(root, 500.0, 0.0, 0.0))
    upright = fm.force.Bushing(scene.ground.frame(), post.frame(), stiffness=np.diag([0.0, 0.0, 0.0, 0.0, 0.0, 10.0]))
    scene.add_force(upright)
    scene.add_force(fm.force.FrameForce(post.frame(p=(0.0, 2.0, 0.0)), (0.0, lambda t: -t, 0.0)))
    return scene, lambda path: path.beta(root) + path.beta(foot)


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize("to", [5.01, 5.5, 8.0, 500.0])
def test_a_branch_is_found_whatever_the_range_of_factors(to, side):
    """Another one than that of the path on which the bifurcation was found: 2 P sin(a) = k a."""
    scene, angle_of = post_on_an_arm()
    (critical,) = scene.equilibrium(path=fm.Continuation(to=8.0)).critical
    bent = scene.equilibrium(about=critical, path=fm.Continuation(to=to, side=side))
    angle = angle_of(bent)[1:]
    assert (np.sign(angle) == side).all()
    assert bent.factors[1:] == pytest.approx(5.0 * angle / np.sin(angle), rel=1e-9)


@pytest.mark.parametrize("side", [1, -1])
def test_a_branch_that_rises_to_one_side_and_falls_to_the_other(side):
    """P sin(a) = 10 a + 200 a^2: its first steps are steep in the factor's range."""
    law = fm.compiled(lambda t, a, rate: -10.0 * a - 200.0 * a * a)
    scene, foot = bar(lambda scene, foot, top: scene.add_force(fm.force.JointLaw(foot, law)))
    (critical,) = scene.equilibrium(path=fm.Continuation(to=20.0)).critical
    to = 10.0 + 10.0 * side
    bent = scene.equilibrium(about=critical, path=fm.Continuation(to=to, side=side))
    angle = bent.beta(foot)[1:]
    assert (np.sign(angle) == side).all()
    assert bent.factors[-1] == to
    assert bent.factors[1:] == pytest.approx((10.0 * angle + 200.0 * angle**2) / np.sin(angle), rel=1e-7)


@pytest.mark.parametrize("side", [1, -1])
def test_a_closed_path_is_gone_round_once(side):
    """A law by which a hinge is in balance on a circle: (a - 0.6)^2 + (t - 0.8)^2 = 1."""
    law = fm.compiled(lambda t, a, rate: (a - 0.6) ** 2 + (t - 0.8) ** 2 - 1.0)
    scene = fm.System()
    rod = scene.add(fm.RigidBody(1.0, (0.1,) * 3), name="rod")
    hinge = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), rod.frame(), name="hinge")
    scene.add_force(fm.force.JointLaw(hinge, law))
    with pytest.warns(fm.PathWarning, match=r"is closed: .* as near to 5 as 1\.8$"):
        path = scene.equilibrium(path=fm.Continuation(to=5.0, side=side))
    assert path.end is fm.PathEnd.CLOSED
    assert "(closed)" in repr(path)
    angle = np.unwrap(np.arctan2(path.factors - 0.8, path.beta(hinge) - 0.6))
    assert np.ptp(angle) == pytest.approx(2.0 * np.pi, abs=1e-9)
    assert np.hypot(path.beta(hinge) - 0.6, path.factors - 0.8) == pytest.approx(1.0, abs=1e-9)
    assert path.factors[-1] == path.factors[0] == 0.0
    limits = [one.t for one in path.critical]
    assert sorted(limits) == pytest.approx([-0.2, 1.8], abs=1e-9)


def test_a_small_follower_leaves_a_machine_where_it_settles():
    """A double pendulum that starts nearly upright hangs in the end, a little aside; at what is unstable it is told."""
    scene = fm.System(gravity=(0.0, -9.81, 0.0))
    below, joints = scene.ground.frame(), []
    for name in ("upper", "lower"):
        rod = scene.add(fm.RigidBody(1.0, (0.1,) * 3, com=(0.0, -0.5, 0.0)), name=name)
        joints.append(scene.connect(fm.joint.Revolute("z"), below, rod.frame(), name=f"{name} hinge"))
        below = rod.frame(p=(0.0, -1.0, 0.0))
    joints[0].position, joints[1].position = 2.5, 0.3
    scene.add_force(fm.force.FrameForce(below, (1.0, 0.0, 0.0), axes=fm.force.Axes.FRAME))
    with pytest.warns(fm.EquilibriumWarning, match=r"unstable: one motion grows, most of all in 'lower hinge.angle'"):
        assert scene.equilibrium().unstable == 1
    hangs = scene.equilibrium(stable=True)
    assert hangs.unstable == 0
    # about the lower hinge: the force at 1 m, the weight at half a metre; about the upper one with the upper weight
    upper, lower = float(hangs.beta(joints[0])), float(hangs.beta(joints[0]) + hangs.beta(joints[1]))
    assert np.sin(lower) == pytest.approx(1.0 / (9.81 * 0.5), rel=1e-9)
    assert 9.81 * 1.5 * np.sin(upper) == pytest.approx(np.cos(upper - lower), rel=1e-9)


@pytest.mark.parametrize("follows", [False, True])
def test_what_has_a_potential_out_of_balance(follows):
    """Along rotations second derivatives commute up to the moment that is out of balance."""
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    top = scene.add(fm.RigidBody(2.0, (0.1, 0.2, 0.3), (0.1, 0.2, 0.4)), name="top")
    ball = scene.connect(fm.joint.Spherical(), scene.ground.frame(), top.frame(), name="ball")
    ball.position = [0.8, 0.36, 0.48, 0.0]
    hook = top.frame(p=(0.3, 0.1, 0.5))
    scene.add_force(fm.force.SpringDamper(scene.ground.frame(p=(1.0, 2.0, 0.5)), hook, 300.0, 1.0))
    if follows:
        scene.add_force(fm.force.FrameForce(hook, (5.0, 0.0, 0.0), axes=fm.force.Axes.FRAME))
    start = scene.start()
    there = balance(start.scene, new_work(start.scene.plan), start.x, start.v)
    assert abs(there.lacking).max() > 1.0
    assert has_potential(start.scene, there) is not follows


# --- what is refused


def test_a_load_that_does_nothing():
    scene, _ = truss(load=-3.0)
    with pytest.raises(SceneError, match="the loads do nothing as the factor grows: functions of time scale them"):
        scene.equilibrium(path=fm.Continuation(to=1.0))
    scene, slide = truss(load=None)
    scene.add_force(fm.force.FrameForce(slide.child, (lambda t: t, 0.0, 0.0)))
    with pytest.raises(SceneError, match="the loads do nothing"):
        scene.equilibrium(path=fm.Continuation(to=1.0))


@pytest.mark.parametrize("load", [lambda t: -t * t, lambda t: -2.0 * np.sin(np.pi * t)])
def test_a_load_that_does_nothing_at_first_or_comes_back(load):
    scene, slide = truss(load=load)
    path = scene.equilibrium(path=fm.Continuation(to=1.0))
    assert path.end is fm.PathEnd.REACHED
    assert load_of_truss(path.beta(slide)) == pytest.approx([-load(t) for t in path.factors], abs=1e-9)


def test_a_mechanism():
    scene, _ = truss()
    loose = scene.add(fm.RigidBody(1.0, (1e-2,) * 3), name="loose")
    scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(), loose.frame(), name="rail")
    with pytest.raises(SceneError, match=r"nothing resists the motion of 'rail.displacement': .* mechanism"):
        scene.equilibrium(path=fm.Continuation(to=1.0))


@pytest.mark.parametrize(
    ("given", "pattern"),
    [
        ({"to": np.nan}, "to must be a load factor, a number"),
        ({"to": True}, "to must be a load factor"),
        ({"to": 1.0, "back_to": "no"}, "back_to must be a load factor"),
        ({"to": 1.0, "side": 0}, "side must be 1 or -1"),
        ({"to": 1.0, "longest_step": 0.0}, "longest_step must be above 0"),
        ({"to": 1.0, "most_points": 1}, "most_points must be 2 or more"),
    ],
)
def test_settings_without_sense(given, pattern):
    with pytest.raises(SceneError, match=pattern):
        fm.Continuation(**given)


def test_paths_that_cannot_begin():
    scene, slide = truss()
    with pytest.raises(SceneError, match="ends at the load factor 0 at which it begins"):
        scene.equilibrium(path=fm.Continuation(to=0.0))
    with pytest.raises(SceneError, match="does not lie on the other side of the start"):
        scene.equilibrium(path=fm.Continuation(to=2.0, back_to=1.0))
    with pytest.raises(SceneError, match=r"path must be fm\.Continuation"):
        scene.equilibrium(path=2.0)
    begin = scene.equilibrium(t=2.0)
    with pytest.raises(SceneError, match="under its own load factor, 2, and t = 1 is another"):
        scene.equilibrium(t=1.0, about=begin, path=fm.Continuation(to=3.0))
    heavier, _ = truss(gravity=5.0)
    with pytest.raises(SceneError, match="`about` is no equilibrium of this scene at the factor 2"):
        heavier.equilibrium(about=begin, path=fm.Continuation(to=3.0))
    slide.velocity = 1.0
    with pytest.raises(SceneError, match="of a machine at rest, but joint 'slide' is given a velocity"):
        scene.equilibrium(path=fm.Continuation(to=3.0))


class Nowhere:
    """A space in which nothing is found and no length is a number."""

    width = 1.0

    def largest(self, a):
        return np.nan

    def correct(self, start, step, across, *, undetermined=0):
        raise ConvergenceError("nothing here")


@pytest.mark.timeout(20)
def test_a_path_whose_tangent_is_no_number_ends():
    begin = Station(SimpleNamespace(factor=0.0), PathDirection(np.array([np.nan]), np.nan), None)
    with pytest.raises(ConvergenceError, match="cannot be followed beyond the factor 0"):
        next(follow(Nowhere(), begin, Bounds(to=1.0, back_to=-1.0, longest=0.3, points=10)))


def test_zieglers_column_flutters_while_its_load_is_large():
    """Under a follower beyond (7/2 - sqrt 2) c / l (Ziegler 1952); the load comes back to where it began."""
    scene, small = fm.System(gravity=(0.0, 0.0, 0.0)), (1e-7, 1e-7, 1e-7)
    lower, upper = (scene.add(fm.RigidBody(mass=m, inertia=small, com=(1.0, 0.0, 0.0))) for m in (2.0, 1.0))
    hinges = [
        scene.connect(fm.joint.Revolute(axis="z"), scene.ground.frame(), lower.frame()),
        scene.connect(fm.joint.Revolute(axis="z"), lower.frame(p=(1.0, 0.0, 0.0)), upper.frame()),
    ]
    for hinge in hinges:
        scene.add_force(fm.force.JointSpring(hinge, 1.0))
    push = (lambda t: -12.0 * t * (1.0 - t), 0.0, 0.0)
    tip = upper.frame(p=(1.0, 0.0, 0.0))
    scene.add_force(fm.force.FrameForce(tip, push, axes=fm.force.Axes.FRAME))
    path = scene.equilibrium(path=fm.Continuation(to=1.0))
    assert [one.kind for one in path.critical] == 2 * [fm.CriticalKind.FLUTTER]
    root = np.sqrt(0.25 - (3.5 - np.sqrt(2.0)) / 12.0)
    assert [one.t for one in path.critical] == pytest.approx([0.5 - root, 0.5 + root], abs=1e-6)
    outside = np.abs(path.factors - 0.5) > root
    assert set(path.unstable[outside]) == {0}
    assert set(path.unstable[~outside]) == {2}
