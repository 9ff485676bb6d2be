"""State equations of a user that are solved together with the machine: filters, actuators, hydraulics, controllers."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmbd.errors import SceneError
from flexmbd.given import checked, numbers, refuse_other
from flexmbd.multibody.bodies.body import Body, Frame
from flexmbd.multibody.bodies.port import InducedFlow, StrainFlow
from flexmbd.multibody.force.protocol import ElementTable, vector
from flexmbd.multibody.functions.compiled_function import Compiled, Signature
from flexmbd.multibody.functions.linear_system import LinearSystem
from flexmbd.multibody.functions.signal import Signal
from flexmbd.multibody.functions.spline_table import Table
from flexmbd.multibody.functions.switched import Switched, at_side, refuse_other_law, switch_number, switched_now
from flexmbd.multibody.functions.time_function import Sine, answered
from flexmbd.multibody.joint.connection import Connection
from flexmbd.multibody.kernels.base.fingerprint import fingerprint
from flexmbd.multibody.kernels.elements.state_rates import OF_MODES, OF_POSITION, OF_TIME, OF_VELOCITY
from flexmbd.multibody.motion.instant import Instant, measure
from flexmbd.multibody.motion.machine import Machine
from flexmbd.multibody.motion.quantity import Acceleration, Output, Position, Velocity

FloatArray = NDArray[np.float64]

#: What states follow: of fm.output a Position or Velocity; a port's induced or strain flow; a signal that a controller
#: sets; a number or function of time as data; a function of the machine's Instant.
Followed: TypeAlias = (
    Output | InducedFlow | StrainFlow | Signal | Table | Sine | Compiled | float | Callable[[Instant], ArrayLike]
)
#: f(t, z, u) -> rates or outputs in Python, or ``flexmbd.compiled`` f(t, z, u, out); or ``flexmbd.Switched``.
StateEquation: TypeAlias = Compiled | Switched | Callable[[float, FloatArray, FloatArray], Any]


@checked("name", "names")
@dataclass(frozen=True, eq=False)
class States:
    """First-order differential equations z' = f(t, z, u) with outputs y = g(t, z, u), solved with the machine.

    Made by ``System.add_states``, which tells how each attribute is given.  Every integrator solves them as it does
    the machine, to its own order, with the same control of the error: a radian of the machine's motion may add rtol
    times the larger of ``scale`` and the largest value met.

    Attributes:
        rates: f.
        initial: (n,) z at the start.
        scale: sizes of the states in their own units, (n,) or one for all.
        measurements: u, the quantities that they follow.
        outputs: g; None: y = z.
        inputs: the signals that y sets, loads on joints' coordinates.
        name: in messages and results.
        names: of the states.

    Raises:
        SceneError: an argument is not of its kind.
    """

    rates: StateEquation
    initial: ArrayLike
    scale: ArrayLike
    measurements: Sequence[Followed] = ()
    outputs: StateEquation | None = None
    inputs: Sequence[Signal] = ()
    name: str = "states"
    names: Sequence[str] = ()

    def __post_init__(self) -> None:
        z, scale = numbers(self.initial), numbers(self.scale)
        if z.ndim != 1 or not len(z) or not np.isfinite(z).all():
            raise SceneError(f"{self.what}: initial values must be finite numbers (n,), got {self.initial!r:.60}")
        if scale.shape not in ((), z.shape) or not (np.isfinite(scale).all() and (scale > 0.0).all()):
            raise SceneError(
                f"{self.what}: the scale must be the size of each state in its unit, positive, got {self.scale!r:.60}"
            )
        if self.names and len({*self.names}) != len(z):
            raise SceneError(f"{self.what}: {len(z)} states need {len(z)} distinct names, got {self.names!r:.60}")
        if self.rates is None:
            raise SceneError(f"{self.what}: rates must be a function of t, z and u, got None")
        for function, role in ((self.rates, "rates"), (self.outputs, "outputs")):
            _refuse_no_equation(function, f"{self.what}: {role}")
        for name, given in (("measurements", self.measurements), ("inputs", self.inputs)):
            refuse_other(given, Sequence, f"{self.what}: {name}", wanted="a list")
        for signal in self.inputs:
            refuse_other(signal, Signal, f"{self.what}: an input", wanted='a signal, fm.Signal("pressure force")')
        if self.outputs is None and len(self.inputs) not in (0, len(z)):
            raise SceneError(
                f"{self.what}: {len(z)} states cannot set {len(self.inputs)} signals; give outputs=g(t, z, u)"
            )
        for quantity in self.measurements:
            self._refuse_unfollowed(quantity)
        switches = [f for f in (self.rates, self.outputs) if isinstance(f, Switched)]
        if switches and switches[0].when is not switches[-1].when:
            raise SceneError(f"{self.what}: rates and outputs that both switch must do so by one function when=")
        if switches and any(isinstance(q, (InducedFlow, StrainFlow)) for q in self.measurements):
            raise SceneError(f"{self.what}: equations that switch cannot follow a port; follow the modal coordinates")
        if switches and any(isinstance(q, (Signal, Table, Sine, Compiled)) for q in self.measurements):
            raise SceneError(f"{self.what}: equations that switch cannot follow signals or data; follow coordinates")
        if self._asks_machine and any(isinstance(q, (Signal, Table, Sine, Compiled)) for q in self.measurements):
            raise SceneError(
                f"{self.what}: states that follow frames or functions of the machine cannot follow signals or data as "
                "well; follow coordinates of joints in place of frames"
            )

    def _refuse_unfollowed(self, quantity: object) -> None:
        if isinstance(quantity, Acceleration):
            raise SceneError(
                f"{self.what}: states cannot follow accelerations, which depend on the states; measure accelerations "
                "with a controller, or follow positions and velocities"
            )
        kinds = (Position, Velocity, InducedFlow, StrainFlow, Signal, Table, Sine, Compiled)
        if not isinstance(quantity, kinds) and (isinstance(quantity, Output) or not callable(quantity)):
            value: Any = quantity
            vector(value, (), f"{self.what}: what states follow (fm.output.Position or Velocity, a signal, data)")

    @property
    def what(self) -> str:
        """Its name in messages."""
        return f"states {self.name!r}"

    @property
    def code(self) -> str:
        """Tells them from other equations."""
        functions = (f for f in (self.rates, self.outputs) if f is not None)
        parts = [part for f in functions for part in ((f.law, f.when) if isinstance(f, Switched) else (f,))]
        return " ".join(fingerprint(part.source if isinstance(part, Compiled) else part) for part in parts)

    @property
    def count(self) -> int:
        """How many states."""
        return len(self.first)

    @property
    def first(self) -> FloatArray:
        """(n,) the states at the start."""
        return numbers(self.initial)

    @property
    def scales(self) -> FloatArray:
        """(n,) sizes of the states."""
        return np.broadcast_to(numbers(self.scale), (self.count,)).copy()

    @property
    def state_names(self) -> tuple[str, ...]:
        """Of each state."""
        own = self.names or [f"z[{k}]" for k in range(self.count)]
        return tuple(f"{self.name}.{name}" for name in own)

    @property
    def connections(self) -> tuple[Connection, ...]:
        """The joints whose coordinates they follow."""
        outputs = (q.of for q in self.measurements if isinstance(q, Output))
        return tuple(of for of in outputs if isinstance(of, Connection))

    @property
    def frames(self) -> tuple[Frame, ...]:
        """The frames that they follow."""
        outputs = (q.of for q in self.measurements if isinstance(q, Output))
        return tuple(of for of in outputs if isinstance(of, Frame))

    @property
    def _asks_machine(self) -> bool:
        """Whether they follow more than coordinates and data, so that the machine's frames are asked in Python."""
        return any(
            isinstance(q.of, Frame)
            if isinstance(q, Output)
            else not isinstance(q, (InducedFlow, StrainFlow, Signal, Table, Sine, Compiled))
            and callable(q)
            for q in self.measurements
        )

    def check(self) -> None:
        """Raise SceneError where a joint has coordinates that are not numbers of their own."""
        for quantity in self.measurements:
            if isinstance(quantity, Output) and isinstance(quantity.of, Connection):
                joint = quantity.of.joint
                if len(joint.start) != len(joint.velocity_names) and isinstance(quantity, Position):
                    raise SceneError(
                        f"{self.what}: the coordinates of joint {quantity.of.name!r} are a quaternion, not independent "
                        "numbers; follow a function of the machine, lambda now: ..."
                    )

    def assemble(self, table: ElementTable) -> None:
        """Add a link for each state, and the row of the equations."""
        whole = self._asks_machine
        quantities = [] if whole else [row for q in self.measurements for row in self._rows(q, table)]
        switched = next((f for f in (self.rates, self.outputs) if isinstance(f, Switched)), None)
        if switched is None:
            table.states(self, (self._address(table, 1.0, whole=whole), 0), quantities, whole=whole)
            return
        addresses = (self._address(table, 1.0, whole=whole), self._address(table, -1.0, whole=whole))
        number = _SwitchNumber(self, switched_now(switched), quantities, whole=whole)
        if whole:
            table.when_built(number.take)
        number.place = table.states(self, addresses, quantities, whole=whole, switch=(switched, number))

    def _address(self, table: ElementTable, side: float, *, whole: bool) -> int:
        """Address of the equations on a side of their switch."""
        f, g = (at_side(one, side) if isinstance(one, Switched) else one for one in (self.rates, self.outputs))
        if isinstance(f, Compiled) and (g is None or isinstance(g, Compiled)) and not whole:
            return table.compiled_states(f, g, self.count, len(self.inputs))
        equations = _PythonEquations(self, (f, g))
        if whole:
            table.when_built(equations.take)
        count = self.count + len(self.inputs)
        return table.python_states(equations.of_machine if whole else equations, self.what, count)

    def _rows(self, quantity: Followed, table: ElementTable) -> list[tuple[int, int, int]]:
        """Of each number of a quantity its kind, its place, and the velocity that goes with it."""
        if isinstance(quantity, InducedFlow | StrainFlow):
            return [self._flow_row(quantity, table)]
        if isinstance(quantity, Output):
            kind = OF_POSITION if isinstance(quantity, Position) else OF_VELOCITY
            of = quantity.of
            if isinstance(of, Connection):
                places = [table.coordinate(of, k) for k in range(len(of.joint.velocity_names))]
            else:
                x, v = table.modes(cast(Body, of))
                record = cast(Body, of).reduced()
                places = [(x + k, v + k) for k in range(0 if record is None else record.n_modes)]
            return [(kind, x if kind == OF_POSITION else v, v) for x, v in places]
        return [(OF_TIME, table.time(quantity, f"what {self.what} follow"), 0)]

    def _flow_row(self, quantity: InducedFlow | StrainFlow, table: ElementTable) -> tuple[int, int, int]:
        """Kind, place and velocity of a port's flow as a sum of modal coordinates and functions of time."""
        port = quantity.port
        x, v = table.modes(port.body)
        matrix = () if port.second is None else port.second.ravel()
        others = quantity.others if isinstance(quantity, InducedFlow) else []
        times = [table.time(other.effort_now, f"{other.effort_name} of {other.label}") for other, _ in others]
        table.follow(times)
        order = quantity.order if isinstance(quantity, StrainFlow) else 0
        efforts = [part for time, (_, per) in zip(times, others, strict=True) for part in (float(time), per)]
        head = [len(port.load), order, x, v, port.second is not None, len(others)]
        return OF_MODES, table.numbers([*map(float, head), *port.load, *matrix, *efforts]), v


class _PythonEquations:
    """Equations in Python: rates and outputs (n + k,) in one."""

    def __init__(self, states: States, functions: tuple[Any, Any]) -> None:
        self._states = states
        self._machine: Machine | None = None
        self._functions: list[Any] = [f.source if isinstance(f, Compiled) else f for f in functions]
        self._writes = [isinstance(f, Compiled) for f in functions]

    def take(self, machine: Machine) -> None:
        """Keep the compiled scene, which frames are asked of."""
        self._machine = machine

    def __call__(self, t: float, z: FloatArray, u: FloatArray) -> FloatArray:
        """Rates and outputs in one array, by states z (n,) and followed quantities u (m,)."""
        n, k = self._states.count, len(self._states.inputs)
        rates = self._asked(0, t, z, u, n)
        if not k or self._functions[1] is None:
            return np.concatenate([rates, z[:k]])
        return np.concatenate([rates, self._asked(1, t, z, u, k)])

    def _asked(self, which: int, t: float, z: FloatArray, u: FloatArray, size: int) -> FloatArray:
        function, role = self._functions[which], ("rates", "outputs")[which]
        if self._writes[which]:
            answer: Any = np.zeros(size)
            function(t, z, u, answer)
        else:
            answer = function(t, z.copy(), u.copy())
        try:
            return answered(np.atleast_1d(answer), (size,))
        except SceneError as reason:
            raise SceneError(f"as {role} {reason}") from reason

    def of_machine(self, t: float, x: FloatArray, v: FloatArray) -> FloatArray:
        """The same by configuration x (nx,) and velocities v (nv,) of the whole machine."""
        machine, states = self._machine, self._states
        if machine is None:
            raise SceneError(f"{states.what} are in no machine")
        now = Instant(machine, t, x, v, np.zeros_like(v))
        u = [measure(_of_instant(q), now) for q in states.measurements]
        return self(t, now.states(states), np.concatenate([np.zeros(0), *u]))


class _SwitchNumber:
    """The number of the states' switch, by the machine's state; ``place``: of the states in v."""

    def __init__(
        self, states: States, switched: Switched, quantities: Sequence[tuple[int, int, int]], *, whole: bool
    ) -> None:
        self.place = slice(0)
        self._states, self._switched, self._quantities, self._whole = states, switched, quantities, whole
        self._machine: Machine | None = None

    def take(self, machine: Machine) -> None:
        """Keep the compiled scene, which frames are asked of."""
        self._machine = machine

    def __call__(self, side: float, t: float, x: FloatArray, v: FloatArray) -> Any:
        """By x (nx,), v (nv,) of the whole machine."""
        if self._whole and self._machine is not None:
            now = Instant(self._machine, t, x, v, np.zeros_like(v))
            u = np.concatenate([np.zeros(0), *(measure(_of_instant(q), now) for q in self._states.measurements)])
        else:
            u = np.array([x[place] if kind == OF_POSITION else v[place] for kind, place, _ in self._quantities])
        return switch_number(self._switched, side, t, self._states.scales * v[self.place], u)


def _of_instant(quantity: Any) -> Any:
    """What an Instant can be asked for."""
    return quantity if isinstance(quantity, Output) or callable(quantity) else lambda now: quantity


def state_sizes(scale: ArrayLike, states: Mapping[str, float], what: str) -> tuple[FloatArray, FloatArray]:
    """(n,) sizes of the states of a force, and their values at the start.

    Raises:
        SceneError: sizes that are not positive, or values that are no numbers; ``what`` names the force.
    """
    sizes, initial = numbers(scale), numbers([*states.values()])
    if initial.ndim != 1 or not np.isfinite(initial).all():
        raise SceneError(f"{what}: states at the start must be finite numbers, got {dict(states)!r:.100}")
    if sizes.shape not in ((), initial.shape) or not (np.isfinite(sizes).all() and (sizes > 0.0).all()):
        raise SceneError(
            f"{what}: the scale must be the size of each state in its unit, positive, got {scale!r:.60}"
        )
    return np.broadcast_to(sizes, initial.shape).copy(), initial


def _refuse_no_equation(function: object, what: str) -> None:
    if isinstance(function, Switched):
        refuse_other_law(function, Signature.STATE, what)
    elif isinstance(function, Compiled):
        if function.signature is not Signature.STATE:
            raise SceneError(f"{what}: a compiled function must take t, z, u and out")
    elif function is not None and (not callable(function) or isinstance(function, type)):
        raise SceneError(f"{what} must be a function of t, z and u, got {function!r:.60}")


def linear_equations(system: LinearSystem) -> tuple[Compiled, Compiled]:
    """f and g of a continuous linear system, compiled."""
    A, B, C, D = (np.ascontiguousarray(part) for part in (system.A, system.B, system.C, system.D))

    def rates(t, z, u, out):  # type: ignore[no-untyped-def]
        for i in range(A.shape[0]):
            for j in range(A.shape[1]):
                out[i] += A[i, j] * z[j]
            for j in range(B.shape[1]):
                out[i] += B[i, j] * u[j]

    def outputs(t, z, u, out):  # type: ignore[no-untyped-def]
        for i in range(C.shape[0]):
            for j in range(C.shape[1]):
                out[i] += C[i, j] * z[j]
            for j in range(D.shape[1]):
                out[i] += D[i, j] * u[j]

    # compiled with the scene, for the sizes that it has there
    made = (Compiled(0, None, f.__name__, Signature.STATE, fingerprint(f), source=f) for f in (rates, outputs))
    first, second = made
    return first, second
