"""A nodal interface as it is asked for, and its nodes on a mesh."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import InterfaceError
from flexmbd.given import checked


@checked(error=InterfaceError)
@dataclass(frozen=True)
class NodalInterface:
    """A group of the mesh whose nodes keep all their displacements, for coupling with other finite element models.

    Attributes:
        name: the group of facets, edges or vertices of the mesh.
    """

    name: str


@dataclass(frozen=True, eq=False)
class NodalGroup:
    """A nodal interface found on a mesh.

    Attributes:
        name: of the group.
        nodes: (k,) local to this rank, ghosts included; k may be zero.
    """

    name: str
    nodes: NDArray[np.int32]
