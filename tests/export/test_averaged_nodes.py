"""Full matrices with averaged interfaces, against dense algebra; matrices as rows, columns and values."""

from functools import cache

import numpy as np
import pytest
import scipy.linalg
import scipy.sparse

import flexmbd as fm
from flexmbd.errors import ExportError
from flexmbd.export import NodeSet


@cache
def lattice():
    """A truss of 4 x 3 x 3 nodes with random bars and masses: K, M and the node table, numbers not in order."""
    random = np.random.default_rng(2)
    x = np.stack(np.meshgrid(np.arange(4.0), np.arange(3.0), np.arange(3.0), indexing="ij"), axis=-1).reshape(-1, 3)
    x += random.uniform(-0.1, 0.1, x.shape)
    K = np.zeros((3 * len(x), 3 * len(x)))
    for a in range(len(x)):
        for b in range(a):
            length = np.linalg.norm(x[a] - x[b])
            if length < 1.9:
                direction = np.concatenate([x[a] - x[b], x[b] - x[a]]) / length
                dofs = [3 * a, 3 * a + 1, 3 * a + 2, 3 * b, 3 * b + 1, 3 * b + 2]
                K[np.ix_(dofs, dofs)] += random.uniform(1.0, 3.0) * 1e6 * np.outer(direction, direction)
    m = random.uniform(0.5, 2.0, len(x))
    numbers = 10 + random.permutation(len(x))
    return K, np.diag(np.repeat(m, 3)), np.column_stack([numbers, x])


def ends(coupling, **weights):
    """The nodes of the two ends, by their places along x."""
    _, _, table = lattice()
    order = np.argsort(table[:, 1])
    sets = {"left": table[order[:9], 0], "right": table[order[-9:], 0]}
    return {name: NodeSet(nodes, coupling=coupling[name], weights=weights.get(name)) for name, nodes in sets.items()}


def averaging(table, nodes, weights):
    """(6, 3 k) of the frame at the nodes' mean that fits their displacements best, by least squares."""
    at = [int(np.flatnonzero(table[:, 0] == node)[0]) for node in nodes]
    p = table[at, 1:].mean(axis=0)
    T = np.vstack([np.hstack([np.eye(3), np.array([np.cross(e, x - p) for e in np.eye(3)]).T]) for x in table[at, 1:]])
    root = np.sqrt(np.repeat(weights, 3))[:, None]
    A = np.zeros((6, 3 * len(table)))
    A[:, (3 * np.array(at)[:, None] + np.arange(3)).ravel()] = np.linalg.pinv(root * T) * root.T
    return A


AVERAGED, RIGID = fm.Coupling.AVERAGED, fm.Coupling.RIGID
WEIGHTS = np.linspace(1.0, 3.0, 9)


@pytest.mark.parametrize("modes", [6, None])
@pytest.mark.parametrize("left", [AVERAGED, RIGID])
def test_statics_and_frequencies_are_those_of_dense_algebra(left, modes):
    """A load on an averaged frame moves it as in the full body; with all modes (None) its frequencies are exact."""
    K, M, table = lattice()
    whole = modes is None
    modes = (96 if left is AVERAGED else 75) if whole else modes
    sets = ends({"left": left, "right": AVERAGED}, right=WEIGHTS)
    body = fm.export.reduce_matrices(
        scipy.sparse.csr_array(K), scipy.sparse.csr_array(M), table, interfaces=sets, modes=modes, frame="left"
    )
    np.testing.assert_allclose(body.mass, np.trace(M) / 3.0, rtol=1e-12)
    right = averaging(table, sets["right"].nodes, WEIGHTS)
    rows = averaging(table, sets["left"].nodes, np.ones(9))
    if left is RIGID:  # each of its nodes is held
        at = [int(np.flatnonzero(table[:, 0] == node)[0]) for node in sets["left"].nodes]
        rows = np.eye(3 * len(table))[(3 * np.array(at)[:, None] + np.arange(3)).ravel()]
    Z = scipy.linalg.null_space(rows)
    compliance = right @ Z @ np.linalg.solve(Z.T @ K @ Z, Z.T @ right.T)
    frame = body.interface("right")
    found = frame.modes @ (frame.modes.T / body.stiffness[:, None])
    turn = np.kron(np.eye(2), body.R_MB)
    np.testing.assert_allclose(turn @ found @ turn.T, compliance, rtol=0.0, atol=1e-9 * abs(compliance).max())
    exact = np.sqrt(scipy.linalg.eigh(Z.T @ K @ Z, Z.T @ M @ Z, eigvals_only=True)) / 2.0 / np.pi
    few = body.frequencies(["left"])[:3]
    if whole:
        np.testing.assert_allclose(few, exact[:3], rtol=1e-9)
    assert (few > (1.0 - 1e-9) * exact[:3]).all()
    np.testing.assert_allclose(few, exact[:3], rtol=2e-2)


def test_free_frequencies_of_a_body_that_is_held_nowhere():
    """With all modes the reduction of averaged interfaces alone is the full body."""
    K, M, table = lattice()
    sets = ends({"left": AVERAGED, "right": AVERAGED})
    body = fm.export.reduce_matrices(K, M, table, interfaces=sets, modes=len(K) - 12, frame=None)
    exact = np.sqrt(scipy.linalg.eigh(K, M, eigvals_only=True)[6:]) / 2.0 / np.pi
    np.testing.assert_allclose(body.frequencies(), exact, rtol=1e-8)


def test_what_does_not_fit():
    K, M, table = lattice()

    def reduced(match, sets, modes=4):
        with pytest.raises(ExportError, match=match):
            fm.export.reduce_matrices(K, M, table, interfaces=sets, modes=modes, frame=None)

    both = {"left": AVERAGED, "right": AVERAGED}
    reduced("weights must be positive numbers, one a node, 9 of them", ends(both, left=[1.0]))
    reduced("weights must be positive", ends(both, left=[-1.0] * 9))
    reduced("has weights and is rigid", ends({"left": RIGID, "right": AVERAGED}, left=[1.0] * 9))
    reduced("the body has 96 dofs inside", ends(both), modes=97)


@pytest.mark.parametrize("triangle", ["both", "lower", "upper"])
@pytest.mark.parametrize("comma", [", ", " "])
def test_rows_columns_and_values(tmp_path, triangle, comma):
    """Abaqus's FORMAT=COORDINATE: three rows a node, nodes by their numbers, whatever the table's order."""
    K, _, table = lattice()
    order = (3 * np.argsort(table[:, 0])[:, None] + np.arange(3)).ravel()
    sorted_K = K[np.ix_(order, order)]
    kept = {"both": sorted_K, "lower": np.tril(sorted_K), "upper": np.triu(sorted_K)}[triangle]
    lines = [f"{i + 1}{comma}{j + 1}{comma}{kept[i, j]:.17e}" for i, j in np.argwhere(kept != 0.0)]
    (tmp_path / "k.mtx").write_text("\n".join(lines))
    assert np.array_equal(fm.export.read_triplets(tmp_path / "k.mtx", table).toarray(), K)


@pytest.mark.parametrize(
    ("lines", "match"),
    [
        ("1 1 2.0\n2 2\n", "is not `row column value`"),
        ("1 1 2.0\n109 109 1.0\n", "rows up to 109, and the node table asks for 108"),
        ("0 1 2.0\n", "rows up to 1, and"),
        ("1 1 2.0\n1 1 2.0\n", "an entry is there twice"),
        ("1 1 nan\n", "not finite"),
        ("1 1.5 2.\n", "not a whole number"),
    ],
)
def test_rows_that_do_not_fit(tmp_path, lines, match):
    (tmp_path / "k.mtx").write_text(lines)
    with pytest.raises(ExportError, match=match):
        fm.export.read_triplets(tmp_path / "k.mtx", lattice()[2])
