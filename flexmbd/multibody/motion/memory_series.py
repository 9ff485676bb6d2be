"""What force elements remember, by name, from configurations of a machine."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import SceneError
from flexmbd.multibody.scene_index import SceneIndex

FloatArray = NDArray[np.float64]


def memory_series(index: SceneIndex, force: object, x: FloatArray) -> dict[str, FloatArray]:
    """Each (nt,) by name, from x (nt, nx); ``deformation`` (m or rad) is where the memory was written.

    Raises:
        SceneError: the force remembers nothing, or is of another scene.
    """
    places = index.memories.get(force)
    if places is None:
        raise SceneError(f"this force remembers nothing, or is not in the scene: {force!r:.100}")
    return {name: x[:, place] for name, place in places.items()}
