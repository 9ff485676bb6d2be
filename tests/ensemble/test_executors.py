"""Ensembles on workers in other processes and programs: the study sent once to each, lost workers told, dask."""

from __future__ import annotations

import os
import pickle
import sys
import time
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from multiprocessing import get_context

import dask
import numpy as np
import pytest
from distributed import Client, LocalCluster
from varied_machine import double_pendulum, samples

import flexmbd as fm
from flexmbd.errors import EnsembleError

HOW = {"t_end": 0.3, "integrator": fm.ExplicitRungeKutta()}
BALLAST = 4_000_000  # bytes, as of a large record


class Counting(Executor):
    """Another executor, of whose tasks the bytes are counted, as they go to a worker."""

    def __init__(self, pool: Executor) -> None:
        self.pool, self.sizes = pool, list[int]()

    def submit(self, fn, /, *args, **kwargs) -> Future:
        self.sizes.append(len(pickle.dumps((fn, args, kwargs))))
        return self.pool.submit(fn, *args, **kwargs)


def heavy_study(pool, count, **options):
    """An ensemble whose outputs refer to an array of BALLAST bytes."""
    machine, outputs = double_pendulum()
    ballast = np.random.default_rng(1).integers(0, 255, BALLAST, np.uint8)
    angle = outputs["angle"]
    outputs["heavy"] = lambda run: angle(run) + ballast[-1]
    return machine.ensemble(samples(count), outputs, executor=pool, **HOW, **options)


@pytest.fixture(scope="module")
def alone():
    """By threads of this process."""
    machine, outputs = double_pendulum()
    with machine.ensemble(samples(), outputs, workers=1, **HOW) as found:
        return {name: found.output(name) for name in outputs}


@pytest.fixture(scope="module")
def cluster():
    """Two processes with two threads each, of which one that dies takes its task with it."""
    settings = {"distributed.scheduler.allowed-failures": 0, "distributed.admin.tick.limit": "1h"}
    with (
        dask.config.set(settings),
        LocalCluster(n_workers=2, threads_per_worker=2, dashboard_address=None, silence_logs=50) as found,
        Client(found) as client,
    ):
        yield client


def test_each_worker_gets_the_study_once():
    """Of a great many tasks only some are large: as many as workers, and one more for each that was not met by one."""
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        counting = Counting(pool)
        heavy_study(counting, 150, workers=2).close()
        first = np.array(counting.sizes)
        assert len(first) > 20
        assert 2 <= (first > BALLAST).sum() <= 4
        assert first[first < BALLAST].max() < 20_000


def test_workers_that_do_not_know_the_study_get_it(alone):
    """Told of one worker where there are six: each of them gives its first task back or gets one with the study."""
    with ThreadPoolExecutor(6) as threads:
        machine, outputs = double_pendulum()
        pool = Forgetting(threads)
        with machine.ensemble(samples(), outputs, executor=pool, workers=1, **HOW) as found:
            for name, values in alone.items():
                np.testing.assert_array_equal(found.output(name), values)
    assert pool.forgotten > 10


class Forgetting(Executor):
    """Workers that come and go: before each third task nobody knows any study."""

    def __init__(self, pool: Executor) -> None:
        self.pool, self.forgotten, self._count = pool, 0, 0

    def submit(self, fn, /, *args, **kwargs) -> Future:
        self._count += 1
        if self._count % 3 == 0:
            self.forgotten += 1
            self.pool.submit(_forget).result()
        return self.pool.submit(fn, *args, **kwargs)


def _forget():
    from flexmbd.ensemble import variants

    with variants._meeting:
        variants._met.clear()


def at_once(nap):
    """An output that takes so long (s): how many variants are at it at a time in their process."""

    def output(run):
        inside = sys.__dict__.setdefault("_at_once", [])  # of the worker's process
        inside.append(1)
        time.sleep(nap)
        return len(inside), inside.pop()

    return output


def test_all_workers_of_an_executor_get_work():
    """Six at once, of an executor that says nothing of their number, on a computer of one processor."""
    machine, _ = double_pendulum()
    given = {"rate": np.linspace(1.0, 2.0, 60)}
    with ThreadPoolExecutor(6) as threads, pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, "cpu_count", lambda: 1)
        with machine.ensemble(given, {"most": at_once(0.05)}, executor=Counting(threads), **HOW) as found:
            assert found.output("most").max() == 6


def test_dask_workers(cluster, alone, tmp_path):
    machine, outputs = double_pendulum()
    counting = Counting(cluster.get_executor())
    with machine.ensemble(samples(), outputs, executor=counting, file=tmp_path / "study.h5", **HOW) as found:
        for name, values in alone.items():
            np.testing.assert_array_equal(found.output(name), values)
        assert len(found.failures) == 9


def test_threads_of_a_dask_worker_take_turns(cluster):
    """They share a copy of the machine, and with it what its Python function leaves there."""
    scene = fm.System()
    wheel = scene.add(fm.RigidBody(1.0, (1.0, 1.0, 2.0)), name="wheel")
    hinge = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), wheel.frame())
    hinge.velocity = 0.0
    scene.add_force(fm.force.JointLaw(hinge, lambda t, beta, rate: 0.0))
    machine = scene.compile(parameters={"w": fm.parameter.InitialVelocity(hinge)})

    given, pool = {"w": np.linspace(0.1, 1.0, 40)}, cluster.get_executor()
    with machine.ensemble(given, {"most": at_once(0.02)}, t_end=0.1, executor=pool) as found:
        np.testing.assert_array_equal(found.output("most"), np.ones((40, 2)))


def deadly(machine, worst):
    """An output that ends its process at one variant, and takes long enough for a task to be one variant."""
    here, hinge = os.getpid(), machine.connections[1]

    def output(run):
        if abs(run.beta_rate(hinge)[0] - worst) < 1e-9 and os.getpid() != here:
            os._exit(3)
        time.sleep(0.1)
        return 1.0

    return output


def test_a_lost_dask_worker_is_told_with_its_variant(cluster, tmp_path):
    """And the same call goes on where it stopped, by those that are left."""
    machine, _ = double_pendulum()
    given = {"rate": np.linspace(1.0, 2.0, 11)}
    file = tmp_path / "study.h5"
    outputs = {"one": deadly(machine, 1.6)}
    with pytest.raises(EnsembleError, match=r"KilledWorker.* at .*variants? .*6") as told:
        machine.ensemble(given, outputs, executor=cluster.get_executor(), file=file, **HOW)
    assert 6 in told.value.variants  # beside what the worker's other thread was at, and what waited there
    assert len(told.value.variants) < 8
    with machine.ensemble(given, outputs, file=file, **HOW) as found:
        assert found.done.all()


def test_a_lost_process_is_told_with_its_variant():
    machine, _ = double_pendulum()
    given = {"rate": np.linspace(1.0, 2.0, 11)}
    pool = ProcessPoolExecutor(1, mp_context=get_context("spawn"))
    with pool, pytest.raises(EnsembleError, match=r"died .* at variant 6 \(rate = 1\.6\); with file") as told:
        machine.ensemble(given, {"one": deadly(machine, 1.6)}, executor=pool, workers=1, **HOW)
    assert told.value.variants == (6,)
    pool = ProcessPoolExecutor(2, mp_context=get_context("spawn"))
    with pool, pytest.raises(EnsembleError, match=r"died .* at ") as told:
        machine.ensemble(given, {"one": deadly(machine, 1.6)}, executor=pool, workers=2, **HOW)
    assert 6 in told.value.variants
    assert len(told.value.variants) <= 2


def test_an_executor_that_was_shut_down_is_told():
    machine, outputs = double_pendulum()
    pool = ThreadPoolExecutor(1)
    pool.shutdown()
    with pytest.raises(EnsembleError, match=r"takes no tasks .*shutdown"):
        machine.ensemble(samples(6), outputs, executor=pool, **HOW)


def test_an_executor_that_is_shut_down_meanwhile_is_told():
    """What it had taken comes back, and the rest is missed."""
    machine, _ = double_pendulum()
    given = {"rate": np.linspace(1.0, 2.0, 40)}
    pool = ThreadPoolExecutor(1)
    seen: list[int] = []

    def output(run):
        seen.append(1)
        if len(seen) == 5:
            pool.shutdown(wait=False)
        time.sleep(0.05)
        return 1.0

    with pytest.raises(EnsembleError, match=r"takes no tasks .*shutdown"):
        machine.ensemble(given, {"one": output}, executor=pool, workers=1, **HOW)
