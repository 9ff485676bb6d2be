"""Shapes a thousand kilometres from their frame's origin, scenes that far from theirs: the same but for round-off."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import flexmbd as fm
from flexmbd import contact
from flexmbd.multibody.bodies.solid import unit_ball
from flexmbd.multibody.kernels.base.compiling import entry_kernel
from flexmbd.multibody.kernels.contact.gregory_patch import patch_foot

FAR = np.array([2.0**20, -(2.0**19), 2.0**18])  # m; sums with numbers of few digits are exact
TURN = Rotation.from_rotvec((0.4, 0.9, -0.3)).as_matrix()


def short(x):
    """Rounded to what places at FAR have."""
    return np.round(np.asarray(x) * 2.0**30) / 2.0**30


def surface(shift, radii=(0.25, 0.2, 0.15)):
    points, triangles = unit_ball(8, 12)
    return contact.TriangleSurface(fm.System().ground.frame(), short(points * radii) + shift, triangles)


def cam(shift, **given):
    angle = 2.0 * np.pi * np.arange(24) / 24
    reach = 0.2 + 0.05 * np.cos(angle)
    points = np.stack([reach * np.cos(angle), reach * np.sin(angle)], axis=1)
    return contact.Profile(fm.System().ground.frame(), short(points) + shift[:2], **given)


def probed(shape, points):
    found = shape._distances(np.ascontiguousarray(points), shape.table)
    return found[:, 0], found[:, 1:]


@pytest.mark.parametrize(
    ("build", "most"), [(surface, 1e-13), (lambda shift: cam(shift, spline=True), 2e-9), (cam, 2e-9)]
)
def test_distances_and_normals_far_from_the_origin(build, most):
    """Exactly moved they are the same: of surfaces to round-off of their own size, of profiles of places there."""
    p = short(np.random.default_rng(5).uniform(-0.4, 0.4, (300, 3)))
    near, far = (probed(build(shift), p + shift) for shift in (np.zeros(3), FAR))
    assert far[0] == pytest.approx(near[0], abs=most)
    clear = np.abs(near[0]) > 1e-3  # beside an edge's own place the direction has no digits
    assert far[1][clear] == pytest.approx(near[1][clear], abs=1e3 * most)


@entry_kernel
def feet(data, points, out):
    for k in range(points.shape[0]):
        p = (points[k, 0], points[k, 1], points[k, 2])
        out[k, 0], out[k, 1], out[k, 2] = patch_foot(data, 0, p, 0.3, 0.3)


@pytest.mark.parametrize("shift", [np.zeros(3), FAR])
def test_the_foot_is_within_where_newtons_steps_do_not_become_round_off(shift):
    """Of a patch whose own numbers are those of a far place, as it was before they were seen from a corner."""
    items = surface(np.zeros(3)).table.values
    unit = [abs(np.linalg.norm(items[o + 10 : o + 13]) - 1.0) < 1e-14 for o in range(items.size - 89)]
    o = next(o for o in np.flatnonzero(unit) if items[o] == 1.0)
    control, normal = items[o + 32 : o + 89].reshape(19, 3), items[o + 10 : o + 13]
    middle = control[[0, 4, 8]].mean(axis=0)
    out = np.zeros((1, 3))
    feet((control + shift).ravel(), (middle + 0.05 * normal + shift)[None], out)
    assert out[0, 2] == 0.0
    assert out[0, :2] == pytest.approx([1.0 / 3.0, 1.0 / 3.0], abs=0.1)


SHAPES = {
    "half space": lambda frame: contact.HalfSpace(frame),
    "sphere": lambda frame: contact.Sphere(frame, 0.5),
    "box": lambda frame: contact.Box(frame, (1.0, 1.0, 1.0)),
    "capsule": lambda frame: contact.Capsule(frame, 0.5, 1.0),
    "cylinder": lambda frame: contact.Cylinder(frame, 0.5),
    "profile": lambda frame: contact.Profile(frame, [(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)]),
    "surface": lambda frame: contact.TriangleSurface.of_shape(frame, fm.Shape.box((1.0, 1.0, 1.0))),
}


def bounced(kind, shift, law):
    """Where a ball ends that fell upon a shape and rolls, against ``shift``."""
    scene = fm.System(gravity=(0.0, 0.0, -10.0))
    body = scene.add(fm.RigidBody(1.0, (0.004, 0.004, 0.004)), name="ball")
    free = scene.connect(fm.joint.Free(), scene.ground.frame(), body.frame())
    top = np.array([0.0, 0.0, 0.0 if kind == "half space" else 0.5])
    turn = np.eye(3)
    if kind in ("capsule", "cylinder", "profile"):  # their axis along y
        turn = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
    free.position = (*(shift + top + (0.0, 0.0, 0.109375)), 1.0, 0.0, 0.0, 0.0)
    free.velocity = (0.25, 0.125, 0.0, 0.0, 0.0, 0.0)
    shape = SHAPES[kind](scene.ground.frame(tuple(shift), R=turn))
    friction = None
    if not isinstance(law, contact.Hard):
        friction = contact.Friction(0.3, stiffness=1e4, damping=20.0, load=10.0)
    options = {"rtol": 1e-6, "integrator": fm.ExplicitRungeKutta()}
    if isinstance(law, contact.Hard):
        options = {"h": 2.0**-10}
    given = {} if friction is None else {"friction": friction}
    scene.touch(shape, contact.Sphere(body.frame(), 0.1), law, **given)
    run = scene.simulate(0.25, **options)
    return run.position(body.frame())[-1] - shift, run.velocity(body.frame())[-1]


@pytest.mark.parametrize("law", [contact.PowerLaw(k=1e4, restitution=0.6), contact.Hard(restitution=0.6, mu=0.3)])
@pytest.mark.parametrize("kind", SHAPES)
def test_a_ball_bounces_there_as_here(kind, law):
    """Within the tolerance; of fixed steps within round-off of places there, 1e-10 m, as an impact makes it grow."""
    here, there = bounced(kind, np.zeros(3), law), bounced(kind, FAR, law)
    most = 1e-7 if isinstance(law, contact.Hard) else 3e-5
    assert there[0] == pytest.approx(here[0], abs=most)
    assert there[1] == pytest.approx(here[1], abs=10.0 * most)
    assert abs(here[1][2]) < 0.2  # it met the shape: it would fall with 2.5 m/s
