"""What a user says of a surface that may be touched."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import ReductionError
from flexmbd.given import checked, shown

FloatArray = NDArray[np.float64]


@checked(error=ReductionError)
@dataclass(frozen=True, eq=False)
class Patch:
    """A surface that may be touched, divided into contact patches of a size.

    The dent of a force on a point grows without bound as the mesh is refined; that of a force spread over a patch
    does not. So the size, and not the mesh, says how finely contact is resolved: a few patches across the region that
    touches, a few facets across a patch.

    Attributes:
        name: of the surface, in the record.
        size: m, of a patch: as many patches as make their mean area about its square.
        facets: the mesh's group of facets; or a function of points (3, n) in m, in the mesh's axes, that says of each
            whether it is on the surface (n,): a facet of the boundary is if all of its corners are. None: the group
            `name`.
        tol: the largest share of a patch's deflection under its own load, all interfaces fixed, that the modes may
            leave to the residual flexibility; so many contact shapes are kept as further modes. None: none.

    Raises:
        ReductionError: a size that is not positive, a tolerance that is not between 0 and 1, no name.
    """

    name: str
    size: float
    facets: str | Callable[[FloatArray], NDArray[np.bool_]] | None = None
    tol: float | None = None

    def __post_init__(self) -> None:
        if not self.name:
            raise ReductionError("a contact patch has a name that is not empty")
        if not self.size > 0.0:
            raise ReductionError(f"contact patch {self.name!r}: size must be positive, m, got {self.size!r}")
        if self.tol is not None and not 0.0 < self.tol < 1.0:
            raise ReductionError(f"contact patch {self.name!r}: tol must be a share between 0 and 1, got {self.tol!r}")

    def __repr__(self) -> str:
        """As it was written; a function without its address, which differs between the ranks."""
        more = "" if self.facets is None else f", facets={shown(self.facets)}"
        more += "" if self.tol is None else f", tol={self.tol!r}"
        return f"Patch({self.name!r}, size={self.size!r}{more})"
