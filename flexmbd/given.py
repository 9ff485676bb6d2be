"""Arguments from users: `checked` reads off its annotations what a public function or constructor takes.

What checks single values stands in `given_values`, and is offered here as well.
"""

from __future__ import annotations

import builtins
import inspect
import math
import numbers as kinds_of_numbers
import os
import sys
from collections.abc import Callable, Collection, Iterable, Mapping
from functools import wraps
from types import NoneType, UnionType
from typing import Any, Literal, NamedTuple, TypeVar, Union, get_args, get_origin

import numpy as np
from numpy.typing import ArrayLike

from flexmbd.errors import FlexmbdError, OutOfMemoryError, SceneError, out_of_memory
from flexmbd.given_values import FloatArray as FloatArray
from flexmbd.given_values import is_list as is_list
from flexmbd.given_values import is_number as is_number
from flexmbd.given_values import is_truth as is_truth
from flexmbd.given_values import numbers as numbers
from flexmbd.given_values import refuse_no_function as refuse_no_function
from flexmbd.given_values import refuse_no_name as refuse_no_name
from flexmbd.given_values import refuse_no_truth as refuse_no_truth
from flexmbd.given_values import refuse_other as refuse_other
from flexmbd.given_values import shaped_numbers as shaped_numbers
from flexmbd.given_values import shown as shown

T = TypeVar("T")


class _Asked(NamedTuple):
    """What an annotation asks for.

    Attributes:
        wanted: in words.
        fits: whether a value is of it.
        real: whether a number that fits becomes a float: a whole one may be too large for others, and would have
            kernels compiled of its own.
    """

    wanted: str
    fits: Callable[[Any], bool]
    real: bool = False

    def taken(self, value: Any) -> Any:
        """The value as the function gets it."""
        return float(value) if self.real and type(value) is not float and is_number(value) else value


class _Numbers:
    """Stands for ArrayLike and arrays, which are unions of a dozen classes."""


class _Scope(dict[str, Any]):
    """Names in annotations; what is imported for type checkers alone is open."""

    def __missing__(self, name: str) -> Any:
        if hasattr(builtins, name):
            raise KeyError(name)
        return Any


_MARKERS = {"ArrayLike": _Numbers, "FloatArray": _Numbers}


def checked(
    *names: str,
    but: Collection[str] = (),
    error: type[FlexmbdError] = SceneError,
    agree: Callable[[Mapping[str, Any], str], str] | None = None,
) -> Callable[[T], T]:
    """Check the arguments of a public function, or of a class's constructor, by their annotations, before it begins.

    A float is one finite number, and reaches the function as a float; an int is a whole one, a bool True or False, an
    ArrayLike finite numbers of any shape; a Sequence, tuple or Mapping holds what it says; of a class objects, not the
    class.  What an annotation leaves open, and ranges, are the function's own to check.  An argument's default is
    always right.

    Args:
        *names: the parameters that are checked; all without any.  Numbers given for floats become such all the same.
        but: parameters that are not.
        error: the kind of error.
        agree: called with the arguments, by names, and what is wrong with them, empty where nothing is; returns what
            all ranks are to be told.  For collective functions, in which no rank may stop alone.

    Raises:
        FlexmbdError: of that kind, naming parameter, value and what is wanted; on each rank that is given the value.
    """

    def is_checked(name: str) -> bool:
        return (not names or name in names) and name not in but

    def decorate(thing: T) -> T:
        if isinstance(thing, type):
            thing.__init__ = _wrapped(thing.__init__, thing.__name__, is_checked, error, agree)  # type: ignore[misc]
            return thing
        return _wrapped(thing, thing.__qualname__, is_checked, error, agree)  # type: ignore[attr-defined]

    return decorate


def _wrapped(
    function: Any,
    label: str,
    is_checked: Callable[[str], bool],
    error: type[FlexmbdError],
    agree: Callable[[Mapping[str, Any], str], str] | None,
) -> Any:
    asked: dict[str, _Asked] = {}
    order: list[_Asked | None] = []

    def said(kind: _Asked, value: object) -> str:
        name = next(name for name, one in asked.items() if one is kind)
        return f"{name} must be {kind.wanted}, got {' '.join(repr(value).split()):.100}"

    def fault(args: tuple[Any, ...], kwargs: dict[str, Any]) -> str:
        for kind, value in zip(order, args, strict=False):
            if kind is not None and not kind.fits(value):
                return f"{_called(function, label, args)}: {said(kind, value)}"
        for name, value in kwargs.items():
            if name in asked and not asked[name].fits(value):
                return f"{_called(function, label, args)}: {said(asked[name], value)}"
        return ""

    @wraps(function)
    def wrapper(*args: Any, **kwargs: Any) -> Any:
        if not order:  # at the first call: only then is all imported that annotations name
            _learn(function, is_checked, asked, order)
        found = fault(args, kwargs)
        if agree is not None:
            arguments = inspect.signature(function).bind(*args, **kwargs).arguments
            if function.__name__ == "__init__":  # what is not made yet can be asked nothing
                arguments.pop(next(iter(arguments)))
            found = agree(arguments, found)
        if found:
            raise error(found)
        plain = [value if kind is None else kind.taken(value) for kind, value in zip(order, args, strict=False)]
        named = {name: asked[name].taken(value) if name in asked else value for name, value in kwargs.items()}
        try:
            return function(*plain, *args[len(plain) :], **named)
        except OutOfMemoryError:
            raise
        except MemoryError as reason:
            raise out_of_memory(_called(function, label, args), reason) from reason

    return wrapper


def _called(function: Any, label: str, args: tuple[Any, ...]) -> str:
    """A function's name in messages: a method's by the class of its object, which may have inherited it."""
    is_method = function.__name__ != "__init__" and function.__code__.co_varnames[:1] in (("self",), ("cls",))
    if not (is_method and args):
        return label
    owner = args[0] if isinstance(args[0], type) else type(args[0])
    return f"{owner.__name__}.{function.__name__}"


def _learn(
    function: Any, is_checked: Callable[[str], bool], asked: dict[str, _Asked], order: list[_Asked | None]
) -> None:
    """Find what a function's parameters ask for: by name, and of those given by place in their order."""
    scope = vars(sys.modules[function.__module__]) if function.__module__ in sys.modules else function.__globals__
    for parameter in inspect.signature(function).parameters.values():
        if parameter.kind in (parameter.VAR_POSITIONAL, parameter.VAR_KEYWORD):
            continue
        kind = _annotated(parameter.annotation, scope)
        if kind is not None and not is_checked(parameter.name):  # the function's own to check
            kind = _Asked(kind.wanted, lambda value: True, real=True) if kind.real else None
        if kind is not None:
            asked[parameter.name] = _or_default(kind, parameter.default)
        if parameter.kind is not parameter.KEYWORD_ONLY:
            order.append(asked.get(parameter.name))
    order.append(None)


def _or_default(kind: _Asked, default: object) -> _Asked:
    return _Asked(kind.wanted, lambda value: value is default or kind.fits(value), kind.real)


def _annotated(annotation: Any, scope: Mapping[str, Any]) -> _Asked | None:
    """What an annotation asks for; None for one that is open, or whose names are there for type checkers alone."""
    if isinstance(annotation, str):
        try:
            annotation = eval(annotation, {}, _Scope({**scope, **_MARKERS}))  # noqa: S307  (the package's own words)
        except (AttributeError, TypeError):
            return None
    return _kind(annotation)


def _kind(asked: Any) -> _Asked | None:
    origin, parts = get_origin(asked), get_args(asked)
    if origin is np.ndarray or asked == ArrayLike:
        return None
    if origin is None and isinstance(asked, type) and asked in _PLAIN:
        return _PLAIN[asked]
    if origin in (Union, UnionType):
        return _either([_kind(part) for part in parts])
    if origin is Literal:
        return _Asked(" or ".join(map(repr, parts)), lambda value: isinstance(value, str | int) and value in parts)
    if origin is Callable or asked is Callable:
        return _Asked("a function", lambda value: callable(value) and not isinstance(value, type))
    if origin is tuple:
        return _row([_kind(part) for part in parts]) if parts[-1:] != (...,) else _several(_kind(parts[0]))
    if isinstance(origin, type) and issubclass(origin, Mapping):
        return _mapping(*map(_kind, parts))
    if origin is Iterable:
        return _iterable(_kind(parts[0]) if parts else None)
    if isinstance(origin, type) and issubclass(origin, Collection):
        return _several(_kind(parts[0]))
    if not isinstance(asked, type) or asked in (object, Any, inspect.Parameter.empty):
        return None
    if getattr(asked, "_is_protocol", False) and not getattr(asked, "_is_runtime_protocol", False):
        return None
    return _Asked(f"a {asked.__name__}", lambda value: not isinstance(value, type) and isinstance(value, asked))


def _is_finite(value: object) -> bool:
    return math.isfinite(value) if type(value) is float else is_number(value)


def _is_whole(value: object) -> bool:
    return isinstance(value, kinds_of_numbers.Integral) and not is_truth(value)


def _is_path(value: object) -> bool:
    return isinstance(value, str | os.PathLike) and "\0" not in str(value) and str(value) != ""


def _are_finite(value: object) -> bool:
    return bool(np.isfinite(numbers(value)).all())


def _either(kinds: list[_Asked | None]) -> _Asked | None:
    known = [kind for kind in kinds if kind is not None]
    if len(known) < len(kinds):
        return None
    if _PLAIN[os.PathLike] in known or any(kind.wanted == "a Path" for kind in known):  # of which str is a part
        known = [_PLAIN[os.PathLike], *(kind for kind in known if kind.wanted not in ("a text", "a Path"))]
    wanted = " or ".join(dict.fromkeys(kind.wanted for kind in known))
    real = _PLAIN[float] in known and _PLAIN[int] not in known
    return _Asked(wanted, lambda value: any(kind.fits(value) for kind in known), real)


def _several(kind: _Asked | None) -> _Asked:
    of = "" if kind is None else f", each {kind.wanted}"
    return _Asked(f"a list{of}", lambda value: is_list(value) and (kind is None or all(map(kind.fits, value))))


def _iterable(kind: _Asked | None) -> _Asked:
    """Something to go through once; what lies there already is looked at, and a text stands for its letters."""
    of = "" if kind is None else f", each {kind.wanted}"
    return _Asked(
        f"a list{of}",
        lambda value: (
            isinstance(value, Iterable)
            and not isinstance(value, bytes | np.ndarray)
            and (kind is None or not isinstance(value, list | tuple | set) or all(map(kind.fits, value)))
        ),
    )


def _row(kinds: list[_Asked | None]) -> _Asked:
    wanted = ", ".join("anything" if kind is None else kind.wanted for kind in kinds)
    return _Asked(
        f"a tuple of {len(kinds)}: {wanted}",
        lambda value: (
            is_list(value)
            and len(value) == len(kinds)
            and all(kind is None or kind.fits(one) for kind, one in zip(kinds, value, strict=True))
        ),
    )


def _mapping(key: _Asked | None = None, item: _Asked | None = None) -> _Asked:
    of = " to ".join("anything" if kind is None else kind.wanted for kind in (key, item))
    return _Asked(
        f"a mapping of {of}",
        lambda value: (
            isinstance(value, Mapping)
            and (key is None or all(map(key.fits, value)))
            and (item is None or all(map(item.fits, value.values())))
        ),
    )


_PLAIN: dict[Any, _Asked] = {
    float: _Asked("a finite number", _is_finite, real=True),
    int: _Asked("a whole number", _is_whole),
    bool: _Asked("True or False", lambda value: is_truth(value) and not isinstance(value, np.ndarray)),
    str: _Asked("a text", lambda value: isinstance(value, str)),
    NoneType: _Asked("None", lambda value: value is None),
    os.PathLike: _Asked("a path", _is_path),
    _Numbers: _Asked("finite numbers", _are_finite),
}
