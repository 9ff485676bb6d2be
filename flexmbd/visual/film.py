"""Films of a machine, drawn off-screen by pyvista and written as .mp4 or .gif."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import PictureError
from flexmbd.multibody.bodies.body import FlexibleBody
from flexmbd.multibody.bodies.continuum_body import ContinuumBody
from flexmbd.visual import stage
from flexmbd.visual.camera import Camera, frame_all, viewing_axes
from flexmbd.visual.destination import checked_path, write
from flexmbd.visual.library import load
from flexmbd.visual.recorded_motion import RecordedMotion
from flexmbd.visual.recorded_skin import FieldSeries, Look, look_of, recorded_skin, refuse_unknown
from flexmbd.visual.sketch import Shape, Sketch, sketch
from flexmbd.visual.skin import Skin, skins
from flexmbd.visual.stress_picture import StressModel

FloatArray = NDArray[np.float64]
Picture = NDArray[np.uint8]

#: What ``animate`` writes.
SUFFIXES = (".gif", ".mp4")

# A motion shorter than the first is slowed down to a film of the second (s).
_SHORT, _SLOWED = 3.0, 8.0

# Shares of the picture's height that are left to words: above, and below with a colour bar.
_ABOVE, _BELOW = 0.08, 0.13


def animate(
    trajectory: RecordedMotion,
    path: str | Path,
    *,
    between: tuple[float, float] | None = None,
    slow_motion: float | None = None,
    fps: int = 30,
    size: tuple[int, int] = (1280, 720),
    amplification: float = 1.0,
    models: Mapping[FlexibleBody, StressModel] | None = None,
    recordings: Sequence[FieldSeries] = (),
    looks: Mapping[ContinuumBody, Look] | None = None,
    progress: bool = False,
) -> Path:
    """Film the machine.

    A flexible body whose record holds its surface shows it, deformed and coloured; other bodies
    are drawn as sticks between their frames with a ball at the centre of mass.  A body with history
    that was recorded shows its surface, coloured by a field.  The camera stands
    still and projects in parallel, along the normal of a plane motion.

    Collective over the trajectory's team, whose root draws and writes, and over the communicators
    of ``models``.

    Args:
        trajectory: what to film.
        path: .mp4 or .gif; an existing file survives a failure.
        between: first and last time (s); by default the whole trajectory.
        slow_motion: seconds of film for a second of motion; by default 1 for a motion of 3 s or
            longer, and for a shorter one what makes a film of 8 s.
        fps: pictures for a second of film.
        size: width and height in pixels, even numbers.
        amplification: factor on the deformation of surfaces, beyond the rigid motion that follows
            their interfaces; stated in the picture.
        models: colours these bodies by von Mises stress instead of displacement.
        recordings: of bodies with history; what ``Trajectory.animate`` gives is its own.
        looks: how bodies with history are shown; by default coloured by von Mises stress.
        progress: show a progress bar.

    Returns:
        The path.

    Raises:
        PictureError: an unknown suffix, a bad choice, a file that cannot be written; on all ranks.
        SceneError: ``between`` is outside the trajectory.
    """
    target = checked_path(path, SUFFIXES)
    times, slowness = _times(trajectory, between, slow_motion, fps)
    if not (np.isfinite(amplification) and amplification >= 0.0):
        raise PictureError(f"the amplification must not be negative, got {amplification}")
    refuse_unknown(looks or {}, recordings)
    shown = skins(trajectory, times, models or {}, amplification=amplification)
    for one in recordings:
        shown.append(recorded_skin(one, times, look_of(looks or {}, one), amplification=amplification))
    error: Exception | None = None
    if trajectory.team.is_root:
        try:
            drawn = sketch(trajectory, times, skinned=[body for skin in shown for body in skin.covers])
            notes = _notes(times, slowness, amplification if shown else 1.0)
            gravity = trajectory.scene.plan.gravity
            camera = _camera(drawn, shown, gravity, aspect=size[0] / size[1])

            def fill(temporary: Path) -> None:
                pictures = _pictures(drawn, shown, notes, camera, size)
                _write_film(temporary, pictures, fps, len(times), progress=progress)

            write(target, fill)
        except Exception as caught:  # noqa: BLE001  (whatever it is, all ranks must hear of it)
            error = caught
    trajectory.team.fail(error)
    return target


def _times(
    trajectory: RecordedMotion,
    between: tuple[float, float] | None,
    slow_motion: float | None,
    fps: int,
) -> tuple[FloatArray, float]:
    """Times (nt,) of the film's pictures, and seconds of film for a second of motion."""
    first, last = between or (float(trajectory.t[0]), float(trajectory.t[-1]))
    span = last - first
    if not span > 0.0:
        raise PictureError(f"a film from {first:g} to {last:g} s shows nothing")
    if slow_motion is None:
        slow_motion = 1.0 if span >= _SHORT else _SLOWED / span
    if not (isinstance(fps, int) and fps > 0 and np.isfinite(slow_motion) and slow_motion > 0.0):
        raise PictureError(
            f"fps must be a positive whole number and slow_motion positive, got {fps!r} and "
            f"{slow_motion!r}"
        )
    count = max(2, round(span * slow_motion * fps) + 1)
    return np.linspace(first, last, count, dtype=np.float64), slow_motion


def _notes(times: FloatArray, slowness: float, amplification: float) -> list[str]:
    """What is written in each picture."""
    size, unit = stage.readable(float(np.abs(times).max()), "s")
    digits = max(0, int(np.ceil(-np.log10((times[1] - times[0]) / size))))
    suffix = ""
    if slowness > 1.001:
        suffix += f"    slowed {slowness:.3g} times"
    elif slowness < 0.999:
        suffix += f"    {1.0 / slowness:.3g} times as fast"
    if amplification != 1.0:
        suffix += f"    deformation × {amplification:g}"
    return [f"t = {t / size:.{digits}f} {unit}{suffix}" for t in times]


def _camera(
    drawn: Sketch,
    shown: Sequence[Skin],
    gravity: FloatArray,
    *,
    aspect: float,
) -> Camera:
    """A camera that sees everything at all instants."""
    points = [drawn.places, *(primitive.reach() for primitive in drawn.primitives)]
    for skin in shown:
        corners = np.array(np.meshgrid(*skin.bounds.T)).reshape(3, -1).T
        if skin.body is None:
            points.append(corners)
            continue
        pose = drawn.bodies[skin.body]
        moved = np.einsum("kij,cj->kci", pose.R, corners) + pose.p[:, None, :]
        points.append(moved.reshape(-1, 3))
    towards, up = viewing_axes(drawn.places, gravity)
    below = _BELOW if shown else _ABOVE
    return frame_all(
        np.concatenate(points), towards, up, aspect=aspect, above=_ABOVE, below=below
    )


def _pictures(
    drawn: Sketch,
    shown: Sequence[Skin],
    notes: Sequence[str],
    camera: Camera,
    size: tuple[int, int],
) -> Iterator[Picture]:
    """Draw instant after instant, as (height, width, 3)."""
    plotter = stage.open_stage(size)
    try:
        stage.place_camera(plotter, camera)
        movers = [*_add_primitives(plotter, drawn), *_add_skins(plotter, drawn, shown)]
        _add_legend(plotter, drawn, shown)
        words = stage.add_words(plotter, notes[0])
        plotter.show(auto_close=False)  # off-screen: only makes `render` draw from now on
        for k, note in enumerate(notes):
            for move in movers:
                move(k)
            words.input = note
            plotter.render()
            yield plotter.screenshot(return_img=True)
    finally:
        plotter.close()


def _add_primitives(plotter: Any, drawn: Sketch) -> Iterator[Callable[[int], None]]:
    """Put the solids on the stage; yield what moves each to an instant."""
    pyvista = load("pyvista")
    units = {
        Shape.CYLINDER: pyvista.Cylinder(center=(0, 0, 0.5), direction=(0, 0, 1), resolution=32),
        Shape.BALL: pyvista.Sphere(radius=1.0, theta_resolution=32, phi_resolution=24),
        Shape.BOX: pyvista.Box(),
    }
    units[Shape.CYLINDER].points[:, :2] *= 2.0  # radius 1
    for primitive in drawn.primitives:
        smooth = primitive.shape is not Shape.BOX
        actor = plotter.add_mesh(
            units[primitive.shape],
            color=primitive.colour,
            smooth_shading=smooth,
            split_sharp_edges=smooth,
            ambient=0.3,
        )

        def move(k: int, actor: Any = actor, pose: FloatArray = primitive.pose) -> None:
            actor.user_matrix = pose[k]

        yield move


def _add_skins(
    plotter: Any, drawn: Sketch, shown: Sequence[Skin]
) -> Iterator[Callable[[int], None]]:
    """Put the surfaces on the stage, one colour bar a quantity; yield what moves each."""
    quantities = list(dict.fromkeys(skin.quantity for skin in shown))
    for skin in shown:
        largest = max(s.largest for s in shown if s.quantity == skin.quantity)
        name, unit = skin.quantity
        scale, unit = stage.readable(largest, unit)
        mesh, vertex = stage.surface_mesh(skin.x, skin.triangle)
        mesh.point_data["value"] = np.zeros(mesh.n_points)
        row = quantities.index(skin.quantity)
        actor = stage.add_surface(
            plotter, mesh, largest=largest / scale, quantity=name, unit=unit, row=row
        )

        def move(
            k: int,
            skin: Skin = skin,
            mesh: Any = mesh,
            actor: Any = actor,
            vertex: NDArray[np.int64] = vertex,
            scale: float = scale,
        ) -> None:
            places, value = skin.at(k)
            mesh.points = places[vertex]
            mesh.point_data["value"] = value[vertex] / scale
            pose = np.eye(4)
            if skin.body is None:  # it deforms without limit, and its normals turn
                mesh.compute_normals(cell_normals=False, consistent_normals=False, inplace=True)
            else:
                pose[:3, :3] = drawn.bodies[skin.body].R[k]
                pose[:3, 3] = drawn.bodies[skin.body].p[k]
            actor.user_matrix = pose

        yield move


def _add_legend(plotter: Any, drawn: Sketch, shown: Sequence[Skin]) -> None:
    """Name the bodies by their colours; one with a surface has that of what is not stressed."""
    skinned = {body.name for skin in shown for body in skin.covers}
    entries = [
        [name, stage.BARE if name in skinned else colour] for name, colour in drawn.colours.items()
    ]
    if 0 < len(entries) <= 12:
        height = 0.05 * len(entries)
        plotter.add_legend(
            entries, bcolor=None, face="circle", loc="lower left", size=(0.14, height), border=False
        )


def _write_film(
    target: Path, pictures: Iterator[Picture], fps: int, count: int, *, progress: bool
) -> None:
    if progress:
        pictures = iter(load("tqdm").tqdm(pictures, total=count, unit="picture"))
    if target.suffix.lower() == ".gif":
        images = map(load("PIL.Image").fromarray, pictures)
        next(images).save(target, save_all=True, append_images=images, duration=1e3 / fps, loop=0)
        return
    choices = {"fps": fps, "codec": "libx264", "quality": 8, "macro_block_size": 2}
    with load("imageio.v2").get_writer(
        target, format="FFMPEG", mode="I", ffmpeg_log_level="error", **choices
    ) as film:
        for picture in pictures:
            film.append_data(picture)
