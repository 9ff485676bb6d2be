"""Checks of the dimensions a part is asked for, on all ranks."""

from __future__ import annotations

import math
import numbers
import os
from collections.abc import Callable, Collection, Mapping
from typing import Any

from mpi4py import MPI

from flexmbd.continuum import parallel
from flexmbd.errors import MeshError
from flexmbd.files.memory import available_memory
from flexmbd.given import checked, is_number

#: What gmsh and DOLFINx keep of one cell at least, bytes: its corners' numbers in both and their places.
_CELL = 100


def _told_to_all(arguments: Mapping[str, Any], fault: str) -> str:
    """What is wrong on the lowest rank on which anything is; of a communicator that is none, here alone. Collective."""
    parts = arguments.get("parts")
    part = next(iter(parts.values()), None) if isinstance(parts, Mapping) else arguments.get("part")
    comm = arguments.get("comm", MPI.COMM_WORLD if part is None else getattr(part, "comm", None))
    if not isinstance(comm, MPI.Comm) or comm == MPI.COMM_NULL:
        return fault or f"comm must be a communicator of MPI, as MPI.COMM_WORLD, got {comm!r:.100}"
    return parallel.told_to_all({"comm": comm}, fault)


#: For functions that make meshes: what is neither a size nor a choice is of its annotation's type, on all ranks.
checked_part = checked(
    "part", "parts", "path", "points", "beams", "solid", "glue", "teeth", "fine", "pressure_angle", "backlash", "comm",
    error=MeshError, agree=_told_to_all,
)  # fmt: skip


def check_arguments(
    comm: MPI.Comm, arguments: Mapping[str, object], check: Callable[[], None]
) -> None:
    """Refuse bad arguments, and arguments that differ between ranks. Collective.

    Args:
        comm: the ranks.
        arguments: by their names; the communicator itself is left out, and functions are not
            compared.
        check: raises a MeshError if the arguments are bad.

    Raises:
        MeshError: on all ranks, that of the lowest rank; or a name and two values of it.
    """
    error: str | None = None
    try:
        check()
    except MeshError as caught:
        error = str(caught)
    plain = {name: _plain(value) for name, value in arguments.items() if name != "comm"}
    heard = comm.allgather((error, plain))
    first = heard[0][1]
    for name in plain:
        for rank, (_, theirs) in enumerate(heard):
            if theirs[name] != first[name]:
                raise MeshError(
                    f"{name} is {first[name]} on rank 0 and {theirs[name]} on rank {rank}; "
                    "give the same on all ranks"
                )
    if error is not None:
        raise MeshError(error)


def _plain(value: object) -> str:
    """A text that is the same for the same value, whatever type of number it is."""
    if isinstance(value, numbers.Real):
        return repr(float(value)) if not isinstance(value, numbers.Integral) else repr(int(value))
    if isinstance(value, Mapping):
        return f"{{{', '.join(f'{key!r}: {_plain(item)}' for key, item in value.items())}}}"
    if isinstance(value, tuple | list):
        return f"({', '.join(_plain(item) for item in value)})"
    if callable(value):
        return "a function"
    return repr(str(value)) if isinstance(value, os.PathLike) else repr(value)


def require_positive(**lengths: float) -> None:
    """Refuse a length that is not a positive, finite number; not collective.

    Args:
        **lengths: values in m, by the names the caller knows them by.

    Raises:
        MeshError: names the first length that is at fault.
    """
    for name, value in lengths.items():
        if not is_number(value) or not 0 < value < math.inf:
            raise MeshError(f"{name} must be a positive, finite length in m, got {value!r}")


def require_fitting(h: float, lengths: Mapping[str, float]) -> None:
    """Refuse cells that are larger than a part in every direction, as millimetres beside metres; not collective.

    Raises:
        MeshError: names the sizes.
    """
    if h > max(lengths.values()):
        others = ", ".join(f"{name} {value:g} m" for name, value in lengths.items())
        raise MeshError(f"h = {h:g} m exceeds {others}: sizes do not fit together; give all of them in metres")


def require_degree(degree: int) -> None:
    """Refuse a degree of the geometry other than 1 and 2; not collective.

    Raises:
        MeshError: names the degree.
    """
    if not is_number(degree) or degree not in (1, 2):
        raise MeshError(f"degree of the geometry must be 1 or 2, got {degree!r}")


def require_cell(
    cell: str, *, known: tuple[str, str] = ("tetrahedron", "hexahedron")
) -> None:
    """Refuse a cell other than those known; not collective.

    Raises:
        MeshError: names the cell.
    """
    if not isinstance(cell, str) or cell not in known:
        raise MeshError(f'cell must be "{known[0]}" or "{known[1]}", got {cell!r}')


def require_counts(name: str, counts: object, *, number: int) -> None:
    """Refuse what is not a tuple of that many positive whole numbers; not collective.

    Raises:
        MeshError: names the counts by `name`.
    """
    if (
        not isinstance(counts, tuple | list)
        or len(counts) != number
        or not all(isinstance(n, numbers.Integral) and is_number(n) and int(n) > 0 for n in counts)
    ):
        words = {2: "two", 3: "three", 4: "four"}
        raise MeshError(f"{name} must be {words[number]} positive whole numbers, got {counts!r}")
    require_room(name, math.prod(map(int, counts)))


def require_names(name: str, names: object, *, example: str) -> None:
    """Refuse what is not a list of texts that are not empty; not collective.

    Raises:
        MeshError: names the list by `name`.
    """
    if not isinstance(names, Collection) or isinstance(names, str) or not all(isinstance(n, str) and n for n in names):
        raise MeshError(f"{name} must be a list of names, as {example}, got {names!r}")


def require_count(name: str, count: object) -> None:
    """Refuse what is not a positive whole number; not collective.

    Raises:
        MeshError: names the count by `name`.
    """
    if not isinstance(count, numbers.Integral) or not is_number(count) or int(count) <= 0:
        raise MeshError(f"{name} must be a positive whole number, got {count!r}")
    require_room(name, int(count))


def require_memory(h: float, *sides: float) -> None:
    """Refuse cells of size h (m) too many of which fill a box of these sides (m) of the part; not collective.

    Raises:
        MeshError: names h.
    """
    require_room(f"h = {h:g} m", math.prod(max(1.0, side / h) for side in sides))


def require_room(name: str, cells: float) -> None:
    """Refuse so many cells that what is kept of them exceeds the memory that is free; not collective.

    Args:
        name: what makes them, in the message.
        cells: their number, about.

    Raises:
        MeshError: names it.
    """
    free = available_memory()
    if free is not None and cells * _CELL > free:
        raise MeshError(f"{name} makes {cells:.3g} cells, more than memory holds ({free / 1e9:.3g} GB are free)")


def intervals(length: float, h: float) -> int:
    """Number of equal intervals, each up to `h` long, that a length is divided into."""
    return max(1, math.ceil(length / h * (1 - 1e-12)))
