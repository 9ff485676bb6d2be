"""Six dofs that tell a body's rigid motion: they do, and round-off does not choose among equally good ones."""

import numpy as np
import pytest

from flexmbd.record.carrying_dofs import carrying_dofs, independent_rows

CUBE = np.stack(np.meshgrid(*3 * [[-0.5, 0.0, 0.5]], indexing="ij"), axis=-1).reshape(-1, 3)


def rigid_rows(x, dofs):
    """The displacements of some dofs under unit translations and rotations, (6, 6)."""
    node, axis = np.divmod(dofs, 3)
    motions = [np.tile(e, (len(x), 1)) for e in np.eye(3)] + [np.cross(e, x) for e in np.eye(3)]
    return np.array([motion[node, axis] for motion in motions])


@pytest.mark.parametrize("size", [1e-3, 1.0, 1e3])
def test_they_tell_every_rigid_motion(size):
    found = carrying_dofs(size * CUBE)
    assert np.linalg.cond(rigid_rows(CUBE, found)) < 10.0


def test_round_off_chooses_nothing():
    expected = carrying_dofs(CUBE)
    rng = np.random.default_rng(1)
    for _ in range(50):
        turn = np.eye(3) + 1e-13 * rng.standard_normal((3, 3))
        np.testing.assert_array_equal(carrying_dofs(CUBE @ turn + 1e-14 * rng.standard_normal(CUBE.shape)), expected)


def test_nodes_in_a_line_tell_it_not():
    line = np.outer(np.linspace(0.0, 1.0, 5), [1.0, 2.0, -0.5])
    assert carrying_dofs(line) is None
    assert carrying_dofs(line[:1]) is None


def test_rows_that_depend_are_left_out():
    rows = np.array([[1.0, 0.0], [2.0, 0.0], [0.0, 0.5]])
    chosen, sizes = independent_rows(rows)
    np.testing.assert_array_equal(chosen, [1, 2])
    np.testing.assert_allclose(sizes, [2.0, 0.5])
    assert len(independent_rows(rows[:0])[0]) == 0
