"""The ring and the slope of yielding.py by dolfinx-external-operator, in a process of its own.

    PYTHON benchmarks/external_operator_peer.py ring 4 0.2,0.4,...       # PYTHON: of install_peers.sh
    PYTHON benchmarks/external_operator_peer.py slope 8 2.0,2.5,...

The scenes and ways of its demos of von Mises and Mohr-Coulomb plasticity (Latyshev, Bleyer, Maurini & Hale 2025,
doi:10.46298/jtcam.14449): stresses and tangents at the points by numba and by jax, Newton's method with a factor each
iteration. Written for this comparison on biquadratic quadrilaterals with 3 x 3 points, so that flexmbd's bricks are the
same discrete problem. Prints one line of JSON; seconds of processor time without what compiles.
"""

from __future__ import annotations

import json
import sys
import time
from functools import partial

from mpi4py import MPI

import basix.ufl
import numpy as np
import ufl
from dolfinx import fem, mesh
from dolfinx.fem.petsc import NonlinearProblem
from dolfinx_external_operator import (
    FEMExternalOperator,
    evaluate_external_operators,
    evaluate_operands,
    replace_external_operators,
)
from dolfinx_external_operator.petsc import assemble_residual_with_callback

# xx, yy, zz, sqrt(2) xy
TRACE = np.array([1.0, 1.0, 1.0, 0.0])
DEVIATORIC = np.eye(4) - np.outer(TRACE, TRACE) / 3


def strain(v):
    g = ufl.grad(v)
    return ufl.as_vector([g[0, 0], g[1, 1], 0.0, np.sqrt(0.5) * (g[0, 1] + g[1, 0])])


def elastic(young, ratio):
    lam, mu = young * ratio / (1 + ratio) / (1 - 2 * ratio), young / 2 / (1 + ratio)
    return lam * np.outer(TRACE, TRACE) + 2 * mu * np.eye(4), mu


class Problem:
    """A plane body whose stress is an external operator of the step's strain."""

    def __init__(self, domain):
        self.space = fem.functionspace(domain, ("Lagrange", 2, (2,)))
        self.dx = ufl.Measure("dx", domain=domain, metadata={"quadrature_degree": 4, "quadrature_scheme": "default"})
        stresses = basix.ufl.quadrature_element(domain.topology.cell_name(), degree=4, value_shape=(4,))
        self.stresses = fem.functionspace(domain, stresses)
        self.step, self.u = fem.Function(self.space), fem.Function(self.space)
        self.v = ufl.TestFunction(self.space)
        self.before = fem.Function(self.stresses)
        self.stress = FEMExternalOperator(strain(self.step), function_space=self.stresses)

    def run(self, load_work, factor, bcs, evaluate, commit, loads, at, *, guess):
        """Load step by step.

        Args:
            load_work: virtual work of the loads, with `factor` in it.
            factor: its fem.Constant.
            bcs: Dirichlet conditions.
            evaluate: (strains) -> tangents, stresses and more, flat.
            commit: is given what more there is after each step.
            loads: values of the factor.
            at: the dof whose displacement is kept.
            guess: of a step's displacement.
        """
        self.stress.external_function = lambda derivatives: evaluate
        work = ufl.inner(strain(self.v), self.stress) * self.dx - load_work
        slope = ufl.derivative(work, self.step, ufl.TrialFunction(self.space))
        work, operators = replace_external_operators(work)
        slope, derivatives = replace_external_operators(ufl.algorithms.expand_derivatives(slope))
        options = {
            "snes_type": "vinewtonrsls", "snes_linesearch_type": "basic", "ksp_type": "preonly", "pc_type": "lu",
            "pc_factor_mat_solver_type": "mumps", "snes_atol": 1e-8, "snes_rtol": 1e-8, "snes_max_it": 100,
        }
        problem = NonlinearProblem(
            work, self.step, J=slope, bcs=bcs, petsc_options_prefix="peer_", petsc_options=options
        )
        more = []

        def update(operators, derivatives):
            ((_, stress, *rest),) = evaluate_external_operators(derivatives, evaluate_operands(operators))
            self.stress.ref_coefficient.x.array[:] = stress
            more[:] = rest

        residual = partial(
            assemble_residual_with_callback, problem.u, problem.F, problem.J, bcs, update, [operators, derivatives]
        )
        problem.solver.setFunction(residual, problem.b)
        self.step.x.array[:] = guess
        update(operators, derivatives)  # compiles
        moved, iterations, begin = [], 0, time.process_time()
        for load in loads:
            factor.value = load
            self.step.x.array[:] = guess
            problem.solve()
            iterations += problem.solver.getIterationNumber()
            if problem.solver.getConvergedReason() <= 0:
                break
            self.u.x.array[:] += self.step.x.array
            self.before.x.array[:] = self.stress.ref_coefficient.x.array
            commit(*more)
            moved.append(float(self.u.x.array[at]))
        return {"seconds": time.process_time() - begin, "moved": moved, "iterations": iterations}


def ring(n, loads):
    """n cells along the radius, 3 n around; MPa, mm."""
    import numba

    young, ratio, strength, outer = 70e3, 0.3, 250.0, 1.3
    hardening = young * (young / 100) / (young - young / 100)
    domain = mesh.create_rectangle(MPI.COMM_SELF, [[0.0, 0.0], [1.0, 1.0]], [n, 3 * n], mesh.CellType.quadrilateral)
    inner = mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[0], 0.0))
    ends = [mesh.locate_entities_boundary(domain, 1, lambda x, y=y: np.isclose(x[1], y)) for y in (0.0, 1.0)]
    r, angle = 1.0 + (outer - 1.0) * domain.geometry.x[:, 0], np.pi / 2 * domain.geometry.x[:, 1]
    domain.geometry.x[:, :2] = np.stack([r * np.cos(angle), r * np.sin(angle)], axis=1)
    body = Problem(domain)
    held = [fem.locate_dofs_topological(body.space.sub(k), 1, ends[1 - k]) for k in (0, 1)]
    bcs = [fem.dirichletbc(0.0, dofs, body.space.sub(k)) for k, dofs in enumerate(held)]
    tags = mesh.meshtags(domain, 1, np.sort(inner), np.ones(len(inner), dtype=np.int32))
    ds = ufl.Measure("ds", domain=domain, subdomain_data=tags, metadata={"quadrature_degree": 4})
    pressure = fem.Constant(domain, 0.0)
    C, mu = elastic(young, ratio)
    points = len(body.before.x.array) // 4
    alpha = np.zeros(points)

    @numba.njit
    def back(strains, before, alpha):
        tangents, stresses, growth = np.empty((len(alpha), 4, 4)), np.empty((len(alpha), 4)), np.empty(len(alpha))
        for i in range(len(alpha)):
            trial = before[i] + C @ strains[i]
            s = DEVIATORIC @ trial
            q = max(np.sqrt(1.5 * np.dot(s, s)), 1e-12 * strength)
            over = max(q - strength - hardening * alpha[i], 0.0)
            growth[i] = over / (3 * mu + hardening)
            less = 3 * mu * growth[i] / q
            stresses[i] = trial - less * s
            along = 3 * mu / (3 * mu + hardening) - less if over > 0 else 0.0
            tangents[i] = C - 3 * mu * along * np.outer(s, s) / q**2 - 2 * mu * less * DEVIATORIC
        return tangents, stresses, growth

    def evaluate(strains):
        tangents, stresses, growth = back(strains.reshape(-1, 4), body.before.x.array.reshape(-1, 4), alpha)
        return tangents.reshape(-1), stresses.reshape(-1), growth

    def commit(growth):
        alpha[:] += growth

    work = -pressure * ufl.inner(ufl.FacetNormal(domain), body.v) * ds(1)
    at = corner(body.space, 1.0, 0.0)
    return body.run(work, pressure, bcs, evaluate, commit, loads, at, guess=np.finfo(float).eps)


def slope(n, loads):
    """n x n cells; MPa, mm."""
    import jax
    import jax.numpy as jnp

    jax.config.update("jax_enable_x64", True)
    cohesion, angle, turn = 3.45, np.radians(30), np.radians(26)
    apex = 0.26 * cohesion / np.tan(angle)
    C, _ = elastic(6778.0, 0.25)
    domain = mesh.create_rectangle(MPI.COMM_SELF, [[0.0, 0.0], [1.2, 1.0]], [n, n], mesh.CellType.quadrilateral)
    body = Problem(domain)
    sides = [lambda x: np.isclose(x[0], 1.2), lambda x: np.isclose(x[1], 0.0)]
    bcs = [fem.dirichletbc(np.zeros(2), fem.locate_dofs_geometrical(body.space, side), body.space) for side in sides]

    def deviatoric(sin3):
        part, bound = np.sin(angle) / np.sqrt(3), np.sin(3 * turn)
        theta = jnp.arcsin(jnp.clip(sin3, -bound, bound)) / 3
        side = jnp.where(sin3 < 0, -1.0, 1.0)
        value, first = np.cos(turn) - part * side * np.sin(turn), -(side * np.sin(turn) + part * np.cos(turn))
        second = (-value + 3 * side * np.tan(3 * turn) * first) / (18 * np.cos(3 * turn) ** 2)
        first = first / (3 * np.cos(3 * turn)) - 2 * second * side * bound
        rounded = value + first * (sin3 - side * bound) + second * (sin3**2 - bound**2)
        return jnp.where(jnp.abs(sin3) > bound, rounded, jnp.cos(theta) - part * jnp.sin(theta))

    def surface(stress):
        s = DEVIATORIC @ stress
        j2 = jnp.maximum(jnp.vdot(s, s) / 2, (1e-10 * cohesion) ** 2)
        j3 = s[2] * (s[0] * s[1] - s[3] ** 2 / 2)
        under = j2 * deviatoric(-1.5 * np.sqrt(3) * j3 / j2**1.5) ** 2 + (apex * np.sin(angle)) ** 2
        return TRACE @ stress / 3 * np.sin(angle) + jnp.sqrt(under) - cohesion * np.cos(angle)

    flow = jax.jacfwd(surface)

    def equations(y, strains, before):
        stress, multiplier = y[:4], y[4]
        yields = surface(before + C @ strains) > 0
        balance = stress - before - C @ (strains - jnp.where(yields, multiplier, 0.0) * flow(stress))
        return jnp.append(balance, jnp.where(yields, surface(stress), multiplier))

    slopes = jax.jacfwd(equations)

    def back(strains, before):
        y = jnp.append(before, 0.0)
        lack = equations(y, strains, before)
        bound = 1e-8 * jnp.linalg.norm(lack)

        def change(state):
            y, lack, k = state
            y = y - jnp.linalg.solve(slopes(y, strains, before), lack)
            return y, equations(y, strains, before), k + 1

        def goes_on(state):
            return jnp.logical_and(jnp.linalg.norm(state[1]) > bound, state[2] < 200)

        y, _, _ = jax.lax.while_loop(goes_on, change, (y, lack, 0))
        return y[:4], y[:4]

    derivative = jax.jit(jax.vmap(jax.jacfwd(back, has_aux=True)))

    def evaluate(strains):
        tangents, stresses = derivative(strains.reshape(-1, 4), body.before.x.array.reshape(-1, 4))
        return np.asarray(tangents).reshape(-1), np.asarray(stresses).reshape(-1)

    weight = fem.Constant(domain, 0.0)
    work = -weight * body.v[1] * body.dx
    at = corner(body.space, 0.0, 1.0)
    found = body.run(work, weight, bcs, evaluate, lambda: None, loads, at, guess=1e-8)
    return found | {"moved": [-u for u in found["moved"]]}


def corner(space, x, y):
    """The dof along x of the node at a place."""
    (node,) = fem.locate_dofs_geometrical(space, lambda at: np.isclose(at[0], x) & np.isclose(at[1], y))
    return 2 * int(node)


if __name__ == "__main__":
    task = {"ring": ring, "slope": slope}[sys.argv[1]]
    print(json.dumps(task(int(sys.argv[2]), [float(load) for load in sys.argv[3].split(",")])))
