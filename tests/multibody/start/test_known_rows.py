"""Variants of machines with redundant loops: the rows of the compiled machine are kept where they are still good."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

import flexmbd as fm
from flexmbd import parameter as vary
from flexmbd.errors import AssemblyError, FlexmbdError, SceneError
from flexmbd.multibody.start import independent_rows

HINGE = fm.joint.Revolute("z")
SIDES = {"crank": 0.2, "coupler": 0.6, "rocker": 0.5, "base": 0.6}
NOMINAL: dict[str, Any] = {**SIDES, "angle": 1.2, "speed": 6.0, "mass": 1.5, "pivot": np.eye(3), "foot": np.eye(3)}


def angles() -> tuple[float, float]:
    """The coupler's and the rocker's angles against x in the nominal four-bar (rad)."""
    tip = SIDES["crank"] * np.exp(1j * NOMINAL["angle"])
    across = SIDES["base"] - tip
    far = abs(across)
    inner = np.arccos((SIDES["coupler"] ** 2 - SIDES["rocker"] ** 2 + far**2) / (2.0 * SIDES["coupler"] * far))
    coupler = np.angle(across) + inner
    return float(coupler), float(np.angle(tip + SIDES["coupler"] * np.exp(1j * coupler) - SIDES["base"]))


COUPLER, ROCKER = angles()


@dataclass
class Machine:
    scene: fm.System
    parameters: dict[str, Any]

    def start(self, values: dict[str, Any], *, machine: fm.CompiledMachine | None = None) -> Any:
        """The start, or the error that there is none."""
        given = {name: (value, 0.0, 0.0) if name in SIDES else value for name, value in values.items()}
        try:
            return self.scene.start() if machine is None else machine.start(**given)
        except FlexmbdError as reason:
            return reason


def fourbar(values: dict[str, Any], *, close: Any = HINGE, still: bool = False) -> Machine:
    """A plane four-bar of hinges, whose closing joint holds two rows more than it needs, or three."""
    given = {**NOMINAL, **values}
    scene = fm.System(gravity=(0.0, -9.81, 0.0))
    links = [scene.add(fm.RigidBody(given["mass"], (1e-3, 2e-2, 2e-2), (0.1, 0.0, 0.0))) for _ in range(3)]
    crank, coupler, rocker = links
    base = scene.ground.frame((given["base"], 0.0, 0.0), R=given["pivot"])
    foot = rocker.frame(R=given["foot"])
    ends = {body: frame.frame((given[body], 0.0, 0.0)) for body, frame in zip(SIDES, links, strict=False)}
    drive = scene.connect(HINGE, scene.ground.frame(), crank.frame())
    pin = scene.connect(HINGE, ends["crank"], coupler.frame())
    pivot = scene.connect(HINGE, base, foot)
    scene.connect(close, ends["coupler"], ends["rocker"])
    drive.position = given["angle"]
    pin.position, pivot.position = COUPLER - NOMINAL["angle"], ROCKER
    parameters: dict[str, Any] = {name: vary.FrameOrigin(frame) for name, frame in {**ends, "base": base}.items()}
    parameters |= {"angle": vary.InitialPosition(drive), "mass": [vary.Mass(link) for link in links]}
    parameters |= {"pivot": vary.FrameAxes(base), "foot": vary.FrameAxes(foot)}
    if not still:
        drive.velocity = given["speed"]
        parameters["speed"] = vary.InitialVelocity(drive)
    return Machine(scene, parameters)


def random_values(seed: int) -> dict[str, Any]:
    generator = np.random.default_rng(seed)
    values = {name: size * generator.uniform(0.9, 1.1) for name, size in SIDES.items()}
    values["angle"], values["speed"] = generator.uniform(1.0, 1.5), generator.uniform(-9.0, 9.0)
    values["mass"] = generator.uniform(1.0, 3.0)
    chosen = generator.permutation(list(values))[: int(generator.integers(1, 8))]
    return {str(name): values[name] for name in chosen}


@pytest.fixture
def searches(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """How many blocks of rows were looked for beside each start."""
    found: list[int] = []
    search = independent_rows._regular_positions

    def counted(scene: Any, work: Any, x: Any, wanted: Any) -> Any:
        found.append(len(wanted))
        return search(scene, work, x, wanted)

    monkeypatch.setattr(independent_rows, "_regular_positions", counted)
    return found


def assert_alike(found: Any, wanted: Any) -> None:
    """Two starts are one motion, or two errors of one kind."""
    if isinstance(wanted, FlexmbdError):
        assert type(found) is type(wanted)
        return
    assert not isinstance(found, FlexmbdError), found
    assert len(found.choice.rows) == len(wanted.choice.rows)
    np.testing.assert_allclose(found.x, wanted.x, rtol=0, atol=1e-9)
    np.testing.assert_allclose(found.v, wanted.v, rtol=1e-8, atol=1e-9)
    np.testing.assert_allclose(found.a, wanted.a, rtol=1e-7, atol=1e-6)


def test_starts_of_variants_are_those_of_machines_built_with_their_values(searches: list[int]) -> None:
    nominal = fourbar({})
    machine = nominal.scene.compile(parameters=nominal.parameters)
    nominal.start({"mass": 2.0}, machine=machine)
    assert sum(searches) == 1
    for seed in range(25):
        values = random_values(seed)
        searches.clear()
        found = nominal.start(values, machine=machine)
        assert sum(searches) == 0  # none of them needs a search of its own
        assert_alike(found, fourbar(values).start(values))
        assert sum(searches) == 1


def test_a_run_of_a_variant_is_that_of_the_machine_built_with_its_values() -> None:
    values = {"coupler": 0.62, "speed": -4.0, "mass": 2.0}
    nominal = fourbar({})
    machine = nominal.scene.compile(parameters=nominal.parameters)
    found = machine.simulate(0.3, rtol=1e-8, coupler=(0.62, 0.0, 0.0), speed=-4.0, mass=2.0)
    wanted = fourbar(values).scene.simulate(0.3, rtol=1e-8)
    np.testing.assert_allclose(found.x[-1], wanted.x[-1], rtol=0, atol=1e-7)


@pytest.mark.parametrize("sides", [(0.3, 0.6, 0.3, 0.6), (0.2, 0.3, 0.5, 0.6), (0.1, 0.6, 0.5, 0.6)])
@pytest.mark.parametrize("nominal_is_singular", [False, True])
def test_singular_starts_of_variants_are_told_from_regular_ones(
    sides: tuple[float, ...], nominal_is_singular: bool
) -> None:
    """Four-bars stretched out in a line, where one row fewer is independent, and beside it."""
    flat: dict[str, Any] = dict(zip(SIDES, sides, strict=True)) | {"angle": 0.0, "speed": 0.0}
    values: dict[str, Any] = {**SIDES, "angle": 1.2, "speed": 3.0} if nominal_is_singular else flat
    nominal = fourbar(flat if nominal_is_singular else {})
    machine = nominal.scene.compile(parameters=nominal.parameters)
    assert_alike(nominal.start(values, machine=machine), fourbar(values).start(values))


@pytest.mark.parametrize("tilt", [1e-3, 0.1, 0.7])
def test_rows_that_hold_in_a_variant_alone_are_not_left_out(tilt: float) -> None:
    """The pivot of the rocker leans along the rocker: the slopes are as before, but nothing can move beside the start.

    The ball that closes the loop then leaves its plane with the square of any angle.
    """
    ball = fm.joint.Spherical()
    nominal = fourbar({}, close=ball, still=True)
    machine = nominal.scene.compile(parameters=nominal.parameters)
    assert len(nominal.start({"mass": 2.0}, machine=machine).choice.rows) == 2
    lean = turn(np.array([-np.sin(ROCKER), np.cos(ROCKER), 0.0]), tilt)
    back = turn(np.array([0.0, 0.0, 1.0]), ROCKER)
    values = {"pivot": lean, "foot": back.T @ lean @ back}
    found = nominal.start(values, machine=machine)
    assert isinstance(found, SceneError)
    assert "loops lock" in str(found)
    assert_alike(found, fourbar(values, close=ball, still=True).start(values))


@pytest.mark.parametrize("tilt", [1e-3, 0.1, 0.7])
def test_rows_that_a_variant_needs_more_are_kept(tilt: float) -> None:
    """The pivot of the rocker leans across the rocker, which would lead the loop out of its plane at once."""
    ball = fm.joint.Spherical()
    nominal = fourbar({}, close=ball, still=True)
    machine = nominal.scene.compile(parameters=nominal.parameters)
    lean = turn(np.array([np.cos(ROCKER), np.sin(ROCKER), 0.0]), tilt)
    back = turn(np.array([0.0, 0.0, 1.0]), ROCKER)
    found = nominal.start({"pivot": lean, "foot": back.T @ lean @ back}, machine=machine)
    assert len(found.choice.rows) == 3
    np.testing.assert_allclose(found.a, 0.0, atol=1e-7)


def test_a_variant_that_cannot_be_assembled_is_refused() -> None:
    nominal = fourbar({})
    machine = nominal.scene.compile(parameters=nominal.parameters)
    with pytest.raises(AssemblyError):
        machine.start(coupler=(3.0, 0.0, 0.0))


def turn(axis: np.ndarray, angle: float) -> np.ndarray:
    """The rotation about an axis (Rodrigues)."""
    cross = np.cross(np.eye(3), axis)
    return np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross
