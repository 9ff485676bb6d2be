"""Which of the named groups of a file are taken."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from pathlib import Path
from typing import TypeVar

from flexmbd.errors import MeshError

T = TypeVar("T")


def chosen(
    kind: str, there: Mapping[str, T], names: Collection[str] | None, path: Path | None = None
) -> dict[str, T]:
    """Those of the groups that are to be taken; not collective.

    Args:
        kind: "cell" or "facet", for the message.
        there: the groups by their names.
        names: to take; None for all.
        path: of the file, for the message.

    Raises:
        MeshError: a name is not there.
    """
    if names is None:
        return dict(there)
    for name in names:
        if name not in there:
            known = ", ".join(repr(known) for known in sorted(there)) or "none"
            where = "" if path is None else f"{path}: "
            raise MeshError(f"{where}there is no {kind} group {name!r}; its {kind} groups are: {known}")
    return {name: there[name] for name in names}
