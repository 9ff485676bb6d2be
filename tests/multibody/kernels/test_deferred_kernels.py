"""Kernels that are compiled when a machine first needs them: who needs which, and what happens where that fails."""

from __future__ import annotations

import json
import subprocess
import sys

import numpy as np
import pytest

from flexmbd.multibody.kernels.base import deferred
from flexmbd.multibody.kernels.base.compiling import entry_kernel
from flexmbd.multibody.kernels.base.deferred import NUMBER, TUPLE3, deferred_kernel

PENDULUM = """
import json, sys
import flexmbd as fm
from flexmbd.multibody.kernels.base import deferred

scene = fm.System(gravity=(0.0, 0.0, -9.81))
rod = scene.add(fm.RigidBody(mass=1.0, inertia=(0.1, 0.1, 0.1), com=(0.5, 0.0, 0.0)))
hinge = scene.connect(fm.joint.Revolute(axis="y"), scene.ground.frame(), rod.frame())
hinge.position = 0.3
if "spring" in sys.argv:
    scene.add_force(fm.force.JointSpring(hinge, stiffness=1.0))
scene.simulate(0.1, integrator=getattr(fm, sys.argv[1])())
print(json.dumps([name for (_, name), (kernel, _) in deferred._kernels.items() if kernel.images]))
"""


def needed(*words: str) -> set[str]:
    """The deferred kernels that a pendulum compiles or loads, in a process of its own."""
    done = subprocess.run([sys.executable, "-c", PENDULUM, *words], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return set(json.loads(done.stdout))


@pytest.mark.parametrize(
    "method", ["ExplicitRungeKutta", "GeneralizedAlpha", "RadauIIA", "EnergyMomentum", "CentralDifference"]
)
def test_a_rigid_pendulum_needs_none(method: str) -> None:
    """A hinge and a rigid body: no modes, no loops, no elements, no general recursion."""
    assert needed(method) == set()


def test_a_spring_brings_its_own() -> None:
    found = needed("ExplicitRungeKutta", "spring")
    assert "subtract_coordinate_forces" in found
    assert not found & {"prepare_body", "deform_frame", "project", "_add_reactions", "_accelerate_bodies"}


@deferred_kernel(TUPLE3)
def _doubled(values, share):
    return (2.0 * share * values[0], 2.0 * share * values[1], 2.0 * share * values[2])


@entry_kernel
def _enter(values, out):
    x, y, z = _doubled(values, 3)
    out[0] = x + y + z


@deferred_kernel(NUMBER)
def _untrue(values):
    return (values[0], values[1])


@entry_kernel
def _enter_untrue(values, out):
    out[0] = _untrue(values)


@deferred_kernel(NUMBER)
def _late(values):
    return values[0]


@entry_kernel
def _enter_late(values, out):
    out[0] = _late(values)


def test_what_is_returned_arrives() -> None:
    """Integers that the caller knows go as any other number: one image serves all."""
    out = np.zeros(1)
    for _ in range(2):
        _enter(np.array([1.0, 2.0, 4.0]), out)
        assert out[0] == 42.0


def test_a_kernel_that_returns_something_else_is_refused(capfd: pytest.CaptureFixture[str]) -> None:
    out = np.zeros(1)
    with pytest.raises(RuntimeError, match="could not be compiled"):
        _enter_untrue(np.ones(3), out)
    assert out[0] == 0.0
    assert "_untrue returns (float64, float64), and says that it returns float64" in capfd.readouterr().err


def test_an_interruption_while_compiling_leaves_the_kernels(monkeypatch: pytest.MonkeyPatch) -> None:
    """As Ctrl-C does; the next call compiles it."""
    out = np.zeros(1)

    def interrupt(*_: object) -> int:
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(deferred, "_address", interrupt)
        with pytest.raises(KeyboardInterrupt):
            _enter_late(np.array([5.0]), out)
    assert out[0] == 0.0
    _enter_late(np.array([5.0]), out)
    assert out[0] == 5.0
