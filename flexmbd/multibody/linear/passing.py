"""Steps of statics that pass through nothing: what bodies that touch allow of Newton's step."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuation.line_search import ShareTrial
from flexmbd.multibody.contact.elastic_surface import ElasticSurface
from flexmbd.multibody.contact.shapes import Sphere
from flexmbd.multibody.contact.surface_contact import SurfaceContact
from flexmbd.multibody.kernels.base.arrays import Work
from flexmbd.multibody.kernels.elements.table import of_surfaces
from flexmbd.multibody.kernels.reading.force_tables import contacts_by_law, element_numbers, touched_shape
from flexmbd.multibody.kernels.sampling.passing_shares import (
    GAP,
    N_PASSING,
    SHARE,
    TOUCH,
    passing_shares,
    point_shares,
    step_between_frames,
)
from flexmbd.multibody.linear.balance import moved, step_size
from flexmbd.multibody.plan.compiled_scene import CompiledScene

FloatArray = NDArray[np.float64]
AnyPlace = TypeVar("AnyPlace")

_PIECE = 0.3  # rad, or of the machine's extent: of a step along which contacts are asked anew
_PIECES = 1000  # at most


@dataclass(frozen=True)
class Passing:
    """How much of a step may be gone.

    Attributes:
        share: of the step; infinite where it passes through nothing.
        contact: the name of the contact that allows no more; empty without any.
        gap: m, of that before the step; negative where it overlaps.
        touch: of the step, at which something may be touched first; none where it is pressed already, infinite where
            it comes nearer to nothing.
    """

    share: float = np.inf
    contact: str = ""
    gap: float = 0.0
    touch: float = np.inf

    @property
    def meets(self) -> bool:
        """Whether the step comes nearer to something that it may touch, or presses it."""
        return self.touch < np.inf

    @property
    def told(self) -> str:
        """The contact and its gap."""
        how = f"{self.gap:.3g} m apart" if self.gap > 0.0 else f"pressed in by {-self.gap:.3g} m"
        return f"{self.contact}, {how}"


def passing(scene: CompiledScene, work: Work, x: FloatArray, step: FloatArray) -> Passing:
    """How much of a step (nv,) from x (nx,) may be gone before a contact would be on the far side of what it meets.

    Half of the way to the middle of what is met is allowed from outside, half of what is left of it from inside; so
    that no gap closes and opens again on the other side, and what is pressed in is not pushed through.
    """
    if not may_touch(scene) or not np.isfinite(step).all():
        return Passing()
    rows, step = contacts_by_law(scene.plan), np.ascontiguousarray(step)
    found: FloatArray = np.zeros((len(rows), N_PASSING))
    passing_shares(scene.plan, work, rows, x, step, found)
    names = [scene.element_names[k] for k in element_numbers(scene.plan, [*rows])]
    for contact in surfaces_that_touch(scene):
        of_points = touching_points(scene, work, contact, x, step)
        found = np.vstack([found, of_points])
        names += [contact.what] * len(of_points)
    if not len(found):
        return Passing()
    least, touch = int(np.argmin(found[:, SHARE])), float(found[:, TOUCH].min())
    if not found[least, SHARE] < np.inf:
        return Passing(touch=touch)
    return Passing(float(found[least, SHARE]), names[least], float(found[least, GAP]), touch)


def landing(
    place: AnyPlace, share: float, *, touch: float, work: float, before: float, ratio: float
) -> ShareTrial[AnyPlace]:
    """A trial of a share of a step down the energy, that is good where forces push back by a ratio of before at most.

    From where something is touched forces change about linearly: the next trial is where they do no work.

    Args:
        place: at the share.
        share: of the step.
        touch: of the step, at which something is touched first.
        work: (J) that is done against the forces there on the whole step.
        before: the same at its beginning, negative.
        ratio: below 1.
    """
    then = 0.5
    if touch < share and work > 0.0 > before:
        then = (touch + (share - touch) * before / (before - work)) / share
    return ShareTrial(place, share, work - ratio * abs(before), then)


def passing_on_the_way(
    scene: CompiledScene, work: Work, x: FloatArray, step: FloatArray, sizes: FloatArray
) -> Passing:
    """As ``passing``, of a step so long that angles turn on the way: piece by piece; ``sizes`` (nv,): motions'.

    Raises:
        SceneError: on the way the loops do not close.
    """
    size = step_size(sizes, step)
    if not may_touch(scene) or not np.isfinite(size):
        return Passing()
    pieces, found, touch = max(1, int(np.ceil(min(size / _PIECE, _PIECES)))), Passing(), np.inf
    for k in range(pieces):
        place = x if k == 0 else moved(scene, work, x, (k / pieces) * step)
        found = passing(scene, work, place, step / pieces)
        if found.touch <= 1.0 or k == pieces - 1:
            touch = min(touch, (k + found.touch) / pieces)
        if found.share < 1.0:
            return replace(found, share=(k + found.share) / pieces, touch=touch)
    return replace(found, share=np.inf, touch=touch)


def may_touch(scene: CompiledScene) -> bool:
    """Whether there are contacts by a law, or of elastic surfaces."""
    return len(contacts_by_law(scene.plan)) > 0 or bool(of_surfaces(scene.plan).any())


def surfaces_that_touch(scene: CompiledScene) -> list[SurfaceContact]:
    """The contacts of elastic surfaces."""
    if not of_surfaces(scene.plan).any():
        return []
    return [one for one in scene.index.forces if isinstance(one, SurfaceContact)]


def touching_points(
    scene: CompiledScene, work: Work, contact: SurfaceContact, x: FloatArray, step: FloatArray
) -> FloatArray:
    """(p, N_PASSING) of the patches of a surface, or of the sphere that touches one: shares of a step (nv,), and gaps.

    Infinite of what is behind another elastic surface, out of reach of its patches.
    """
    row, motion = scene.index.forces[contact].elements.start, np.zeros(18)
    step_between_frames(scene.plan, work, row, x, step, motion)
    d, R, rate, spin = motion[:3], motion[3:12].reshape(3, 3), motion[12:15], motion[15:]
    arms: FloatArray = np.zeros((1, 3))
    by_modes: FloatArray = np.zeros((1, 3))
    if not isinstance(contact.surface, Sphere):
        modes, phi = scene.index.modes[contact.surface.body], contact.surface.displacements
        arms, by_modes = contact.surface.points + phi @ x[modes.x], phi @ step[modes.v]
    places = d + arms @ R.T
    speeds = rate + np.cross(spin, arms @ R.T) + by_modes @ R.T
    beside, depth = 0.0, np.inf
    o, radius = touched_shape(scene.plan, row)
    found, other = np.zeros((len(places), N_PASSING)), contact.other
    if isinstance(other, ElasticSurface):  # its patches feel what is near them; what it is bent by is small beside that
        beside = float(np.linalg.norm(other.displacements @ step[scene.index.modes[other.body].v], axis=1).max())
        depth = other.felt
    point_shares(scene.plan.data, o, radius, depth, places, speeds, beside, found)
    if isinstance(other, ElasticSurface):
        nearest = np.linalg.norm(places[:, None] - other.points, axis=2).min(axis=1)
        found[(nearest >= depth + radius) & ~(found[:, GAP] > 0.0)] = np.inf
    return found
