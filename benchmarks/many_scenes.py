"""Machines of many bodies, here and in exudyn, for `many_bodies.py`: each builds one by its sizes.

exudyn's are those that its documentation has for speed: points of the plane on spring-dampers, planar bodies on planar
hinges with index 3, an output nowhere, the sparse solver.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from typing import Any

import numpy as np

import flexmbd as fm

GRAVITY, LIGHT = 9.81, 0.981  # m/s^2; of lattices, which sag by a tenth of their depth
MASS, STIFFNESS, DAMPING = 0.1, 4.0e4, 2.0  # kg, N/m, N s/m
LINK, LINK_MASS, LINK_INERTIA = 0.2, 0.5, 2e-3  # m, kg, kg m^2 about the centre
RUNG = 0.5  # m

Place = tuple[int, int]


def springs(nx: int, ny: int) -> Iterator[tuple[Place, Place, float]]:
    """Pairs of nodes of a lattice with spacing 1 m, and their distance; columns -1 and nx are walls."""
    for i in range(-1, nx):
        for j in range(ny):
            for di, dj in ((1, 0), (0, 1), (1, 1), (1, -1)):
                if 0 <= j + dj < ny and not (i == -1 and di == 0):
                    yield (i, j), (i + di, j + dj), float(np.hypot(di, dj))


def lattice(nx: int, ny: int) -> tuple[fm.System, list[fm.Frame]]:
    """Point masses on springs between two walls, which sag; their frames."""
    system, frames = fm.System(gravity=(0.0, -LIGHT, 0.0)), {}
    for i in range(nx):
        for j in range(ny):
            point = system.add(fm.PointMass(MASS))
            frames[i, j] = point.frame()
            plane = system.connect(fm.joint.PlanarPoint("z"), system.ground.frame(), frames[i, j])
            plane.position = (float(i), float(j))
    for one, other, length in springs(nx, ny):
        ends = [frames.get(end) or system.ground.frame(p=(*map(float, end), 0.0)) for end in (one, other)]
        system.add_force(fm.force.SpringDamper(*ends, stiffness=STIFFNESS, length=length, damping=DAMPING))
    return system, list(frames.values())


def unbalanced(places: np.ndarray, nx: int, ny: int) -> float:
    """The largest force (N) that is left on a node of a lattice whose nodes are at rest at ``places`` (nx ny, 2) m."""
    numbers = {(i, j): i * ny + j for i in range(nx) for j in range(ny)}
    nodes = [*places, *(np.array(end, float) for end in _walls(nx, ny))]
    numbers |= {end: len(places) + k for k, end in enumerate(_walls(nx, ny))}
    known = list(springs(nx, ny))
    one, other = (np.array([numbers[pair[k]] for pair in known]) for k in range(2))
    d = np.array(nodes)[other] - np.array(nodes)[one]
    length = np.linalg.norm(d, axis=1)
    pull = (STIFFNESS * (length - np.array([pair[2] for pair in known])) / length)[:, None] * d
    left = np.tile([0.0, -LIGHT * MASS], (len(nodes), 1))
    np.add.at(left, one, pull)
    np.subtract.at(left, other, pull)
    return float(np.abs(left[: len(places)]).max())


def _walls(nx: int, ny: int) -> list[Place]:
    return [(i, j) for i in (-1, nx) for j in range(ny)]


def chain(links: int) -> tuple[fm.System, list[fm.Frame]]:
    """Rigid links on hinges, from the horizontal; where each begins."""
    system, frames = fm.System(gravity=(0.0, -GRAVITY, 0.0)), []
    end = system.ground.frame()
    for _ in range(links):
        link = system.add(fm.RigidBody(LINK_MASS, (LINK_INERTIA,) * 3, (0.5 * LINK, 0.0, 0.0)))
        system.connect(fm.joint.Revolute("z"), end, link.frame())
        end = link.frame(p=(LINK, 0.0, 0.0))
        frames.append(end)
    return system, frames


def ladder(windows: int) -> tuple[fm.System, list[fm.Frame]]:
    """A hanging ladder: each rung hangs on two ropes' links, a loop a window; where each rung ends."""
    system, frames = fm.System(gravity=(0.0, -GRAVITY, 0.0)), []
    ends = [system.ground.frame(p=(x, 0.0, 0.0)) for x in (0.0, RUNG)]
    hinge, inertia = fm.joint.Revolute("z"), (LINK_INERTIA,) * 3
    for k in range(windows):
        ropes = [system.add(fm.RigidBody(LINK_MASS, inertia, (0.0, -0.5 * LINK, 0.0))) for _ in range(2)]
        rung = system.add(fm.RigidBody(LINK_MASS, inertia, (0.5 * RUNG, 0.0, 0.0)))
        first = [system.connect(hinge, end, rope.frame()) for end, rope in zip(ends, ropes, strict=True)]
        foot = [rope.frame(p=(0.0, -LINK, 0.0)) for rope in ropes]
        system.connect(hinge, foot[0], rung.frame())
        system.connect(hinge, rung.frame(p=(RUNG, 0.0, 0.0)), foot[1])
        ends = [rung.frame(), rung.frame(p=(RUNG, 0.0, 0.0))]
        frames.append(ends[1])
        if k == 0:
            first[0].velocity = 1.0
    return system, frames


def four_bars(loops: int) -> fm.System:
    """Four-bars side by side, each begun at another angle, to be closed at the start."""
    system, hinge = fm.System(gravity=(0.0, -GRAVITY, 0.0)), fm.joint.Revolute("z")
    for k in range(loops):
        lengths = (0.2, 0.5, 0.3)
        crank, coupler, rocker = (
            system.add(fm.RigidBody(LINK_MASS, (LINK_INERTIA,) * 3, (0.5 * length, 0.0, 0.0))) for length in lengths
        )
        drive = system.connect(hinge, system.ground.frame(p=(0.0, 0.0, k)), crank.frame())
        system.connect(hinge, crank.frame(p=(lengths[0], 0.0, 0.0)), coupler.frame())
        system.connect(hinge, coupler.frame(p=(lengths[1], 0.0, 0.0)), rocker.frame(p=(lengths[2], 0.0, 0.0)))
        system.connect(hinge, system.ground.frame(p=(0.45, 0.0, k)), rocker.frame())
        drive.position, drive.velocity = 1.0 + 0.5 * k / loops, 2.0
    return system


def pendulums(count: int) -> tuple[fm.System, list[fm.Frame]]:
    """Side by side, each begun at another angle; their ends."""
    system, frames = fm.System(gravity=(0.0, -GRAVITY, 0.0)), []
    for k in range(count):
        link = system.add(fm.RigidBody(LINK_MASS, (LINK_INERTIA,) * 3, (0.5 * LINK, 0.0, 0.0)))
        hinge = system.connect(fm.joint.Revolute("z"), system.ground.frame(), link.frame())
        hinge.position = 1.5 * (k + 1) / count
        frames.append(link.frame(p=(LINK, 0.0, 0.0)))
    return system, frames


def cluster(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Places (n, 3) m and velocities (n, 3) m/s of bodies of 1/n kg that attract each other with G = 1."""
    side = int(np.ceil(count ** (1 / 3)))
    grid = np.array([(i, j, k) for i in range(side) for j in range(side) for k in range(side)], float)[:count]
    place = (2.0 * (grid + np.random.default_rng(7).uniform(0.3, 0.7, grid.shape))) / side - 1.0
    return place, 0.4 * np.cross([0.0, 0.0, 1.0], place)


def stars(count: int) -> tuple[fm.System, list[fm.Frame]]:
    """The cluster by one element of gravitation."""
    system, bodies = fm.System(), []
    for place, velocity in zip(*cluster(count), strict=True):
        bodies.append(system.add(fm.PointMass(1.0 / count)))
        flight = system.connect(fm.joint.Translation(), system.ground.frame(), bodies[-1].frame())
        flight.position, flight.velocity = place, velocity
    system.add_force(fm.force.Gravitation(bodies, G=1.0))
    return system, [body.frame() for body in bodies]


# -- exudyn ------------------------------------------------------------------------------------------------------------


def modules() -> tuple[Any, Any]:
    """exudyn in the build without range checks, and its items.

    Raises:
        ImportError: it is not installed.
    """
    os.environ.setdefault("EXUDYN_MODULE", "fast")
    import exudyn
    import exudyn.itemInterface as item

    return exudyn, item


def exudyn_lattice(nx: int, ny: int) -> Any:
    """`lattice` by points of the plane."""
    exudyn, item = modules()
    system, markers = exudyn.SystemContainer().AddSystem(), {}
    ground = system.AddObject(item.ObjectGround())
    for i in range(-1, nx + 1):
        for j in range(ny):
            if i in (-1, nx):
                marker = item.MarkerBodyPosition(bodyNumber=ground, localPosition=[float(i), float(j), 0.0])
                markers[i, j] = system.AddMarker(marker)
                continue
            node = system.AddNode(item.NodePoint2D(referenceCoordinates=[float(i), float(j)]))
            body = system.AddObject(item.ObjectMassPoint2D(mass=MASS, nodeNumber=node))
            markers[i, j] = system.AddMarker(item.MarkerBodyPosition(bodyNumber=body))
            system.AddLoad(item.Force(markerNumber=markers[i, j], loadVector=[0.0, -LIGHT * MASS, 0.0]))
    for one, other, length in springs(nx, ny):
        ends = [markers[one], markers[other]]
        system.AddObject(
            item.SpringDamper(markerNumbers=ends, stiffness=STIFFNESS, damping=DAMPING, referenceLength=length)
        )
    return system


def _exudyn_link(system: Any, item: Any, place: list[float], angle: float, turn: float = 0.0) -> Any:
    """A planar body whose frame is its centre of mass, with its weight."""
    node = system.AddNode(item.NodeRigidBody2D(referenceCoordinates=[*place, 0.0], initialCoordinates=[0, 0, angle],
                                               initialVelocities=[0.0, 0.0, turn]))  # fmt: skip
    body = system.AddObject(item.ObjectRigidBody2D(mass=LINK_MASS, inertia=LINK_INERTIA, nodeNumber=node))
    centre = system.AddMarker(item.MarkerBodyPosition(bodyNumber=body))
    system.AddLoad(item.Force(markerNumber=centre, loadVector=[0.0, -GRAVITY * LINK_MASS, 0.0]))
    return body


def _exudyn_hinge(system: Any, item: Any, one: Any, at: list[float], other: Any, there: list[float]) -> None:
    ends = [(one, at), (other, there)]
    markers = [system.AddMarker(item.MarkerBodyPosition(bodyNumber=b, localPosition=[*p, 0.0])) for b, p in ends]
    system.AddObject(item.RevoluteJoint2D(markerNumbers=markers))


def exudyn_chain(links: int) -> Any:
    """`chain` by planar bodies."""
    exudyn, item = modules()
    system = exudyn.SystemContainer().AddSystem()
    before, at = system.AddObject(item.ObjectGround()), [0.0, 0.0]
    for k in range(links):
        link = _exudyn_link(system, item, [(k + 0.5) * LINK, 0.0], 0.0)
        _exudyn_hinge(system, item, before, at, link, [-0.5 * LINK, 0.0])
        before, at = link, [0.5 * LINK, 0.0]
    return system


def exudyn_ladder(windows: int) -> Any:
    """`ladder` by planar bodies; the links of the first window turn, and all hangs on them."""
    exudyn, item = modules()
    system = exudyn.SystemContainer().AddSystem()
    ground = system.AddObject(item.ObjectGround())
    ends = [(ground, [0.0, 0.0]), (ground, [RUNG, 0.0])]
    for k in range(windows):
        top, turn = -k * LINK, 1.0 if k == 0 else 0.0
        ropes = []
        for x in (0.0, RUNG):
            rope = _exudyn_link(system, item, [x, top - 0.5 * LINK], 0.0, turn)
            _set_speed(system, rope, [0.5 * LINK * turn if k == 0 else LINK, 0.0])
            ropes.append(rope)
        rung = _exudyn_link(system, item, [0.5 * RUNG, top - LINK], 0.0)
        _set_speed(system, rung, [LINK, 0.0])
        for (body, at), rope in zip(ends, ropes, strict=True):
            _exudyn_hinge(system, item, body, at, rope, [0.0, 0.5 * LINK])
        _exudyn_hinge(system, item, ropes[0], [0.0, -0.5 * LINK], rung, [-0.5 * RUNG, 0.0])
        _exudyn_hinge(system, item, ropes[1], [0.0, -0.5 * LINK], rung, [0.5 * RUNG, 0.0])
        ends = [(rung, [-0.5 * RUNG, 0.0]), (rung, [0.5 * RUNG, 0.0])]
    return system


def _set_speed(system: Any, body: Any, speed: list[float]) -> None:
    node = system.GetObject(body)["nodeNumber"]
    turn = system.GetNode(node)["initialVelocities"][2]
    system.SetNodeParameter(node, "initialVelocities", [*speed, turn])


def exudyn_pendulums(count: int) -> Any:
    """`pendulums` by planar bodies."""
    exudyn, item = modules()
    system = exudyn.SystemContainer().AddSystem()
    ground = system.AddObject(item.ObjectGround())
    for k in range(count):
        angle = 1.5 * (k + 1) / count
        centre = [0.5 * LINK * np.cos(angle), 0.5 * LINK * np.sin(angle)]
        link = _exudyn_link(system, item, centre, angle)
        _exudyn_hinge(system, item, ground, [0.0, 0.0], link, [-0.5 * LINK, 0.0])
    return system


def exudyn_stars(count: int) -> Any:
    """`stars` by a spring-damper a pair, whose force is an expression that exudyn evaluates without Python."""
    exudyn, item = modules()
    from exudyn.advancedUtilities import CreateSymbolicUserFunction

    system = exudyn.SystemContainer().AddSystem()

    def attraction(mbs, t, itemNumber, deltaL, deltaL_t, stiffness, damping, force):  # type: ignore[no-untyped-def]
        return stiffness / ((deltaL + 1.0) * (deltaL + 1.0))

    law = CreateSymbolicUserFunction(
        system, attraction, "springForceUserFunction", itemTypeName="ObjectConnectorSpringDamper"
    )
    system.variables["law"] = law  # which must live as long as the system does
    markers = []
    for place, velocity in zip(*cluster(count), strict=True):
        node = system.AddNode(item.NodePoint(referenceCoordinates=place, initialVelocities=velocity))
        body = system.AddObject(item.MassPoint(mass=1.0 / count, nodeNumber=node))
        markers.append(system.AddMarker(item.MarkerBodyPosition(bodyNumber=body)))
    for i in range(count):
        for j in range(i + 1, count):
            ends = {"markerNumbers": [markers[i], markers[j]], "referenceLength": 1.0}
            system.AddObject(item.SpringDamper(**ends, stiffness=1.0 / count**2, springForceUserFunction=law))
    return system
