"""Collective-safe errors, work on one rank, gathering, and the MPI team of a machine.

An error on one rank alone leaves the others waiting for ever in their next collective call; every
function here therefore raises on all ranks or on none.
"""

from __future__ import annotations

import contextlib
import os
import pickle
import signal
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Protocol, TypeVar, runtime_checkable

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from flexmbd.errors import FlexmbdError
from flexmbd.given import checked, is_number, numbers, shown
from flexmbd.libraries import has_mpi_workers

T = TypeVar("T")

_ROOT = 0
# The process in which MPI was started.
_PROCESS = os.getpid()
# How a rank waits: it looks whether the others have come, and sleeps this share of the time that it has waited so far,
# this long (s) at most.
_SHARE, _NAP = 0.02, 0.02
# Messages of rank 0's `MpiTeam.tell`: their tag, and those that may be on their way.
_TOLD = 32_119
_UNREAD: list[MPI.Request] = []
# Bytes in one message; MPI counts them in 32 bits.
_MESSAGE = 1 << 30


def python_takes_broken_pipes() -> None:
    """Put Python's own answer to SIGPIPE back, for PETSc's start replaced it by an abort of all ranks. Not collective.

    A script that prints into ``| head`` then ends as any other.  Outside the main thread, which alone may, nothing.
    """
    with contextlib.suppress(ValueError):
        signal.signal(signal.SIGPIPE, signal.getsignal(signal.SIGPIPE))


def refuse_absent_ranks(comm: MPI.Comm) -> None:
    """Refuse what needs other ranks where these are not there. Not collective.

    To them a process that was forked from a rank is not there: they would wait for its parent, and it for them, without
    end.  So would rank 0 for ranks that are workers of mpi4py.futures.

    Raises:
        FlexmbdError: it is such a process.
    """
    if comm.size == 1:
        return
    if os.getpid() != _PROCESS:
        raise FlexmbdError(
            f"this process was forked from rank {comm.rank} of {comm.size} after MPI had started, and is not one of "
            "the ranks: it can do what a single process does (comm=MPI.COMM_SELF), or start workers by "
            "multiprocessing's 'spawn'"
        )
    if has_mpi_workers() and MPI.Comm.Compare(comm, MPI.COMM_WORLD) in (MPI.IDENT, MPI.CONGRUENT):
        raise FlexmbdError(
            f"rank {comm.rank} of {comm.size} would wait for the others without end, for they are workers of "
            "mpi4py.futures: give comm=MPI.COMM_SELF to meshes, so that one process does what is to be done"
        )


def raise_collectively(comm: MPI.Comm, error: Exception | None) -> None:
    """Raise on every rank if any rank has an error. Collective.

    Args:
        comm: the ranks that take part.
        error: this rank's error, or None.

    Raises:
        Exception: of the type and text of the lowest failing rank's error, and naming that rank;
            on one rank the error itself. A type that cannot be rebuilt from its text becomes a
            RuntimeError that names it.
    """
    if comm.size == 1:
        if error is not None:
            raise error
        return
    refuse_absent_ranks(comm)
    failures = [
        (rank, failure)
        for rank, failure in enumerate(comm.allgather(_portable(error)))
        if failure is not None
    ]
    if failures:
        rank, failure = failures[0]
        kind, text = pickle.loads(failure)  # noqa: S301  (from our own ranks)
        raise kind(f"{text} (on rank {rank} of {comm.size})") from error


@checked()
def on_root(comm: MPI.Comm, function: Callable[[], T]) -> T:
    """Run `function` on rank 0 only and hand its result to every rank. Collective.

    The other ranks sleep meanwhile, where a collective call of MPI would keep their processors busy.

    Args:
        comm: the ranks that take part.
        function: takes nothing; its result must be picklable.

    Raises:
        Exception: whatever `function` raised, on every rank; an interrupt (Ctrl-C) as itself on its own rank.
        SceneError: no communicator, or no function; on the rank that is given it.
    """
    refuse_absent_ranks(comm)
    result = b""
    error: BaseException | None = None
    if comm.rank == _ROOT:
        try:
            # pickled here, because a failure inside bcast would leave the others waiting
            result = pickle.dumps(function(), protocol=pickle.HIGHEST_PROTOCOL)
        except BaseException as caught:  # noqa: BLE001  (whatever it is, all ranks must hear of it)
            error = caught
    _end_for_all(comm, error, "while rank 0 worked for all")
    value: T = pickle.loads(_broadcast(comm, result))  # noqa: S301
    return value


def on_every(comm: MPI.Comm, function: Callable[[], object]) -> None:
    """Run `function`, which is not collective, on every rank; an error on one rank is raised on all. Collective.

    Args:
        comm: the ranks that take part.
        function: takes nothing.

    Raises:
        Exception: as `raise_collectively` does; an interrupt (Ctrl-C) as itself on its own rank.
    """
    refuse_absent_ranks(comm)
    error: BaseException | None = None
    try:
        function()
    except BaseException as caught:  # noqa: BLE001  (whatever it is, all ranks must hear of it)
        error = caught
    _end_for_all(comm, error, "while all ranks worked")


def _end_for_all(comm: MPI.Comm, error: BaseException | None, when: str) -> None:
    """Wait for all ranks and raise what any of them has: `on_root`, `on_every`. Collective."""
    error = _meet(comm) or error
    interrupt = f"{type(error).__name__} {when}"
    try:
        raise_collectively(comm, error if error is None or isinstance(error, Exception) else RuntimeError(interrupt))
    except RuntimeError:
        if error is not None and not isinstance(error, Exception):
            raise error from None
        raise


def _meet(comm: MPI.Comm) -> KeyboardInterrupt | None:
    """Wait until all ranks have come, asleep; an interrupt meanwhile is kept. Collective."""
    meeting = comm.Ibarrier()
    began = time.monotonic()
    interrupt: KeyboardInterrupt | None = None
    while not meeting.Test():
        try:
            time.sleep(min(_NAP, _SHARE * (time.monotonic() - began)))
        except KeyboardInterrupt as reason:
            if interrupt is not None:  # the second one does not wait for the others
                raise
            interrupt = reason
    return interrupt


def _broadcast(comm: MPI.Comm, data: bytes) -> bytes:
    """Rank 0's bytes on every rank, however many. Collective."""
    found = bytearray(comm.bcast(len(data), root=_ROOT))
    if comm.rank == _ROOT:
        found[:] = data
    for begin in range(0, len(found), _MESSAGE):
        comm.Bcast([memoryview(found)[begin : begin + _MESSAGE], MPI.BYTE], root=_ROOT)
    return bytes(found)


def check_same(comm: MPI.Comm, kind: type[Exception], **arguments: object) -> None:
    """Refuse arguments that differ between the ranks. Collective.

    Args:
        comm: the ranks that take part.
        kind: of the error.
        **arguments: by the names the user knows them by; compared by their text (`repr`).

    Raises:
        Exception: of that kind, on all ranks; gives a name and two values of it.
    """
    refuse_absent_ranks(comm)
    heard = comm.allgather({name: repr(value) for name, value in arguments.items()})
    for name in arguments:
        for rank, theirs in enumerate(heard):
            if theirs[name] != heard[0][name]:
                raise kind(
                    f"{name} is {heard[0][name]} on rank 0 and {theirs[name]} on rank {rank}; "
                    "give the same on all ranks"
                )


@runtime_checkable
class OnRanks(Protocol):
    """An object that is distributed over a communicator: a mesh, a model, a body with history."""

    @property
    def comm(self) -> MPI.Comm:
        """The ranks."""


def told_to_all(arguments: Mapping[str, Any], fault: str) -> str:
    """The fault of the lowest rank that has one, for `flexmbd.given.checked`. Collective.

    The ranks are those of the first argument that is a communicator or lies on one's (`OnRanks`); without any only
    those hear of it on which it is wrong.

    Raises:
        FlexmbdError: as `refuse_absent_ranks`.
    """
    comms = (value.comm if isinstance(value, OnRanks) else value for value in arguments.values())
    comm = next((comm for comm in comms if isinstance(comm, MPI.Comm) and comm != MPI.COMM_NULL), None)
    if comm is None:
        return fault
    refuse_absent_ranks(comm)
    return next(filter(None, comm.allgather(fault)), "")


def refuse_vectors(
    comm: MPI.Comm, size: int | None, *, kind: type[FlexmbdError], dt: object = None, **vectors: object
) -> None:
    """Refuse wrong vectors and step lengths on all ranks where one rank has them. Collective.

    For calls in each step of a solver: kind and shape are looked at, and whether a vector's numbers are finite is not,
    for that shows in what comes of them.

    Args:
        comm: the ranks that take part.
        size: of the vectors on this rank; None: any.
        kind: of the error.
        dt: s; None: there is none.
        **vectors: by the names the user knows them by.

    Raises:
        FlexmbdError: of that kind, on all ranks.
    """
    fault = ""
    for name, value in vectors.items():
        right = isinstance(value, np.ndarray) and value.ndim == 1 and value.dtype.kind in "iuf"
        if not right or size not in (None, np.size(value)):  # type: ignore[arg-type]
            wanted = "a vector of numbers" if size is None else f"an array ({size},) of numbers"
            got = f"({', '.join(map(str, value.shape))})" if isinstance(value, np.ndarray) else shown(value)
            fault = f"{name} must be {wanted} on each rank, got {got}"
    if dt is not None and not (is_number(dt) and numbers(dt) >= 0.0):
        fault = f"dt must be the length of a step (s), 0 or more, got {shown(dt)}"
    if comm.allreduce(bool(fault), op=MPI.LOR):
        raise kind(next(filter(None, comm.allgather(fault))))


def gather_rows(comm: MPI.Comm, rows: npt.NDArray[Any]) -> npt.NDArray[Any] | None:
    """Stack the rows of all ranks, in the order of the ranks, on rank 0. Collective.

    Args:
        comm: the ranks that take part.
        rows: (n_local, ...) array; n_local may differ between ranks, and may be zero.

    Returns:
        (sum of n_local, ...) array on rank 0, None on the others.
    """
    refuse_absent_ranks(comm)
    parts = comm.gather(np.ascontiguousarray(rows), root=_ROOT)
    return np.concatenate(parts) if parts is not None else None


@checked()
@dataclass(frozen=True)
class MpiTeam:
    """The ranks of one machine, as `flexmbd.Team` tells: rank 0 runs it, or decides where all of them step.

    Attributes:
        comm: the MPI communicator.
        collective_functions: whether the user's functions (of time, laws, forces, events and their actions) call MPI,
            so that all ranks must step and call them.
    """

    comm: MPI.Comm
    collective_functions: bool = False

    def __deepcopy__(self, memo: object) -> MpiTeam:
        """Itself: the ranks are the same."""
        return self

    def __reduce__(self) -> tuple[Any, ...]:
        """What is unpickled is run by one process: ranks belong to a run."""
        return _team_of_one, ()

    @property
    def size(self) -> int:
        """Number of ranks."""
        return int(self.comm.size)

    @property
    def is_root(self) -> bool:
        """Whether this rank writes files, prints and draws."""
        return bool(self.comm.rank == _ROOT)

    def agree(self, x: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Rank 0's array, bit for bit, on every rank. Collective.

        Args:
            x: array of the same shape and type on every rank.

        Returns:
            A new array of that shape.
        """
        refuse_absent_ranks(self.comm)
        agreed = np.array(x, order="C")
        self.comm.Bcast(agreed, root=_ROOT)
        return agreed

    def fail(self, error: Exception | None) -> None:
        """Raise on every rank if any rank hands in an error (`raise_collectively`). Collective."""
        raise_collectively(self.comm, error)

    def on_root(self, function: Callable[[], T]) -> T:
        """The result of `function` on rank 0, on every rank; the others sleep meanwhile (`on_root`). Collective."""
        return on_root(self.comm, function)

    def tell(self, what: str, error: Exception | None) -> None:
        """Raise on every rank that calls, for the same text, the error that rank 0 has, if any. Not collective.

        Rank 0 does not wait; a rank that never calls leaves a message of some hundred bytes unread.
        """
        refuse_absent_ranks(self.comm)
        if self.is_root:
            failure = _portable(error)
            _UNREAD[:] = [message for message in _UNREAD if not message.Test()]
            _UNREAD.extend(self.comm.isend((what, failure), dest=rank, tag=_TOLD) for rank in range(1, self.size))
            if error is not None:
                raise error
            return
        told, failure = self.comm.recv(source=_ROOT, tag=_TOLD)
        while told != what:  # of what this rank did not ask about
            told, failure = self.comm.recv(source=_ROOT, tag=_TOLD)
        if failure is not None:
            kind, text = pickle.loads(failure)  # noqa: S301  (from our own ranks)
            raise kind(f"{text} (on rank {_ROOT} of {self.size})")


def _team_of_one() -> MpiTeam:
    return MpiTeam(MPI.COMM_SELF)


def _portable(error: Exception | None) -> bytes | None:
    """Type and text of an error as bytes that can be rebuilt on another rank."""
    if error is None:
        return None
    text = str(error.args[0]) if isinstance(error, KeyError) and error.args else str(error)
    try:
        type(error)(text)
        return pickle.dumps((type(error), text))
    except Exception:  # noqa: BLE001  (a type that needs more than a text, or is local)
        return pickle.dumps((RuntimeError, f"{type(error).__name__}: {text}"))
