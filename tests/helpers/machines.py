"""Small machines that several tests share."""

from __future__ import annotations

import numpy as np

import flexmbd as fm

CRANK, ROD = 0.08, 0.3


def pendulum(length=1.0):
    """A point mass of 1 kg on a massless arm, from the horizontal at -x, g = 9.81 down y."""
    scene = fm.System(gravity=(0.0, -9.81, 0.0))
    bob = scene.add(fm.RigidBody(1.0, (1e-12, 1e-12, 1e-12), (length, 0.0, 0.0)), name="bob")
    hinge = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), bob.frame())
    hinge.position = np.pi
    return scene, bob, hinge


def slider_crank(rod=None, *, axis="z"):
    """Crank 0.08 m, rod 0.3 m, piston sliding along x; the prismatic joint closes the loop."""
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    crank = scene.add(
        fm.RigidBody(0.4, np.diag([2e-4, 3e-4, 4e-4]), (0.03, 0.0, 0.0)), name="crank"
    )
    if rod is None:
        rod = fm.RigidBody(0.8, np.diag([3e-4, 7e-3, 7.2e-3]), (0.14, 0.0, 0.0))
        conrod = scene.add(rod, name="conrod")
        big, small = conrod.frame(), conrod.frame(p=(ROD, 0.0, 0.0))
    else:
        conrod = scene.add(fm.FlexibleBody(rod), name="conrod")
        big, small = conrod.frame("root"), conrod.frame("tip")
    piston = scene.add(fm.RigidBody(0.3, np.diag([1e-4, 1e-4, 1e-4])), name="piston")
    turn = fm.joint.Revolute(axis)
    j1 = scene.connect(turn, scene.ground.frame(), crank.frame())
    scene.connect(turn, crank.frame(p=(CRANK, 0.0, 0.0)), big)
    scene.connect(turn, small, piston.frame())
    scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(), piston.frame(), name="guide")
    return scene, piston, j1


def slider_position(angle):
    """Closed form of the slider's position (m) over the crank angle (rad)."""
    return CRANK * np.cos(angle) + np.sqrt(ROD**2 - (CRANK * np.sin(angle)) ** 2)
