"""The stepper of systems and of compiled machines: its arguments stand here once."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal

from flexmbd.integrate.protocol import Integrator
from flexmbd.multibody.functions.signal import Signal
from flexmbd.multibody.linear.working_point import WorkingPoint
from flexmbd.run.settings import RunSettings
from flexmbd.run.stepped_integration import settings_of
from flexmbd.run.stepped_machine import SteppedMachine
from flexmbd.run.stepped_outputs import SteppedOutput


@dataclass(frozen=True, eq=False)
class StepperRequest:
    """The arguments of a stepper.

    Attributes:
        settings: checks and gives the settings of a run as long as steps are about to go.
        inputs: signals that are set from outside, by their own names or others.
        outputs: quantities that each step returns.
        interpolation: of inputs within a step, "held" or "linear".
        open_end: whether steps of error control are those of a chain of restarts.
        values: of parameters, by their names.
    """

    settings: Callable[[], RunSettings]
    inputs: Sequence[Signal] | Mapping[str, Signal]
    outputs: Sequence[SteppedOutput] | Mapping[str, SteppedOutput]
    interpolation: Literal["held", "linear"]
    open_end: bool
    values: Mapping[str, Any]


class Steppable(ABC):
    """A machine that can be stepped from outside."""

    @abstractmethod
    def _begin_steps(self, request: StepperRequest) -> SteppedMachine:
        """The machine at its start, to be stepped."""

    def stepper(
        self,
        *,
        h: float | None = None,
        rtol: float = 1e-6,
        inputs: Sequence[Signal] | Mapping[str, Signal] = (),
        outputs: Sequence[SteppedOutput] | Mapping[str, SteppedOutput] = (),
        interpolation: Literal["held", "linear"] = "held",
        horizon: float | None = None,
        t_start: float = 0.0,
        about: WorkingPoint | None = None,
        integrator: Integrator | Literal["auto"] = "auto",
        max_step: float | None = None,
        values: Mapping[str, Any] | None = None,
    ) -> SteppedMachine:
        """The machine to be stepped from outside: by a controller, a learning agent, an optimiser, another program.

        With a fixed step the states after steps of h are to the bit those of ``simulate(h=h)``; docs/cosimulation.md
        tells what holds of others.

        Args:
            h: fixed step (s) instead of error control; a step of the caller's that is no multiple ends with a shorter
                one.
            rtol: as of ``simulate``.
            inputs: signals that stand in loads of the scene, by their own names, or a mapping that gives others.
            outputs: what each step tells: of fm.output a Position, Velocity or Acceleration, or functions of the
                machine's ``fm.Instant``; a mapping has it told by names.
            interpolation: "held": inputs are constant over a step; "linear": they go straight to the values given.
            horizon: about how long (s) it will run: steps under error control are those of a ``simulate`` of that
                length.  By default they are those of a chain of restarts, each up to the end of a step.
            t_start: start time (s).
            about: where to begin, of ``equilibrium``, instead of the initial values of joints and bodies.
            integrator: the method, as of ``simulate``.
            max_step: longest step (s) of error control.
            values: of a compiled machine's parameters, by their names.

        Raises:
            SceneError, AssemblyError: as ``start``; a bad argument; a name that is no parameter's; an input that is in
                no load, or set by a controller; an output that is not in the scene; bodies with history, which cannot
                be stepped so.
        """
        settings = partial(
            settings_of, h=h, rtol=rtol, horizon=horizon, t_start=t_start, about=about, integrator=integrator,
            max_step=max_step,
        )  # fmt: skip
        open_end = horizon is None and h is None
        given = {} if values is None else values
        return self._begin_steps(StepperRequest(settings, inputs, outputs, interpolation, open_end, given))
