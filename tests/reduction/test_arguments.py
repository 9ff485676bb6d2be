"""Arguments of a reduction that are others on one rank: one error on all of them, and no hang."""

from functools import partial

from mpi4py import MPI

import pytest
from bracket import bracket

from flexmbd.errors import ReductionError
from flexmbd.reduction import InterfaceModes, Keep, Patch, Truncation, craig_bampton, guyan
from flexmbd.reduction.damping import ModalDamping
from flexmbd.reduction.unit_loads import BodyForce

LAST = MPI.COMM_WORLD.rank == MPI.COMM_WORLD.size - 1


@pytest.mark.parametrize(
    ("name", "make"),
    [
        ("geometric_stiffness", lambda: craig_bampton(bracket(degree=1), modes=2, geometric_stiffness="no")),
        ("complete", lambda: Truncation(2, complete="no")),
        ("free", lambda: Truncation(2, free="no")),
        ("local", lambda: InterfaceModes(2, local="no")),
        ("modes", lambda: Keep(modes="no")),
        ("surface", lambda: Keep(surface="no")),
        ("stress", lambda: Keep(stress="no")),
    ],
)
def test_what_is_neither_true_nor_false_is_refused(name, make):
    with pytest.raises(ReductionError, match=f"{name} must be True or False, got 'no'"):
        make()


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
        ("contact", [Patch("pad", size=0.1)]),
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


@pytest.mark.mpi
@pytest.mark.parametrize("wrong", [3, "weight", ["weight"], BodyForce("weight", (0.0, 0.0, -1.0))])
def test_what_is_wrong_on_one_rank_is_told_on_all(wrong):
    """A check that one rank alone fails, before the ranks compare what they were given."""
    model = bracket(degree=1)
    given = wrong if LAST else ()
    for reduced in (guyan, partial(craig_bampton, modes=2)):
        with pytest.raises(ReductionError, match="loads must be a list, each a Pressure or a Traction or a BodyForce"):
            reduced(model, frame="root", loads=given)
