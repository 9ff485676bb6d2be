"""An example: files of a folder, and how it is run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class SceneFolder:
    """A scene with its files.

    Attributes:
        name: of the example and of its folder.
        about: one line.
        files: texts by their names; one is scene.toml.
        then: commands to try in the folder, after `flexmbd simulate scene.toml`.
    """

    name: str
    about: str
    files: Mapping[str, str]
    then: tuple[str, ...]
