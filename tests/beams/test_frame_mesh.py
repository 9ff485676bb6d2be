"""Frames of beams as points and lines: what their nodes are called and where they lie, and what is refused."""

import numpy as np
import pytest

from flexmbd.beams.frame_mesh import mesh_frame
from flexmbd.errors import MeshError, SceneError

SQUARE = {"a": (0, 0, 0), "b": (1, 0, 0), "c": (1, 1, 0), "d": (0, 1, 0)}


def test_nodes_of_a_frame():
    beams = {"rim": [("a", "b"), ("b", "c")], "tie": [("a", "d")], "stay": [("c", "d")]}
    frame = mesh_frame(SQUARE, beams, divisions={"rim": 2, "tie": 3, "stay": 1})
    assert frame.names == ("a", "b", "c", "d", "rim 1.1", "rim 2.1", "tie.1", "tie.2")
    assert frame.points == 4
    assert frame.x[4:] == pytest.approx(np.array([[0.5, 0, 0], [1, 0.5, 0], [0, 1 / 3, 0], [0, 2 / 3, 0]]))
    assert frame.elements.tolist() == [[0, 4], [4, 1], [1, 5], [5, 2], [0, 6], [6, 7], [7, 3], [2, 3]]
    assert frame.group.tolist() == [0, 0, 0, 0, 1, 1, 1, 2]
    ends = frame.x[frame.elements]
    assert frame.middles == pytest.approx(ends.mean(axis=1))


@pytest.mark.parametrize("turn", [0.5, np.pi, 5.0])
def test_an_arc_goes_through_its_place(turn):
    """Less and more than half of a circle about a centre in space, in equal parts."""
    centre, first, second = np.array([0.3, -0.2, 0.5]), np.array([0.6, 0.8, 0.0]), np.array([-0.8, 0.6, 0.0])

    def at(angle):
        return centre + 2 * (np.cos(angle) * first + np.sin(angle) * second)

    frame = mesh_frame({"a": at(0), "b": at(turn)}, {"arc": [("a", at(0.3 * turn), "b")]}, divisions=5)
    assert frame.x == pytest.approx(np.array([at(turn * part) for part in (0, 1, 0.2, 0.4, 0.6, 0.8)]))
    assert frame.middles == pytest.approx(np.array([at(turn * (k + 0.5) / 5) for k in range(5)]))


@pytest.mark.parametrize(
    ("points", "beams", "divisions", "message"),
    [
        ({"a": (0, 0, 0), "b": (0, 0, 0), "c": (1, 0, 0)}, [("a", "b"), ("b", "c")], 1, "'a' and 'b' coincide"),
        ({"a": (0, 0, 0), "b": (1, 0, 0), "c": (0, 0, 0)}, [("a", "b"), ("b", "c")], 1, "'a' and 'c' coincide"),
        (SQUARE, [("a", "b"), ("b", "c"), ("c", "a"), ("b", "d")], 2, "nodes 'g 3.1' and 'g 4.1' coincide"),
        ({**SQUARE, "e": (0.4, 0, 0)}, [("a", "b")], 1, "point 'e' lies on beam .* not joined to it; divide"),
        (SQUARE, [("a", "b"), ("b", "c")], 1, "point 'd' is in no beam"),
        (SQUARE, [("a", "b"), ("c", "d")], 1, "falls into 2 pieces: no beams lead from 'a' to 'c'"),
        (SQUARE, [("a", "e")], 1, "there is no point 'e'; the points are: 'a', 'b', 'c', 'd'"),
        (SQUARE, [("a", "a")], 1, "ends where it starts"),
        (SQUARE, [("a", "b"), ("b", "a")], 1, "is there already, in group 'g'"),
        (SQUARE, ["ab"], 1, 'must be \\("start", "end"\\)'),
        (SQUARE, [], 1, "a frame needs beams"),
        ({"a": (0, 0, np.nan), "b": (1, 0, 0)}, [("a", "b")], 1, "point 'a' must be three finite coordinates"),
        ({"a": "here", "b": (1, 0, 0)}, [("a", "b")], 1, "point 'a' must be three finite coordinates"),
        ({"a": (0, 0, 0), "b": (1, 0, 0)}, [("a", (0.5, 0, 0), "b")], 1, "lie in a line"),
        ({"a": (0, 0, 0), "b": (1, 0, 0)}, [("a", (0.5, 0), "b")], 1, "goes through must be three finite"),
        ({"a": (0, 0, 0), "b": (1, 0, 0)}, [("a", "b")], 0, "divisions of group 'g' must be a positive whole"),
        ({"a": (0, 0, 0), "b": (1, 0, 0)}, [("a", "b")], {"h": 1}, "given for 'h'; give one number, or one for each"),
        ({"a": (0, 0, 0), "g.1": (1, 0, 0)}, [("a", "g.1")], 2, "a point is called 'g.1', as a node inside a beam"),
    ],
)
def test_frames_that_are_none(points, beams, divisions, message):
    with pytest.raises(MeshError, match=message):
        mesh_frame(points, {"g": beams}, divisions=divisions)


def test_places_that_are_none():
    frame = mesh_frame({"a": (0, 0, 0), "b": (1, 0, 0)}, {"g": [("a", "b")]}, divisions=2)
    for place in (np.array(["a"]), ["a", "b", "c"], (0.5, True, 0.0), (0.5, 0.0)):
        with pytest.raises(SceneError, match="a place must be a node's name or three finite coordinates in m"):
            frame.node(place)
