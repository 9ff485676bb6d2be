"""The longest stable step of central differences on a body with history, as it deforms.

At rest it is 2 / omega with the largest angular frequency omega of lumped masses and internal forces, whose
derivatives along Lanczos' vectors are taken by differences.  Later the stiffness changes with the shape of the
cells.  That change is seen on the operator of grad u : grad v, which knows of nothing but shapes: the step goes with
the inverse root of its largest eigenvalue.  Between two such estimates it goes with the least size of a cell, the
inverse norm of the inverse Jacobian.  Viscous forces, which act by the rates of the step before, shorten it: with the
largest eigenvalues k of stiffness and c of damping, by mass, it is bounded by h^2 k + 2 h c = 4.  Bulk viscosity counts
among them, its quadratic part by the fastest compression of the last step.  No change of shape lengthens the step
beyond the estimate at rest where springs on facets are in it.  Plastic flow only softens a body, and is left out on
purpose.

Formulations of the initial configuration have their estimate anew where the least stretch in a cell has changed, by
the law itself where it has no history.  None lengthens the step beyond that at rest: what is stretched need not be
softer.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext

from petsc4py import PETSc

import basix
import numpy as np
import ufl
from dolfinx import fem, la
from numpy.typing import NDArray

from flexmbd.continuum import compat
from flexmbd.continuum.history.body_memory import BodyMemory
from flexmbd.continuum.history.fresh_body import as_fresh
from flexmbd.continuum.history.moved_mesh import MovedMesh
from flexmbd.continuum.history.nonlinear_model import NonlinearModel
from flexmbd.continuum.history.plane_bodies import inverse_jacobian
from flexmbd.continuum.interior.bulk_viscosity import BulkForces
from flexmbd.continuum.interior.staggered_fields import StaggeredFields
from flexmbd.continuum.interior.thickness_mass import ThicknessMass
from flexmbd.continuum.matrices.fastest_vibration import largest_eigenvalue
from flexmbd.errors import ConvergenceError, FormulationError

FloatArray = NDArray[np.float64]

# Strain, roughly, of a displacement along one of Lanczos' vectors.
_SMALL = 1e-7

# Relative change of the smallest cell's size after which the eigenvalue is found anew.
_CHANGE = 0.08


class StableStep:
    """Estimates the stable step, and follows it."""

    def __init__(
        self,
        body: NonlinearModel,
        masses: FloatArray,
        memory: BodyMemory,
        *,
        bulk: BulkForces | None = None,
        fields: StaggeredFields | None = None,
        thickness: ThicknessMass | None = None,
    ) -> None:
        """Collective; compiles.

        Args:
            body: at rest. What is found is of the undeformed body, but for `present`.
            masses: (owned nodes,) kg, lumped.
            memory: of the body, whose numbers of nodes tell where Lanczos' method begins on any ranks.
            bulk: the forces of bulk viscosity, if any.
            fields: unknowns besides the displacement, if any: the nodes vibrate with these in balance.
            thickness: further mass of edges through a wall, if any.

        Raises:
            FormulationError: unknowns besides the displacement have no balance at given displacements.
        """
        self._body, self._root, self._fields = body, np.repeat(np.sqrt(masses), 3), fields
        self._thickness = thickness
        begin = np.random.default_rng(0).standard_normal((memory.node_count, 3))
        self._begin: FloatArray = memory.scatter_nodes(begin).reshape(-1)[: len(self._root)]
        self._u = fem.Function(body.space)
        moved, v = fem.Function(body.layout.node_space), ufl.TestFunction(body.layout.node_space)
        self._moved, self._sum = moved.x, fem.Function(body.layout.node_space).x
        rule = {"quadrature_degree": 2 * body.degree}
        self._shapes = fem.form(ufl.inner(ufl.grad(moved), ufl.grad(v)) * ufl.dx(metadata=rule))
        domain = body.mesh.mesh
        points, _ = basix.make_quadrature(basix.CellType[domain.topology.cell_name()], 2 * body.degree)
        inverse = inverse_jacobian(domain)
        self._sizes = self._stretches = fem.Expression(ufl.inner(inverse, inverse), points)
        if not body.is_updated:
            # not of sizes: a wall whose edges through it are heavier has its step by those along it
            back = ufl.inv(ufl.Identity(3) + ufl.grad(moved))
            self._stretches = fem.Expression(ufl.inner(back, back), points)
        self._cells = np.arange(domain.topology.index_map(body.mesh.dim).size_local, dtype=np.int32)
        self._bulk = bulk
        self._held: FloatArray | float = 0.0  # N, in the shape about which differences are taken
        # stress by the displacement alone: what changes with it is asked of the law
        history = any(group.optional.state is not None for group in body.groups)
        self._is_elastic = not (body.is_updated or history or body.fields is not None or fields is not None)
        self._shape: MovedMesh | None = None
        # cells of beams and plates keep their shape; straight ones under curved displacements have their corners'
        if not body.turns and compat.geometry_degree(domain) in (1, body.degree):
            self._shape = MovedMesh(body.layout.node_space)
        with as_fresh(body):
            self._find_at_rest()

    def _find_at_rest(self) -> None:
        """The estimate of the undeformed body. Collective."""
        body, bulk, fields = self._body, self._bulk, self._fields
        self._first, self._length, self._size = self._of_shapes(), self._least(self._sizes), self._smallest()
        self._damping = self._damping_rate()
        self._bulk_rate = 0.0 if bulk is None else self._largest_rate(bulk.unit_matrix())
        if body.springs is not None and not body.springs.are_linear:
            raise FormulationError(
                f"springs on facets of {body.form_name} are not linear in the displacement, and explicit steps have no "
                "stable length; load the body slowly (follow), or give them an energy that is quadratic"
            )
        self._elastic = self._found = self._by_law(at_rest=True)
        if fields is not None:
            fields.forget()

    def _by_law(self, *, at_rest: bool = False) -> float:
        """Step, s, by the internal forces about the last accepted displacement. Collective."""
        body = self._body
        if not at_rest:
            self._held = body.force(np.zeros(body.layout.n_local), dt=0.0)
        squared = self._largest(self._by_differences)
        body.revert()
        return 2.0 / float(np.sqrt(squared))

    @property
    def at_rest(self) -> float:
        """Stable step, s, of the undeformed body."""
        return self._with_viscosity(self._elastic)

    def present(self) -> float:
        """Stable step, s, of the body as it is. Collective."""
        if self._shape is None:
            return self.at_rest
        size = self._smallest()
        if abs(size / self._size - 1.0) > (_CHANGE if self._body.is_updated else _CHANGE / 2):
            self._size = size
            if self._is_elastic:
                self._found = self._by_law()
            else:
                self._found = self._elastic * float(np.sqrt(self._first / self._of_shapes()))
            if self._body.springs is not None or not self._body.is_updated:
                self._found = min(self._found, self._elastic)
        # laws of small strains do not know of their cells' shape: small changes of that are left to be found anew
        between = min(1.0, size / self._size) if self._body.is_updated else 1.0
        return self._with_viscosity(self._found * between)

    @property
    def memory(self) -> tuple[float, float]:
        """The state of the estimate `present`; to be set anew with the body's history."""
        return self._size, self._found

    @memory.setter
    def memory(self, values: tuple[float, float]) -> None:
        self._size, self._found = values

    def _with_viscosity(self, h: float) -> float:
        """The longest stable step, s, where it is h without viscosity: cells that shrink are damped more, too."""
        c = self._damping * (self._elastic / h) ** 2
        if self._bulk is not None:
            viscosity = self._bulk.viscosity
            share = viscosity.linear + viscosity.quadratic**2 * self._bulk.fastest()
            c += self._bulk_rate * share * self._elastic / h
        if c == 0.0:
            return h
        k = 4.0 / h**2
        return float((np.sqrt(c**2 + 4.0 * k) - c) / k)

    def _damping_rate(self) -> float:
        """1/s, the largest eigenvalue of the dissipation's matrix by mass. Collective.

        Raises:
            FormulationError: viscous forces that are not linear in the rates have no such bound.
        """
        body = self._body
        if body.viscous_forces is None:
            return 0.0
        if not body.viscous_forces.are_linear:
            raise FormulationError(
                f"the dissipation of {body.form_name} is not quadratic in the rates, and explicit steps have no stable "
                "length; take ImplicitContinuum"
            )
        return self._largest_rate(body.viscous_forces.matrix())

    def _largest_rate(self, matrix: PETSc.Mat) -> float:
        """1/s, the largest eigenvalue of a matrix of forces by rates, by mass; it is destroyed. Collective."""
        body = self._body
        if body.ties is not None:
            alone, matrix = matrix, body.ties.condensed(matrix, keeps_diagonal=False)
            alone.destroy()
        x, y = matrix.createVecs()

        def by_rates(w: FloatArray) -> FloatArray:
            x.array[:] = self._at_dofs(w)
            matrix.mult(x, y)
            return np.asarray(body.layout.displacements(y.array).reshape(-1))

        found = self._largest(by_rates)
        matrix.destroy()
        return float(found)

    def _present_shape(self) -> AbstractContextManager[None]:
        """The mesh under the body's displacement, within a `with` block."""
        if self._shape is None:
            return nullcontext()
        return self._shape.at(self._body.displacement[self._body.layout.displacement_dofs].reshape(-1))

    def _smallest(self) -> float:
        """Size of the smallest cell, in some unit; of formulations of the initial configuration the least stretch."""
        body = self._body
        if not body.is_updated:
            self._moved.array[:] = body.displacement[body.layout.displacement_dofs].reshape(-1)
        with body.present_mesh():
            return self._least(self._stretches)

    def _least(self, squared_inverse: fem.Expression) -> float:
        """The inverse root of its largest value on any cell. Collective."""
        most = float(squared_inverse.eval(self._body.mesh.mesh, self._cells).max(initial=0.0))
        return max(self._body.comm.allgather(most)) ** -0.5

    def _of_shapes(self) -> float:
        with self._present_shape():
            return self._largest(self._by_shapes)

    def _largest(self, apply: Callable[[FloatArray], FloatArray]) -> float:
        """The largest eigenvalue of what ``apply`` makes of displacements, by mass. Collective."""
        half = _same if self._thickness is None else self._thickness.inverse_root

        def by_mass(w: FloatArray) -> FloatArray:
            return half(apply(half(w) / self._root) / self._root)

        return largest_eigenvalue(self._body.comm, by_mass, len(self._root), begin=self._begin)

    def _at_dofs(self, displacements: FloatArray) -> FloatArray:
        """(owned dofs,) from (owned nodes * 3,)."""
        return self._body.layout.at_dofs(displacements.reshape(-1, 3), owned=True)

    def _by_shapes(self, w: FloatArray) -> FloatArray:
        owned = len(self._root)
        self._moved.array[:owned] = w
        self._moved.scatter_forward()
        self._body.complete_nodes(self._moved.array.reshape(-1, 3))
        self._sum.array[:] = 0.0
        fem.assemble_vector(self._sum.array, self._shapes)
        self._sum.scatter_reverse(la.InsertMode.add)
        image: FloatArray = self._sum.array[:owned].copy()
        return self._body.condense_nodes(image.reshape(-1, 3)).reshape(-1)

    def _by_differences(self, w: FloatArray) -> FloatArray:
        body, owned = self._body, self._body.n_owned
        u = self._u.x
        u.array[:owned] = self._at_dofs(w)
        u.scatter_forward()
        size = _SMALL * self._length / max(body.comm.allgather(float(abs(u.array).max(initial=0.0))))
        u.array[:] *= size
        if self._fields is None:
            # exact fields of one cell would be asked for digits that differences so small do not have
            return np.asarray((body.force(u.array, dt=0.0, explicit=True) - self._held) / size)
        try:
            force = self._fields.balanced(u.array, dt=0.0)[1]
        except ConvergenceError as reason:
            raise FormulationError(
                f"{body.form_name} has unknowns besides the displacement that are not determined by it, as the "
                "pressure of what keeps its volume: explicit steps have no stable length; take ImplicitContinuum"
            ) from reason
        return np.asarray(body.layout.displacements(force).reshape(-1) / size)


def _same(w: FloatArray) -> FloatArray:
    return w
