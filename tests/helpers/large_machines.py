"""Machines of many bodies, each joined with few others."""

from __future__ import annotations

import numpy as np

import flexmbd as fm

HINGE = fm.joint.Revolute("z")


def brick(**options):
    return fm.RigidBody(0.8, (0.02, 0.03, 0.02), (0.1, 0.0, 0.2), **options)


def lattice(rows, columns):
    """Particles in a plane on springs to their neighbours, the first column on the ground."""
    scene = fm.System(gravity=(0.0, -9.81, 0.0))
    slides = fm.joint.Generic(translations="xy", rotations="")
    frames = {}
    for i in range(columns + 1):
        for j in range(rows):
            place = (0.1 * i, 0.1 * j, 0.0)
            if i == 0:
                frames[i, j] = scene.ground.frame(p=place)
                continue
            body = scene.add(fm.RigidBody(0.1, (1e-4, 1e-4, 1e-4)), name=f"{i}, {j}")
            scene.connect(slides, scene.ground.frame(p=place), body.frame())
            frames[i, j] = body.frame()
    for (i, j), frame in frames.items():
        for to in ((i + 1, j), (i, j + 1), (i + 1, j + 1), (i + 1, j - 1)):
            if to in frames and (i > 0 or to[0] > 0):
                length = 0.1 * np.hypot(to[0] - i, to[1] - j)
                scene.add_force(fm.force.SpringDamper(frame, frames[to], 1e4, 1.0, length))
    return scene


def ladder(windows):
    """Four-bars that hang one from the other, the first on the ground."""
    scene = fm.System(gravity=(0.0, -9.81, 0.0))
    left, right = scene.ground.frame(), scene.ground.frame(p=(1.0, 0.0, 0.0))
    inertia = (0.1, 0.1, 0.1)
    for k in range(windows):
        rail = scene.add(fm.RigidBody(1.0, inertia, (0.0, -0.5, 0.0)), name=f"rail {k}")
        rung = scene.add(fm.RigidBody(1.0, inertia, (0.5, 0.0, 0.0)), name=f"rung {k}")
        other = scene.add(fm.RigidBody(1.0, inertia, (0.0, -0.5, 0.0)), name=f"other rail {k}")
        scene.connect(HINGE, left, rail.frame()).position = 0.3 if k == 0 else 0.0
        scene.connect(HINGE, rail.frame(p=(0.0, -1.0, 0.0)), rung.frame())
        scene.connect(HINGE, rung.frame(p=(1.0, 0.0, 0.0)), other.frame(p=(0.0, -1.0, 0.0)))
        scene.connect(HINGE, right, other.frame())
        left, right = rail.frame(p=(0.0, -1.0, 0.0)), other.frame(p=(0.0, -1.0, 0.0))
    return scene


def combs(teeth):
    """Two chains side by side with springs between their links, which the recursion over a tree does not serve."""
    scene = fm.System(gravity=(0.0, -9.81, 0.0))
    chains = []
    for side in range(2):
        end, links = scene.ground.frame(p=(0.0, 0.0, float(side))), []
        for k in range(teeth):
            link = scene.add(brick(), name=f"link {side}, {k}")
            scene.connect(HINGE, end, link.frame(), name=f"hinge {side}, {k}").position = 0.2 - 0.1 * side
            end = link.frame(p=(0.5, 0.0, 0.0))
            links.append(link)
        chains.append(links)
    for one, other in zip(*chains, strict=True):
        scene.add_force(fm.force.SpringDamper(one.frame((0.2, 0.1, 0.0)), other.frame(), 300.0, 2.0, 0.9))
    return scene


def hammock(links):
    """A chain of balls between two points of the ground, which a further ball closes."""
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    end, ball = scene.ground.frame(), fm.joint.Spherical()
    for k in range(links):
        link = scene.add(brick(), name=f"link {k}")
        joint = scene.connect(ball, end, link.frame(), name=f"ball {k}")
        if k < 2:  # of as many as may be set
            joint.velocity = (0.5, 0.3 * k, -1.0)
        end = link.frame(p=(0.5, 0.0, 0.1))
    scene.connect(ball, scene.ground.frame(p=(0.4 * links, 0.1, 0.0)), end, name="last ball")
    return scene


def marbles(count, *, aside=0.0):
    """Balls in a row that touch the ground and each other with friction, pushed along the row and turning."""
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    radius, shapes = 0.1, []
    law = fm.contact.PowerLaw(k=2e4, p=1.5, restitution=0.6)
    rough = fm.contact.Friction(0.3, stiffness=1e4, damping=20.0, load=10.0)
    floor = fm.contact.HalfSpace(scene.ground.frame())
    for k in range(count):
        ball = scene.add(fm.RigidBody(1.0, (4e-3, 4e-3, 4e-3)), name=f"marble {k}")
        free = scene.connect(fm.joint.Free(), scene.ground.frame(), ball.frame(), name=f"flight {k}")
        free.position = (0.1995 * k, aside * (k % 2), 0.0995, 1.0, 0.0, 0.0, 0.0)
        free.velocity = (1.0 - 0.3 * (k % 3), 0.2, 0.0, 1.0, 5.0, -2.0)
        shapes.append(fm.contact.Sphere(ball.frame(), radius))
        scene.touch(floor, shapes[-1], law, friction=rough)
        if k > 0:
            scene.touch(shapes[-2], shapes[-1], law, friction=rough)
    return scene
