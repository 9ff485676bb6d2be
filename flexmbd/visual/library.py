"""The libraries that draw: loaded when a picture is asked for, and not before."""

from __future__ import annotations

import importlib
import importlib.util
from typing import Any

from flexmbd.errors import PictureError


def load(name: str) -> Any:
    """Import a drawing library.

    Raises:
        PictureError: it is not installed, or cannot be loaded; says how to get it.
    """
    try:
        return importlib.import_module(name)
    except ImportError as reason:
        raise PictureError(
            f"this picture needs {name}: pip install 'flexmbd[pictures]' ({reason})"
        ) from reason


def require(name: str) -> None:
    """Tell on every rank, without loading it, that a library is missing.

    Raises:
        PictureError: it is not installed.
    """
    if importlib.util.find_spec(name) is None:
        raise PictureError(f"this picture needs {name}: pip install 'flexmbd[pictures]'")
