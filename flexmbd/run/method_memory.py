"""An integrator's memory beside the state, as arrays by their names: put back from a snapshot or a checkpoint."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from numpy.typing import NDArray

from flexmbd.errors import RecordError

MethodArrays = Mapping[str, NDArray[Any]]


def refuse_other_memory(own: MethodArrays, memory: MethodArrays, *, method: str) -> None:
    """Refuse a checkpoint's arrays that are not those of the method; none are right, for then it has not begun.

    Args:
        own: the method's arrays.
        memory: the checkpoint's.
        method: the method's name.

    Raises:
        RecordError: names, shapes or types differ.
    """
    if not memory:
        return
    if other := sorted(memory.keys() ^ own.keys()):
        raise RecordError(
            f"the checkpoint was written by another version of flexmbd, whose {method} remembers other arrays "
            f"({', '.join(other)}); go on with that version, or start anew"
        )
    for name, here in own.items():
        there = memory[name]
        if (here.shape, here.dtype) != (there.shape, there.dtype):
            raise RecordError(
                f"the checkpoint is damaged: the array {name!r} of {method} has shape {there.shape} and type "
                f"{there.dtype} in place of {here.shape} and {here.dtype}"
            )


def recall(own: MethodArrays, memory: MethodArrays) -> None:
    """Put arrays back into the method's memory."""
    for name, kept in memory.items():
        own[name][...] = kept
