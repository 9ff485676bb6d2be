"""Pictures of a record and of a stress field; the module that draws them is loaded at the first picture."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from flexmbd.errors import PictureError
from flexmbd.given import checked
from flexmbd.portraits import portraits


class PicturedRecord:
    """Pictures of a reduced body: its surface, its modes, films of these."""

    @checked("mode", "amplitude", error=PictureError)
    def show(
        self,
        *,
        mode: int | None = None,
        amplitude: float = 0.1,
        path: str | Path | None = None,
        size: tuple[int, int] = (1280, 720),
        view: Any = None,
    ) -> Path | None:
        """Show the body or one of its modes in a window or a notebook; or write it to ``path``, a .png. Not collective.

        Args:
            mode: which mode displaces it, from 0; None: undeformed.
            amplitude: the largest displacement drawn, as a part of the body's length.
            path: where to; needs no display.
            size: width and height in pixels, even numbers.
            view: (3,) direction from the body to the camera, in B.

        Raises:
            PictureError: the record has no surface, no such mode; there is no display; the file cannot be written.
        """
        return portraits().show_record(self, mode=mode, amplitude=amplitude, path=path, size=size, view=view)

    @checked("mode", "amplitude", "fps", error=PictureError)
    def animate(
        self,
        path: str | Path,
        *,
        mode: int,
        amplitude: float = 0.1,
        seconds: float = 2.0,
        fps: int = 30,
        size: tuple[int, int] = (1280, 720),
        view: Any = None,
    ) -> Path:
        """Film one period of a mode to .mp4 or .gif, which lasts ``seconds``. Not collective; see ``show``.

        Raises:
            PictureError: as ``show``; another suffix.
        """
        return portraits().film_mode(
            self, path, mode=mode, amplitude=amplitude, seconds=seconds, fps=fps, size=size, view=view
        )

    @checked("mode", "amplitude", error=PictureError)
    def to_pyvista(self, *, mode: int | None = None, amplitude: float = 0.1) -> Any:
        """The scene of ``show`` as a pyvista.PolyData, in B (m). Not collective.

        Raises:
            PictureError: the record has no surface, no such mode; or pyvista is not installed.
        """
        return portraits().record_scene(self, mode=mode, amplitude=amplitude).to_pyvista()[0]

    def _repr_html_(self) -> str:
        """Its text and, where pyvista can draw here, a picture."""
        return portraits().html_of(repr(self), lambda: portraits().record_scene(self))


class PicturedField:
    """Pictures of a stress field."""

    @checked("title", error=PictureError)
    def show(
        self,
        *,
        path: str | Path | None = None,
        amplification: float = 1.0,
        size: tuple[int, int] = (1280, 720),
        title: str = "",
        view: Any = None,
    ) -> Path | None:
        """Show the stress in a window or a notebook; or write it to ``path``, a .png. Not collective.

        Args:
            path: where to; needs no display.
            amplification: factor on the displacement.
            size: width and height in pixels, even numbers.
            title: written above.
            view: (3,) direction from the body to the camera, in the field's axes.

        Raises:
            PictureError: there is no display; a bad choice; the file cannot be written.
        """
        scene = portraits().stress_scene(self, amplification=amplification, title=title)
        return portraits().present(scene, path=path, size=size, view=view)

    def to_pyvista(self, *, amplification: float = 1.0) -> Any:
        """The surface as a pyvista.PolyData with "von Mises stress" (Pa) at its points. Not collective.

        Raises:
            PictureError: pyvista is not installed.
        """
        return portraits().stress_scene(self, amplification=amplification).to_pyvista()[0]

    def _repr_html_(self) -> str:
        """Its text and, where pyvista can draw here, a picture."""
        return portraits().html_of(repr(self), lambda: portraits().stress_scene(self))
