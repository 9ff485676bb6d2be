"""Sparse LU factors of matrices of blocks, against dense ones of numpy."""

import numpy as np
import pytest

from flexmbd.multibody.kernels.sparse.block_lu import (
    add_product,
    clear,
    count_signs,
    factor_holding,
    factor_sparse,
    new_block_matrix,
    new_complex_block_matrix,
    solve_sparse,
)
from flexmbd.multibody.kernels.sparse.block_pattern import new_block_pattern

EPSILON = np.finfo(float).eps


def put(pattern, matrix, dense):
    """Write the entries of a dense matrix that lie in the pattern; returns the matrix of these."""
    kept = np.zeros_like(dense)
    clear(matrix)
    for i in range(len(pattern.first) - 1):
        for q in range(pattern.entry_at[i], pattern.entry_at[i + 1]):
            columns = slice(*pattern.first[pattern.column[q] : pattern.column[q] + 2])
            width = columns.stop - columns.start
            for r in range(pattern.first[i + 1] - pattern.first[i]):
                row = pattern.first[i] + r
                at = pattern.offset[q] + r * pattern.stride[q]
                matrix.values[at : at + width] = kept[row, columns] = dense[row, columns]
    return kept


def new_matrix(pattern, kind):
    return new_complex_block_matrix(pattern) if kind is complex else new_block_matrix(pattern)


def random_numbers(random, shape, kind):
    real = random.standard_normal(shape)
    return real + 1j * random.standard_normal(shape) if kind is complex else real


def solved(pattern, dense, rhs):
    """The solution, and the matrix that was solved."""
    matrix = new_matrix(pattern, complex if np.iscomplexobj(dense) else float)
    kept = put(pattern, matrix, dense)
    assert factor_sparse(pattern, matrix)
    found = rhs.copy()
    solve_sparse(pattern, matrix, found)
    return found, kept


def backward_error(matrix, found, rhs):
    """What of the right-hand sides is left, over what the products' round-off may be."""
    size = abs(matrix) @ abs(found).T + abs(rhs).T
    return (abs(matrix @ found.T - rhs.T) / size).max() / EPSILON


def lattice_pairs(nx, ny):
    node = np.arange(nx * ny).reshape(nx, ny)
    along = np.stack((node[:-1].ravel(), node[1:].ravel()), axis=1)
    across = np.stack((node[:, :-1].ravel(), node[:, 1:].ravel()), axis=1)
    return np.concatenate((along, across))


@pytest.mark.parametrize("kind", [float, complex])
@pytest.mark.parametrize("seed", range(8))
def test_random_patterns(kind, seed):
    random = np.random.default_rng(seed)
    count = int(random.integers(1, 60))
    sizes = random.integers(1, [2, 7, 20][seed % 3] + 1, count)
    pairs = np.argwhere(random.random((count, count)) < [0.02, 0.1, 0.4][seed // 3])
    pattern = new_block_pattern(sizes, pairs)
    n = int(sizes.sum())
    dense = random_numbers(random, (n, n), kind) + 2.0 * np.sqrt(n) * np.eye(n)
    rhs = random_numbers(random, (3, n), kind)
    found, matrix = solved(pattern, dense, rhs)
    assert backward_error(matrix, found, rhs) < 8 * n
    assert np.count_nonzero(matrix) > 0
    exact = np.linalg.solve(matrix, rhs.T).T
    assert abs(found - exact).max() < 100 * EPSILON * np.linalg.cond(matrix) * abs(exact).max()


@pytest.mark.parametrize("kind", [float, complex])
def test_wide_fronts_by_blas(kind):
    random = np.random.default_rng(3)
    sizes = np.full(36, 9)
    pattern = new_block_pattern(sizes, lattice_pairs(6, 6))
    assert pattern.widest > 40
    dense = random_numbers(random, (324, 324), kind) + 30.0 * np.eye(324)
    rhs = random_numbers(random, (2, 324), kind)
    found, matrix = solved(pattern, dense, rhs)
    assert backward_error(matrix, found, rhs) < 500


def test_a_full_block_is_pivoted():
    random = np.random.default_rng(5)
    dense = random.standard_normal((60, 60))
    dense[np.diag_indices(60)] = 0.0
    rhs = random.standard_normal((1, 60))
    found, matrix = solved(new_block_pattern([60], []), dense, rhs)
    assert backward_error(matrix, found, rhs) < 1e4


def saddle_point(random, bodies, rows):
    """Springs along a chain with rows between two bodies each: sizes, pairs, ranks, matrix."""
    sizes = random.integers(1, 4, bodies)
    first = np.concatenate(([0], np.cumsum(sizes)))
    n = first[-1]
    pairs = [(k, k + 1) for k in range(bodies - 1)]
    chain = random.standard_normal((n, n))
    stiffness = np.zeros((n, n))
    for i, j in pairs:
        both = slice(first[i], first[j + 1])
        stiffness[both, both] += chain[both, both] @ chain[both, both].T + np.eye(first[j + 1] - first[i])
    jacobian = np.zeros((rows, n))
    for k in range(rows):
        for i in random.choice(bodies, 2, replace=False):
            jacobian[k, first[i] : first[i + 1]] = random.standard_normal(sizes[i])
            pairs.append((i, bodies + k))
    matrix = np.block([[stiffness, jacobian.T], [jacobian, np.zeros((rows, rows))]])
    ranks = np.repeat([0, 1], [bodies, rows])
    return np.concatenate((sizes, np.ones(rows, int))), np.array(pairs), ranks, matrix


@pytest.mark.parametrize("seed", range(10))
def test_saddle_points(seed):
    random = np.random.default_rng(seed)
    sizes, pairs, ranks, dense = saddle_point(random, 40, 15)
    pattern = new_block_pattern(sizes, pairs, ranks=ranks)
    rhs = random.standard_normal((2, len(dense)))
    found, matrix = solved(pattern, dense, rhs)
    assert (matrix == dense).all()
    exact = np.linalg.solve(dense, rhs.T).T
    assert abs(found - exact).max() < 1e3 * EPSILON * np.linalg.cond(dense) * abs(exact).max()


def test_rows_wait_for_pivots():
    # a row of multipliers of size two between bodies of one unknown each: both go first, in whatever block order
    for shift in range(3):
        sizes = np.roll([1, 1, 2], shift)
        one, two, rows = np.roll(np.arange(3), shift).argsort()[[0, 1, 2]] if shift else (0, 1, 2)
        ranks = np.zeros(3, int)
        ranks[rows] = 1
        pattern = new_block_pattern(sizes, [(one, rows), (two, rows)], ranks=ranks)
        order = list(pattern.unknown)
        last = range(pattern.first[rows], pattern.first[rows + 1])
        assert set(order[2:]) == set(last)


def free_chain(stiffnesses):
    """Masses in a row, held by nothing."""
    n = len(stiffnesses) + 1
    matrix = np.zeros((n, n))
    for k, stiffness in enumerate(stiffnesses):
        matrix[k : k + 2, k : k + 2] += stiffness * np.array([[1.0, -1.0], [-1.0, 1.0]])
    return matrix


@pytest.mark.parametrize("units", [1.0, 1e-9, 1e7])
def test_a_worthless_pivot_is_named(units):
    # of two chains the second is held by nothing; its unknowns are in other units, each in one of its own
    random = np.random.default_rng(2)
    held = free_chain(10.0 ** random.uniform(-2, 2, 29)) + 0.1 * np.eye(30)
    free = free_chain(10.0 ** random.uniform(-2, 2, 39))
    dense = np.zeros((70, 70))
    dense[:30, :30], dense[30:, 30:] = held, free
    scale = np.concatenate((np.ones(30), units * 10.0 ** random.uniform(-3, 3, 40)))
    dense *= scale[:, None] * scale
    pairs = [(k, k + 1) for k in range(69) if k != 29]
    pattern = new_block_pattern(np.ones(70, int), pairs)
    matrix = new_block_matrix(pattern)
    put(pattern, matrix, dense)
    assert not factor_sparse(pattern, matrix)
    assert 30 <= matrix.worthless[0] < 70
    # and it can be factored once it is held, however softly against the rest
    dense[50, 50] += 1e-6 * scale[50] ** 2
    put(pattern, matrix, dense)
    assert factor_sparse(pattern, matrix)
    assert matrix.worthless[0] == -1


def test_a_zero_matrix_has_no_pivot():
    pattern = new_block_pattern([2, 3], [(0, 1)])
    matrix = new_block_matrix(pattern)
    assert not factor_sparse(pattern, matrix)


def test_the_order_of_blocks_does_not_matter():
    random = np.random.default_rng(8)
    sizes = random.integers(1, 5, 30)
    pairs = np.argwhere(random.random((30, 30)) < 0.08)
    n = int(sizes.sum())
    dense, rhs = random.standard_normal((n, n)) + 30 * np.eye(n), random.standard_normal((1, n))
    found, matrix = solved(new_block_pattern(sizes, pairs), dense, rhs)
    shuffled = random.permutation(30)  # block k is the one that was shuffled[k]
    begins = np.concatenate(([0], np.cumsum(sizes)))
    unknown = np.concatenate([np.arange(begins[k], begins[k + 1]) for k in shuffled])
    place = np.argsort(shuffled)
    pattern = new_block_pattern(sizes[shuffled], place[pairs])
    again, same = solved(pattern, matrix[np.ix_(unknown, unknown)], rhs[:, unknown])
    assert (same == matrix[np.ix_(unknown, unknown)]).all()
    np.testing.assert_allclose(again, found[:, unknown], rtol=0, atol=1e-14 * abs(found).max())


def test_a_given_order():
    random = np.random.default_rng(9)
    order = random.permutation(20)
    pattern = new_block_pattern(np.full(20, 2), lattice_pairs(5, 4), order=order)
    dense, rhs = random.standard_normal((40, 40)) + 20 * np.eye(40), random.standard_normal((1, 40))
    found, matrix = solved(pattern, dense, rhs)
    assert backward_error(matrix, found, rhs) < 100


@pytest.mark.parametrize("kind", [float, complex])
def test_products(kind):
    random = np.random.default_rng(4)
    pattern = new_block_pattern([2, 1, 3, 2], [(0, 1), (1, 2), (0, 3)])
    matrix = new_matrix(pattern, kind)
    kept = put(pattern, matrix, random_numbers(random, (8, 8), kind))
    vector, out = random_numbers(random, 8, kind), random_numbers(random, 8, kind)
    expected = out - 0.3 * (kept @ vector)
    add_product(pattern, matrix, vector, -0.3, out)
    np.testing.assert_allclose(out, expected, rtol=0, atol=1e-14)
    offset, stride = pattern.entries([3, 1], [0, 2])
    assert matrix.values[offset[0] + stride[0] + 1] == kept[7, 1]
    assert matrix.values[offset[1] + 2] == kept[2, 5]
    with pytest.raises(KeyError, match="no such block"):
        pattern.entries([2], [3])


def nested_dissection(nodes):
    """The order of a lattice's nodes that takes of the order of n^(3/2) operations (George 1973)."""
    if nodes.size <= 6:
        return list(nodes.ravel())
    if nodes.shape[0] < nodes.shape[1]:
        nodes = nodes.T
    middle = nodes.shape[0] // 2
    return [*nested_dissection(nodes[:middle]), *nested_dissection(nodes[middle + 1 :]), *nodes[middle]]


@pytest.mark.parametrize("side", [20, 40, 80])
def test_operations_of_lattices_are_at_most_those_of_nested_dissection(side):
    sizes, pairs = np.full(side**2, 2), lattice_pairs(side, side)
    dissected = new_block_pattern(sizes, pairs, order=nested_dissection(np.arange(side**2).reshape(side, side)))
    assert new_block_pattern(sizes, pairs).operations <= dissected.operations


def test_operations_of_chains_and_ladders_grow_with_their_length():
    def ladder(count):
        hub = np.stack((np.arange(2 * count), np.full(2 * count, 2 * count)), axis=1)
        pairs = np.concatenate((lattice_pairs(count, 2), hub))
        return new_block_pattern(np.full(2 * count + 1, 6), pairs)

    assert ladder(400).operations < 2.1 * ladder(200).operations
    assert ladder(400).fill < 2.1 * ladder(200).fill


def test_no_unknowns():
    pattern = new_block_pattern([], [])
    matrix = new_block_matrix(pattern)
    assert factor_sparse(pattern, matrix)
    solve_sparse(pattern, matrix, np.zeros((1, 0)))


def test_what_nothing_resists_is_held():
    # three chains, the second free: with forces in balance on it the solution is that of the least-squares problem
    # up to a shift; negative eigenvalues are counted without what is held
    random = np.random.default_rng(6)
    chains = [free_chain(10.0 ** random.uniform(-1, 1, 9)) for _ in range(3)]
    dense = np.zeros((30, 30))
    for k, chain in enumerate(chains):
        dense[10 * k : 10 * k + 10, 10 * k : 10 * k + 10] = chain
    dense[0, 0] += 1.0
    dense[25, 25] -= 0.5
    pairs = [(k, k + 1) for k in range(29) if k % 10 != 9]
    pattern = new_block_pattern(np.ones(30, int), pairs)
    matrix = new_block_matrix(pattern)
    put(pattern, matrix, dense)
    assert factor_holding(pattern, matrix)
    assert (matrix.held > 0.0).sum() == 1
    held = int(np.argmax(matrix.held))
    assert 10 <= held < 20
    values = np.linalg.eigvalsh(dense)
    assert count_signs(pattern, matrix) == (np.sum(values < -1e-12), 0)
    force = random.standard_normal(30)
    force[10:20] -= force[10:20].mean()
    found = force[None].copy()
    solve_sparse(pattern, matrix, found)
    assert found[0, held] == pytest.approx(0.0, abs=1e-13)
    np.testing.assert_allclose(dense @ found[0], force, atol=1e-12)


def test_a_column_that_fills_gives_a_pivot():
    # the second unknown's column is zero among the pivots of its front until the first has gone
    dense = np.array([[0.0, 1.0, 2.0], [1.0, 0.0, 0.0], [3.0, 0.0, 1e-3]])
    rhs = np.array([[1.0, 2.0, 3.0]])
    found, _ = solved(new_block_pattern([3], []), dense, rhs)
    np.testing.assert_allclose(found[0], np.linalg.solve(dense, rhs[0]), rtol=1e-10)


@pytest.mark.parametrize("seed", range(4))
def test_regular_blocks_of_many_zeros_have_pivots(seed):
    random = np.random.default_rng(seed)
    upper = np.triu(random.standard_normal((12, 12)) * (random.random((12, 12)) < 0.2), 1)
    dense = (np.eye(12) + upper)[random.permutation(12)]
    rhs = random.standard_normal((1, 12))
    found, _ = solved(new_block_pattern([12], []), dense, rhs)
    np.testing.assert_allclose(found[0], np.linalg.solve(dense, rhs[0]), atol=1e-12 * abs(found).max())
