"""Lists of indices in arrays, and patterns of machines by them, against plain Python."""

import numpy as np
import pytest
from spring_lattice import linked_pendulums, spring_lattice

import flexmbd as fm
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.sparse.index_lists import distinct, new_lists, owned
from flexmbd.multibody.kernels.tangent.unknown_blocks import unknown_blocks

LISTS = [[3, 1, 3, -1], [], [2, 2, 0], [5], [1, 4]]


def as_lists(lists):
    return [lists.items[a:b].tolist() for a, b in zip(lists.starts[:-1], lists.starts[1:], strict=True)]


def test_lists():
    lists = new_lists(LISTS)
    assert as_lists(lists) == LISTS
    assert as_lists(lists.taken(np.array([4, 0, 1, 4]))) == [LISTS[k] for k in (4, 0, 1, 4)]
    assert as_lists(lists.once()) == [[3, 1], [], [2, 0], [5], [1, 4]]
    assert as_lists(lists.taken(np.array([0, 2, 1, 3])).paired()) == [LISTS[0] + LISTS[2], LISTS[3]]
    assert as_lists(owned(np.array([2, 0, 2, 0]), np.array([7, 8, 9, 1]), 3)) == [[8, 1], [], [7, 9]]
    one, other = lists.squares()
    assert list(zip(one.tolist(), other.tolist(), strict=True)) == [(i, j) for k in LISTS for i in k for j in k]


@pytest.mark.parametrize("most", [6, 10_000])
def test_distinct(most):
    keys = np.array([5, 1, 5, 0, 1])
    assert distinct(keys, most).tolist() == [0, 1, 5]


def whole_path(blocks, frame):
    """The blocks that move a frame, through cut bodies to the ground."""
    found, way = set(), blocks.path(frame)
    while True:
        found.update(int(blocks.of[group.first]) for group in way.groups)
        if way.root < 0:
            return found - {-1}
        found.add(int(blocks.of[blocks.cut(way.root)]))
        body = blocks.cuts[way.root]
        joint = blocks.joints[body]
        if joint is not None:
            found.add(int(blocks.of[joint.first]))
        way = blocks.inward[body]


def ladder(windows):
    """Rungs on two links each, hung on the rung before."""
    scene, hinge = fm.System(), fm.joint.Revolute("z")
    ends = [scene.ground.frame((x, 0.0, 0.0)) for x in (0.0, 0.5)]
    for _ in range(windows):
        bodies = [scene.add(fm.RigidBody(1.0, (1.0, 1.0, 1.0))) for _ in range(3)]
        for end, rope in zip(ends, bodies[:2], strict=True):
            scene.connect(hinge, end, rope.frame())
        scene.connect(hinge, bodies[0].frame((0.0, -0.2, 0.0)), bodies[2].frame())
        scene.connect(hinge, bodies[2].frame((0.5, 0.0, 0.0)), bodies[1].frame((0.0, -0.2, 0.0)))
        ends = [bodies[2].frame(), bodies[2].frame((0.5, 0.0, 0.0))]
    return scene


@pytest.mark.parametrize("cut", [[], [2], [1, 2, 6], range(2, 24, 3)])
def test_rows_wait_for_what_moves_one_of_their_frames_alone(cut):
    plan = ladder(8).compile().scene.plan
    where = np.zeros(len(plan.tree), bool)
    where[list(cut)] = True
    blocks = unknown_blocks(plan, where)
    waits = blocks.waits()
    assert len(blocks.row_groups) == 8
    for (first, _), own in zip(blocks.row_groups, blocks.row_blocks, strict=True):
        one, other = (whole_path(blocks, int(frame)) for frame in plan.rows[first, [at.ROW_F, at.ROW_G]])
        assert set(waits[int(own)]) == one ^ other


@pytest.mark.parametrize("scene", [spring_lattice(5, 3, fm.joint.Planar("z"))[0], linked_pendulums(4), ladder(4)])
def test_pairs_are_those_that_forces_and_rows_join(scene):
    plan = scene.compile().scene.plan
    blocks = unknown_blocks(plan)
    expected = {(k, k) for k in range(len(blocks.first))}
    for e in plan.elements:
        joined = set().union(*(whole_path(blocks, int(f)) for f in e[[at.EL_F, at.EL_G]]))
        expected |= {(i, j) for i in joined for j in joined}
    for (first, _), own in zip(blocks.row_groups, blocks.row_blocks.tolist(), strict=True):
        joined = set().union(*(whole_path(blocks, int(f)) for f in plan.rows[first, [at.ROW_F, at.ROW_G]]))
        expected |= {(i, j) for i in joined for j in joined}
        expected |= {pair for k in joined for pair in ((own, k), (k, own))}
    for outer, _, _, inner, _, _ in blocks.body_pairs:
        i, j = (int(blocks.of[k]) for k in (outer, inner))
        expected |= {(i, j), (j, i)}
    assert [tuple(pair) for pair in blocks.pairs.tolist()] == sorted(expected)
