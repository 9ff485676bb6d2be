"""Shapes along exact beams: a rope over a drum, a cable on a floor, a ball on a rope."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmbd.beams.exact_elements import beams_of, node_weights
from flexmbd.errors import SceneError
from flexmbd.given import checked, refuse_other
from flexmbd.multibody.bodies.body import Frame
from flexmbd.multibody.contact.shapes import Capsule, Sphere
from flexmbd.multibody.exact_beam import ExactBeam

FloatArray = NDArray[np.float64]


@checked("group", "radius")
def spheres_along(beam: ExactBeam, group: str, radius: float) -> tuple[tuple[Sphere, ...], FloatArray]:
    """Spheres about the nodes of a group of beams, by which it touches other shapes, and the length each stands for.

    The lengths are those by which the beam's mass lies in its nodes; their sum is the length of the group's beams.  A
    law of k (N/m) per length is one of k times its length for each sphere, under which a cable on a floor is as deep
    everywhere.

    Args:
        beam: the beam.
        group: of its beams.
        radius: m, as that of the rope.

    Returns:
        (k,) spheres in the order of the beam's nodes, and (k,) m.

    Raises:
        SceneError: no such group, or a radius that is not positive.
    """
    number = _group(beam, group)
    carried = node_weights(beam.elements, beam.mesh.points, len(beam.mesh.x))
    lengths = np.array([sum(length for one, length in each if one.group == number) for each in carried])
    rows = np.flatnonzero(lengths)
    return tuple(Sphere(beam.frame(beam.mesh.names[row]), radius) for row in rows), lengths[rows]


@checked("group", "radius")
def capsules_along(beam: ExactBeam, group: str, radius: float) -> tuple[Capsule, ...]:
    """Capsules along a group of beams, which spheres touch: one a node, from an element's middle to the next one's.

    Each is straight and turns with its section.  Where two meet, a sphere next to their ends touches both.

    Args:
        beam: the beam.
        group: of its beams.
        radius: m, as that of the rope.

    Raises:
        SceneError: no such group, or a radius that is not positive.
    """
    number = _group(beam, group)
    found = []
    for elements in beams_of(beam.elements, beam.mesh.points):
        if elements[0].group != number:
            continue
        for k in range(len(elements) + 1):
            before = 0.5 * elements[k - 1].length if k > 0 else 0.0
            after = 0.5 * elements[k].length if k < len(elements) else 0.0
            row = elements[k].start if k < len(elements) else elements[-1].end
            axes = elements[k].R_start if k < len(elements) else elements[-1].R_end
            node = beam.frame(beam.mesh.names[row])
            along = Frame(node.body, 0.5 * (after - before) * axes[:, 0], axes[:, [1, 2, 0]], None, node.label)
            found.append(Capsule(along, radius, before + after))
    return tuple(found)


def _group(beam: ExactBeam, group: str) -> int:
    """The group's number."""
    refuse_other(beam, ExactBeam, "what shapes are spread along", wanted="fm.ExactBeam(...)")
    if group not in beam.mesh.groups:
        raise SceneError(f"no group {group!r}; the groups are: {', '.join(map(repr, beam.mesh.groups))}")
    return beam.mesh.groups.index(group)
