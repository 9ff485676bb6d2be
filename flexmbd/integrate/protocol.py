"""The interface between a simulation and its integrator."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from flexmbd.integrate.controller import Stepper
from flexmbd.integrate.state import Groups, State
from flexmbd.multibody.kernels.base.arrays import Work
from flexmbd.multibody.plan.compiled_scene import CompiledScene


@runtime_checkable
class Integrator(Protocol):
    """A method of integration: its options, and how to step a compiled scene with it.

    It attempts steps; ``controller`` chooses their lengths and accepts or rejects them.  A rejected step leaves
    no trace in the state.  Every attempt evaluates functions of time at the instants of its own stages, but no later
    than ``state.function_time``.  With FIXED_STEP each step is STEP long but the last; else the local error rules
    (``state.error_ratio``).
    """

    @property
    def name(self) -> str:
        """How ``explain`` calls the method, its options included."""

    @property
    def order(self) -> int:
        """Order of the error of positions and velocities at the step's end."""

    def check(self, scene: CompiledScene) -> None:
        """Raise SceneError where the method cannot run the scene, with a method that can."""

    def stepper(self, scene: CompiledScene, state: State, groups: Groups, work: Work) -> Stepper:
        """Allocate the method's workspace and its memory."""
