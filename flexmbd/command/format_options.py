"""Options of formats on the command line, `--option fmi=2`: what the writers' own signatures have."""

from __future__ import annotations

import argparse
import difflib
import enum
import inspect
import types
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Union, get_args, get_origin, get_type_hints

from flexmbd.errors import ExportError
from flexmbd.export import FORMATS, Format
from flexmbd.toml_file import toml_value

_WORDS = {int: "a whole number", float: "a number", bool: "true or false", str: "a text", type(None): "nothing"}


def add_options(parser: argparse.ArgumentParser) -> None:
    """Give a parser the argument `--option`."""
    parser.add_argument(
        "--option",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        dest="options",
        help="an option of the format, as fmi=2 or interface=foot, listed below; repeat it",
    )


def options_told() -> str:
    """The options of all formats, with their defaults, a line each."""
    lines = []
    for one in FORMATS:
        for what, call in _calls(one):
            told = [f"{name}={_default(found.default)}" for name, found in _options(call).items()]
            if told:
                lines.append(f"  {what}: {', '.join(told)}")
    return "\n".join(lines)


def given_options(chosen: Format, words: Sequence[str], *, with_deck: bool) -> tuple[dict[str, Any], dict[str, Any]]:
    """Arguments for a format's writer and for that of its deck, of NAME=VALUE each.

    Raises:
        ExportError: the format has no such option, or its value is of another kind.
    """
    calls = [call for what, call in _calls(chosen) if with_deck or call is chosen.write]
    known = [_options(call) for call in calls]
    found: tuple[dict[str, Any], dict[str, Any]] = {}, {}
    for word in words:
        name, equals, text = (part.strip() for part in word.partition("="))
        if not (name and equals and text):
            raise ExportError(f"--option takes NAME=VALUE, as fmi=2, got {word!r}")
        takers = [k for k, options in enumerate(known) if name in options]
        if not takers:
            raise ExportError(f"{chosen.name} has no option {name!r}; {_meant(name, known)}")
        for k in takers:
            found[k][name] = _value(get_type_hints(calls[k]).get(name, Any), text, f"option {name} of {chosen.name}")
    return found


def _calls(one: Format) -> list[tuple[str, Callable[..., Any]]]:
    """What writes the format's files, by what to call it."""
    deck = [(f"{one.name} --deck", one.deck)] if one.deck is not None else []
    return [(one.name, one.write), *deck]


def _options(call: Callable[..., Any]) -> dict[str, inspect.Parameter]:
    found = inspect.signature(call).parameters
    return {name: one for name, one in found.items() if one.kind is one.KEYWORD_ONLY and name != "lossy"}


def _meant(name: str, known: Sequence[Mapping[str, object]]) -> str:
    names = [one for options in known for one in options]
    near = difflib.get_close_matches(name, names, n=1)
    return f"did you mean {near[0]!r}?" if near else f"it has {', '.join(names) or 'none'}"


def _default(value: object) -> str:
    if isinstance(value, enum.Enum):
        return value.name.lower() if isinstance(value.value, str) else str(value.value)
    if isinstance(value, bool):
        return str(value).lower()
    if value is None:
        return "(none)"
    return "[]" if value == () else str(list(value)) if isinstance(value, tuple) else str(value)


def _value(kind: Any, text: str, what: str) -> Any:
    """A value of a type, from its text.

    Raises:
        ExportError: it is of another type.
    """
    try:
        return _fitting(kind, toml_value(text), text)
    except (TypeError, ValueError) as reason:
        raise ExportError(f"{what} must be {_told(kind)}, got {text!r}") from reason


def _fitting(kind: Any, value: Any, text: str) -> Any:
    """A value as a type asks for it; ValueError where it is of another."""
    if kind is Any:
        return value
    if get_origin(kind) in (Union, types.UnionType):
        for one in get_args(kind):
            try:
                return _fitting(one, value, text)
            except ValueError:
                continue
        raise ValueError
    if get_origin(kind) is not None and issubclass(get_origin(kind), Sequence) and isinstance(value, list):
        return tuple(_fitting(get_args(kind)[0], one, str(one)) for one in value)
    if isinstance(kind, type) and issubclass(kind, enum.Enum):
        for one in kind:
            if value in (one.value, one.name, one.name.lower()):
                return one
        raise ValueError
    if kind is str:
        return value if isinstance(value, str) else text
    if kind is float and isinstance(value, int) and not isinstance(value, bool):
        return float(value)
    if isinstance(kind, type) and type(value) is kind:
        return value
    raise ValueError


def _told(kind: Any) -> str:
    if get_origin(kind) in (Union, types.UnionType):
        return " or ".join(dict.fromkeys(_told(one) for one in get_args(kind) if one is not type(None)))
    if get_origin(kind) is not None:
        return f"a list, as [1, 2], each {_told(get_args(kind)[0])}"
    if isinstance(kind, type) and issubclass(kind, enum.Enum):
        return f"one of {', '.join(_default(one) for one in kind)}"
    return _WORDS.get(kind, str(kind))
