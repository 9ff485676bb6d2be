"""A record that goes to its file from all ranks, none of which holds the groups of the mesh as a whole."""

from __future__ import annotations

import os
from collections.abc import Mapping
from contextlib import ExitStack
from itertools import pairwise
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np

from flexmbd.continuum import parallel
from flexmbd.errors import RecordError
from flexmbd.files.tree_file import Tree, not_written, seal
from flexmbd.files.tree_layout import Reserved, lay_out, put, room_of
from flexmbd.files.whole_file import part_file
from flexmbd.record.file_kind import RECORD
from flexmbd.record.groups import GROUPS, IntArray
from flexmbd.record.reduced_body import ReducedBody
from flexmbd.reduction.spread_groups import AnyArray, SpreadGroup, SpreadRows


def write_record(comm: MPI.Comm, path: str | Path, body: ReducedBody, groups: Mapping[str, SpreadGroup[Any]]) -> None:
    """Write a record with spread groups: to the byte the file that `ReducedBody.save` makes of the whole. Collective.

    Rank 0 lays the file out and writes what it has of the body; then each rank writes its rows to their places. What
    was there survives until the new file is complete, an error or an interrupt on any rank ends it on all.

    Args:
        comm: the ranks, which all see the folder.
        path: destination; a symbolic link is followed. Rank 0's counts.
        body: without these groups, the same on all ranks.
        groups: by their names in the record.

    Raises:
        RecordError: on all ranks: the file cannot be written, or by one rank not, or numbers are not finite.
    """
    tree = _tree(body, groups)
    target, room = Path(os.path.realpath(path)), room_of(tree)
    with ExitStack() as stack:

        def begin() -> tuple[Path, dict[str, int]]:
            try:
                part, file = stack.enter_context(part_file(target))
                return part, lay_out(part, file, tree, kind=RECORD)
            except OSError as error:
                raise not_written(target, error, room=room) from error

        def end() -> None:
            try:
                # opened anew: a network file system need not show what others wrote to one that is open
                file = os.open(part, os.O_RDWR | getattr(os, "O_CLOEXEC", 0))
                try:
                    seal(file, RECORD)
                finally:
                    os.close(file)
                stack.pop_all().close()  # it takes its place
            except OSError as error:
                raise not_written(target, error, room=room) from error

        part, places = parallel.on_root(comm, begin)
        parallel.on_every(comm, lambda: _write_rows(part, places, groups, room=room))
        parallel.on_root(comm, end)


def _tree(body: ReducedBody, groups: Mapping[str, SpreadGroup[Any]]) -> Tree:
    """The record's tree, in the order of `ReducedBody.tree`, with places where rows are to come."""
    known = body.tree()
    whole = {name: item for name, item in known.items() if name not in GROUPS}
    for name in GROUPS:
        if name in groups:
            whole[name] = {key: _place_of(array) for key, array in groups[name].items.items()}
        elif name in known:
            whole[name] = known[name]
    return whole


def _place_of(array: AnyArray | SpreadRows) -> AnyArray | Reserved:
    if isinstance(array, SpreadRows):
        return Reserved((array.count, *array.shape), np.dtype(np.float64))
    return array


def _write_rows(part: Path, places: Mapping[str, int], groups: Mapping[str, SpreadGroup[Any]], *, room: int) -> None:
    """Write this rank's rows. Not collective."""
    try:
        file = os.open(part, os.O_WRONLY | getattr(os, "O_CLOEXEC", 0))
    except OSError as error:
        raise RecordError(
            f"this rank cannot open {part}, which rank 0 has made: {error.strerror or error}; choose a folder that all "
            "ranks see, or save the record by rank 0"
        ) from error
    try:
        for name, group in groups.items():
            for key, array in group.items.items():
                place = places.get(f"/{name}/{key}")
                if isinstance(array, SpreadRows) and place is not None:
                    _write_array(file, place, array, what=f"{group.kind.__name__}: {key}")
    except OSError as error:
        raise not_written(part, error, room=room) from error
    finally:
        os.close(file)


def _write_array(file: int, begin: int, array: SpreadRows, *, what: str) -> None:
    size = 8 * int(np.prod(array.shape))
    for place, values in array.pieces():
        if not np.isfinite(values).all():
            raise RecordError(f"this reduced body is not consistent: {what} holds values that are not finite")
        for run in _runs(place):
            put(file, begin + size * int(place[run.start]), values[run])


def _runs(place: IntArray) -> list[slice]:
    """Stretches of ascending places that follow on each other."""
    ends = np.append(np.flatnonzero(np.diff(place) != 1) + 1, len(place))
    return [slice(int(begin), int(end)) for begin, end in pairwise([0, *ends])]
