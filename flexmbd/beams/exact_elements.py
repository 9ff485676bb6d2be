"""Elements and lumps of geometrically exact beams: elasticity between two sections, and the mass of a section.

An element is exact in statics for small deformations of its own, of any curved axis (Castigliano's theorem; Anthonis &
Ramon 2003, eq. 16-21), and for constant strains of any size, as it measures them by the logarithm of the pose
(``pose_logarithm``).  Mass lies on the sections by the weights of Gregory's quadrature, whose error is of the fourth
power of an element's length.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from flexmbd.beams.arc import Arc
from flexmbd.beams.castigliano import Section
from flexmbd.beams.frame_mesh import FrameMesh
from flexmbd.beams.pose_logarithm import logarithm_change, pose_logarithm
from flexmbd.errors import SceneError
from flexmbd.overflow import refuse_not_finite, refuse_overflow

FloatArray = NDArray[np.float64]

# Gregory's correction of the trapezoidal rule at an end, from its outermost weight of 1 on: exact for cubics.
_GREGORY = np.array([3.0 / 8.0, 7.0 / 6.0, 23.0 / 24.0]) - 1.0


@dataclass(frozen=True, eq=False)
class ElementAtRest:
    """An element between two sections.

    Attributes:
        start, end: rows of its nodes.
        group: number of its group of beams.
        R_start, R_end: (3, 3) whose columns are the tangent, y and z of the section, in the frame's axes.
        length: m, along its axis.
        stiffness: (6, 6) against ``logarithm - rest``: N/m, N, N m/rad.
        rest: (6,) the logarithm of the end's pose in the start's, m and rad.
    """

    start: int
    end: int
    group: int
    R_start: FloatArray
    R_end: FloatArray
    length: float
    stiffness: FloatArray
    rest: FloatArray


def elements_at_rest(mesh: FrameMesh, sections: Mapping[str, Section]) -> tuple[ElementAtRest, ...]:
    """The elements of a frame.

    Raises:
        SceneError: a section's orientation lies along its beam.
    """
    found = []
    for (a, b), middle, group in zip(mesh.elements, mesh.middles, mesh.group, strict=True):
        name = mesh.groups[group]
        arc = Arc(mesh.x[a], middle, mesh.x[b])
        found.append(_element(arc, sections[name], name, (int(a), int(b), int(group))))
    return tuple(found)


def _element(arc: Arc, section: Section, name: str, place: tuple[int, int, int]) -> ElementAtRest:
    ends = arc.axes(np.array([0.0, 1.0]), section, name)
    first, last = ends[0].T, ends[1].T
    d, R = first.T @ (arc.end - arc.start), first.T @ last
    change = logarithm_change(d, R)
    rest = pose_logarithm(d, R)
    scale = _scale(arc.length)
    with refuse_overflow(f"the stiffness of an element of {name!r}"):
        flexibility = arc.flexibility(section, name)
        stiffness = np.linalg.inv(_scaled(change @ flexibility @ change.T, arc.length)) * np.outer(scale, scale)
    refuse_not_finite(f"the stiffness of an element of {name!r}", stiffness)
    return ElementAtRest(*place, first, last, arc.length, 0.5 * (stiffness + stiffness.T), rest)


def strained(element: ElementAtRest, strain: FloatArray, group: str) -> ElementAtRest:
    """The element, slack at a strain (6,) beside that of its shape: stretch and shears, twist and curvatures (rad/m).

    Raises:
        SceneError: its sections would be half a revolution apart.
    """
    rest = element.rest + element.length * strain
    if np.linalg.norm(rest[3:]) >= np.pi:
        raise SceneError(
            f"strain of {group!r}: an element of {element.length:.4g} m turns by half a revolution; take more divisions"
        )
    return replace(element, rest=rest)


def _scale(length: float) -> FloatArray:
    """Per unit of each strain: translations by the length, rotations by 1."""
    return np.array([1.0 / length] * 3 + [1.0] * 3)


def _scaled(flexibility: FloatArray, length: float) -> FloatArray:
    scale = _scale(length)
    return flexibility * np.outer(scale, scale)


def beam_weights(count: int) -> FloatArray:
    """(count + 1,) weights of the sections of a beam of ``count`` equal elements, whose sum is ``count``.

    Gregory's: exact for cubics from two elements on, so that mass, centre and inertia of a straight beam are right;
    never negative.  Of one element half on each end.
    """
    weights = np.ones(count + 1)
    if count == 1:
        return 0.5 * weights
    weights[:3] += _GREGORY
    weights[::-1][:3] += _GREGORY
    return weights


def beams_of(elements: Sequence[ElementAtRest], points: int) -> list[list[ElementAtRest]]:
    """The elements of each beam: it begins at a named point, and they are in order."""
    beams: list[list[ElementAtRest]] = []
    for one in elements:
        if one.start < points:
            beams.append([])
        beams[-1].append(one)
    return beams


def node_weights(elements: Sequence[ElementAtRest], points: int, nodes: int) -> list[list[tuple[ElementAtRest, float]]]:
    """What each node carries of each beam there: an element at the node, whose section it is, and a length (m)."""
    carried: list[list[tuple[ElementAtRest, float]]] = [[] for _ in range(nodes)]
    for beam in beams_of(elements, points):
        rows = [beam[0].start, *(one.end for one in beam)]
        for row, one, weight in zip(rows, [beam[0], *beam], beam_weights(len(beam)), strict=True):
            carried[row].append((one, weight * one.length))
    return carried


def section_spread(section: Section) -> FloatArray:
    """(2, 2) integral of {y, z} {y, z} over the section, m^4."""
    return np.array([[section.Iz, section.Iyz], [section.Iyz, section.Iy]])
