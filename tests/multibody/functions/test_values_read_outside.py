"""Compiled functions of users read numbers and arrays outside themselves: a scene takes them as they are now."""

from __future__ import annotations

import types
from typing import Any

import numba
import numpy as np
import pytest

import flexmbd as fm
from flexmbd.errors import SceneError

FORCE = 1.0
ARRAY = np.array([1.0])
SETTINGS: Any = types.ModuleType("settings")
SETTINGS.force = 1.0


@fm.compiled
def of_a_global(t):
    return FORCE


@fm.compiled
def of_an_array(t):
    return ARRAY[0]


@fm.compiled
def of_a_module(t):
    return SETTINGS.force


@fm.compiled
def law(t, beta, rate):
    return FORCE


@fm.compiled
def state(t, x, v, out):
    out[0] = FORCE


@fm.compiled
def motion_rate(t):
    return FORCE


@numba.njit
def helper():
    return FORCE


def mass_on_a_slide():
    scene = fm.System()
    body = scene.add(fm.RigidBody(1.0, (1.0, 1.0, 1.0)), name="body")
    return scene, scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(), body.frame(), name="slide")


def speed(scene, slide):
    """(m/s) after a second: that of the force on a kilogram."""
    return float(scene.simulate(1.0).beta_rate(slide)[-1])


WAYS = {
    "global": lambda slide: fm.force.JointForce(slide, of_a_global),
    "array": lambda slide: fm.force.JointForce(slide, of_an_array),
    "module": lambda slide: fm.force.JointForce(slide, of_a_module),
    "piecewise": lambda slide: fm.force.JointForce(slide, fm.Piecewise(of_a_global, [0.5])),
    "law": lambda slide: fm.force.JointLaw(slide, law),
    "state": lambda slide: fm.force.StateForce(state),
}


@pytest.mark.parametrize("way", WAYS)
def test_a_scene_takes_what_a_compiled_function_names_as_it_is_now(way, monkeypatch):
    """Before, after and before again; a machine that is compiled keeps what there was."""
    scene, slide = mass_on_a_slide()
    scene.add_force(WAYS[way](slide))
    machine = scene.compile()
    assert speed(scene, slide) == pytest.approx(1.0)
    monkeypatch.setitem(globals(), "FORCE", 5.0)
    monkeypatch.setattr(SETTINGS, "force", 5.0)
    ARRAY[0] = 5.0
    try:
        assert speed(scene, slide) == pytest.approx(5.0)
        assert machine.simulate(1.0).beta_rate(slide)[-1] == pytest.approx(1.0)
    finally:
        ARRAY[0] = 1.0
    monkeypatch.undo()
    assert speed(scene, slide) == pytest.approx(1.0)


def test_a_closure_is_looked_at_too():
    """A number of the function around it, and one of a function inside it."""
    force = 1.0

    @fm.compiled
    def inner(t):
        return sum([force for _ in range(2)])

    scene, slide = mass_on_a_slide()
    scene.add_force(fm.force.JointForce(slide, inner))
    assert speed(scene, slide) == pytest.approx(2.0)
    force = 5.0
    assert speed(scene, slide) == pytest.approx(10.0)


def test_a_prescribed_motion_is_looked_at():
    """x = FORCE t, by three compiled functions."""
    scene, slide = mass_on_a_slide()
    names = {"FORCE": 1.0}
    value, rate, acceleration = (
        fm.compiled(types.FunctionType(code, names))
        for code in ((lambda t: FORCE * t).__code__, (lambda t: FORCE).__code__, (lambda t: 0.0).__code__)
    )
    slide.prescribe(fm.Motion(value, rate, acceleration))
    assert scene.simulate(1.0).beta(slide)[-1] == pytest.approx(1.0)
    names["FORCE"] = 5.0
    assert scene.simulate(1.0).beta(slide)[-1] == pytest.approx(5.0)


def test_unchanged_functions_are_not_compiled_again(monkeypatch):
    """The address of each value's function stays."""
    assert of_a_global.as_it_is_now() is of_a_global
    monkeypatch.setitem(globals(), "FORCE", 7.0)
    assert of_a_global.as_it_is_now() is of_a_global.as_it_is_now() is not of_a_global


def test_a_compiled_helper_that_names_other_values_now_is_refused(monkeypatch):
    """numba keeps the helper's machine code, whatever is compiled anew around it."""

    @fm.compiled
    def of_a_helper(t):
        return helper()

    scene, slide = mass_on_a_slide()
    scene.add_force(fm.force.JointForce(slide, of_a_helper))
    assert speed(scene, slide) == pytest.approx(1.0)
    monkeypatch.setitem(globals(), "FORCE", 5.0)
    with pytest.raises(SceneError, match="of_a_helper calls a function compiled by numba"):
        scene.compile()
