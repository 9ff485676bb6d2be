"""What a simulation asks of an integrator."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol, runtime_checkable

from flexmbd.integrate.state import Groups, Record, State
from flexmbd.multibody.kernels.layout import Work
from flexmbd.multibody.plan import CompiledScene

#: Steps until the end, a full record or a failure; returns a code of ``integrate.state``.
Stepper = Callable[[Record], int]


@runtime_checkable
class Integrator(Protocol):
    """A method of integration: its options, and how to step a compiled scene with it.

    A stepper steps from ``State`` until TIME_END (DONE), until the record is full (OUTPUT), or
    until it fails (a code that says how); a rejected step leaves no trace in the state.  Every
    call evaluates functions of time at the instants of its own stages.  With FIXED_STEP each step
    is STEP long but the last; else the local error rules (``state.error_ratio``).
    """

    @property
    def name(self) -> str:
        """How ``explain`` calls the method, its options included."""

    @property
    def order(self) -> int:
        """Order of the error of positions and velocities at the step's end."""

    @property
    def memory_rows(self) -> int:
        """Rows of ``State.memory`` that the method wants."""

    def check(self, scene: CompiledScene) -> None:
        """Raise SceneError where the method cannot run the scene, with a method that can."""

    def stepper(
        self, scene: CompiledScene, state: State, groups: Groups, work: Work
    ) -> tuple[Stepper, Callable[[], None]]:
        """Set up the method's part of ``state`` if it is new (no steps yet), and allocate.

        Returns the stepper and ``drop_factors``, which makes it forget its iteration matrix.
        """
