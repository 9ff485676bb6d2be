"""An object in a notebook: its text and, where it can be drawn in bounded time, a picture."""

from __future__ import annotations

import base64
import html
import io
import subprocess
import sys
from collections.abc import Callable
from functools import cache

from flexmbd.visual.drawn_scene import DrawnScene, drawn_scene
from flexmbd.visual.library import load
from flexmbd.visual.recorded_motion import RecordedMotion
from flexmbd.visual.view import SceneView

_SIZE = (640, 360)
# Seconds that a first picture of a process of its own may take, and triangles that a picture is drawn of.
_PATIENCE, _MOST_TRIANGLES = 20.0, 1_000_000
_MOST_BODIES = 200

# A graphics library that is not there may end the process or wait for ever: so it is tried in another one.
_TRIAL = "import pyvista; p = pyvista.Plotter(off_screen=True); p.add_mesh(pyvista.Sphere()); p.screenshot(None)"


def html_of(text: str, draw: Callable[[], DrawnScene | None]) -> str:
    """A text and below it what ``draw`` gives, as HTML; the text alone where nothing can be drawn. Not collective.

    Args:
        text: of the object.
        draw: makes the scene; where it raises, or gives None, there is no picture.
    """
    words = f"<pre>{html.escape(text)}</pre>"
    picture = _picture(draw) if can_draw() else None
    if picture is None:
        return words
    code = base64.b64encode(picture).decode()
    return f'<div>{words}<img alt="{html.escape(text)}" width="{_SIZE[0]}" src="data:image/png;base64,{code}"></div>'


def still_of(motion: RecordedMotion) -> DrawnScene | None:
    """A machine at its first instant; None of one with so many bodies that a picture would take long."""
    if len(motion.bodies) > _MOST_BODIES:
        return None
    return drawn_scene(motion, motion.t[:1], notes=[f"t = {motion.t[0]:.5g} s"])


@cache
def can_draw() -> bool:
    """Whether pyvista draws off-screen on this machine within some seconds; tried once a process, in another one."""
    try:
        done = subprocess.run([sys.executable, "-c", _TRIAL], capture_output=True, timeout=_PATIENCE, check=False)
    except (OSError, subprocess.TimeoutExpired):
        return False
    return done.returncode == 0


def _picture(draw: Callable[[], DrawnScene | None]) -> bytes | None:
    try:
        scene = draw()
        if scene is None or sum(len(part.triangle) for part in scene.parts) > _MOST_TRIANGLES:
            return None
        view = SceneView(scene, size=_SIZE)
        try:
            shot = view.screenshot()
        finally:
            view.close()
        file = io.BytesIO()
        load("PIL.Image").fromarray(shot).save(file, format="png")
        return file.getvalue()
    except Exception:  # noqa: BLE001  (an object is shown by its text whatever its picture lacks)
        return None
