"""A machine as surfaces that move, for films, pictures, windows and other programs' meshes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmbd.errors import PictureError
from flexmbd.given import checked, is_number, numbers, shown
from flexmbd.multibody.bodies.body import Body, FlexibleBody
from flexmbd.multibody.bodies.continuum_body import ContinuumBody
from flexmbd.record.stress_field import StressModel
from flexmbd.visual.camera import Camera, frame_all, oblique, viewing_axes
from flexmbd.visual.force_arrows import ForceArrows, ForcesAt, forces_at
from flexmbd.visual.library import load
from flexmbd.visual.palette import GROUND, body_colours
from flexmbd.visual.part import Part, RigidPart, placed, reach
from flexmbd.visual.pressure_skin import PressuresAt, pressure_skins
from flexmbd.visual.recorded_motion import RecordedMotion
from flexmbd.visual.recorded_skin import FieldSeries, Look, look_of, recorded_skin, refuse_unknown
from flexmbd.visual.sketch import skeleton, stick_radius, symbols
from flexmbd.visual.skin import skins

FloatArray = NDArray[np.float64]

#: A place (3,) m and a radius (m).
Zoom: TypeAlias = tuple[ArrayLike, float]

# From bare steel: what is not stressed.
BARE = "#b9c2cc"

# Of an arrow's head over a stick's radius, and of the longest arrow over that: a quarter of the scene's extent.
_THICK, _LONGEST = 2.0, 14.0

# Shares of the picture's height that are left free: above for words.
_ABOVE, _BELOW = 0.1, 0.04


@dataclass(frozen=True, eq=False)
class DrawnScene:
    """The surfaces of a scene at nt instants.

    Attributes:
        parts: what is drawn.
        fixed: the shapes of the ground, which stand beside the camera's choice.
        legend: names and colours of what is drawn.
        places: (k, 3) m, by which the view is chosen: frames and centres of mass over all instants.
        gravity: (3,) m/s^2.
        notes: what is written in the picture of each instant.
        eye: the natural (towards, up), each (3,); None: by ``viewing_axes``.
        zoom: a ball that fills the picture's height in the place of all that moves: its middle (3,) and radius, m.
    """

    parts: tuple[Part, ...]
    fixed: tuple[RigidPart, ...]
    legend: Mapping[str, str]
    places: FloatArray
    gravity: FloatArray
    notes: tuple[str, ...]
    eye: tuple[FloatArray, FloatArray] | None = None
    zoom: tuple[FloatArray, float] | None = None

    def camera(self, aspect: float, view: FloatArray | None = None) -> Camera:
        """A camera that sees all that moves at all instants, from a direction ``view`` (3,) or the natural one."""
        if view is None and self.eye is not None:
            towards, up = self.eye
        else:
            towards, up = viewing_axes(self.places, self.gravity, view)
        corners = [reach(part) for part in (self.parts or self.fixed)]
        points = np.concatenate([self.places, *corners])
        whole = frame_all(points, towards, up, aspect=aspect, above=_ABOVE, below=_BELOW)
        if self.zoom is None:
            return whole
        focus, radius = self.zoom
        # so far away that all stands before it
        distance = whole.distance + float(np.linalg.norm(whole.focus - focus))
        return replace(whole, focus=focus, half_height=radius, distance=distance)

    @property
    def quantities(self) -> tuple[tuple[str, str], ...]:
        """The quantities that colours show and their SI units, each once; none that is zero at all instants."""
        found = dict.fromkeys(part.quantity for part in self.parts if part.colour is None)
        return tuple(quantity for quantity in found if self.largest(quantity) > 0.0)

    def largest(self, quantity: tuple[str, str]) -> float:
        """The largest value over all instants."""
        return max(part.largest for part in self.parts if part.colour is None and part.quantity == quantity)

    def to_pyvista(self, k: int = 0) -> Any:
        """A pyvista.MultiBlock of the surfaces at an instant, in the inertial frame (m), a block for each part.

        Values, as "displacement" (m) or "von Mises stress" (Pa), are point data; "colour" is field data.

        Raises:
            PictureError: pyvista is not installed.
        """
        pyvista = load("pyvista")
        blocks = pyvista.MultiBlock()
        names: dict[str, int] = {}
        for part in (*self.parts, *self.fixed):
            places, values = placed(part, k)
            mesh = pyvista.PolyData.from_regular_faces(places, part.triangle)
            if part.colour is None:
                mesh.point_data[part.quantity[0]] = values
            mesh.field_data["colour"] = [part.colour or BARE]
            names[part.label] = count = names.get(part.label, 0) + 1
            blocks.append(mesh, name=part.label if count == 1 else f"{part.label} ({count})")
        return blocks


def drawn_scene(
    motion: RecordedMotion,
    times: FloatArray,
    *,
    notes: Sequence[str],
    amplification: float = 1.0,
    models: Mapping[FlexibleBody, StressModel] | None = None,
    recordings: Sequence[FieldSeries] = (),
    looks: Mapping[ContinuumBody, Look] | None = None,
    frames: bool = False,
    forces: ForcesAt | None = None,
    pressures: PressuresAt | None = None,
    hide: Sequence[Body] = (),
    zoom: Zoom | None = None,
) -> DrawnScene:
    """The surfaces of a machine at ``times`` (nt,) s.  Collective over the communicators of ``models``, if any.

    A body is shown by its ``shape``, or else by the surface that its record holds, deformed and coloured; a recorded
    body with history by its own, coloured by a field; others by symbols.

    Args:
        motion: of the machine.
        times: s.
        notes: what is written in each picture.
        amplification: factor on deformations.
        models: colour these bodies by von Mises stress.
        recordings: of bodies with history.
        looks: how these are shown.
        frames: whether the axes of all frames are drawn.
        forces: drawn as arrows, the largest over all times a quarter of the scene's extent; None: none.
        pressures: by which reduced bodies are coloured, in the place of their displacement or shape; None: none.
        hide: bodies that are left out, as those that stand before what is to be seen.
        zoom: a place (3,) m and a radius (m): the picture's height shows this ball; None: all that moves.

    Raises:
        PictureError: a bad choice.
    """
    refuse_bad_look(amplification=amplification)
    acting = None if forces is None else forces_at(forces, times)
    refuse_unknown(looks or {}, recordings)
    hidden, closer = _names_of(motion, hide), _checked_zoom(zoom)
    bones = skeleton(motion, times)
    colours = dict(zip(motion.bodies, body_colours(len(motion.bodies)), strict=True))
    coloured = models or {}
    pressed = (
        []
        if pressures is None
        else pressure_skins(motion, times, pressures, amplification=amplification, coloured=coloured)
    )
    beside = [body for part in pressed for body in part.covers]
    parts: list[Part] = [*skins(motion, times, coloured, amplification=amplification, beside=beside), *pressed]
    for one in recordings:
        parts.append(recorded_skin(one, times, look_of(looks or {}, one), amplification=amplification))
    valued = [body for part in parts for body in part.covers]
    for name, body in motion.bodies.items():
        if body.shape is not None and not any(body is other for other in valued):
            for piece in body.shape.pieces():
                colour = piece.colour or colours[name]
                parts.append(RigidPart(name, colour, piece.points, piece.triangles, bones.bodies[body], (body,)))
    places = np.concatenate([bones.places, *(reach(part) for part in parts)])
    if not np.isfinite(np.linalg.norm(places)):
        raise PictureError(
            f"with amplification {amplification:g} the machine exceeds the range of floating-point numbers"
        )
    covered = [body for part in parts for body in part.covers]
    parts += symbols(motion, bones, stick_radius(places), colours=colours, shown=covered, frames=frames)
    if acting is not None:
        parts += _arrows(*acting, places)
    sticks = [name for name, body in motion.bodies.items() if name not in hidden and _lacks_surface(body, covered)]
    notes = _with_reasons(notes, sticks)
    bare = {body.name for body in valued}
    legend = {name: BARE if name in bare else _own_colour(motion, name) or colours[name] for name in motion.bodies}
    if hidden:
        parts = [part for part in parts if part.label not in hidden]
        legend = {name: colour for name, colour in legend.items() if name not in hidden}
    gravity, fixed = motion.scene.plan.gravity, _fixed(motion, len(times))
    return DrawnScene(tuple(parts), fixed, legend, bones.places, gravity, tuple(notes), zoom=closer)


def _arrows(tails: FloatArray, forces: FloatArray, places: FloatArray) -> list[Part]:
    """Forces (nt, n, 3) N at places (nt, n, 3) m in a scene of this extent (k, 3); none where none ever acts."""
    thick = _THICK * stick_radius(places)
    arrows = ForceArrows(tails, forces, _LONGEST * thick, thick)
    return [arrows] if arrows.largest > 0.0 else []


def _checked_zoom(zoom: Zoom | None) -> tuple[FloatArray, float] | None:
    """A place (3,) m and a radius (m).

    Raises:
        PictureError: it is none.
    """
    if zoom is None:
        return None
    place, radius = zoom if isinstance(zoom, list | tuple) and len(zoom) == 2 else ((), 0.0)
    middle = numbers(place)
    if not (middle.shape == (3,) and np.isfinite(middle).all() and is_number(radius) and radius > 0.0):
        raise PictureError(
            f"zoom is a place (3,) and a positive radius, in m, as ((0.1, 0, 0), 0.02), got {shown(zoom)}"
        )
    return middle, float(radius)


def _names_of(motion: RecordedMotion, bodies: Sequence[Body]) -> set[str]:
    """The names of bodies of a machine.

    Raises:
        PictureError: one is of another machine.
    """
    for body in bodies:
        if not any(body is other for other in motion.bodies.values()):
            raise PictureError(f"what is to be hidden is no body of this machine: {shown(body)}")
    return {body.name for body in bodies}


def _lacks_surface(body: Body, covered: Sequence[Body]) -> bool:
    return isinstance(body, FlexibleBody) and not any(body is other for other in covered)


def _with_reasons(notes: Sequence[str], bodies: Sequence[str]) -> list[str]:
    """The notes, which also say why flexible bodies, by their names, are drawn as sticks."""
    if not bodies:
        return list(notes)
    named = ", ".join(bodies[:3]) + (", ..." if len(bodies) > 3 else "")
    reason = f"{named} as sticks: no surface in the record; reduce with keep=Keep(surface=True), or give a shape="
    return [f"{note}\n{reason}" if note else reason for note in notes]


def portrait(
    *parts: Part, notes: Sequence[str], legend: Mapping[str, str] | None = None
) -> DrawnScene:
    """A scene of one body, seen mostly along its thinnest direction, its longest one to the right."""
    x = np.concatenate([reach(part) for part in parts])
    return DrawnScene(parts, (), legend or {}, x, np.zeros(3), tuple(notes), eye=oblique(x))


@checked("motion", "recordings", error=PictureError)
def machine_meshes(
    motion: RecordedMotion,
    t: float,
    *,
    amplification: float = 1.0,
    recordings: Sequence[FieldSeries] = (),
    pressures: PressuresAt | None = None,
) -> Any:
    """The scene of a picture at ``t`` (s) as a pyvista.MultiBlock; see ``DrawnScene.to_pyvista``. Not collective.

    ``pressures`` as of ``show``.

    Raises:
        SceneError: a time outside the motion.
        PictureError: pyvista is not installed.
    """
    times = np.atleast_1d(numbers(t))
    return drawn_scene(
        motion, times, notes=[""], amplification=amplification, recordings=recordings, pressures=pressures
    ).to_pyvista()


def _own_colour(motion: RecordedMotion, name: str) -> str | None:
    """The colour of a body's shape, of its first part that has one."""
    shape = motion.bodies[name].shape
    given = [] if shape is None else [piece.colour for piece in shape.pieces()]
    return given[0] if given else None


def _fixed(motion: RecordedMotion, count: int) -> tuple[RigidPart, ...]:
    """The shapes of the ground."""
    ground = motion.scene.parts.ground
    if ground.shape is None:
        return ()
    pose = np.broadcast_to(np.eye(4), (count, 4, 4))
    return tuple(
        RigidPart(ground.name, piece.colour or GROUND, piece.points, piece.triangles, pose)
        for piece in ground.shape.pieces()
    )


def refuse_bad_look(*, amplification: float = 1.0, size: tuple[int, int] = (2, 2)) -> None:
    """Refuse a negative amplification, and sizes that are not two positive even numbers (films need them even).

    Raises:
        PictureError: on each rank that calls.
    """
    if not (is_number(amplification) and amplification >= 0.0):
        raise PictureError(f"the amplification must not be negative, got {amplification!r:.100}")
    whole = isinstance(size, Sequence) and len(size) == 2 and all(isinstance(n, int) for n in size)
    if not whole or not all(n > 0 and n % 2 == 0 for n in size):
        raise PictureError(f"the size must be two positive even numbers of pixels, got {size!r:.100}")


def checked_view(view: ArrayLike | None) -> FloatArray | None:
    """A direction (3,) from the scene to the eye, of length one.

    Raises:
        PictureError: it is none.
    """
    if view is None:
        return None
    vector = numbers(view)
    length = float(np.linalg.norm(vector)) if vector.shape == (3,) else 0.0
    if not (np.isfinite(length) and length > 0.0):
        raise PictureError(f"view is a direction (3,) from the scene to the eye, not all zero, got {view!r}")
    return np.asarray(vector / length)
