"""Runs that go to a file while they run: read to the bit, by others, after a kill, and gone on with by a restart."""

import os
import resource
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from machines import slider_crank
from spring_interior import ImplicitSprings, as_continuum, chain

import flexmbd as fm
from flexmbd.errors import RecordError, SceneError
from flexmbd.files import memory
from flexmbd.run import row_store, run_stream
from flexmbd.run.stopped import SimulationError

_ROWS = ("t", "x", "v", "a", "row_multipliers")


def pulse(t):
    return 3.0 if t < 0.02 else 0.0


def machine():
    """A loop with a torque that jumps, and what tells that the crank has come by; its redundant rows are left out."""
    scene, _, crank = slider_crank()
    crank.velocity = 50.0
    scene.add_force(fm.force.JointTorque(crank, fm.Piecewise(pulse, [0.02])))
    return scene, fm.Event(lambda now: now.beta(crank) - 1.0, name="passed")


def same(one, other, *, rows=slice(None)):
    for name in _ROWS:
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name)[rows])


def told(events):
    return [(one.name, one.t, one.row) for one in events]


@pytest.fixture(autouse=True)
def many_blocks(monkeypatch):
    """A block for each call of the stepper."""
    monkeypatch.setattr(run_stream, "_EVERY", 0.0)


@pytest.mark.parametrize("with_event", [False, True])
def test_a_stream_is_what_save_writes_to_the_bit(with_event, tmp_path):
    scene, event = machine()
    events = [event] if with_event else []
    run = scene.simulate(0.1, integrator=fm.RadauIIA(), events=events, stream=tmp_path / "run.h5")
    back = fm.Trajectory.load(tmp_path / "run.h5", scene)
    same(back, run)
    assert run.departures
    assert bool(run.events) == with_event
    assert told(back.events) == told(run.events)
    assert (back.stats, back.kept_rows, len(back.departures)) == (run.stats, run.kept_rows, len(run.departures))
    assert back.save(tmp_path / "back.h5").read_bytes() == run.save(tmp_path / "run_2.h5").read_bytes()
    assert len(list(tmp_path.iterdir())) == 3  # and no parts


def test_bodies_with_history_are_in_it(tmp_path):
    def scene():
        made = fm.System(gravity=(0.0, -9.81, 0.0))
        _, frames = as_continuum(made, chain(ImplicitSprings, stiffness=500.0))
        made.connect(fm.joint.Revolute("z"), made.ground.frame(), frames[0])
        return made

    run = scene().simulate(0.02, integrator=fm.GeneralizedAlpha(), stream=tmp_path / "run.h5")
    back = fm.Trajectory.load(tmp_path / "run.h5", scene())
    same(back, run)
    body, again = (one.scene.interiors.bodies[0] for one in (run, back))
    for name, energy in run.energies(body).items():
        np.testing.assert_array_equal(back.energies(again)[name], energy)


def test_a_restart_goes_on_with_the_stream(tmp_path):
    """Of a run that was broken off behind the checkpoint: the file is that of one that never stopped."""
    scene, event = machine()
    whole = scene.simulate(0.1, integrator=fm.RadauIIA(), events=[event], checkpoints=[0.02, 0.05])
    path = tmp_path / "run.h5"
    with pytest.raises(SimulationError, match="max_rows") as stopped:
        scene.simulate(0.1, integrator=fm.RadauIIA(), events=[event], checkpoints=[0.02, 0.05], stream=path,
                       max_rows=len(whole.t) - 5)  # fmt: skip
    broken = stopped.value.trajectory
    same(fm.Trajectory.load(path, scene), broken)
    for checkpoint in broken.checkpoints:  # at a break, and between events
        rest = scene.simulate(0.1, integrator=fm.RadauIIA(), events=[event], restart=checkpoint, stream=path,
                              checkpoints=[t for t in (0.05,) if t > checkpoint.t])  # fmt: skip
        back = fm.Trajectory.load(path, scene)
        same(back, whole)
        same(rest, whole, rows=slice(len(whole.t) - len(rest.t), None))
        assert told(back.events) == told(whole.events)
        for one, other in zip(back.departures, whole.departures, strict=True):
            assert one.row == other.row
            np.testing.assert_array_equal(one.v, other.v)
    other, _ = machine()
    other.gravity = (0.0, 0.0, -1.0)
    late = other.simulate(0.2, integrator=fm.RadauIIA(), checkpoints=[0.15]).checkpoints[0]
    with pytest.raises(RecordError, match=r"of another machine"):
        other.simulate(0.2, integrator=fm.RadauIIA(), restart=late, stream=path)
    late = scene.simulate(0.2, integrator=fm.RadauIIA(), checkpoints=[0.15]).checkpoints[0]
    with pytest.raises(RecordError, match=r"holds no step at t = 0\.15 s"):
        scene.simulate(0.2, integrator=fm.RadauIIA(), restart=late, stream=path)


_FOR_EVER = """
import sys
sys.path.insert(0, {helpers!r})
sys.path.insert(0, {here!r})
import test_streams
from flexmbd.run import run_stream
import flexmbd as fm
run_stream._EVERY = 0.05
scene, event = test_streams.machine()
scene.simulate(1e9, h=1e-4, integrator=fm.RadauIIA(), stream={path!r})
"""


def test_a_killed_run_leaves_what_it_did_and_can_be_followed(tmp_path):
    """Another process reads it as it grows; after kill -9 it is a sound file, and its writer's lock is gone."""
    scene, _ = machine()
    path, here = tmp_path / "run.h5", os.path.dirname(__file__)
    code = _FOR_EVER.format(helpers=os.path.join(here, "..", "helpers"), here=here, path=str(path))
    process = subprocess.Popen([sys.executable, "-c", code])
    try:
        lengths: list[int] = []
        deadline = time.monotonic() + 120.0
        while len(set(lengths)) < 4 and time.monotonic() < deadline:
            time.sleep(0.1)
            if path.exists():
                try:
                    lengths.append(len(fm.Trajectory.load(path, scene).t))
                except RecordError as error:
                    if "holds no rows yet" not in str(error):  # between its first two blocks
                        raise
        assert len(set(lengths)) >= 4
        assert lengths == sorted(lengths)
    finally:
        process.send_signal(signal.SIGKILL)
        process.wait()
    with open(path, "ab") as file:  # as far as the next block got
        file.write(path.read_bytes()[:1000])
    left = fm.Trajectory.load(path, scene)
    assert len(left.t) >= lengths[-1]
    longer = scene.simulate(left.t[-1] + 1e-3, h=1e-4, integrator=fm.RadauIIA())
    same(left, longer, rows=slice(len(left.t)))
    assert np.isnan(left.stats.constraint_residual)


def test_a_damaged_block_is_told(tmp_path):
    scene, _ = machine()
    path = tmp_path / "run.h5"
    scene.simulate(0.05, integrator=fm.RadauIIA(), stream=path)
    sound = path.read_bytes()
    random = np.random.default_rng(0)
    for at in random.integers(len(sound), size=200):
        path.write_bytes(sound[:at] + bytes([sound[at] ^ 1]) + sound[at + 1 :])
        try:
            fm.Trajectory.load(path, scene)
        except RecordError:
            continue
        assert sound[at - 1 : at + 1].strip(b"\0") == b"", at  # of the zeros behind a head
    for size in range(0, len(sound), 997):
        path.write_bytes(sound[:size])
        try:
            assert 0 < len(fm.Trajectory.load(path, scene).t)
        except RecordError:
            assert size < 40_000


def test_rows_without_room_in_memory_go_to_the_disk(tmp_path, monkeypatch):
    scene, event = machine()
    run = scene.simulate(0.1, integrator=fm.RadauIIA(), events=[event], stream=tmp_path / "run.h5")
    monkeypatch.setattr(row_store, "_SMALL", 1)
    monkeypatch.setattr(row_store, "available_memory", lambda: 4_000)
    spilled = scene.simulate(0.1, integrator=fm.RadauIIA(), events=[event], stream=tmp_path / "spilled.h5")
    same(spilled, run)
    assert spilled.x.base is not None  # mapped
    back = fm.Trajectory.load(tmp_path / "spilled.h5", scene)
    same(back, run)
    assert told(back.events) == told(run.events)
    np.testing.assert_array_equal(spilled.energy().total, run.energy().total)
    assert memory.available_memory() != 4_000

    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (800, limits[1]))  # as a disk that is full
    try:
        with pytest.raises(SimulationError, match="no room in memory, nor on the disk") as stopped:
            scene.simulate(0.1, integrator=fm.RadauIIA(), events=[event])
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    got = stopped.value.trajectory
    assert len(got.t) > 10
    same(got, run, rows=slice(len(got.t)))


def test_places_that_cannot_be_written(tmp_path):
    scene, _ = machine()
    with pytest.raises(RecordError, match=r"cannot write .*nowhere"):
        scene.simulate(0.01, stream=tmp_path / "nowhere" / "run.h5")
    with pytest.raises(RecordError, match="not a regular file"):
        scene.simulate(0.01, stream=tmp_path)
    with pytest.raises(SceneError, match="stream"):
        scene.simulate(0.01, stream=3)
    scene.simulate(0.01, integrator=fm.RadauIIA(), stream=tmp_path / "run.h5")
    first = scene.simulate(0.02, integrator=fm.RadauIIA(), checkpoints=[0.01]).checkpoints[0]
    scene.simulate(0.005, integrator=fm.RadauIIA()).save(tmp_path / "saved.h5")
    with pytest.raises(RecordError, match="is not a flexmbd run"):
        scene.simulate(0.02, integrator=fm.RadauIIA(), restart=first, stream=tmp_path / "saved.h5")
    with open(tmp_path / "run.h5", "rb") as file:  # as another run that writes
        import fcntl

        fcntl.flock(file, fcntl.LOCK_EX)
        with pytest.raises(RecordError, match="being written by another run"):
            scene.simulate(0.02, integrator=fm.RadauIIA(), restart=first, stream=tmp_path / "run.h5")


def test_what_controllers_did_is_in_it(tmp_path):
    def cart():
        scene = fm.System()
        body = scene.add(fm.RigidBody(mass=2.0, inertia=(1.0, 1.0, 1.0)), name="cart")
        slide = scene.connect(fm.joint.Prismatic(axis="x"), scene.ground.frame(), body.frame(), name="slide")
        slide.position, push = 1.0, fm.Signal("push")
        scene.add_force(fm.force.JointForce(slide, push))
        law = scene.add_controller(
            lambda t, y, sum_: ([-30.0 * y[0] - 5.0 * sum_[0]], [sum_[0] + 0.01 * y[0]]), period=0.01, inputs=[push],
            measurements=[fm.output.Position(slide)], state=[0.0],
        )  # fmt: skip
        return scene, law, slide

    path = tmp_path / "run.h5"
    scene, law, slide = cart()
    whole = scene.simulate(1.0, integrator=fm.RadauIIA(), stream=path, checkpoints=[0.5])
    for restart in (None, whole.checkpoints[0]):
        if restart is not None:
            scene.simulate(1.0, integrator=fm.RadauIIA(), stream=path, restart=restart)
        back = fm.Trajectory.load(path, scene)
        same(back, whole)
        for name in ("t", "measurements", "inputs", "states", "before"):
            np.testing.assert_array_equal(getattr(back.sampled(law), name), getattr(whole.sampled(law), name))
        np.testing.assert_array_equal(back.drive(slide), whole.drive(slide))
