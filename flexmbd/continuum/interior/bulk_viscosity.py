"""Bulk viscosity of explicit steps: a pressure by the rate of volume change, which spreads shocks over a few cells.

    q = rho L (b1 c |e| + b2^2 L e^2),   e = div v of the cell

von Neumann & Richtmyer 1950 (quadratic, against compression alone), Landshoff 1955 (linear, both ways, against the
ringing behind).  rho is the present density, c the speed of dilatational waves at rest, L a cell's size, sqrt(3) over
the norm of the inverse Jacobian: the edge of a cube, of a flat cell between once and 1.7 times its thickness.  e is
that of the cell's middle, so nothing damps the modes that keep it.
"""

from __future__ import annotations

from dataclasses import dataclass

from petsc4py import PETSc

import basix
import numpy as np
import ufl
from dolfinx import fem, la
from numpy.typing import NDArray

from flexmbd.continuum.finite_elements import assembly
from flexmbd.continuum.history.nonlinear_model import NonlinearModel
from flexmbd.continuum.history.plane_bodies import inverse_jacobian
from flexmbd.errors import FormulationError, SceneError
from flexmbd.given import is_number

FloatArray = NDArray[np.float64]

_STRAIN = 1e-8  # by which the dilatational modulus is found


@dataclass(frozen=True)
class BulkViscosity:
    """Coefficients of the bulk viscosity; 0.06 and 1.2 are customary.

    Attributes:
        linear: b1, roughly the share of critical damping of a cell's fastest vibration.
        quadratic: b2; a shock is some 2 b2 cells thick.

    Raises:
        SceneError: one is negative, or no number.
    """

    linear: float = 0.06
    quadratic: float = 1.2

    def __post_init__(self) -> None:
        for name, value in (("linear", self.linear), ("quadratic", self.quadratic)):
            if not is_number(value) or value < 0.0:
                raise SceneError(f"BulkViscosity: {name} = {value!r} must be a finite number, at least 0")


class BulkForces:
    """The nodal forces of bulk viscosity on a body. Constructing one is collective, and compiles."""

    def __init__(self, body: NonlinearModel, viscosity: BulkViscosity) -> None:
        """Find densities and wave speeds.

        Args:
            body: at rest.
            viscosity: the coefficients.

        Raises:
            FormulationError: there are unknowns besides the displacement.
        """
        if body.layout.has_further:
            raise FormulationError(
                f"{body.form_name} has unknowns besides the displacement, with which there is no bulk viscosity; leave "
                "it out, or give the form a dissipation"
            )
        self._body, self.viscosity = body, viscosity
        domain = body.mesh.mesh
        self._mass = self._cell_masses()
        self._rates = fem.Function(body.space)
        self._sum = fem.Function(body.space).x
        inverse = inverse_jacobian(domain)
        size = ufl.sqrt(body.mesh.dim / ufl.inner(inverse, inverse))
        speed = fem.Constant(domain, self._speed())
        growth = ufl.div(self._rates)
        # the middle's Jacobian times the measure of the reference cell is the cell's volume
        points, weights = basix.make_quadrature(basix.CellType[domain.topology.cell_name()], 0)
        # of a plane body per area, as the kinetic energy
        density = self._mass / (float(weights.sum()) * abs(ufl.JacobianDeterminant(domain)))
        slowing = viscosity.quadratic**2 * size * ufl.conditional(ufl.lt(growth, 0.0), -growth, 0.0)
        stress = density * size * (viscosity.linear * speed + slowing) * growth
        v, along = ufl.TestFunction(body.space), ufl.TrialFunction(body.space)
        middle = ufl.dx(metadata={"quadrature_degree": 0}, domain=domain)
        self._work = fem.form(stress * ufl.div(v) * middle)
        self._unit = density * size * speed * ufl.div(along) * ufl.div(v) * middle
        self._speeds = fem.Expression(-growth * size / speed, points)
        self._cells = np.arange(domain.topology.index_map(body.mesh.dim).size_local, dtype=np.int32)

    def _cell_masses(self) -> fem.Function:
        """kg, a number a cell. Collective."""
        domain = self._body.mesh.mesh
        masses = fem.Function(fem.functionspace(domain, ("Discontinuous Lagrange", 0)))
        moving, of_cell = fem.Function(self._body.space), ufl.TestFunction(masses.function_space)
        moving.x.array.reshape(-1, 3)[:, 0] = 1.0
        for group in self._body.groups:
            for density, rule in group.kinetic_energy(moving):
                form = fem.form(assembly.integral((2 * density * of_cell, rule), group, domain))
                fem.assemble_vector(masses.x.array, form)
        masses.x.scatter_forward()
        return masses

    def _speed(self) -> float:
        """m/s, of dilatational waves at rest, the largest along an axis, by means over the body. Collective."""
        body, owned = self._body, self._body.n_owned
        cells = body.mesh.mesh.topology.index_map(body.mesh.dim).size_local
        mass = sum(body.comm.allgather(float(self._mass.x.array[:cells].sum())))
        squares = []
        for k in (k for k in range(3) if k != body.plane_axis):
            u = fem.Function(body.space).x
            u.array.reshape(-1, 3)[: owned // 3, k] = _STRAIN * body.layout.node_x[: owned // 3, k]
            u.scatter_forward()
            work = float(body.force(u.array, dt=0.0) @ u.array[:owned])
            squares.append(sum(body.comm.allgather(work)) / (_STRAIN**2 * mass))
        body.revert()
        return float(np.sqrt(max(squares)))

    def unit_matrix(self) -> PETSc.Mat:
        """The forces' derivative by the rates for a linear coefficient of 1, N s/m, at rest. Collective; compiles."""
        return assembly.assemble({"bulk viscosity": [fem.form(self._unit)]}, self._body.groups, self._body.space)[0]

    def step(self, increment: FloatArray, *, dt: float) -> FloatArray:
        """Forces (owned dofs,) N that hold the body against what its last step has made of volumes. Collective.

        Args:
            increment: (local dofs including ghosts,) m, of the step that was accepted.
            dt: s.
        """
        self._rates.x.array[:] = increment / dt if dt > 0.0 else 0.0
        self._sum.array[:] = 0.0
        with self._body.present_mesh():
            fem.assemble_vector(self._sum.array, self._work)
        self._sum.scatter_reverse(la.InsertMode.add)
        force: FloatArray = self._sum.array[: self._body.n_owned].copy()
        return force

    def set_rates(self, rates: FloatArray) -> None:
        """Set the velocities (owned nodes, 3) m/s, in body axes, that `fastest` asks for. Collective."""
        self._rates.x.array[: self._body.n_owned] = rates.ravel()
        self._rates.x.scatter_forward()

    def fastest(self) -> float:
        """The largest speed at which a cell is compressed over that of sound, by the rates last set. Collective."""
        with self._body.present_mesh():
            values = self._speeds.eval(self._body.mesh.mesh, self._cells)
        return max(self._body.comm.allgather(float(values.max(initial=0.0))))
