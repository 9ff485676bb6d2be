"""A joint of chosen free axes against the joints that it can be, and by coordinates against constraints."""

from __future__ import annotations

from itertools import combinations, permutations, product

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import flexmbd as fm
from flexmbd.errors import SceneError

GRAVITY = (0.4, -1.1, -9.81)
TILT = Rotation.from_rotvec([0.3, -0.5, 0.8]).as_matrix()
EQUAL: dict[str, tuple[tuple[str, str], fm.joint.Joint]] = {
    "fixed": (("", ""), fm.joint.Fixed()),
    "revolute": (("", "y"), fm.joint.Revolute("y")),
    "prismatic": (("x", ""), fm.joint.Prismatic("x")),
    "cylindrical": (("z", "z"), fm.joint.Cylindrical("z")),
    "planar": (("zx", "y"), fm.joint.Planar("y")),
    "universal": (("", "zx"), fm.joint.Universal("z", "x")),
}


def machine(joint, *, position=None, velocity=None, way=None, reverse=False):
    """A swinging carrier and a body on it."""
    scene = fm.System(gravity=GRAVITY)
    carrier = scene.add(fm.RigidBody(1.3, np.diag([0.05, 0.06, 0.07]), (0.2, 0.05, -0.1)), name="carrier")
    body = scene.add(fm.RigidBody(0.9, np.diag([0.02, 0.03, 0.04]), (0.1, 0.05, -0.02)), name="body")
    scene.connect(fm.joint.Revolute("y"), scene.ground.frame(), carrier.frame()).velocity = 1.2
    ends = [carrier.frame(p=(0.4, 0.1, 0.0), R=TILT), body.frame(p=(-0.1, 0.05, 0.02), R=TILT.T)]
    studied = scene.connect(joint, *(ends[::-1] if reverse else ends), way=way)
    if position is not None and len(position):
        studied.position, studied.velocity = position, velocity
    return scene, body, studied


def start_of(scene, body, joint):
    run = scene.simulate(1e-6, h=1e-6)
    return np.concatenate([run.acceleration(body.frame())[0], run.reaction(joint)[0], run.position(body.frame())[0]])


@pytest.mark.parametrize("name", EQUAL)
def test_equal_to_the_joint_that_it_is(name):
    """The same coordinates, motion and reaction, along the tree and as constraints."""
    axes, joint = EQUAL[name]
    count = len(joint.velocity_names)
    x, v = np.linspace(0.1, 0.4, count), np.linspace(0.6, -0.9, count)
    for way in fm.Way:
        found = []
        for one in (fm.joint.Generic(*axes), joint):
            scene, body, studied = machine(one, position=x, velocity=v, way=way)
            assert len(one.rows) == 6 - count
            run = scene.simulate(0.1, h=2e-3, integrator=fm.ExplicitRungeKutta())
            found.append(np.concatenate([run.position(body.frame())[-1], run.reaction(studied)[-1]]))
        np.testing.assert_allclose(found[0], found[1], atol=1e-9)


@pytest.mark.parametrize(
    "axes", [("x", "zy"), ("yz", "xz"), ("xyz", "y"), ("zx", "xyz"), ("", "zyx"), ("xyz", "zyx"), ("y", "zx")]
)
def test_coordinates_and_constraints_agree(axes):
    """Whichever way it goes, and turned round, where the tree can."""
    joint = fm.joint.Generic(*axes)
    count = len(joint.velocity_names)
    x, v = np.linspace(0.1, 0.4, count), np.linspace(0.6, -0.9, count)
    for reverse in (False, True):
        found = [start_of(*machine(joint, position=x, velocity=v, way=way, reverse=reverse)) for way in fm.Way]
        np.testing.assert_allclose(found[0], found[1], atol=3e-11)


def test_where_its_coordinates_lead():
    """Slides along axes of F, then turns one after the other, each about an axis of what those before have turned."""
    orders = ["", *("".join(p) for k in (1, 2, 3) for c in combinations("xyz", k) for p in permutations(c))]
    units = dict(zip("xyz", np.eye(3), strict=True))
    for translations, rotations in product(("", "y", "xz", "zyx"), orders):
        joint = fm.joint.Generic(translations, rotations)
        count = len(translations)
        x = np.linspace(0.2, 0.9, len(joint.velocity_names))
        scene = fm.System()
        body = scene.add(fm.RigidBody(1.0, (1.0, 1.0, 1.0)))
        connection = scene.connect(joint, scene.ground.frame(), body.frame())
        if len(x):
            connection.position = x
        start = scene.at_start()
        p, R = np.zeros(3), np.eye(3)
        for letter, slide in zip(translations, x[:count], strict=True):
            p = p + slide * units[letter]
        for letter, angle in zip(rotations, x[count:], strict=True):
            R = R @ Rotation.from_rotvec(angle * units[letter]).as_matrix()
        np.testing.assert_allclose(start.position(body.frame())[0], p, atol=1e-14)
        np.testing.assert_allclose(start.rotation(body.frame())[0], R, atol=1e-14)


def test_a_loop_that_closes_turned_over_is_refused():
    """Its axis held along y, whatever y is called."""
    scene = fm.System()
    body = scene.add(fm.RigidBody(1.0, (1.0, 1.0, 1.0)), name="body")
    over = scene.add(fm.RigidBody(1.0, (1.0, 1.0, 1.0)), name="over")
    scene.connect(fm.joint.Fixed(), scene.ground.frame(), body.frame())
    scene.connect(fm.joint.Revolute("x"), scene.ground.frame(), over.frame()).position = np.pi
    scene.connect(fm.joint.Generic("xyz", "y"), body.frame(), over.frame(), name="held")
    with pytest.raises(fm.AssemblyError, match="'held'"):
        scene.start()


@pytest.mark.parametrize("given", [("w", ""), ("xx", ""), ("", "yzy"), (1, ""), ("", None), ("X", "")])
def test_axes_that_are_none(given):
    with pytest.raises(SceneError, match="of a Generic joint are letters of 'xyz'"):
        fm.joint.Generic(*given)
