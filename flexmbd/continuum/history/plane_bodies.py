"""Plane bodies: along which axis of the mesh their normal is, and the map of flat cells."""

from __future__ import annotations

from typing import Any

import numpy as np
import ufl
from ufl.core.expr import Expr

from flexmbd.continuum import compat
from flexmbd.continuum.finite_elements.discrete_forms import DiscretisedBody
from flexmbd.errors import FormulationError
from flexmbd.round_off import ROUND_OFF


def plane_axis(body: DiscretisedBody) -> int | None:
    """The axis of the mesh (0, 1, 2) along the normal of a plane body; None of others. Collective.

    Raises:
        FormulationError: on all ranks: the mesh lies in no plane of two axes, or some of its formulations alone are
            plane.
    """
    are_plane = {group.optional.thickness is not None for group in body.groups}
    if not any(are_plane):
        return None
    if len(are_plane) > 1:
        raise FormulationError(f"{body.form_name}: plane formulations and others cannot be in one body")
    x = body.layout.node_x[: body.layout.n_owned_nodes]
    low = np.min(body.comm.allgather(x.min(axis=0, initial=np.inf)), axis=0)
    high = np.max(body.comm.allgather(x.max(axis=0, initial=-np.inf)), axis=0)
    extents = high - low
    axis = int(np.argmin(extents))
    if extents[axis] > ROUND_OFF * max(abs(low).max(), abs(high).max()):
        raise FormulationError(
            f"{body.form_name} is plane, and the mesh lies in no plane along two axes: it reaches over "
            f"({', '.join(f'{extent:.4g}' for extent in extents)}) m. Mesh it in the plane z = const; its frames place "
            "it anywhere in a machine"
        )
    return axis


def inverse_jacobian(domain: Any) -> Expr:
    """The inverse of the Jacobian of a mesh's cells; of flat ones that from the plane."""
    is_solid = compat.topological_dimension(domain.ufl_domain()) == 3
    return ufl.inv(ufl.Jacobian(domain)) if is_solid else ufl.JacobianInverse(domain)
