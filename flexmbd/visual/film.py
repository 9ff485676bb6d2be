"""Films of a machine, drawn off-screen by pyvista and written as .mp4 or .gif."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmbd.errors import PictureError
from flexmbd.given import checked
from flexmbd.multibody.bodies.body import Body, FlexibleBody
from flexmbd.multibody.bodies.continuum_body import ContinuumBody
from flexmbd.record.stress_field import StressModel
from flexmbd.visual.destination import checked_path, write
from flexmbd.visual.drawn_scene import DrawnScene, Zoom, checked_view, drawn_scene, refuse_bad_look
from flexmbd.visual.force_arrows import ForcesAt
from flexmbd.visual.library import load, require
from flexmbd.visual.pressure_skin import PressuresAt
from flexmbd.visual.recorded_motion import RecordedMotion
from flexmbd.visual.recorded_skin import FieldSeries, Look
from flexmbd.visual.scales import readable
from flexmbd.visual.view import Picture, SceneView

FloatArray = NDArray[np.float64]

#: What ``animate`` writes.
SUFFIXES = (".gif", ".mp4")

# A motion shorter than the first is slowed down to a film of the second (s).
_FASTEST = 1000  # pictures a second
_MOST_PICTURES = 10**6  # of films, each kept in a file
_SHORT, _SLOWED = 3.0, 8.0


@checked(but=("path", "size", "amplification", "view", "forces", "pressures", "zoom"), error=PictureError)
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
    view: ArrayLike | None = None,
    frames: bool = False,
    forces: ForcesAt | None = None,
    pressures: PressuresAt | None = None,
    hide: Sequence[Body] = (),
    zoom: Zoom | None = None,
    progress: bool = False,
) -> Path:
    """Film the machine.

    A body is shown by its ``shape``, or else by the surface that its record holds, deformed and coloured; other bodies
    are drawn as sticks between their frames with a ball at the centre of mass.  A body with history
    that was recorded shows its surface, coloured by a field.  The camera stands
    still and projects in parallel, along the normal of a plane motion; it sees all that moves at all instants.

    The trajectory's root draws and writes, the other ranks return at once: it may be called on the root alone.  Where
    ``models`` are given it is collective over their communicators.

    Args:
        trajectory: to film.
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
        view: (3,) direction from the scene to the camera, instead of the natural one.
        frames: whether the axes of all frames are drawn: x red, y green, z blue.
        forces: drawn as arrows, the largest over all times a quarter of the scene's extent: a function of times (k,) s
            that gives places (k, n, 3) m and forces (k, n, 3) N; ``Trajectory.animate`` gives those of ``contacts``.
        pressures: of contacts, by which reduced bodies are coloured in place of their displacement: a function of times
            (k,) s that gives (k, patches) Pa by body; ``Trajectory.animate`` makes it of contacts of elastic surfaces.
        hide: bodies that are left out, as those that stand before what is to be seen.
        zoom: a place (3,) m and a radius (m): the picture's height shows this ball; by default all that moves.
        progress: show a progress bar.

    Returns:
        The path.

    Raises:
        PictureError: an unknown suffix, a folder that is not there, a bad choice: on all ranks that call; a file that
            cannot be written: on the root.
        SceneError: ``between`` is outside the trajectory.
    """
    target = checked_path(path, SUFFIXES)
    times, slowness = _times(trajectory, between, slow_motion, fps)
    require("pyvista")
    refuse_bad_look(amplification=amplification, size=size)
    eye = checked_view(view)
    if not (models or trajectory.team.is_root):
        return target
    scene = drawn_scene(
        trajectory,
        times,
        notes=_notes(times, slowness, amplification),
        amplification=amplification,
        models=models,
        recordings=recordings,
        looks=looks,
        frames=frames,
        forces=forces,
        pressures=pressures,
        hide=hide,
        zoom=zoom,
    )
    if trajectory.team.is_root:
        write_film(scene, target, fps=fps, size=size, view=eye, progress=progress)
    return target


def write_film(
    scene: DrawnScene,
    target: Path,
    *,
    fps: int,
    size: tuple[int, int],
    view: FloatArray | None = None,
    progress: bool = False,
) -> None:
    """Draw a scene instant after instant and write the film. Not collective.

    Raises:
        PictureError: a bad size, or the file cannot be written.
    """

    def fill(temporary: Path) -> None:
        _write_film(temporary, _pictures(scene, size, view), fps, len(scene.notes), progress=progress)

    write(target, fill)


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
    if not (isinstance(fps, int) and 0 < fps <= _FASTEST and np.isfinite(slow_motion) and slow_motion > 0.0):
        raise PictureError(
            f"fps must be a whole number up to 1000 and slow_motion positive, got {fps!r} and "
            f"{slow_motion!r}"
        )
    count = max(2, round(span * slow_motion * fps) + 1)
    if count > _MOST_PICTURES:
        raise PictureError(f"a film of {count:.3g} pictures is too long; show less, or lower slow_motion or fps")
    return np.linspace(first, last, count, dtype=np.float64), slow_motion


def _notes(times: FloatArray, slowness: float, amplification: float) -> list[str]:
    """What is written in each picture."""
    size, unit = readable(float(np.abs(times).max()), "s")
    digits = max(0, int(np.ceil(-np.log10((times[1] - times[0]) / size))))
    suffix = ""
    if slowness > 1.001:
        suffix += f"    slowed {slowness:.3g} times"
    elif slowness < 0.999:
        suffix += f"    {1.0 / slowness:.3g} times as fast"
    if amplification != 1.0:
        suffix += f"    deformation × {amplification:g}"
    return [f"t = {t / size:.{digits}f} {unit}{suffix}" for t in times]


def _pictures(scene: DrawnScene, size: tuple[int, int], view: FloatArray | None) -> Iterator[Picture]:
    """Draw instant after instant, as (height, width, 3)."""
    drawn = SceneView(scene, size=size, view=view)
    try:
        drawn.plotter.show(auto_close=False)  # off-screen: only makes `render` draw from now on
        for k in range(len(scene.notes)):
            drawn.move_to(k)
            yield drawn.screenshot()
    finally:
        drawn.close()


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
