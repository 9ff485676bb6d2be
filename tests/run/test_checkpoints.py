"""Checkpoints: a restart gives the numbers of the run that went on, to the bit."""

from __future__ import annotations

import numpy as np
import pytest
from machines import pendulum, slider_crank
from particles import particle_body

import flexmbd as fm
from flexmbd.errors import RecordError, SceneError

METHODS = [
    fm.GeneralizedAlpha(),
    fm.GeneralizedAlpha(rho=0.5),
    fm.ExplicitRungeKutta(),
    fm.ExplicitRungeKutta(fm.Pair.DORMAND_PRINCE_8),
    fm.RadauIIA(),
    fm.EnergyMomentum(),
    fm.CentralDifference(),
]


def tree():
    return pendulum()[0], 2.0


def loop():
    scene, _, crank = slider_crank()
    crank.velocity = 50.0
    scene.add_force(fm.force.JointTorque(crank, lambda t: 0.3 * np.cos(20.0 * t)))
    return scene, 0.2


def flexible():
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    body = scene.add(fm.FlexibleBody(particle_body(3, modes=4, damping=0.5).record), name="flexible")
    scene.connect(fm.joint.Revolute("y"), scene.ground.frame(), body.frame())
    return scene, 1.0


@pytest.mark.parametrize("method", METHODS, ids=lambda method: method.name)
@pytest.mark.parametrize("machine", [tree, loop, flexible])
@pytest.mark.parametrize("fixed", [False, True])
def test_a_restart_goes_on_to_the_bit(machine, method, fixed, tmp_path):
    scene, end = machine()
    # with steps of a power of two no step is cut at the checkpoints, so old factors would fit
    h = 2.0 ** np.floor(np.log2(end / 200))
    how = {"h": h} if fixed else {"rtol": 1e-6}
    places = [64 * h, 128 * h]
    whole = scene.simulate(end, integrator=method, checkpoints=places, **how)
    assert [c.t for c in whole.checkpoints] == places
    stored = whole.checkpoints[0].save(tmp_path / "kept.npz")
    again, _ = machine()
    rest = again.simulate(
        end, integrator=method, restart=fm.Checkpoint.load(stored), checkpoints=places[1:], **how
    )
    first = len(whole.t) - len(rest.t)
    assert rest.t[0] == places[0]
    assert first > 5
    assert rest.stats.steps == whole.stats.steps
    for name in ("t", "x", "v", "a", "multipliers"):
        np.testing.assert_array_equal(getattr(rest, name), getattr(whole, name)[first:])


@pytest.mark.parametrize("method", [fm.ExplicitRungeKutta(), fm.RadauIIA()], ids=lambda method: method.name)
def test_a_run_may_keep_a_checkpoint_of_its_end(method):
    """What goes on from there has the numbers of the run that did not stop: fixed steps, to the bit."""
    scene, _ = tree()
    whole = scene.simulate(1.0, h=2.0**-7, integrator=method, checkpoints=[0.5])
    first = scene.simulate(0.5, h=2.0**-7, integrator=method, checkpoints=[0.5])
    (kept,) = first.checkpoints
    assert kept.t == first.t[-1] == 0.5
    rest = scene.simulate(1.0, h=2.0**-7, integrator=method, restart=kept)
    np.testing.assert_array_equal(rest.x, whole.x[len(first.t) - 1 :])


def test_steps_after_a_restart_are_bounded_by_the_time_that_is_simulated_now():
    """Not by that of the run before it, whose steps were a tenth of its time at most."""
    scene = fm.System()
    body = scene.add(fm.RigidBody(1.0, (1.0, 1.0, 1.0)), name="body")
    scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(), body.frame()).velocity = 1.0
    (kept,) = scene.simulate(1e-3, checkpoints=[1e-3]).checkpoints
    rest = scene.simulate(100.0, restart=kept)
    assert rest.t[-1] == 100.0
    assert rest.stats.steps < 100
    assert rest.position(body.frame())[-1, 0] == pytest.approx(100.0, rel=1e-12)


def test_a_checkpoint_belongs_to_its_scene_and_method(tmp_path):
    scene, _ = tree()
    kept = scene.simulate(1.0, checkpoints=[0.5]).checkpoints[0]
    with pytest.raises(SceneError, match="give the same integrator"):
        scene.simulate(1.0, restart=kept, integrator=fm.GeneralizedAlpha(rho=0.1))
    with pytest.raises(SceneError, match="another scene"):
        pendulum(1.1)[0].simulate(1.0, restart=kept)
    with pytest.raises(SceneError, match=r"t_end = 0\.4 s must lie after the start, 0\.5"):
        scene.simulate(0.4, restart=kept)
    with pytest.raises(SceneError, match="checkpoints at 2 s lie outside"):
        scene.simulate(1.0, checkpoints=[2.0])
    with pytest.raises(RecordError, match="not a checkpoint that can be read"):
        fm.Checkpoint.load(tmp_path / "missing.npz")
    (tmp_path / "other.npz").write_bytes(b"something else")
    with pytest.raises(RecordError, match="not a checkpoint that can be read"):
        fm.Checkpoint.load(tmp_path / "other.npz")


def changed(path, target, change):
    """A copy of a checkpoint's file with other arrays."""
    with np.load(path) as file:
        arrays = dict(file)
    change(arrays)
    np.savez(target, **arrays)
    return target


@pytest.mark.parametrize(
    ("change", "what"),
    [
        (lambda file: file.update(version=7), r"format 7, this one reads \d+"),
        (lambda file: file.pop("groups.softest"), r"groups\.softest of the state"),
        (lambda file: file.update({"state.angle": np.zeros(3)}), r"state\.angle of the state"),
        (lambda file: file.update({"state.counts": file["state.counts"][:-1]}), r"state\.counts of the state"),
        (lambda file: file.pop("method.noise.count"), r"remembers other arrays \(noise\.count\)"),
        (lambda file: file.update({"method.trend": np.zeros(1)}), r"remembers other arrays \(trend\)"),
    ],
)
def test_what_other_versions_wrote_is_refused_as_such(change, what, tmp_path):
    scene, _ = tree()
    how = {"integrator": fm.ExplicitRungeKutta(), "rtol": 1e-6}
    kept = scene.simulate(1.0, checkpoints=[0.5], **how).checkpoints[0].save(tmp_path / "kept.npz")
    other = changed(kept, tmp_path / "other.npz", change)
    with pytest.raises(RecordError, match=rf"written by another version of flexmbd.*{what}.*start anew"):
        scene.simulate(1.0, restart=fm.Checkpoint.load(other), **how)
    scene.simulate(1.0, restart=fm.Checkpoint.load(changed(kept, tmp_path / "same.npz", lambda file: None)), **how)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"t_end": -1.0}, "must lie after the start"),
        ({"t_end": np.nan}, "must lie after the start"),
        ({"t_end": 1.0, "h": 0.0}, "h = 0.0 s must be positive"),
        ({"t_end": 1.0, "h": -1e-3}, "must be positive"),
        ({"t_end": 1.0, "h": np.inf}, "must be positive and finite"),
        ({"t_end": 1.0, "rtol": 0.0}, "rtol = 0.0 must lie between"),
        ({"t_end": 1.0, "rtol": -1e-6}, "must lie between"),
        ({"t_end": 1.0, "rtol": np.nan}, "must lie between"),
    ],
)
def test_arguments_that_make_no_simulation(arguments, message):
    with pytest.raises(SceneError, match=message):
        tree()[0].simulate(**arguments)
