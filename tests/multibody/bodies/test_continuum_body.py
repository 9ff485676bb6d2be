"""Bodies with history in a scene: what is refused, where their frames start, what the scene tells of them."""

from __future__ import annotations

import numpy as np
import pytest
from spring_interior import ExplicitSprings, ImplicitSprings, as_continuum, chain
from spring_machines import Nothing, pendulum

import flexmbd as fm
from flexmbd.errors import InterfaceError, SceneError
from flexmbd.multibody.bodies.continuum_body import InteriorFrame, Scheme
from flexmbd.rotation import from_quaternion

TURN = from_quaternion(np.array([0.8, 0.0, 0.6, 0.0]))


def frame(name="a", *, p=(0.0, 0.0, 0.0), R=None, mass=1.0, inertia=(0.1, 0.1, 0.1)):
    turn = np.eye(3) if R is None else R
    return InteriorFrame(name, np.array(p), turn, mass, np.zeros(3), np.diag(inertia))


def body_of(*frames):
    interior = Nothing()
    interior.frames = frames
    return fm.ContinuumBody(interior)


@pytest.mark.parametrize(
    ("frames", "message"),
    [
        ((), "it needs interface frames"),
        ((frame(), frame()), r"each with a name of its own, got \['a', 'a'\]"),
        ((frame(), frame("b", mass=0.0)), "interface frame 'b' of a continuum body: rigid body: mass must be positive"),
        ((frame(inertia=(0.1, 0.1, 0.5)),), "interface frame 'a' .* belong to no body"),
        ((frame(R=np.diag([1.0, 1.0, -1.0])),), "interface frame 'a' .* not a rotation"),
    ],
)
def test_frames_that_no_body_can_have(frames, message):
    with pytest.raises(SceneError, match=message):
        body_of(*frames)


def test_an_interior_must_be_steppable():
    bare = type("Bare", (), {name: getattr(Nothing, name) for name in ("begin", "snapshot", "restore", "energies")})()
    bare.frames, bare.mass = (frame(),), 0.0
    with pytest.raises(SceneError, match=r"must be an ExplicitInterior or an ImplicitInterior, .*Bare"):
        fm.ContinuumBody(bare)


def test_names():
    scene = fm.System()
    body, _ = as_continuum(scene, chain(ImplicitSprings, 1, stiffness=1e3))
    assert [part.name for part in body.parts] == ["lattice.end 0", "lattice.end 1"]
    with pytest.raises(SceneError, match="already in this scene"):
        scene.add(body)
    for name in ("lattice", "lattice.end 1"):
        with pytest.raises(SceneError, match=f"the name '{name}' is taken"):
            scene.add(fm.RigidBody(1.0, (1.0, 1.0, 1.0)), name=name)
    with pytest.raises(InterfaceError, match="no interface 'tip'; it has 'end 0', 'end 1'"):
        body.frame("tip")
    with pytest.raises(SceneError, match=r"nothing connects 'lattice\.end 0', 'lattice\.end 1' to the ground"):
        scene.compile()
    assert body.mass == pytest.approx(2 * 1.3 + 3 * 0.4)


def test_frames_that_no_joint_carries_start_where_the_body_has_them():
    """Three turned frames, the middle one on a hinge that turns: the others move with it as one rigid body."""
    scene = fm.System()
    other = from_quaternion(np.array([0.5, 0.5, -0.5, 0.5]))
    frames = [frame("a", p=(0.2, 0.0, 0.1), R=other), frame("b", p=(1.0, 0.5, 0.0), R=TURN)]
    frames.append(frame("c", p=(2.0, 0.0, 0.0)))
    body = scene.add(body_of(*frames), name="body")
    place = np.array([3.0, -1.0, 0.5])
    hinge = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(place), body.frame("b"))
    hinge.position, hinge.velocity = 0.7, 2.0
    run = scene.simulate(1e-6, h=1e-6)
    R_WB = run.rotation(body.frame("b"))[0] @ TURN.T
    spin = run.rotation(body.frame("b"))[0] @ [0.0, 0.0, 2.0]
    for one in frames:
        arm = R_WB @ (one.p_BI_B - frames[1].p_BI_B)
        marker = body.frame(one.name)
        np.testing.assert_allclose(run.position(marker)[0], place + arm, atol=1e-14)
        np.testing.assert_allclose(run.rotation(marker)[0], R_WB @ one.R_BI, atol=1e-14)
        np.testing.assert_allclose(run.velocity(marker)[0], np.cross(spin, arm), atol=1e-14)
        np.testing.assert_allclose(run.angular_velocity(marker)[0], spin, atol=1e-14)


def test_a_body_added_before_hangs_on_a_frame_all_the_same():
    scene = fm.System()
    ball = scene.add(fm.RigidBody(1.0, (0.1, 0.1, 0.1)), name="ball")
    body, (a, b) = as_continuum(scene, chain(ImplicitSprings, 1, stiffness=1e3))
    scene.connect(fm.joint.Spherical(), b, ball.frame())
    scene.connect(fm.joint.Revolute("y"), scene.ground.frame(), a)
    start = scene.start()
    assert len(start.scene.plan.rows) == 0
    run = scene.simulate(1e-6, h=1e-6)
    np.testing.assert_allclose(run.position(ball.frame())[0], [1.0, 0.0, 0.0], atol=1e-14)
    assert body.interior.x[:, 0].max() == pytest.approx(1.0)


def test_a_start_that_deforms_the_body_is_refused():
    scene = fm.System()
    _, (a, b) = as_continuum(scene, chain(ImplicitSprings, 1, stiffness=1e3))
    scene.connect(fm.joint.Fixed(), scene.ground.frame(), a)
    slide = scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(), b)
    slide.position = 1.01
    with pytest.raises(SceneError, match=r"body 'lattice' must start in the shape.*'end 1' 0\.01 m and 0 rad from"):
        scene.start()
    slide.position = 1.0
    scene.start()


def test_what_the_scene_tells():
    scene, *_ = pendulum(chain(ExplicitSprings, 1, stiffness=2e3), False)
    text = scene.explain()
    assert "bodies with history:\n  lattice: 2 interface frames as rigid bodies (end 0, end 1), no multipliers" in text
    assert "its interior of 1.2 kg can step explicitly, by 0.0" in text
    assert "lattice.end 1 (rigid): 6 coordinates of its own, starts where its body has it" in text
    assert "interior of lattice on lattice.end 1" in text
    assert "central differences" in text
    scene, *_ = pendulum(chain(ImplicitSprings, 1, stiffness=2e3), False)
    assert "is solved for at a step's end, with its condensed tangent" in scene.explain()


def test_scenes_without_history_know_nothing_of_it():
    scene = fm.System()
    body = scene.add(fm.RigidBody(1.0, (0.1, 0.1, 0.1)))
    scene.connect(fm.joint.Free(), scene.ground.frame(), body.frame())
    run = scene.simulate(0.1, integrator=fm.GeneralizedAlpha())
    assert run.scene.interiors is None
    assert run.interior_rows == ()
    assert "history" not in scene.explain()
    with pytest.raises(SceneError, match="no interior in this trajectory"):
        run.energies(body_of(frame()))


def test_the_scheme_is_the_machines():
    """A damped oscillator by the scheme's own formulas, against the machine's fixed steps of it."""
    alpha = fm.GeneralizedAlpha(rho=0.6)
    scheme, h, rate = Scheme(*alpha.coefficients()), 0.05, 3.0
    scene, body, found = fm.System(), body_of(frame()), []
    scene.add(body, name="body")
    slide = scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(), body.frame("a"))
    scene.add_force(fm.force.JointSpring(slide, rate**2, 0.0, 0.4))
    slide.position = 1.0
    run = scene.simulate(2.0, h=h, rtol=1e-12, integrator=alpha)
    x, v = np.ones(1), np.zeros(1)
    a = auxiliary = -(rate**2) * x
    for k in range(40):
        # linear, so that the balance at the end is solved at once
        rule = scheme if k > 0 else scheme.begun_anew()
        per_x, per_v = rule.slopes(h)
        move, speed, _ = rule.end(h, v, a, auxiliary, 0.0 * a)
        end = -(rate**2 * (x + move) + 0.4 * speed) / (1.0 + rate**2 * per_x + 0.4 * per_v)
        move, v, auxiliary = rule.end(h, v, a, auxiliary, end)
        x, a = x + move, end
        found.append(x[0])
    np.testing.assert_allclose(run.beta(slide)[1:], found, atol=1e-11)


@pytest.mark.parametrize("rho", [0.0, 0.6, 1.0])
def test_a_step_that_begins_anew_is_newmarks(rho):
    """With A = a + d (a' - a) the method's own formulas give the trapezoidal rule for velocities."""
    scheme, h = Scheme(*fm.GeneralizedAlpha(rho=rho).coefficients()), 0.1
    v, a, a_end = np.array([2.0, -1.0]), np.array([0.3, 5.0]), np.array([-0.7, 4.0])
    fitting = a + scheme.delay * (a_end - a)
    want = scheme.end(h, v, a, fitting, a_end)
    for here, there in zip(scheme.begun_anew().end(h, v, a, np.full(2, np.nan), a_end), want, strict=True):
        np.testing.assert_allclose(here, there, rtol=1e-14)
    np.testing.assert_allclose(want[1], v + 0.5 * h * (a + a_end), rtol=1e-14)
    step = 1e-3
    per_x, per_v = scheme.begun_anew().slopes(h)
    moved = scheme.begun_anew().end(h, v, a, a, a_end + step)
    assert (moved[0] - want[0])[0] / step == pytest.approx(per_x, rel=1e-9)
    assert (moved[1] - want[1])[0] / step == pytest.approx(per_v, rel=1e-9)
