"""Machines whose linear equations are known."""

from __future__ import annotations

import numpy as np
from particles import particle_body

import flexmbd as fm

G = 9.81


def chain(links, *, length=1.0):
    """Equal point masses on massless bars, hanging."""
    scene = fm.System(gravity=(0.0, 0.0, -G))
    end, joints = scene.ground.frame(), []
    for k in range(links):
        bob = scene.add(fm.RigidBody(1.3, (1e-12, 1e-12, 1e-12), (0.0, 0.0, -length)), name=f"bob {k}")
        joints.append(scene.connect(fm.joint.Revolute("y"), end, bob.frame(), name=f"hinge {k}"))
        end = bob.frame(p=(0.0, 0.0, -length))
    return scene, joints


def loaded(limb_seed=3):
    """A cart on a prescribed guide, a flexible limb on it at rest under its weight, and a loop through a bar."""
    scene = fm.System(gravity=(0.4, 0.0, -G))
    cart = scene.add(fm.RigidBody(2.0, (0.1, 0.1, 0.1), (0.0, 0.1, 0.05)), name="cart")
    guide = scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(), cart.frame(), name="guide")
    guide.prescribe(lambda t: (0.0, 0.0, 0.0))
    limb = scene.add(fm.FlexibleBody(particle_body(limb_seed, modes=3, damping=1.0).record), name="limb")
    hinge = scene.connect(fm.joint.Revolute("y"), cart.frame(p=(0.1, 0.0, 0.3)), limb.frame("root"), name="hinge")
    hand = scene.add(fm.RigidBody(0.5, (0.01, 0.02, 0.02), (0.05, 0.02, 0.1)), name="hand")
    wrist = scene.connect(fm.joint.Spherical(), limb.frame("tip"), hand.frame(), name="wrist")
    scene.add_force(fm.force.JointSpring(hinge, 30.0, 0.1, 0.5))
    scene.add_force(fm.force.Bushing(limb.frame("tip"), hand.frame(), np.diag([0, 0, 0, 9.0, 8, 7]), 0.2 * np.eye(6)))
    return scene, guide, hinge, wrist, limb, hand


def loop(enforce=None):
    """A four-bar whose ground slides by a prescribed closure, sprung, at rest under its weight."""
    scene = fm.System(gravity=(0.0, 0.0, -G))
    crank = scene.add(fm.RigidBody(1.0, (0.02, 0.03, 0.02), (0.1, 0.0, 0.0)), name="crank")
    rod = scene.add(fm.RigidBody(1.5, (0.02, 0.05, 0.05), (0.25, 0.0, 0.0)), name="rod")
    slide = scene.add(fm.RigidBody(0.7, (0.01, 0.01, 0.01), (0.0, 0.02, 0.0)), name="slide")
    turn = fm.joint.Revolute("y")
    hinge = scene.connect(turn, scene.ground.frame(), crank.frame(), name="hinge")
    scene.connect(turn, crank.frame(p=(0.3, 0.0, 0.0)), rod.frame(), name="knee")
    scene.connect(turn, rod.frame(p=(0.6, 0.0, 0.0)), slide.frame(), name="ankle")
    base = scene.add(fm.RigidBody(3.0, (0.1, 0.1, 0.1)), name="base")
    scene.connect(fm.joint.Prismatic("x"), base.frame(), slide.frame(), name="rail")
    lift = scene.connect(
        fm.joint.Prismatic("z"), scene.ground.frame(), base.frame(), name="lift", way=fm.Way.CONSTRAINTS,
        enforce=enforce,
    )
    lift.prescribe(lambda t: (0.05, 0.0, 0.0))
    scene.add_force(fm.force.JointSpring(hinge, 60.0, -0.4, 0.8))
    hinge.position = -0.5
    return scene, hinge, lift, rod


def rotor(speed=3.0):
    """A hub at constant speed, a flexible blade on it that bends outwards, and a pendulum at its tip."""
    scene = fm.System()
    hub = scene.add(fm.RigidBody(1.0, (0.1, 0.1, 0.1)), name="hub")
    axle = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), hub.frame(), name="axle")
    axle.prescribe(lambda t: (speed * t, speed, 0.0))
    blade = scene.add(fm.FlexibleBody(particle_body(8, modes=3, damping=2.0, size=0.1).record), name="blade")
    scene.connect(fm.joint.Fixed(), hub.frame(p=(0.05, 0.0, 0.0)), blade.frame("root"), name="root")
    bob = scene.add(fm.RigidBody(0.02, (1e-4, 2e-4, 2e-4), (0.1, 0.02, 0.0)), name="bob")
    flap = scene.connect(fm.joint.Revolute("y"), blade.frame("tip"), bob.frame(), name="flap")
    scene.add_force(fm.force.JointSpring(flap, 2.0, 0.0, 0.01))
    return scene, axle, flap, blade
