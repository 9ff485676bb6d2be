"""Static condensation to single dofs; the comparison with another program is in test_calculix.py."""

from itertools import product

from mpi4py import MPI

import numpy as np
import pytest
from bracket import bracket
from full_model import FullModel

from flexmbd.errors import ReductionError
from flexmbd.reduction import static_condensation


@pytest.fixture(scope="module")
def full():
    return FullModel(bracket(degree=1))


# Out of order, and not all components of a node.
SOME = [(17, "y"), (2, "z"), (2, "x"), (30, "y"), (9, "x"), (9, "y"), (21, "z"), (5, "y")]


def by_hand(full, dofs):
    kept = np.array([3 * node + "xyz".index(component) for node, component in dofs])
    rest = np.setdiff1d(np.arange(full.K.shape[0]), kept)
    k, m = full.K.toarray(), full.M.toarray()
    t = np.zeros((len(k), len(kept)))
    t[kept] = np.eye(len(kept))
    t[rest] = -np.linalg.solve(k[np.ix_(rest, rest)], k[np.ix_(rest, kept)])
    return k[np.ix_(kept, kept)] + k[np.ix_(kept, rest)] @ t[rest], t.T @ m @ t


@pytest.mark.mpi
def test_any_dofs_in_any_order(full):
    found = static_condensation(full.model, SOME)
    k, m = by_hand(full, SOME)
    assert abs(found.K - k).max() < 1e-11 * abs(k).max()
    assert abs(found.M - m).max() < 1e-11 * abs(m).max()
    assert list(zip(found.node.tolist(), found.component, strict=True)) == SOME


@pytest.mark.mpi
def test_middles_of_edges_can_be_kept():
    """Nodes of the displacement that the mesh's input does not have."""
    full = FullModel(bracket(degree=2))
    dofs = list(product((0, 40, 120), "xyz"))
    found = static_condensation(full.model, dofs)
    k, _ = by_hand(full, dofs)
    assert abs(found.K - k).max() < 1e-11 * abs(k).max()


@pytest.mark.mpi
def test_all_dofs_are_the_model_itself(full):
    dofs = list(product(range(len(full.x)), "xyz"))
    found = static_condensation(full.model, dofs)
    assert abs(found.K - full.K).max() < 1e-15 * abs(full.K).max()
    assert abs(found.M - full.M).max() < 1e-15 * abs(full.M).max()


@pytest.mark.mpi
def test_every_rank_has_the_same_bits(full):
    found = static_condensation(full.model, SOME)
    mine = found.K.tobytes() + found.M.tobytes()
    assert all(other == mine for other in MPI.COMM_WORLD.allgather(mine))


@pytest.mark.mpi
@pytest.mark.parametrize(
    ("dofs", "message"),
    [
        ([], "no dofs are retained"),
        ([*SOME, (2, "x")], r"dof \(2, 'x'\) is retained twice"),
        ([*SOME, (2, "rx")], "node 2 has no component 'rx'"),
        ([*SOME, (400, "x")], "no node 400; its nodes are numbered from 0 to 35"),
        ([*SOME, (-1, "x")], "no node -1"),
        (list(product((0, 5), "xyz")), "free to move as a rigid one"),
        (list(product(range(36), "xy"))[::2], "free to move as a rigid one"),
        (list(product([3], "xyz")), "free to move as a rigid one"),
    ],
)
def test_what_cannot_be_retained(full, dofs, message):
    with pytest.raises(ReductionError, match=message):
        static_condensation(full.model, dofs)
