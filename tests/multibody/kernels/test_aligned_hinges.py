"""Joints along the axes of their parent, which the recursion takes a shorter way, against the general way.

Most machines are made of them: a hinge about z on a body whose own hinge is about z.  The two ways are run over the
same machine, in every combination of two joints one on the other, of rigid and flexible bodies, of chain and branch,
with loads and without.
"""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from particles import particle_body
from random_trees import NOTHING, somewhere
from scipy.spatial.transform import Rotation

import flexmbd as fm
from flexmbd.multibody.kernels.forward_dynamics import articulated_layout as to
from flexmbd.multibody.kernels.forward_dynamics.articulated import articulate, forward_dynamics, solve_mass

JOINTS = {
    "hinge": fm.joint.Revolute("z"),
    "slide": fm.joint.Prismatic("z"),
    "screw": fm.joint.Screw(0.3, "z"),
    "weld": fm.joint.Fixed(),
    "driven hinge": fm.joint.Revolute("z"),
    "driven slide": fm.joint.Prismatic("z"),
}
ROOTS = {"hinge": fm.joint.Revolute("z"), "ball": fm.joint.Spherical()}
SHAPES = {"chain": (0, 1, 2), "branch": (0, 1, 1), "two roots": (0, 0, 2)}  # the parent of the second to fourth body


def body_of(kind, seed, scene):
    """A rigid body with all products of inertia, or a flexible one."""
    rng = np.random.default_rng(seed)
    if kind == "flexible":
        return scene.add(fm.FlexibleBody(particle_body(seed, modes=4, damping=1.0).record), name=f"body {seed}")
    lever = Rotation.random(random_state=seed).as_matrix()
    inertia = lever @ np.diag(rng.uniform(0.02, 0.03, 3)) @ lever.T
    return scene.add(fm.RigidBody(rng.uniform(0.5, 2.0), inertia, tuple(rng.standard_normal(3) * 0.2)), name=f"{seed}")


def mark(body, p, R):
    """A frame on a body; of a flexible one its own."""
    return body.frame() if isinstance(body, fm.FlexibleBody) else body.frame(p=p, R=R)


def machine(lower, upper, *, root="ball", second="rigid", shape="chain", tilt=None, loaded=False):
    """Four bodies: ``root`` on the ground, then ``lower``, ``upper`` and a hinge; ``tilt`` turns the lower's frame.

    On a ball all of it turns in space; on a hinge all axes stay parallel.
    """
    rng = np.random.default_rng(1)
    scene = fm.System(gravity=(1.0, -9.0, 3.0))
    bodies = [scene.ground]
    parents = (0, *(1 + k for k in SHAPES[shape]))
    for k, name in enumerate((root, lower, upper, "hinge")):
        body = body_of(second if k == 1 else "rigid", k + 1, scene)
        turn = np.eye(3) if tilt is None or k != 1 else Rotation.from_rotvec(tilt).as_matrix()
        place = rng.standard_normal((2, 3)) * 0.3
        inner, outer = mark(bodies[parents[k]], place[0], turn), mark(body, place[1], np.eye(3))
        joint = scene.connect(ROOTS[name] if k == 0 else JOINTS[name], inner, outer)
        if name.startswith("driven"):
            joint.prescribe(fm.Sine(0.3, 1.7, 0.4))
        bodies.append(body)
        if loaded:
            here = scene.ground.frame(p=(0.2 * k, -0.1, 0.3))
            scene.add_force(fm.force.Bushing(here, outer, np.linspace(20.0, 40.0, 6), np.linspace(0.3, 0.1, 6)))
            if len(joint.joint.velocity_names) == 1 and not name.startswith("driven"):
                scene.add_force(fm.force.JointSpring(joint, 30.0, 0.2, 1.5))
    return scene.compile().scene


def general(aw):
    """The same recursion with no joint taken for one along its parent's axes."""
    link = aw.link.copy()
    link[link[:, to.FORM] <= to.ALIGNED, to.FORM] = to.TURNED
    return aw.replace(link=link, planar=np.zeros_like(aw.planar))


def answers(compiled, make, seed=3):
    """Accelerations, and what unit forces make of the machine by the factors of either entry."""
    x, v, work = somewhere(compiled, seed)
    plan, rhs = compiled.plan, np.eye(compiled.nv)
    aw = make(to.new_articulated_work(plan))
    a, moved, again = np.zeros(compiled.nv), np.zeros_like(rhs), np.zeros_like(rhs)
    forward_dynamics(plan, work, aw, x, v, a, NOTHING)
    solve_mass(plan, work, aw, rhs, moved)
    articulate(plan, work, aw, x)
    solve_mass(plan, work, aw, rhs, again)
    return aw, a, moved, again


@pytest.mark.parametrize("loaded", [False, True])
@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("second", ["rigid", "flexible"])
@pytest.mark.parametrize("root", ROOTS)
@pytest.mark.parametrize(("lower", "upper"), [*product(JOINTS, JOINTS)])
def test_the_short_way_is_the_general_one(lower, upper, root, second, shape, loaded):
    compiled = machine(lower, upper, root=root, second=second, shape=shape, loaded=loaded)
    short, *found = answers(compiled, lambda aw: aw)
    assert (short.link[root == "ball" :, to.FORM] <= to.ALIGNED).all()
    _, *expected = answers(compiled, general)
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_allclose(one, other, rtol=0.0, atol=1e-12 * np.abs(other).max())


def test_every_short_form_is_met():
    """Plain hinges, aligned joints, and trees of parallel hinges alone, which have a recursion of their own."""
    forms, planar = set(), set()
    for lower, upper, second, shape in product(JOINTS, JOINTS, ("rigid", "flexible"), SHAPES):
        aw = to.new_articulated_work(machine(lower, upper, root="hinge", second=second, shape=shape).plan)
        forms |= set(aw.link[:, to.FORM])
        planar.add((lower == upper == "hinge" and second == "rigid", bool(aw.planar[0])))
    assert forms == {to.PLAIN, to.ALIGNED}
    assert planar == {(True, True), (False, False)}


@pytest.mark.parametrize("second", ["rigid", "flexible"])
@pytest.mark.parametrize("lower", JOINTS)
def test_a_tilted_axis_goes_the_general_way_and_tends_to_the_short_one(lower, second):
    """Off by 1e-3, 1e-6 and 1e-9 rad: accelerations differ by the tilt, in proportion."""
    _, straight, *_ = answers(machine(lower, "hinge", second=second), lambda aw: aw)
    apart = []
    for angle in (1e-3, 1e-6, 1e-9):
        tilted = machine(lower, "hinge", second=second, tilt=angle * np.array([0.6, -0.8, 0.0]))
        aw, a, *_ = answers(tilted, lambda aw: aw)
        assert aw.link[1, to.FORM] == to.TURNED
        apart.append(np.abs(a - straight).max() / np.abs(straight).max())
    assert 1e-5 < apart[0] < 0.1
    assert apart[1] == pytest.approx(1e-3 * apart[0], rel=0.05)
    assert apart[2] < 1.05e-6 * apart[0]
