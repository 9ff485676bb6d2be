"""The nodes of a nodal interface on a mesh."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class NodalGroup:
    """A nodal interface found on a mesh.

    Attributes:
        name: of the group.
        nodes: (k,) local to this rank, ghosts included; k may be zero.
    """

    name: str
    nodes: NDArray[np.int32]
