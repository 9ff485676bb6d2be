"""Other values in a scene file, by dotted paths: body.crank.mass, force[0].stiffness, simulate.rtol."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from typing import Any

from flexmbd.errors import SceneError
from flexmbd.scene_file.values import nearest
from flexmbd.toml_file import TomlSection, toml_path

_PLURALS = {
    "bodies": "body", "joints": "joint", "forces": "force", "couplings": "coupling", "events": "event",
    "controllers": "controller", "touches": "touch",
}  # fmt: skip


def changed(top: TomlSection, changes: Mapping[str, object]) -> TomlSection:
    """A scene file with other values; those of unknown keys are refused by who reads it, as if they stood in the file.

    Args:
        top: of the file.
        changes: values by dotted paths; tables headed [[body]] and so on are told by their name or their number.

    Raises:
        SceneError: a path leads nowhere; the message names it and the nearest that is there.
    """
    if not changes:
        return top
    values = copy.deepcopy(dict(top.values))
    for path, value in changes.items():
        words = toml_path(path)
        if not words:
            raise SceneError(f"{path!r} is no path to a key, as body.crank.mass, force[0].stiffness or simulate.rtol")
        _change(values, [_PLURALS.get(words[0], words[0]), *words[1:]], value, path)
    return TomlSection(values, top.place, top.file, top.kind)


def _change(values: dict[str, Any], words: list[str], value: object, path: str) -> None:
    at: Any = values
    for depth, word in enumerate(words[:-1]):
        if depth == 0 and word in ("simulate", "output"):
            at = at.setdefault(word, {})
            continue
        at = at[_key(at, word, path)]
    last = words[-1]
    if isinstance(at, dict):
        at[last] = value
    else:
        at[_key(at, last, path)] = value


def _key(at: Any, word: str, path: str) -> str | int:
    """The key or the index that a word of a path means."""
    if isinstance(at, dict):
        if word not in at:
            raise SceneError(f"{path}: there is no {word!r} in the file; {nearest(word, at)}")
        return word
    if isinstance(at, list):
        names = [str(one["name"]) if isinstance(one, dict) and "name" in one else "" for one in at]
        if word in names:
            return names.index(word)
        if word.isdecimal() and int(word) < len(at):
            return int(word)
        told = nearest(word, [name for name in names if name] or [str(k) for k in range(len(at))])
        raise SceneError(f"{path}: there is no {word!r} in the file; {told}")
    raise SceneError(f"{path}: nothing stands below {at!r:.60} in the file, so there is no {word!r}")
