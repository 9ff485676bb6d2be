"""Outputs sampled without trajectories: to the bit what trajectories give, variant by variant, whoever runs them."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import varied_machine
from particles import particle_body

import flexmbd as fm
from flexmbd import parameter as vary
from flexmbd.ensemble import Ensemble, Sampled
from flexmbd.errors import RecordError, SceneError
from flexmbd.multibody.parameter.value_columns import tabled_names, value_columns
from flexmbd.output import Acceleration, Position, Velocity
from flexmbd.run import simulation
from flexmbd.run.prepared import PreparedRuns

TIMES = np.linspace(0.0, 0.3, 7)
RK = fm.ExplicitRungeKutta()
Asked = dict[str, tuple[Sampled, Callable[[fm.Trajectory], Any]]]


def pendulum() -> tuple[fm.CompiledMachine, dict[str, np.ndarray], Asked]:
    """Masses, lengths, springs and rates vary; some masses are none."""
    machine, _ = varied_machine.double_pendulum()
    hinge, elbow = machine.connections
    bob: Any = machine.bodies[1]
    pin, end = elbow.parent, bob.frame((0.3, 0.1, 0.0))
    return machine, varied_machine.samples(20), {
        "pin": (Sampled(Position(pin), t=TIMES), lambda run: run.position(pin, t=TIMES)),
        "end": (Sampled(Velocity(end), t=0.3), lambda run: run.velocity(end, t=[0.3])[0]),
        "pull": (Sampled(Acceleration(end), t=TIMES[1:3]), lambda run: run.acceleration(end, t=TIMES[1:3])),
        "angle": (Sampled(Position(hinge), t=0.123), lambda run: run.beta(hinge, t=0.123)[0]),
        "rate": (Sampled(Velocity(elbow), t=TIMES), lambda run: run.beta_rate(elbow, t=TIMES)),
    }  # fmt: skip


def elastic() -> tuple[fm.CompiledMachine, dict[str, np.ndarray], Asked]:
    """A modal body on a ball, round bodies that become others, torques, a driven joint, a marker's axes."""
    rng = np.random.default_rng(4)
    scene = fm.System(gravity=(0.0, -9.81, 0.0))
    top = scene.add(fm.RigidBody(1.0, (0.02, 0.02, 0.01), (0.0, 0.0, 0.3)), name="top")
    tail = scene.add(fm.FlexibleBody(particle_body(1, modes=3, damping=2.0).record), name="tail")
    ball = scene.connect(fm.joint.Spherical(), scene.ground.frame(), top.frame())
    place = scene.ground.frame((0.1, 0.0, 0.0))
    slide = scene.connect(fm.joint.Prismatic("x"), place, tail.frame("root"))
    slide.prescribe(fm.Sine(0.02, 9.0))
    push = scene.add_force(fm.force.FrameForce(tail.frame("tip"), (0.0, -1.0, 0.0)))
    ball.velocity, tail.q, tail.q_rate = (0.0, 0.5, 40.0), (0.0, 0.01, 0.0), (0.0, 0.0, 0.1)
    machine = scene.compile(
        parameters={
            "com": vary.CentreOfMass(top), "mass": vary.Mass(top), "spin": vary.InitialVelocity(ball),
            "q": vary.ModalPosition(tail), "push": vary.OfForce(push, "force"), "place": vary.FrameOrigin(place),
        }
    )  # fmt: skip
    n = 12
    com = np.column_stack([np.where(np.arange(n) % 3, 0.0, 0.05), np.zeros(n), rng.uniform(0.2, 0.4, n)])
    given = {
        "com": com, "mass": rng.uniform(0.5, 2.0, n), "spin": rng.normal(0.0, 9.0, (n, 3)),
        "q": rng.normal(0.0, 0.01, (n, 3)), "push": rng.normal(0.0, 1.0, (n, 3)), "place": rng.normal(0.0, 1.0, (n, 3)),
    }  # fmt: skip
    tip = tail.frame("tip")
    return machine, given, {
        "tip": (Sampled(Position(tip), t=TIMES), lambda run: run.position(tip, t=TIMES)),
        "q": (Sampled(Velocity(tail), t=0.2), lambda run: run.q_rate(tail, t=0.2)),
        "spin": (Sampled(Velocity(ball), t=TIMES), lambda run: run.beta_rate(ball, t=TIMES)),
    }  # fmt: skip


def study(machine: fm.CompiledMachine, given: Any, outputs: Any, **options: Any) -> Ensemble:
    found: Ensemble = machine.ensemble(given, outputs, **{"t_end": 0.3, "integrator": RK, **options})
    return found


@pytest.mark.filterwarnings("ignore:.*use of fork:DeprecationWarning")
@pytest.mark.parametrize("how", ["fork", "thread", "one by one"])
@pytest.mark.parametrize("case", [pendulum, elastic])
def test_the_same_to_the_bit(case: Callable[[], Any], how: str, monkeypatch: pytest.MonkeyPatch) -> None:
    machine, given, asked = case()
    # trajectories in arrays of their own
    monkeypatch.setattr(fm.CompiledMachine, "_prepared_run", lambda *_: (None, None))
    by_run = study(machine, given, {name: ask for name, (_, ask) in asked.items()})
    sampled = {name: one for name, (one, _) in asked.items()}
    if how == "fork":
        with ProcessPoolExecutor(2, mp_context=get_context("fork")) as pool:
            found = study(machine, given, sampled, executor=pool, workers=2)
    else:
        workers = 3 if how == "thread" else 1
        with ThreadPoolExecutor(workers) as threads:
            found = study(machine, given, sampled, executor=threads, workers=workers)
    assert by_run.done.any()
    np.testing.assert_array_equal(found.done, by_run.done)
    assert [one.index for one in found.failures] == [one.index for one in by_run.failures]
    for name in asked:
        np.testing.assert_array_equal(found.output(name), by_run.output(name), err_msg=name)


def unbalanced() -> tuple[fm.CompiledMachine, dict[str, np.ndarray], Asked]:
    """Parallel hinges with links that come off their plane, and a slide beside them."""
    scene = fm.System(gravity=(0.0, -9.81, 0.0))
    arm = scene.add(fm.RigidBody(1.0, (0.01, 0.03, 0.03), (0.3, 0.0, 0.0)), name="arm")
    slider = scene.add(fm.RigidBody(0.5, (0.01, 0.01, 0.01)), name="slider")
    pin = arm.frame((0.6, 0.0, 0.0))
    scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), arm.frame())
    scene.connect(fm.joint.Prismatic("x"), pin, slider.frame())
    named = {"com": vary.CentreOfMass(arm), "pin": vary.FrameOrigin(pin), "mass": vary.Mass(slider)}
    com = np.array([[0.3, 0.0, 0.0], [0.3, 0.0, 0.1], [2.0, 0.1, 0.0], [0.3, 0.0, 0.0]])
    pins = np.array([[0.6, 0.0, 0.0], [0.1, 0.0, 0.2], [0.6, 0.0, 0.0], [5.0, 0.0, 0.0]])
    return scene.compile(parameters=named), {"com": com, "pin": pins, "mass": np.array([0.5, 1.0, 2.0, 0.5])}, {}


@pytest.mark.parametrize("case", [pendulum, elastic, unbalanced])
def test_tables_write_the_numbers_of_variants(case: Callable[[], Any]) -> None:
    machine, given, _ = case()
    plan = machine.scene.plan
    names = tabled_names(machine.parameters, machine.scene)
    rows = [{name: given[name][k] for name in names} for k in range(len(given["mass"]))]
    columns = value_columns(machine.scene, {name: machine.parameters[name] for name in names}, rows)
    assert columns is not None
    assert columns.possible.sum() >= 4
    for k in np.flatnonzero(columns.possible):
        arrays = {name: getattr(plan, name).copy() for name in ("tree", "rigid", "frames")}
        full, floor = np.zeros((2, len(machine.scene.group_full)))
        columns.table.write(int(k), arrays, full, floor)
        variant = machine.variant(rows[k])
        for name, array in arrays.items():
            np.testing.assert_array_equal(array, getattr(variant.plan, name), err_msg=name)
        np.testing.assert_array_equal((full, floor), (variant.group_full, variant.group_floor))


def test_runs_are_made_without_trajectories(monkeypatch: pytest.MonkeyPatch) -> None:
    machine, given, asked = pendulum()
    sampled = {name: one for name, (one, _) in asked.items()}
    good = {name: column[given["mass"] > 0.0] for name, column in given.items()}
    with monkeypatch.context() as without:
        without.setattr(simulation, "Trajectory", None)
        with study(machine, good, sampled) as found:
            assert found.done.all()


def test_each_thread_makes_its_arrays_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """However many tasks there are; and once more after a variant that fails."""
    machine, given, asked = pendulum()
    sampled = {name: one for name, (one, _) in asked.items()}
    good = {name: np.repeat(column[given["mass"] > 0.0], 5, axis=0) for name, column in given.items()}
    made = list[PreparedRuns]()
    new = PreparedRuns.__init__

    def counted(self: PreparedRuns, *arguments: Any) -> None:
        made.append(self)
        new(self, *arguments)

    monkeypatch.setattr(PreparedRuns, "__init__", counted)
    with study(machine, good, sampled, workers=2) as found:
        assert found.done.all()
    assert len(found.done) > 60
    assert 1 <= len(made) <= 2
    good["rate"][30] = 1e150
    with study(machine, good, sampled, workers=2) as found:
        assert [one.index for one in found.failures] == [30]
    assert len(made) <= 4


def test_a_variant_that_fails_in_the_middle_spoils_no_other() -> None:
    """Not even where its arrays are left full of NaN."""
    machine, given, asked = pendulum()
    sampled = {name: one for name, (one, _) in asked.items()}
    good = {name: column[given["mass"] > 0.0] for name, column in given.items()}
    bad = {name: np.insert(column, [2, 5], column[:2], axis=0) for name, column in good.items()}
    bad["rate"][[2, 6]] = 1e150
    with study(machine, good, sampled, workers=1) as alone, study(machine, bad, sampled, workers=1) as found:
        assert [one.index for one in found.failures] == [2, 6]
        assert "stopped at" in found.failures[0].message
        for name in sampled:
            np.testing.assert_array_equal(found.output(name)[found.done], alone.output(name))


def test_values_that_are_no_numbers_are_told_variant_by_variant() -> None:
    machine, _, asked = pendulum()
    sampled = {"end": asked["end"][0]}
    rows = [{"mass": 1.0}, {"mass": "heavy"}, {"mass": np.nan}, {"mass": True}, {"mass": [1.0, 2.0]}, {"mass": 2.0}]
    with study(machine, rows, sampled) as found:
        assert [one.index for one in found.failures] == [1, 2, 3, 4]
        assert all("mass" in one.message for one in found.failures)
    pins = [{"length": (0.5, 0.0, 0.0)}, {"length": (0.5, np.inf, 0.0)}, {"length": 0.5}]
    with study(machine, pins, sampled) as found:
        assert [one.index for one in found.failures] == [1, 2]


def test_what_cannot_be_sampled_is_told_before_anything_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    machine, given, _ = pendulum()
    hinge = machine.connections[0]
    monkeypatch.setattr(PreparedRuns, "step", None)
    for wrong, text in (
        (Sampled(Position(hinge), t=0.31), "the simulation runs from 0 to 0.3"),
        (Sampled(Position(fm.RigidBody(1.0, (1.0, 1.0, 1.0)).frame()), t=0.1), "belongs to no body of this scene"),
    ):
        with pytest.raises(SceneError, match=text):
            study(machine, given, {"a": wrong})
    with pytest.raises(SceneError, match="what is sampled"):
        Sampled(hinge, t=0.1)  # type: ignore[arg-type]
    with pytest.raises(SceneError, match="at a time, or at an array"):
        Sampled(Position(hinge), t=[[0.1]])
    with pytest.raises(SceneError, match="at a time, or at an array"):
        Sampled(Position(hinge), t=np.nan)


def test_a_file_knows_what_was_sampled(tmp_path: Path) -> None:
    machine, given, _ = pendulum()
    hinge, elbow = machine.connections
    file = tmp_path / "study.h5"
    study(machine, given, {"a": Sampled(Position(hinge), t=0.1)}, file=file).close()
    study(machine, given, {"a": Sampled(Position(hinge), t=0.1)}, file=file).close()
    for other in (Sampled(Position(hinge), t=0.2), Sampled(Velocity(hinge), t=0.1), Sampled(Position(elbow), t=0.1)):
        with pytest.raises(RecordError, match="another ensemble"):
            study(machine, given, {"a": other}, file=file)
