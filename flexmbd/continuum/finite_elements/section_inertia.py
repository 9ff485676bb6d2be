"""The Gram matrix of bodies with cross-sections: beams, whose cells are lines, and shells; and with micro-inertia.

A material point lies at section coordinates xi from its axis or mid-surface, and moves linearly in
them: u(x, xi) = u_0(x) + sum_k xi_k u_k(x).  So a mass integral over the volume is one over the cells,
of the products of the fields' parts with the section's moments, integral of rho {1, xi} {1, xi} dA.
In a solid whose micro-structure turns (Cosserat's) xi is the place from the centre of an element of
structure, in three coordinates, and the moments are those per volume.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import ufl
from dolfinx import fem

from flexmbd.continuum.contract.quadrature import points_and_weights
from flexmbd.continuum.finite_elements.cell_group import CellGroup
from flexmbd.continuum.finite_elements.ghosts import with_ghosts
from flexmbd.continuum.finite_elements.linear_model import LinearModel
from flexmbd.continuum.matrices.blocks import FloatArray
from flexmbd.errors import FormulationError

# Numbers held at a time while the cells are gone through.
_BATCH = 4_000_000


def section_gram(
    model: LinearModel, modes: FloatArray, *, p: FloatArray, R: FloatArray
) -> FloatArray:
    """Mass integrals of {1, position, modes} over the sections; see `inertia.gram_matrix`. Collective.

    The offsets of material points from the axis follow from the form's own `motion`: a rotation w
    moves them by w x offset.  The rule is the finest of the kinetic energy's.
    """
    rotations = model.rigid_motions(np.zeros(3), np.eye(3))[:, 3:]
    state = model.displacement[: model.n_owned]
    fields = with_ghosts(model, np.hstack([rotations, state[:, None], modes]))
    gram = np.zeros((4 + 3 * modes.shape[1],) * 2)
    for group in model.groups:
        sections = _Sections(model, group)
        values = 3 * sections.moments * fields.shape[1] * len(sections.weights)
        if len(group.cells) == 0:
            continue
        parts = -(-len(group.cells) * values // _BATCH)
        for cells in np.array_split(group.cells, parts):
            gram += sections.gram(cells, fields, p=p, R=R)
    # summed on one rank, because a sum may depend on the rank that makes it
    total: FloatArray = model.comm.bcast(model.comm.reduce(gram, root=0), root=0)
    return total


class _Sections:
    """The sections of one cell group at the points of a quadrature rule. Collective, may compile.

    Attributes:
        moments: m, one and the number of section coordinates.
        weights: (q,) of the rule on the reference cell.
    """

    def __init__(self, model: LinearModel, group: CellGroup) -> None:
        self._mesh = model.mesh.mesh
        self._u = u = fem.Function(model.space)
        # names that the Protocol has not, since most formulations lack them
        form: Any = group.formulation
        inertia = ufl.as_matrix(form.section_inertia(group.symbols))
        self.moments = m = inertia.ufl_shape[0]
        if inertia.ufl_shape not in ((2, 2), (3, 3), (4, 4)):
            raise FormulationError(
                f"{group.form_name}: section_inertia must have the shape (3, 3) for beams, (2, 2) for shells, (4, 4) "
                f"for solids, got {inertia.ufl_shape}"
            )
        points_of_section = np.vstack([np.zeros(m - 1), np.eye(m - 1)]).tolist()
        unknown = u if group.fields is None else group.fields.padded(u)
        at = [form.motion(unknown, ufl.as_vector(xi), group.symbols) for xi in points_of_section]
        parts = [at[0], *(moved - at[0] for moved in at[1:])]
        terms = group.kinetic_energy(u)
        finest = max((rule for _, rule in terms), key=lambda rule: rule.degree)
        points, self.weights = points_and_weights(self._mesh.topology.cell_name(), finest)
        x, measure = ufl.SpatialCoordinate(self._mesh), abs(ufl.JacobianDeterminant(self._mesh))
        place = [*x, *(measure * inertia[index] for index in np.ndindex(m, m))]
        self._place = fem.Expression(ufl.as_vector(place), points)
        self._motion = fem.Expression(ufl.as_vector([part[i] for part in parts for i in range(3)]), points)

    def gram(self, cells: np.ndarray, fields: FloatArray, *, p: FloatArray, R: FloatArray) -> FloatArray:
        """The integrals over some cells; `fields` are three unit rotations, the state's motion, then the modes."""
        m, q = self.moments, len(self.weights)
        place = self._place.eval(self._mesh, cells).reshape(-1, 3 + m * m)
        motions = np.empty((len(place), m, 3, fields.shape[1]))
        for i in range(fields.shape[1]):
            self._u.x.array[:] = fields[:, i]
            motions[..., i] = self._motion.eval(self._mesh, cells).reshape(-1, m, 3)
        # sum_i e_i x (e_i x d) = -2 d
        offset = -0.5 * np.sum([np.cross(np.eye(3)[i], motions[..., i]) for i in range(3)], axis=0)
        offset[:, 0] = place[:, :3] - p
        offset += motions[..., 3]
        unit = np.zeros((len(place), m, 1))
        unit[:, 0] = 1.0
        moved = np.einsum("qmai,ab->qmib", motions[..., 4:], R).reshape(len(place), m, -1)
        values = np.concatenate([unit, offset @ R, moved], axis=2)
        inertia = place[:, 3:].reshape(-1, q, m, m) * self.weights[:, None, None]
        weighted = inertia.reshape(-1, m, m) @ values
        gram: FloatArray = np.tensordot(values, weighted, axes=((0, 1), (0, 1)))
        return gram
