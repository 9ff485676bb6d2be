"""A mesh at another place, as parts that are welded lie beside each other."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from flexmbd.continuum.compat import geometry_degree
from flexmbd.continuum.grid.mesh_input import from_root
from flexmbd.continuum.grid.tagged_mesh import TaggedMesh, spread
from flexmbd.errors import MeshError
from flexmbd.given import numbers, shown
from flexmbd.meshes.dimension import check_arguments, checked_part
from flexmbd.meshes.listed_part import ListedPart
from flexmbd.round_off import SEVEN_DIGITS


@checked_part
def placed(part: TaggedMesh, *, p: ArrayLike = (0.0, 0.0, 0.0), R: ArrayLike | None = None) -> TaggedMesh:
    """A copy of a mesh, turned and then moved: points are p + R x. Collective.

    Groups, and the numbers of nodes and cells, stay.

    Args:
        part: the mesh.
        p: (3,) m, where the origin of its axes comes to.
        R: (3, 3) rotation; None: it is not turned.

    Raises:
        MeshError: on all ranks; p or R are no numbers of that shape, R is no rotation.
    """
    place = numbers(p)
    turn = np.eye(3) if R is None else numbers(R)

    def check() -> None:
        if place.shape != (3,) or not np.isfinite(place).all():
            raise MeshError(f"placed: p must be three lengths (m), got {shown(p)}")
        is_rotation = turn.shape == (3, 3) and abs(turn @ turn.T - np.eye(3)).max() <= SEVEN_DIGITS
        if not (is_rotation and np.linalg.det(turn) > 0.0):
            raise MeshError(f"placed: R must be a rotation (3, 3), without a mirror, got {shown(R)}")

    check_arguments(part.comm, {"p": place.tolist(), "R": turn.tolist()}, check)
    listed = ListedPart.of(part, geometry_degree(part.mesh))
    share = from_root(part.comm, lambda: listed.to_input(place + listed.arrays["points"] @ turn.T))
    return spread(part.comm, share, in_pieces=part.in_pieces)
