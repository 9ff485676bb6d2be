"""Ensembles: the same numbers whoever runs the variants, failures reported, a killed one gone on with."""

from __future__ import annotations

import os
import resource
import shutil
import signal
import subprocess
import sys
import time
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path

import h5py
import numpy as np
import pytest
import varied_machine
from varied_machine import COUNT, NAP, double_pendulum, samples, study

import flexmbd as fm
from flexmbd.errors import EnsembleError, RecordError, SceneError

SCRIPT = varied_machine.__file__
HELPERS = str(Path(SCRIPT).parent)


@pytest.fixture(scope="module")
def one_by_one() -> dict[str, np.ndarray]:
    """The outputs by runs of scenes, one after the other; NaN where they fail."""
    machine, outputs = double_pendulum()
    given = samples()
    found = {"angle": np.full(COUNT, np.nan), "path": np.full((COUNT, 7, 3), np.nan)}
    for k in range(COUNT):
        values = {name: column[k] for name, column in given.items()}
        if values["mass"] > 0.0:
            run = machine.simulate(0.3, integrator=fm.ExplicitRungeKutta(), **values)
            for name, ask in outputs.items():
                found[name][k] = ask(run)
    return found


def refuse_difference(found, expected):
    for name, values in expected.items():
        np.testing.assert_array_equal(found.output(name), values)


@pytest.mark.parametrize("workers", [1, 2, 5])
def test_threads(one_by_one, workers):
    machine, outputs = double_pendulum()
    with machine.ensemble(
        samples(), outputs, t_end=0.3, integrator=fm.ExplicitRungeKutta(), workers=workers
    ) as found:
        refuse_difference(found, one_by_one)


@pytest.mark.filterwarnings("ignore:.*use of fork:DeprecationWarning")
@pytest.mark.parametrize("kind", ["fork", "spawn", "thread"])
def test_executors_of_the_standard_library(one_by_one, kind, tmp_path, monkeypatch):
    monkeypatch.setenv("PYTHONPATH", HELPERS)
    made = ThreadPoolExecutor(3) if kind == "thread" else ProcessPoolExecutor(2, mp_context=get_context(kind))
    with made as pool, study(pool, file=tmp_path / "study.h5") as found:
        refuse_difference(found, one_by_one)


@pytest.mark.skipif(shutil.which("mpirun") is None, reason="mpirun is not installed")
@pytest.mark.skipif("OMPI_COMM_WORLD_SIZE" in os.environ, reason="an MPI program starts no other one")
def test_mpi_workers(one_by_one, tmp_path):
    file = tmp_path / "study.h5"
    command = ["mpirun", "-n", "3", sys.executable, "-m", "mpi4py.futures", SCRIPT, str(file), "mpi"]
    told = subprocess.run(command, capture_output=True, text=True, check=False, timeout=250)
    assert told.stdout.split()[-2:] == [str(int(np.isfinite(one_by_one["angle"]).sum())), "2"], told.stderr
    with h5py.File(file) as kept:
        for name, values in one_by_one.items():
            np.testing.assert_array_equal(kept["outputs"][name][()], values)


def test_failures_are_told_and_the_others_go_on(one_by_one):
    with study() as found:
        failed = np.flatnonzero(samples()["mass"] < 0.0)
        assert [failure.index for failure in found.failures] == list(failed)
        first = found.failures[0]
        assert first.values["mass"] == -1.0
        assert first.values["k"] == samples()["k"][failed[0]]
        assert "mass must be positive" in first.message
        np.testing.assert_array_equal(found.done, np.isfinite(one_by_one["angle"]))


def test_outputs_that_fail_or_change_their_shape():
    machine, outputs = double_pendulum()
    outputs["sign"] = lambda run: 1.0 if run.beta_rate(machine.connections[1])[0] > 0.0 else {}["none"]
    given = {"rate": np.array([1.0, 2.0, -1.0, 3.0])}
    with machine.ensemble(given, {"sign": outputs["sign"]}, t_end=0.1) as found:
        assert [(one.index, one.message) for one in found.failures] == [(2, "output 'sign': KeyError: 'none'")]
    shapes = {"t": lambda run: np.zeros(2 if run.beta_rate(machine.connections[1])[0] > 2.5 else 3)}
    with machine.ensemble(given, shapes, t_end=0.1) as found:
        assert [one.message for one in found.failures] == [
            "output 't' has the shape (2,), that of the first variant (3,)"
        ]


def test_a_killed_ensemble_goes_on(one_by_one, tmp_path):
    """Killed by SIGKILL, workers and all, some rows in; another process runs the others alone."""
    file = tmp_path / "study.h5"
    command = [sys.executable, SCRIPT, str(file)]
    process = subprocess.Popen(command, start_new_session=True, stdout=subprocess.DEVNULL)
    until = time.monotonic() + 200.0
    while states(file) < 5 and process.poll() is None and time.monotonic() < until:
        time.sleep(0.01)
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    before = states(file)
    assert 5 <= before
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=250)
    assert int(done.stdout) == int(np.isfinite(one_by_one["angle"]).sum())
    with study(file=file, nap=NAP) as found:
        refuse_difference(found, one_by_one)


def test_an_interrupted_ensemble_ends_at_once_and_goes_on(one_by_one, tmp_path):
    """Ctrl-C on threads: no further variant begins, what was done is in the file, and the same call does the rest."""
    file = tmp_path / "study.h5"
    command = [sys.executable, SCRIPT, str(file), "threads"]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    until = time.monotonic() + 200.0
    while states(file) < 5 and process.poll() is None and time.monotonic() < until:
        time.sleep(0.01)
    process.send_signal(signal.SIGINT)
    told = process.communicate(timeout=100)[1]
    assert told.rstrip().endswith("KeyboardInterrupt")
    assert 5 <= states(file) < COUNT
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=250)
    assert done.stdout.startswith("<Ensemble of 60 variants, 9 failed: angle (60,), path (60, 7, 3)>")
    with study(file=file, nap=NAP) as found:
        refuse_difference(found, one_by_one)


@pytest.mark.filterwarnings("ignore:.*use of fork:DeprecationWarning")
def test_a_worker_that_dies_is_told(tmp_path):
    machine, _ = double_pendulum()
    here = os.getpid()
    outputs = {"angle": lambda run: 1.0 if os.getpid() == here else os._exit(3)}
    given = {"rate": np.linspace(1.0, 2.0, 8)}
    with ProcessPoolExecutor(1) as pool, pytest.raises(EnsembleError, match="a worker of the executor died"):
        machine.ensemble(given, outputs, t_end=0.1, executor=pool, workers=1, file=tmp_path / "study.h5")
    assert states(tmp_path / "study.h5") == 1


def test_a_full_disk_is_told(tmp_path):
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (4096, hard))
    try:
        with pytest.raises(RecordError, match=r"cannot be written to .*File too large"):
            study(file=tmp_path / "study.h5")
        assert not list(tmp_path.iterdir())
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def states(file):
    """How many rows count."""
    try:
        with h5py.File(file, "r", locking=False) as kept:
            return int((kept["state"][()] > 0).sum())
    except OSError:
        return 0


def test_a_finished_ensemble_runs_nothing(one_by_one, tmp_path):
    file = tmp_path / "study.h5"
    study(file=file).close()

    class Refuses(ThreadPoolExecutor):
        def submit(self, *_, **__):
            raise AssertionError("nothing is left to run")

    with study(Refuses(), file=file) as found:
        refuse_difference(found, one_by_one)


def test_a_file_of_another_ensemble_is_refused(tmp_path, monkeypatch):
    file = tmp_path / "study.h5"
    study(file=file, count=8).close()
    machine, outputs = double_pendulum()
    given = samples(8)
    changed = [
        (samples(9), outputs, {}),
        ({**given, "k": given["k"] + 1.0}, outputs, {}),
        (given, {**outputs, "angle": lambda run: 2.0 * run.x[-1, 0]}, {}),
        (given, {"angle": outputs["angle"]}, {}),
        (given, outputs, {"rtol": 1e-5}),
        (given, outputs, {"integrator": fm.RadauIIA()}),
    ]
    for values, asked, options in changed:
        with pytest.raises(RecordError, match="of another ensemble"):
            machine.ensemble(
                values, asked, t_end=0.3, file=file, **{"integrator": fm.ExplicitRungeKutta(), **options}
            )
    pin = machine.parameters["length"][0]
    other = replace(machine, parameters={**machine.parameters, "length": machine.parameters["mass"], "mass": (pin,)})
    with pytest.raises(RecordError, match="of another ensemble"):  # the same names mean other quantities
        other.ensemble(given, outputs, t_end=0.3, file=file, integrator=fm.ExplicitRungeKutta())
    with monkeypatch.context() as patched:
        patched.setattr("flexmbd.ensemble.stamp.program_stamp", lambda: "0.0.1")
        with pytest.raises(RecordError, match="or of another flexmbd"):
            study(file=file, count=8)
    (tmp_path / "other.h5").write_bytes(b"no HDF5")
    with pytest.raises(RecordError, match="cannot be continued"):
        study(file=tmp_path / "other.h5", count=8)
    with pytest.raises(RecordError, match="cannot be written"):
        study(file=tmp_path / "nowhere" / "study.h5", count=8)


@pytest.mark.parametrize("answer", [None, "1.0", 1j, [None, 1.0]])
def test_outputs_that_are_no_numbers(answer):
    machine, _ = double_pendulum()
    with pytest.raises(SceneError, match="the first: output 'x': an output must be a number or an array of numbers"):
        machine.ensemble({"rate": [1.0, 2.0]}, {"x": lambda run: answer}, t_end=0.1)


def test_compiled_functions_side_by_side():
    """Each variant has a flag of its own: one whose function gives no number fails, and no other."""
    scene = fm.System()
    wheel = scene.add(fm.RigidBody(1.0, (1.0, 1.0, 2.0)), name="wheel")
    hinge = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), wheel.frame())
    hinge.velocity = 0.0

    @fm.compiled
    def law(t, beta, rate):
        return np.nan if beta > 1.0 else -0.1 * rate

    scene.add_force(fm.force.JointLaw(hinge, law))
    machine = scene.compile(parameters={"w": fm.parameter.InitialVelocity(hinge)})
    rates = np.linspace(0.15, 3.95, 39)
    outputs, method = {"end": lambda run: run.beta(hinge)[-1]}, fm.ExplicitRungeKutta()
    with machine.ensemble({"w": rates}, outputs, t_end=0.5, integrator=method, workers=4) as found:
        ends = rates * (1.0 - np.exp(-0.05 * 0.5)) / 0.05
        np.testing.assert_array_equal(found.done, ends < 1.0)
        np.testing.assert_allclose(found.output("end")[found.done], ends[found.done], rtol=1e-6)
        assert all("gave no finite number" in one.message for one in found.failures)


def test_machines_that_call_python_take_turns():
    """Functions of the user's keep their failures with the scene: side by side, one variant's would be another's."""
    scene = fm.System()
    wheel = scene.add(fm.RigidBody(1.0, (1.0, 1.0, 2.0)), name="wheel")
    hinge = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), wheel.frame())
    hinge.velocity = 0.0

    def law(t, beta, rate):
        if beta > 1.0:
            raise ValueError("too far")
        return 0.0

    scene.add_force(fm.force.JointLaw(hinge, law))
    machine = scene.compile(parameters={"w": fm.parameter.InitialVelocity(hinge)})
    rates = np.linspace(0.15, 3.95, 39)
    with machine.ensemble({"w": rates}, {"end": lambda run: run.beta(hinge)[-1]}, t_end=0.5, workers=4) as found:
        np.testing.assert_array_equal(found.done, rates < 2.0)
        np.testing.assert_allclose(found.output("end")[found.done], 0.5 * rates[rates < 2.0], rtol=1e-9)
        assert all("too far" in one.message for one in found.failures)


def test_values_of_other_kinds_by_mappings():
    scene = fm.System()
    wheel = scene.add(fm.RigidBody(1.0, (1.0, 1.0, 2.0)), name="wheel")
    hinge = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), wheel.frame())
    torque = scene.add_force(fm.force.JointTorque(hinge, fm.Sine(1.0, 3.0)))
    machine = scene.compile(parameters={"load": fm.parameter.OfForce(torque, "value")})
    rows = [{"load": fm.Sine(amplitude, 3.0)} for amplitude in (1.0, 2.0, 4.0)]
    with machine.ensemble(rows, {"rate": lambda run: run.beta_rate(hinge)[-1]}, t_end=1.0) as found:
        exact = np.array([1.0, 2.0, 4.0]) / 2.0 / 3.0 * (1.0 - np.cos(3.0))
        np.testing.assert_allclose(found.output("rate"), exact, rtol=1e-5)


@pytest.mark.parametrize(
    ("given", "outputs", "options", "fault"),
    [
        ({"masss": [1.0]}, None, {}, "no parameter 'masss'"),
        ({"mass": [1.0], "k": [1.0, 2.0]}, None, {}, "arrays of one length"),
        ({"mass": 1.0}, None, {}, "an array of finite numbers"),
        ({"mass": [np.nan]}, None, {}, "an array of finite numbers"),
        ({"mass": []}, None, {}, "no variant"),
        ([], None, {}, "no variant"),
        ([{"mass": 1.0}, {"k": 1.0}], None, {}, "sample 1 has other parameters"),
        ([1.0], None, {}, "a list of mappings"),
        (5, None, {}, "a list of mappings"),
        ([("mass", 1.0)], None, {}, "a list of mappings"),
        ("mass", None, {}, "a list of mappings"),
        ([{}, {}], None, {}, "name no parameter"),
        ({}, None, {}, "no variant"),
        ({"mass": (m for m in [1.0])}, None, {}, "an array of finite numbers"),
        ({"mass": ["1.0"]}, None, {}, "an array of finite numbers"),
        ({"mass": [[1.0, 2.0]]}, None, {}, "all 1 variants failed; the first: .*mass must be positive"),
        ({3: [1.0]}, None, {}, "no parameter 3"),
        ({"mass": [-1.0, -2.0]}, None, {}, "all 2 variants failed; the first: .*mass must be positive"),
        ({"mass": [1.0]}, {}, {}, "outputs must be functions"),
        ({"mass": [1.0]}, {"x": 3.0}, {}, "outputs must be functions"),
        ({"mass": [1.0]}, {3: np.sum}, {}, "an output cannot be called 3"),
        ({"mass": [1.0]}, {"a/b": np.sum}, {}, "an output cannot be called 'a/b'"),
        ({"mass": [1.0]}, {"": np.sum}, {}, "an output cannot be called ''"),
        ({"mass": [1.0]}, None, {"file": 3}, "file must be a path"),
        ({"mass": [1.0]}, None, {"workers": 0}, "workers must be a positive number"),
        ({"mass": [1.0]}, None, {"executor": 3}, "executor must be"),
        ({"mass": [1.0]}, None, {"t_end": -1.0}, "t_end"),
        ({"mass": [1.0]}, None, {"integrator": "rk"}, "integrator must be"),
    ],
)
def test_wrong_arguments(given, outputs, options, fault):
    machine, asked = double_pendulum()
    with pytest.raises(SceneError, match=fault):
        machine.ensemble(given, asked if outputs is None else outputs, **{"t_end": 0.1, **options})


def test_a_closed_ensemble_says_so():
    machine, outputs = double_pendulum()
    found = machine.ensemble({"rate": [1.0]}, {"angle": outputs["angle"]}, t_end=0.1)
    found.close()
    for ask in (lambda: found.output("angle"), lambda: found.failures):
        with pytest.raises(SceneError, match="the ensemble is closed"):
            ask()


def test_what_cannot_be_sent_is_refused():
    machine, outputs = double_pendulum()
    lock = __import__("threading").Lock()
    outputs["locked"] = lambda run: float(lock.locked())
    with ProcessPoolExecutor(1) as pool, pytest.raises(SceneError, match="cannot be sent to another process"):
        machine.ensemble(samples(6), outputs, t_end=0.3, executor=pool, workers=1)
