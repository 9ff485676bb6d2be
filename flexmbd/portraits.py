"""The drawing of single bodies, for classes that have a `show` and stand below the room that draws.

Loads nothing but Python's own modules: the root says once where the drawing is, and every room may ask for it.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any, Protocol, cast

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from pathlib import Path


class Portraits(Protocol):
    """The module that draws single bodies; its functions are described there (`flexmbd.visual.portraits`)."""

    def show_record(
        self, record: Any, *, mode: int | None, amplitude: float, path: str | Path | None, size: tuple[int, int],
        view: Any,
    ) -> Path | None:
        """Show a reduced body or one of its modes."""

    def film_mode(
        self, record: Any, path: str | Path, *, mode: int, amplitude: float, seconds: float, fps: int,
        size: tuple[int, int], view: Any,
    ) -> Path:
        """Film one period of a mode."""

    def record_scene(self, record: Any, *, mode: int | None = None, amplitude: float = 0.1) -> Any:
        """A reduced body as a scene."""

    def stress_scene(self, field: Any, *, amplification: float = 1.0, title: str = "") -> Any:
        """A stress field as a scene."""

    def shape_scene(self, shape: Any) -> Any:
        """A shape as a scene."""

    def mesh_scene(
        self, x: Any, triangles: Any, *, lines: Any = None, frames: Mapping[str, tuple[Any, Any]] | None = None
    ) -> Any:
        """A mesh as a scene."""

    def present(self, scene: Any, *, path: str | Path | None, size: tuple[int, int], view: Any) -> Path | None:
        """Show a scene, or write it to a file."""

    def html_of(self, text: str, draw: Callable[[], Any]) -> str:
        """A text and a picture for a notebook."""


_module = ""


def draw_with(module: str) -> None:
    """Name the module that draws, which is imported at the first picture."""
    global _module
    _module = module


def portraits() -> Portraits:
    """The module that draws single bodies."""
    return cast(Portraits, importlib.import_module(_module))
