"""Arguments of a reduction that are others on one rank: one error on all of them, and no hang."""

from mpi4py import MPI

import pytest
from bracket import bracket

from flexmbd.errors import ReductionError
from flexmbd.reduction import Keep, Truncation, craig_bampton
from flexmbd.reduction.damping import ModalDamping
from flexmbd.reduction.unit_loads import BodyForce

LAST = MPI.COMM_WORLD.rank == MPI.COMM_WORLD.size - 1


@pytest.mark.parametrize(
    ("name", "arguments"),
    [
        ("geometric_stiffness", {"geometric_stiffness": "no"}),
        ("complete", {"modes": Truncation(2, complete="no")}),  # type: ignore[arg-type]
        ("Keep.modes", {"keep": Keep(modes="no")}),  # type: ignore[arg-type]
        ("Keep.surface", {"keep": Keep(surface="no")}),  # type: ignore[arg-type]
        ("Keep.stress", {"keep": Keep(stress="no")}),  # type: ignore[arg-type]
    ],
)
def test_what_is_neither_true_nor_false_is_refused(name, arguments):
    with pytest.raises(ReductionError, match=f"{name} must be True or False, got 'no'"):
        craig_bampton(bracket(degree=1), **{"modes": 2, "frame": "root", **arguments})


def test_what_is_kept_is_said_by_a_keep():
    with pytest.raises(ReductionError, match=r"keep must be Keep\(modes=..., .*\), got True"):
        craig_bampton(bracket(degree=1), modes=2, frame="root", keep=True)


@pytest.mark.mpi
@pytest.mark.skipif(MPI.COMM_WORLD.size == 1, reason="takes two ranks")
@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("frame", "tip"),
        ("frame", "bore"),
        ("frame", None),
        ("geometric_stiffness", False),
        ("loads", [BodyForce("weight", (0.0, 0.0, -1.0))]),
        ("loads", ["weight"]),
        ("damping", ModalDamping(0.02)),
        ("modes", Truncation(tol=1e-2)),
        ("keep", Keep(modes=True)),
        ("keep", Keep(surface=True)),
    ],
)
def test_what_differs_between_the_ranks_is_refused(name, value):
    arguments = {"modes": 2, "frame": "root", **({name: value} if LAST else {})}
    with pytest.raises(ReductionError, match=rf"^{name} is .* on rank 0 and .* on rank \d; give the same on all ranks"):
        craig_bampton(bracket(degree=1), **arguments)
