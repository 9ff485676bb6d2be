"""Errors, results and decisions that all ranks share; every test runs on any number of ranks."""

from mpi4py import MPI

import numpy as np
import pytest

from flexmbd.continuum.parallel import MpiTeam, gather_rows, on_root, raise_collectively, refuse_vectors
from flexmbd.errors import MeshError

pytestmark = pytest.mark.mpi

COMM = MPI.COMM_WORLD
LAST = COMM.size - 1
ALONE = COMM.size == 1


class Particular(Exception):
    """An error that cannot be made from a text alone."""

    def __init__(self, number: int, *, unit: str) -> None:
        super().__init__(f"{number} {unit}")


def test_no_error_raises_nothing():
    raise_collectively(COMM, None)


def test_an_error_of_one_rank_is_raised_on_all():
    error = MeshError("no cells here") if COMM.rank == LAST else None
    with pytest.raises(MeshError, match="no cells here") as caught:
        raise_collectively(COMM, error)
    if ALONE:
        assert caught.value is error
    else:
        assert str(caught.value) == f"no cells here (on rank {LAST} of {COMM.size})"
        assert caught.value.__cause__ is error


def test_of_several_errors_the_lowest_ranks_is_raised():
    kinds = [MeshError, ValueError]
    with pytest.raises(MeshError, match="from rank 0"):
        raise_collectively(COMM, kinds[COMM.rank % 2](f"from rank {COMM.rank}"))


def test_an_error_that_cannot_be_rebuilt_still_reaches_all():
    error = Particular(3, unit="kg") if COMM.rank == LAST else None
    with pytest.raises(Particular if ALONE else RuntimeError, match="3 kg") as caught:
        raise_collectively(COMM, error)
    assert ALONE or "Particular" in str(caught.value)


def test_on_root_runs_once_and_all_have_the_result():
    ran = []

    def work():
        ran.append(COMM.rank)
        return {"rank": COMM.rank, "x": np.arange(3)}

    result = on_root(COMM, work)
    assert ran == ([0] if COMM.rank == 0 else [])
    assert result["rank"] == 0
    assert np.array_equal(result["x"], np.arange(3))


def test_on_root_raises_everywhere():
    def work():
        raise MeshError("a hole")

    with pytest.raises(MeshError, match="a hole"):
        on_root(COMM, work)


def test_on_root_refuses_on_all_ranks_a_result_that_cannot_travel():
    with pytest.raises(Exception, match=r"pickle|local object"):
        on_root(COMM, lambda: lambda: None)
    # and the ranks are still in step
    assert COMM.allreduce(1) == COMM.size


def test_gather_rows_stacks_by_rank_also_from_ranks_without_rows():
    rows = np.full((COMM.rank, 2), float(COMM.rank))
    gathered = gather_rows(COMM, rows)
    if COMM.rank > 0:
        assert gathered is None
    else:
        counts = [(r, 2) for r in range(COMM.size)]
        expected = np.concatenate([np.full(shape, float(r)) for r, shape in enumerate(counts)])
        assert np.array_equal(gathered, expected)


def test_team_agrees_on_rank_zeros_bits():
    team = MpiTeam(COMM)
    assert team.is_root == (COMM.rank == 0)
    x = np.nextafter(1.0, 2.0) * np.array([[1.0, -0.0], [np.nan, 3.0]])
    mine = x if COMM.rank == 0 else x + 1e-15
    agreed = team.agree(mine)
    assert agreed.tobytes() == x.tobytes()
    assert agreed is not mine
    assert team.agree(np.array(COMM.rank == 0)).item() is True


def test_team_agrees_on_arrays_that_are_not_contiguous():
    agreed = MpiTeam(COMM).agree((np.arange(6.0) + COMM.rank).reshape(2, 3).T)
    assert np.array_equal(agreed, np.arange(6.0).reshape(2, 3).T)


def test_team_fails_together():
    team = MpiTeam(COMM)
    team.fail(None)
    with pytest.raises(ValueError, match="the step went wrong"):
        team.fail(ValueError("the step went wrong") if COMM.rank == LAST else None)


def test_a_key_error_keeps_its_words():
    """``str`` of one has quotation marks around its text."""
    with pytest.raises(KeyError) as caught:
        raise_collectively(COMM, KeyError("boom") if COMM.rank == 0 else None)
    expected = "boom" if COMM.size == 1 else f"boom (on rank 0 of {COMM.size})"
    assert caught.value.args == (expected,)


def test_a_wrong_vector_on_one_rank_is_told_on_all():
    """What a solver hands over in each step: the ranks that have it right do not wait for the others."""
    comm = MPI.COMM_WORLD
    last = comm.size - 1
    refuse_vectors(comm, 3, kind=MeshError, dt=0.0, u=np.full(3, np.nan))
    shape = r"u must be an array \(3,\) of numbers on each rank, got \(2\)"
    for wrong, text in ((np.zeros(2), shape), ("u", "got 'u'")):
        with pytest.raises(MeshError, match=text):
            refuse_vectors(comm, 3, kind=MeshError, u=wrong if comm.rank == last else np.zeros(3))
    with pytest.raises(MeshError, match="dt must be the length of a step"):
        refuse_vectors(comm, 3, kind=MeshError, dt=-1.0 if comm.rank == last else 1.0, u=np.zeros(3))
