"""Passes over many cells: blocks of them by vector registers, in one thread or several.

What is computed is the same to the bit for any number of lanes and of threads.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from typing import Any

from mpi4py import MPI

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum.history.lane_field_loop import pass_field_blocks
from flexmbd.continuum.history.lane_library import common_lanes, lane_kernel, work_of_kernel
from flexmbd.continuum.history.lane_loop import LaneRoom, block_totals, pass_blocks, sum_kept
from flexmbd.continuum.history.point_loop import LAW, CellUnknowns, Fields, Kernels, Room
from flexmbd.errors import FormulationError

FloatArray = NDArray[np.float64]
Indices = NDArray[np.int32]

#: Statements of all kernels for all cells: a body of fewer, half a millisecond a pass, is not worth the second in which
#: kernels for lanes are compiled.
LEAST_WORK = 2_000_000

_MOST_THREADS = 1024  # more than any computer has cores for


def check_threads(threads: int) -> None:
    """Refuse what is no number of threads.

    Raises:
        FormulationError: says so.
    """
    if not 1 <= threads <= _MOST_THREADS:
        raise FormulationError(f"threads must be a number from 1 to {_MOST_THREADS}, got {threads!r}")


class LanePass:
    """Passes over the cells of one group on this rank.

    Attributes:
        threads: among which they are shared; any number, the results are the same.
    """

    def __init__(
        self,
        cells: Indices,
        blocks: Indices,
        width: int,
        *,
        kernels: Kernels,
        room: Room,
        inner: CellUnknowns,
        lanes: int,
        keep: Any,
    ) -> None:
        """Not collective.

        Args:
            cells: of the group.
            blocks: (all cells, m) of the unknowns' dofs.
            width: dofs of a block.
            kernels: for lanes.
            room: in which one cell is worked on.
            inner: fields of one cell.
            lanes: cells of a block.
            keep: what the kernels' addresses lie in.
        """
        self._cells, self._blocks, self._width, self._kernels = cells, blocks, width, kernels
        self._room, self._inner, self._lanes, self._held = room, inner, lanes, keep
        self.threads = 1
        self._rooms: list[LaneRoom] = []
        self._kept: FloatArray = np.zeros((0, 1))
        self._starts: NDArray[np.int64] = np.zeros(0, dtype=np.int64)
        self._places: NDArray[np.int64] = np.zeros(0, dtype=np.int64)
        self._left = np.zeros(len(cells), dtype=np.int64)

    def run(
        self,
        fields: Fields,
        nodes: Indices,
        x: FloatArray,
        forces: FloatArray,
        *,
        sweeps: int,
        tolerance: float,
        accuracy: float,
    ) -> Indices:
        """Evaluate, and add the internal forces; not collective.

        Args:
            fields: what is read and written.
            nodes: (all cells, n) of the geometry.
            x: (nodes, 3) m.
            forces: (dofs,) N, to which they are added.
            sweeps: the most local Newton steps.
            tolerance: change of the local unknowns over their sizes at which they end.
            accuracy: of a cell's forces, to which its own fields are solved for.

        Returns:
            The cells whose local unknowns were not solved for, or whose own fields have no tangent yet, and of which
            nothing was added or kept.
        """
        self._left[:] = 0
        self._prepare(nodes.shape[1])

        def part(first: int, last: int, room: LaneRoom) -> None:
            if self._inner.places.size:
                pass_field_blocks(
                    self._cells, first, last, nodes, x, self._blocks, self._width, fields, self._kernels, room,
                    self._inner, forces, self._kept, self._left, sweeps, tolerance, accuracy,
                )  # fmt: skip
                return
            pass_blocks(
                self._cells, first, last, nodes, x, self._blocks, self._width, fields, self._kernels, room, forces,
                self._kept, self._left, sweeps, tolerance,
            )  # fmt: skip

        self._share(-(-len(self._cells) // self._lanes), part)
        rows = np.flatnonzero(self._left)
        if self.threads > 1:
            self._kept[rows] = 0.0
            self._share(
                len(self._starts) - 1,
                lambda first, last, _: sum_kept(
                    first, last, self._starts, self._places, self._kept, self._width, forces
                ),
            )
        return self._cells[rows]

    def totals(
        self, fields: Fields, own: FloatArray, nodes: Indices, x: FloatArray, kernels: Kernels, *, count: int
    ) -> FloatArray:
        """Sums over the cells of what kernels integrate, (count,); not collective.

        Args:
            fields: what is read.
            own: (all cells, m) the fields of one cell.
            nodes: (all cells, n) of the geometry.
            x: (nodes, 3) m.
            kernels: that of the mean, and in the place of those of forces what integrates, for the same lanes.
            count: of its numbers.
        """
        self._prepare(nodes.shape[1])
        found = np.zeros((len(self._cells), count))

        def part(first: int, last: int, room: LaneRoom) -> None:
            block_totals(
                self._cells, first, last, nodes, x, self._blocks, self._width, fields, kernels, room, self._inner, own,
                found,
            )  # fmt: skip

        self._share(-(-len(self._cells) // self._lanes), part)
        return np.asarray(found.sum(axis=0))

    def in_lanes(self, comm: MPI.Comm, kernels: Kernels, modules: Sequence[Any]) -> Kernels | None:
        """Further kernels for the lanes of this pass; None where they cannot be had. Collective, compiles.

        Args:
            comm: of the body.
            kernels: for one cell.
            modules: as in `lane_pass`.
        """
        if self._lanes == 1:
            return kernels
        found = _all_in_lanes(comm, modules, lanes=self._lanes)
        if found is None:
            return None
        self._held = (self._held, found)
        return _with_addresses(kernels, found)

    def _share(self, count: int, task: Callable[[int, int, LaneRoom], None]) -> None:
        """Let each thread do its part of so many things."""
        if self.threads == 1:
            task(0, count, self._rooms[0])
            return
        bounds = [count * k // self.threads for k in range(self.threads + 1)]
        list(_pool(self.threads).map(task, bounds[:-1], bounds[1:], self._rooms))

    def _prepare(self, nodes: int) -> None:
        """Rooms for the threads, and where they keep forces."""
        if len(self._rooms) == self.threads:
            return
        self._rooms = [_lane_room(self._room, self._inner, self._lanes, nodes) for _ in range(self.threads)]
        self._kept = np.zeros((0, 1))
        if self.threads > 1:
            dofs = self._blocks[self._cells]
            counted = np.bincount(dofs.ravel()) if dofs.size else np.zeros(0, dtype=np.int64)
            self._starts = np.concatenate([[0], np.cumsum(counted)]).astype(np.int64)
            self._places = np.argsort(dofs.ravel(), kind="stable").astype(np.int64)
            self._kept = np.zeros((len(self._cells), self._width * self._blocks.shape[1]))


def lane_pass(
    comm: MPI.Comm,
    cells: Indices,
    *,
    blocks: Indices,
    width: int,
    modules: Sequence[Any],
    kernels: Kernels,
    room: Room,
    inner: CellUnknowns,
) -> LanePass | None:
    """The passes over a group's cells in lanes; None where there is little to do. Collective, compiles.

    Args:
        comm: of the body.
        cells: of the group on this rank.
        blocks: (all cells, m) of the unknowns' dofs.
        width: dofs of a block.
        modules: of FFCx, of the kernels; None for those that are none of its.
        kernels: for one cell.
        room: in which one cell is worked on.
        inner: fields of one cell.
    """
    of_cell = sum(work_of_kernel(module) for module in modules if module is not None)
    if comm.allreduce(len(cells) * of_cell) < LEAST_WORK:
        return None
    lanes = common_lanes(comm)
    found = _all_in_lanes(comm, modules, lanes=lanes)
    if found is None:
        return LanePass(cells, blocks, width, kernels=kernels, room=room, inner=inner, lanes=1, keep=modules)
    wide = _with_addresses(kernels, found)
    keep = (found, modules)
    return LanePass(cells, blocks, width, kernels=wide, room=room, inner=inner, lanes=lanes, keep=keep)


def _with_addresses(kernels: Kernels, found: Sequence[Any]) -> Kernels:
    """The same with the addresses of those that were found in lanes; the law is that of a point."""
    addresses = np.array([0 if one is None else one[0] for one in found], dtype=np.int64)
    addresses[LAW] = kernels.addresses[LAW]
    return kernels._replace(addresses=addresses)


def _all_in_lanes(comm: MPI.Comm, modules: Sequence[Any], *, lanes: int) -> list[Any] | None:
    """The kernels of FFCx's modules in lanes, None for each that is none; None unless all are had. Collective."""
    found: list[Any] = []
    for turn in (comm.rank == 0, comm.rank != 0):  # the first compiles for all
        if turn:
            found = [None if module is None else lane_kernel(module, lanes=lanes) for module in modules]
        comm.barrier()
    lacks = any(module is not None and one is None for module, one in zip(modules, found, strict=True))
    return None if comm.allreduce(lacks, op=MPI.LOR) else found


def _lane_room(one: Room, inner: CellUnknowns, lanes: int, nodes: int) -> LaneRoom:
    rows = len(one.row)
    apart = Room._make(part.copy() for part in one)
    return LaneRoom(
        cells=np.zeros(lanes, dtype=np.int64),
        coordinates=np.zeros((3 * nodes, lanes)),
        row=np.zeros((rows, lanes)),
        given=np.zeros((rows, lanes)),
        tensor=np.zeros((len(one.tensor), lanes)),
        sizes=np.zeros((lanes, *one.sizes.shape)),
        before=np.zeros(lanes),
        one=apart,
        found=np.zeros(lanes, dtype=np.int64),
        values=np.zeros((lanes, len(inner.places))),
        force=np.zeros((lanes, len(inner.force))),
        change=np.zeros((lanes, len(inner.places))),
        step=np.zeros((lanes, len(inner.places))),
        moved=np.zeros((lanes, len(inner.moved))),
        search=np.zeros((lanes, 4)),
        lacks=np.zeros((lanes, 2, len(inner.places))),
    )


@cache
def _pool(threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads, thread_name_prefix="flexmbd cells")
