"""Laws that jump with the state: one law of two sides, told apart by the sign of a function."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import SceneError
from flexmbd.multibody.functions.compiled_function import Compiled, Signature
from flexmbd.multibody.kernels.base.fingerprint import fingerprint

FloatArray = NDArray[np.float64]

_COMPILED = (Signature.SIDED_LAW, Signature.SIDED_STATE)


@dataclass(frozen=True, eq=False)
class Switched:
    """A law that jumps, or bends, where a function of the state passes through zero: a contact, dry friction, a stick.

    The law takes one more argument, its last, ``side``: 1.0 where ``when`` is positive or zero, -1.0 where it is
    negative.  On each side it must be smooth, and defined a little beyond zero: steps are taken with the side on which
    they begin, so that they see no jump.  Where ``when`` passes through zero is located as an event is, to the method's
    own accuracy; there the law changes its side and the method begins anew.

    Attributes:
        law: f(..., side), in Python or ``flexmbd.compiled``, with the arguments of the place where it stands.
        when: of the law's other arguments, one number, continuous: Python or compiled.  What writes into ``out``
            writes this into ``out[0]``.  It may take ``side`` as well: a hysteresis is a number that is another one on
            the other side, as long as it does not leave that side at once.

    Raises:
        SceneError: they are no such functions.
    """

    law: Any
    when: Any

    def __post_init__(self) -> None:
        what = "fm.Switched"
        wanted: tuple[Signature, ...] = (*_COMPILED, *(Signature(-one.value) for one in _COMPILED))
        if isinstance(self.law, Compiled):
            if self.law.signature not in _COMPILED:
                raise SceneError(f"{what}: {self.law.name} must take `side` as its last argument")
            wanted = (self.law.signature, Signature(-self.law.signature.value))
        else:
            if not callable(self.law) or not takes_side(self.law):
                raise SceneError(f"{what}: the last argument of the law must be `side`, as f(t, beta, rate, side)")
        if isinstance(self.when, Compiled):
            if self.when.signature not in wanted:
                raise SceneError(f"{what}: when = {self.when.name} must take the arguments of the law but its side")
        elif not callable(self.when):
            raise SceneError(f"{what}: when must be a function of the arguments of the law but its side")

    @property
    def name(self) -> str:
        """The law's own."""
        return self.law.name if isinstance(self.law, Compiled) else getattr(self.law, "__name__", "law")

    @functools.cached_property
    def follows_side(self) -> bool:
        """Whether ``when``, in Python, takes the side as well."""
        return takes_side(self.when)

    @property
    def code(self) -> str:
        """Tells them from others."""
        return " ".join(fingerprint(one.source if isinstance(one, Compiled) else one) for one in (self.law, self.when))


def refuse_other_law(switched: Switched, signature: Signature, what: str) -> None:
    """Raise SceneError where a compiled law or ``when`` has other arguments than those of a signature."""
    for one in (switched.law, switched.when):
        if isinstance(one, Compiled) and abs(one.signature.value) != signature.value:
            raise SceneError(f"{what}: {one.name} has other arguments; see fm.Switched")


def switched_now(switched: Switched) -> Switched:
    """The same with the values that its compiled functions read from outside as they are now (`Compiled`)."""
    parts = (one.as_it_is_now() if isinstance(one, Compiled) else one for one in (switched.law, switched.when))
    return Switched(*parts)


def at_side(switched: Switched, side: float) -> Any:
    """The law on one side, 1.0 or -1.0, without that argument."""
    if isinstance(switched.law, Compiled):
        return switched.law.as_it_is_now().sides[0 if side > 0.0 else 1]
    return functools.partial(switched.law, side=side)


def switch_number(switched: Switched, side: float, *arguments: Any) -> Any:
    """The value of ``when`` for a side and the law's other arguments."""
    when = switched.when
    if not isinstance(when, Compiled):
        return when(*arguments, side) if switched.follows_side else when(*arguments)
    if when.sides:
        when = when.sides[0 if side > 0.0 else 1]
    if when.signature is Signature.LAW:
        return when.keep.ctypes(*arguments)
    out = np.zeros(max(1, len(arguments[-1])))
    when.source(*arguments, out)
    return out[0]


def takes_side(function: Callable[..., Any]) -> bool:
    """Whether a function's last parameter is ``side``."""
    try:
        names = list(inspect.signature(function).parameters)
    except (TypeError, ValueError):
        return False
    return names[-1:] == ["side"]


@dataclass(frozen=True, eq=False)
class Switch:
    """A switch of a compiled scene.

    Attributes:
        name: of the force element, in messages.
        place: in x of its side, 1.0 or -1.0.
        value: of the side, t (s), x (nx,), v (nv,): the number whose sign is the side.
        code: tells it from others.
    """

    name: str
    place: int
    value: Callable[[float, float, FloatArray, FloatArray], Any]
    code: str
