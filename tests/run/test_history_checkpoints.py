"""Checkpoints of machines with history: a restart, even after the process was killed, goes on to the bit."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from machines import pendulum
from spring_interior import ExplicitSprings, ImplicitSprings, chain
from spring_machines import loop

import flexmbd as fm
from flexmbd.errors import SceneError

FOLDER = Path(__file__).parents[1] / "helpers"
WAYS = [(ExplicitSprings, fm.CentralDifference()), (ImplicitSprings, fm.GeneralizedAlpha())]


def machine(kind):
    return loop(chain(kind, 1, stiffness=2e3, limit=1.0, hardening=200.0), False)


@pytest.mark.parametrize(("kind", "method"), WAYS, ids=["explicit", "implicit"])
@pytest.mark.parametrize("how", [{"h": 2.0**-9}, {"rtol": 1e-4}], ids=["fixed", "controlled"])
def test_a_restart_goes_on_to_the_bit(kind, method, how, tmp_path):
    scene, _, _, body = machine(kind)
    whole = scene.simulate(0.125, integrator=method, checkpoints=[2.0**-5, 2.0**-4], **how)
    stored = whole.checkpoints[0].save(tmp_path / "kept.npz")
    again, _, _, other = machine(kind)
    rest = again.simulate(
        0.125, integrator=method, checkpoints=[2.0**-4], restart=fm.Checkpoint.load(stored), **how
    )
    first = len(whole.t) - len(rest.t)
    assert rest.t[0] == 2.0**-5
    for name in ("t", "x", "v", "a", "multipliers"):
        np.testing.assert_array_equal(getattr(rest, name), getattr(whole, name)[first:])
    for name, there in whole.energies(body).items():
        np.testing.assert_array_equal(rest.energies(other)[name], there[first:])
    assert whole.energies(body)["plastic"][first] > 0.0
    for name, there in body.interior.snapshot().items():
        np.testing.assert_array_equal(other.interior.snapshot()[name], there)


SCRIPT = """
import sys, time
sys.path.insert(0, sys.argv[1])
import flexmbd as fm
from spring_interior import ImplicitSprings, chain
from spring_machines import loop

class Slow(ImplicitSprings):
    def commit(self):
        super().commit()
        time.sleep(0.02)  # so that it is killed half-way

scene, *_ = loop(chain(Slow, 1, stiffness=2e3, limit=1.0, hardening=200.0), False)
scene.simulate(0.25, h=2.0**-9, integrator=fm.GeneralizedAlpha(), checkpoint_file=sys.argv[2], checkpoint_every=0.01)
"""


def test_a_killed_simulation_goes_on_to_the_same_bits(tmp_path):
    file = tmp_path / "run.npz"
    scene, _, _, body = machine(ImplicitSprings)
    how = {"h": 2.0**-9, "integrator": fm.GeneralizedAlpha(), "checkpoint_every": 0.01}
    whole = scene.simulate(0.25, checkpoint_file=tmp_path / "whole.npz", **how)
    process = subprocess.Popen([sys.executable, "-c", SCRIPT, str(FOLDER), str(file)], cwd=tmp_path)
    deadline = time.monotonic() + 120.0
    while process.poll() is None and time.monotonic() < deadline:
        if file.exists() and fm.Checkpoint.load(file).t > 0.05:
            break
        time.sleep(0.01)
    os.kill(process.pid, signal.SIGKILL)
    assert process.wait() == -signal.SIGKILL
    kept = fm.Checkpoint.load(file)
    assert 0.05 < kept.t < 0.24
    again, _, _, other = machine(ImplicitSprings)
    rest = again.simulate(0.25, restart=kept, checkpoint_file=file, **how)
    first = len(whole.t) - len(rest.t)
    for name in ("t", "x", "v", "a", "multipliers"):
        np.testing.assert_array_equal(getattr(rest, name), getattr(whole, name)[first:])
    for name, there in body.interior.snapshot().items():
        np.testing.assert_array_equal(other.interior.snapshot()[name], there)
    assert fm.Checkpoint.load(file).t == fm.Checkpoint.load(tmp_path / "whole.npz").t == 0.24


def test_regular_checkpoints_of_any_machine(tmp_path):
    scene = pendulum()[0]
    file = tmp_path / "run.npz"
    whole = scene.simulate(0.5, checkpoint_file=file, checkpoint_every=0.2, checkpoints=[0.2, 0.3])
    assert [c.t for c in whole.checkpoints] == [0.2, 0.3]
    assert fm.Checkpoint.load(file).t == 0.4
    assert list(tmp_path.iterdir()) == [file]
    with pytest.raises(SceneError, match="go together"):
        scene.simulate(0.5, checkpoint_file=file)
    with pytest.raises(SceneError, match="checkpoint_every = 0"):
        scene.simulate(0.5, checkpoint_file=file, checkpoint_every=0.0)


@pytest.mark.parametrize(("kind", "method"), WAYS, ids=["explicit", "implicit"])
def test_events_go_back_and_on(kind, method):
    """An event is found by repeated steps, which leave no trace."""
    level = 0.985

    def run(**how):
        scene, frames, _, body = machine(kind)
        event = fm.Event(lambda m: m.position(frames[1])[0] - level, name="low", **how)
        return scene.simulate(0.25, h=2.0**-9, integrator=method, events=[event]), frames[1], body

    passing, tip, body = run(direction=fm.Direction.FALLING)
    scene, frames, _, plain_body = machine(kind)
    plain = scene.simulate(0.25, h=2.0**-9, integrator=method)
    t = passing.events[0].t
    assert plain.position(frames[1], t=t)[0, 0] == pytest.approx(level, abs=1e-7)
    # but for the step cut in two at the event the run is the same
    np.testing.assert_allclose(passing.position(tip)[-1], plain.position(frames[1])[-1], atol=1e-5)
    plastic, there = passing.energies(body)["plastic"][-1], plain.energies(plain_body)["plastic"][-1]
    assert there > 0.0
    assert plastic == pytest.approx(there, rel=1e-3)
    stopped, tip, _ = run(direction=fm.Direction.FALLING, stop=True)
    assert stopped.t[-1] == t
    assert stopped.position(tip)[-1, 0] == pytest.approx(level, abs=1e-12)
