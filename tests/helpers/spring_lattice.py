"""Masses on springs: a plane lattice that hangs on the ground, and pairs of pendulums joined by rods and springs."""

import numpy as np

import flexmbd as fm


def spring_lattice(nx, ny, joint, *, seed=0, load=(0.0, -0.5, 0.0), damping=0.0):
    """A lattice with diagonals, in no particular shape, its first column on the ground; the scene, bodies by node."""
    rng = np.random.default_rng(seed)
    scene, bodies = fm.System(), {}
    places = {(i, j): (i + 0.1 * rng.random(), j + 0.1 * rng.random(), 0.0) for i in range(nx) for j in range(ny)}
    for (i, j), place in places.items():
        if i > 0:
            body = bodies[i, j] = scene.add(fm.RigidBody(2.0, (1.0, 1.0, 1.0)), name=f"m {i} {j}")
            scene.connect(joint, scene.ground.frame(place), body.frame(), name=f"j {i} {j}")
            scene.add_force(fm.force.FrameForce(body.frame(), load))

    def frame(node):
        return bodies[node].frame() if node in bodies else scene.ground.frame(places[node])

    for i, j in places:
        for other in ((i + 1, j), (i, j + 1), (i + 1, j + 1)):
            if other in places and (i > 0 or other[0] > 0):
                length = float(np.linalg.norm(np.subtract(places[i, j], places[other])))
                stiffness = 400.0 * rng.uniform(1, 2)
                spring = fm.force.SpringDamper(frame((i, j)), frame(other), stiffness, length, damping=damping)
                scene.add_force(spring)
    return scene, bodies


def linked_pendulums(count):
    """Pairs of pendulums with a rod between their ends, each pair hung on the next by a spring."""
    scene = fm.System(gravity=(0.0, -9.81, 0.0))
    before = None
    for n in range(count):
        ends = []
        for k, angle in enumerate((0.2, 0.35)):
            body = scene.add(fm.RigidBody(1.0 + 0.1 * k, (0.01, 0.01, 0.02), (0.0, -0.5, 0.0)), name=f"p {n} {k}")
            hinge = scene.connect(fm.joint.Revolute("z"), scene.ground.frame((2.0 * n + 0.6 * k, 0, 0)), body.frame())
            hinge.position = angle
            ends.append(body.frame((0.0, -1.0, 0.0)))
        scene.connect(fm.joint.Distance(0.7), *ends)
        if before is not None:
            scene.add_force(fm.force.SpringDamper(before, ends[0], 3.0, 1.0))
        before = ends[1]
    return scene
