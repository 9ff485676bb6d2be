"""Settings of runs: scene, compiled machine and ``RunSettings`` take the same ones, with the same defaults."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import flexmbd as fm


def _taken(function: Callable[..., Any]) -> dict[str, object]:
    """Names of arguments with their defaults, those of parameters of a machine apart."""
    arguments = inspect.signature(function).parameters.values()
    return {one.name: one.default for one in arguments if one.name != "self" and one.kind is not one.VAR_KEYWORD}


def test_settings_are_what_simulate_takes() -> None:
    assert _taken(fm.System.simulate) == _taken(fm.RunSettings) == _taken(fm.CompiledMachine.simulate)


def test_ensembles_take_settings_with_the_same_defaults() -> None:
    ensemble, settings = _taken(fm.CompiledMachine.ensemble), _taken(fm.RunSettings)
    shared = ensemble.keys() & settings.keys()
    assert {"t_end", "rtol", "h", "t_start", "integrator", "max_step", "max_steps", "max_seconds"} <= shared
    assert {name: ensemble[name] for name in shared} == {name: settings[name] for name in shared}


def _pendulum() -> tuple[fm.System, fm.RigidBody]:
    scene = fm.System(gravity=(0.0, -9.81, 0.0))
    link = scene.add(fm.RigidBody(1.0, (0.01, 0.01, 0.02), (0.3, 0.0, 0.0)))
    scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), link.frame())
    return scene, link


def test_runs_by_settings_are_those_of_simulate_to_the_bit() -> None:
    scene, link = _pendulum()
    machine = scene.compile(parameters={"settings": fm.parameter.Mass(link)})  # no name is taken by `run`
    by_settings = machine.run(fm.RunSettings(0.3, rtol=1e-7, t_start=0.1), settings=2.0)
    by_keywords = machine.simulate(0.3, rtol=1e-7, t_start=0.1, settings=2.0)
    link.mass = 2.0
    of_the_scene = scene.simulate(0.3, rtol=1e-7, t_start=0.1)
    for other in (by_keywords, of_the_scene):
        np.testing.assert_array_equal(by_settings.t, other.t)
        np.testing.assert_array_equal(by_settings.x, other.x)
    assert by_settings.t[0] == 0.1


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"t_end": 0.0}, "t_end"),
        ({"rtol": 0.0}, "rtol"),
        ({"h": -1.0}, "step h"),
        ({"h": 1e-3, "max_step": 1e-2}, "max_step"),
        ({"max_steps": 0}, "max_steps"),
        ({"checkpoints": (2.0,)}, "checkpoints at 2"),
        ({"checkpoint_every": 0.1}, "go together"),
        ({"checkpoint_file": Path("x"), "checkpoint_every": -0.1}, "checkpoint_every"),
        ({"progress": "no"}, "progress"),
        ({"integrator": "Radau"}, "integrator"),
        ({"events": (1,)}, "an event"),
        ({"restart": "file"}, "restart"),
        ({"about": 1}, "about"),
    ],
)
def test_bad_settings_are_refused_by_their_names(given: dict[str, Any], message: str) -> None:
    with pytest.raises(fm.SceneError, match=message):
        fm.RunSettings(**{"t_end": 1.0, **given})
