"""Equilibria and linear equations with bodies with history: a lattice of springs, and the same of rigid bodies."""

from __future__ import annotations

import numpy as np
import pytest
from spring_interior import ExplicitSprings, ImplicitSprings, as_continuum, as_rigid_bodies, chain

import flexmbd as fm
from flexmbd.errors import SceneError

ALL = fm.InteriorModes(count=1000)
SPIN = 500.0  # rad/s, of what nothing else turns in the twin


def hung(*, twin=False, kind=ImplicitSprings, free=False, **options):
    """A limp lattice on a sprung hinge, or free, with a ball on a hinge at its other end."""
    scene = fm.System(gravity=(0.0, 0.0, 0.0 if free else -9.81))
    interior = chain(kind, stiffness=3e3, **options)
    if twin:
        frames = as_rigid_bodies(scene, interior)
        for body in [body for body in scene._bodies if body.name.startswith("point")]:
            place = body.frame()  # type: ignore[attr-defined]
            stiffness = np.diag([0, 0, 0, *3 * [SPIN**2 * 0.4]])
            turned = fm.force.Bushing(scene.ground.frame(), place, stiffness, np.zeros((6, 6)))
            scene.add_force(turned)
    else:
        _, frames = as_continuum(scene, interior)
    joint = fm.joint.Free() if free else fm.joint.Revolute("y")
    hinge = scene.connect(joint, scene.ground.frame(), frames[0], name="hinge")
    if twin:
        flying = scene.connect(fm.joint.Free(), scene.ground.frame(), frames[1])
        flying.position = [*interior.frames[1].p_BI_B, 1.0, 0.0, 0.0, 0.0]
    ball = scene.add(fm.RigidBody(0.7, (0.01, 0.02, 0.015), (0.1, 0.0, 0.05)), name="ball")
    neck = scene.connect(fm.joint.Revolute("x"), frames[1], ball.frame(), name="neck")
    if not free:
        scene.add_force(fm.force.JointSpring(hinge, 200.0, 0.0, 0.7))
    return scene, hinge, neck, [*frames, ball.frame((0.1, 0.2, 0.0))]


def test_a_sagging_lattice_is_its_twin_of_rigid_bodies():
    """Equilibrium, eigenvalues and responses; it hangs down by most of its length."""
    found = []
    for twin in (False, True):
        scene, hinge, _, frames = hung(twin=twin)
        eq = scene.equilibrium(stable=True)
        push = fm.force.FrameForce(frames[1], (1.0, 2.0, 0.5), (0.0, 0.3, 0.1))
        seen = [fm.output.Position(frames[2]), fm.output.Acceleration(frames[1]), fm.output.Rotation(frames[0])]
        lin = scene.linearize(
            about=eq, inputs=[fm.force.JointTorque(hinge, 1.0), push], outputs=seen, modes=ALL
        )
        values = lin.eigenvalues()
        values = values[abs(abs(values) - SPIN) > 1e-6 * SPIN]
        response = lin.frequency_response([1.0, 5.0, 40.0])
        found.append(([eq.position(frame) for frame in frames], values, response))
    (places, values, response), (twins, expected, other) = found
    assert places[1][2] < -0.5
    assert np.array(places) == pytest.approx(np.array(twins), abs=1e-9)
    assert len(values) == len(expected) == 2 * (9 * 3 + 6 + 2)
    key, twin_key = (np.lexsort((part.real, part.imag)) for part in (values, expected))
    assert abs(values[key] - expected[twin_key]).max() < 1e-9 * abs(expected).max()
    assert abs(response - other).max(axis=0) == pytest.approx(0.0, abs=1e-8 * abs(other).max())


def test_a_free_lattice_has_six_rigid_motions():
    """Undeformed and at rest: about the start, no equilibrium sought."""
    scene, *_ = hung(free=True)
    values = scene.linearize(modes=ALL).eigenvalues()
    assert (abs(values) < 1e-5 * abs(values).max()).sum() == 2 * 7


def test_fewer_modes_answer_slow_motions_alike():
    """Statically exact whatever their number; each vibration from above."""
    scene, _, _, frames = hung()
    eq = scene.equilibrium(stable=True)
    seen, push = [fm.output.Position(frames[2])], fm.force.FrameForce(frames[2], (1.0, 2.0, 0.5))
    ask = {"about": eq, "inputs": [push], "outputs": seen}
    whole = scene.linearize(**ask, modes=ALL)
    lowest = []
    for count in (0, 4, 12):
        lin = scene.linearize(**ask, modes=fm.InteriorModes(count))
        assert lin.coordinates[-count:] == tuple(f"lattice.q[{k}]" for k in range(count)) or count == 0
        response = lin.frequency_response(0.0)
        assert response == pytest.approx(whole.frequency_response(0.0), rel=1e-9)
        lowest.append(lin.frequencies()[:3] / whole.frequencies()[:3] - 1.0)
    assert (np.diff(lowest, axis=0) <= 1e-12).all()
    assert 0.03 * lowest[0].max() > lowest[2].max() >= -1e-12
    cut = scene.linearize(**ask, modes=fm.InteriorModes(below_hz=10.0))
    assert 0 < len(cut.coordinates) - 8 < 20


def test_it_stays_where_it_has_settled():
    scene, *_, frames = hung()
    eq = scene.equilibrium(stable=True)
    before = scene.linearize(about=eq).frequencies()
    # what the body has done since does not matter
    scene.start()
    run = scene.simulate(0.3, h=0.01, about=eq, integrator=fm.GeneralizedAlpha())
    for frame in frames:
        assert run.position(frame)[0] == pytest.approx(eq.position(frame), abs=1e-12)
        assert np.ptp(run.position(frame), axis=0).max() < 1e-9
    scene.start()
    assert scene.linearize(about=eq).frequencies() == pytest.approx(before, rel=1e-12)


def test_let_go_from_where_a_force_held_it():
    """The start's accelerations are those of the twin, whose bodies have places of their own."""
    rates = []
    for twin in (False, True):
        scene, _, _, frames = hung(twin=twin)
        scene.add_force(fm.force.FrameForce(frames[2], (0.0, 0.0, lambda t: 20.0 if t < 1.0 else 0.0)))
        eq = scene.equilibrium(stable=True)
        run = scene.simulate(2.0 + 1e-3, t_start=2.0, h=1e-3, about=eq, integrator=fm.GeneralizedAlpha())
        rates.append([run.acceleration(frame)[0] for frame in frames])
    assert np.abs(rates[1]).max() > 1.0
    assert np.array(rates[0]) == pytest.approx(np.array(rates[1]), rel=1e-6, abs=1e-6)


def test_a_yielded_lattice_swings_by_its_elastic_stiffness():
    """It hangs lower for good; small vibrations are those of one that stands in the same shape and never yields."""
    scene, *_, frames = hung(limit=60.0, hardening=2e3)
    eq = scene.equilibrium(stable=True)
    assert scene._continua[0].interior.energies()["plastic"] > 1e-3
    yielded = scene.linearize(about=eq, modes=ALL)
    run = scene.simulate(1e-3, h=1e-4, about=eq, integrator=fm.GeneralizedAlpha())
    assert np.ptp(run.position(frames[1]), axis=0).max() < 1e-9
    interior = scene._continua[0].interior
    interior.limit = np.inf
    never = scene.linearize(about=eq, modes=ALL)
    assert yielded.frequencies() == pytest.approx(never.frequencies(), rel=1e-9)


def refusal(call):
    with pytest.raises(SceneError) as caught:
        call()
    return str(caught.value)


def test_what_is_refused():
    scene, *_ = hung(kind=ExplicitSprings)
    assert "'lattice': its interior, ExplicitSprings, only steps forward" in refusal(scene.equilibrium)
    assert "'lattice': its interior, ExplicitSprings, only steps forward" in refusal(scene.linearize)
    scene, hinge, *_ = hung()
    # where it starts it is not in balance: at a node between the frames, not only at a joint
    assert "is not balanced" in refusal(scene.linearize)
    hinge.velocity = 1.0
    assert "'lattice' turns" in refusal(scene.equilibrium)
    scene, *_ = hung()
    run = scene.simulate(0.01, h=0.01, integrator=fm.GeneralizedAlpha())
    assert "trajectory does not hold" in refusal(lambda: scene.linearize(about=run))
