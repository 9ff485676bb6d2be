"""Bodies with history against the same machine of rigid bodies and springs; who may step them."""

from __future__ import annotations

import numpy as np
import pytest
from spring_interior import ExplicitSprings, ImplicitSprings, as_continuum, chain
from spring_machines import cantilever, loop, pendulum

import flexmbd as fm
from flexmbd.errors import SceneError
from flexmbd.multibody.bodies.continuum_body import InteriorFrame

EXPLICIT, IMPLICIT = fm.CentralDifference(corrected=False), fm.GeneralizedAlpha()
BOTH = [(ExplicitSprings, EXPLICIT), (ImplicitSprings, IMPLICIT)]


@pytest.mark.parametrize(("kind", "method"), BOTH, ids=["explicit", "implicit"])
@pytest.mark.parametrize("machine", [pendulum, cantilever, loop])
def test_the_same_motion_as_of_rigid_bodies_and_springs(machine, kind, method):
    """Positions, attitudes, velocities of all frames and a joint's reaction, to round-off."""
    found = []
    for twin in (False, True):
        scene, frames, joint, _ = machine(chain(kind, 2, stiffness=2e3), twin)
        if machine is loop and method is IMPLICIT:
            # shifts of index 2, which close loops, move the points of the twin as well, but not those of an interior
            method = fm.GeneralizedAlpha(index=3)
        run = scene.simulate(0.25, h=2.5e-3, rtol=1e-12, integrator=method)
        parts = [part for f in frames for part in (run.position(f), run.rotation(f), run.velocity(f))]
        found.append([*parts, run.reaction(joint)])
        assert (len(run.scene.plan.rows) > 0) == (machine is loop)
    for here, there in zip(*found, strict=True):
        np.testing.assert_allclose(here, there, rtol=1e-9, atol=1e-9 * max(1.0, np.abs(there).max()))
    assert np.ptp(found[0][3], axis=0).max() > 0.02  # the end moved


def test_mass_of_the_interior_at_its_frames_counts_as_that_of_the_frames():
    """What hangs on the frames' accelerations: consistent at the start, and in every step."""
    found = []
    for own in (0.0, 0.4):
        scene = fm.System(gravity=(0.0, 0.0, -9.81))
        interior = chain(ImplicitSprings, 1, stiffness=2e3)
        interior.masses[:6] = own
        if not own:  # the same masses as part of the frames
            groups = [interior.arms[interior.bonds == k] for k in range(2)]
            interior.frames = tuple(with_points(f, arms, 0.4) for f, arms in zip(interior.frames, groups, strict=True))
        _, (a, b) = as_continuum(scene, interior)
        hinge = scene.connect(fm.joint.Revolute("y"), scene.ground.frame(), a)
        hinge.velocity = 3.0
        scene.add_force(fm.force.FrameForce(b, (0.0, 20.0, 100.0)))
        run = scene.simulate(0.1, h=2e-3, rtol=1e-12, integrator=IMPLICIT)
        found.append([run.position(b), run.acceleration(b), run.rotation(b)])
    for here, there in zip(*found, strict=True):
        np.testing.assert_allclose(here, there, atol=1e-8 * max(1.0, np.abs(there).max()))
    assert np.abs(found[0][1][0]).max() > 10.0


def with_points(frame, arms, mass):
    """The frame with point masses at places in its axes."""
    total = frame.mass + mass * len(arms)
    com = (frame.mass * frame.com + mass * arms.sum(axis=0)) / total

    def spread(r):
        return r @ r * np.eye(3) - np.outer(r, r)

    inertia = frame.inertia + frame.mass * spread(frame.com - com) + mass * sum(spread(r - com) for r in arms)
    return InteriorFrame(frame.name, frame.p_BI_B, frame.R_BI, total, com, inertia)


@pytest.mark.parametrize("method", [fm.RadauIIA(), fm.ExplicitRungeKutta(), fm.EnergyMomentum()])
def test_methods_that_would_spoil_the_history_refuse(method):
    scene, *_ = pendulum(chain(ImplicitSprings, 1, stiffness=2e3), False)
    with pytest.raises(SceneError, match=r"bodies with history \('lattice'\).*take fm.GeneralizedAlpha\(\)"):
        scene.simulate(0.1, integrator=method)


def test_each_method_asks_for_its_kind_of_interior():
    scene, *_ = pendulum(chain(ImplicitSprings, 1, stiffness=2e3), False)
    with pytest.raises(SceneError, match=r"'lattice': take fm.GeneralizedAlpha"):
        scene.simulate(0.1, integrator=EXPLICIT)
    assert "whose interiors are solved for" in scene.explain()
    scene, *_ = pendulum(chain(ExplicitSprings, 1, stiffness=2e3), False)
    with pytest.raises(SceneError, match=r"'lattice': take fm.CentralDifference"):
        scene.simulate(0.1, integrator=IMPLICIT)


def test_an_augmented_lagrangian_is_refused():
    scene, (_, b, _), *_ = pendulum(chain(ImplicitSprings, 1, stiffness=2e3), False)
    held = scene.ground.frame(p=(1.0, 1.0, 0.0))
    scene.connect(fm.joint.Distance(1.0), held, b, enforce=fm.AugmentedLagrangian(1e5), name="rod")
    with pytest.raises(SceneError, match=r"an augmented Lagrangian asks \(rod"):
        scene.simulate(0.1, integrator=IMPLICIT)
