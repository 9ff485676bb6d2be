"""One pass over the cells against DOLFINx's own assembly and evaluation, and the sharing of parts that it needs."""

import types

from mpi4py import MPI

import basix
import numpy as np
import pytest
import ufl
from dolfinx import fem

from flexmbd import meshes
from flexmbd.continuum.history.nonlinear_model import NonlinearModel
from flexmbd.continuum.history.shared_parts import share_parts
from flexmbd.forms import hencky_plasticity as hencky
from flexmbd.forms import j2_plasticity as j2

STEEL = {"E": 210e9, "nu": 0.3, "rho": 7800.0, "yield_stress": 0.24e9}


def skipping():
    """A form that reads the mean and not the history, which lies between displacement and mean."""
    module = types.ModuleType("skipping")
    vars(module).update({name: value for name, value in vars(j2).items() if name[:2] not in ("__", "lo")})

    def residual(u, v, state, p, *, mean=None):
        volume = ufl.div(u) if mean is None else mean
        return [(p.E * ufl.inner(ufl.sym(ufl.grad(u)), ufl.grad(v)) + p.E * volume**2 * ufl.div(v), j2.rule(u))]

    def update(u, state, p, *, mean=None):
        return ufl.as_vector([u[0], ufl.div(u) if mean is None else mean])

    module.state = lambda p: ufl.as_vector([0.0, 0.0])  # type: ignore[attr-defined]
    module.residual, module.update = residual, update  # type: ignore[attr-defined]
    module.stress = lambda u, state, p, *, mean=None: p.E * ufl.sym(ufl.grad(u))  # type: ignore[attr-defined]
    del module.energies, module.state_names
    return module


def moved(form, law=None, *, cell="hexahedron"):
    """A bent block that yields, its trial displacement set, and its one group's history."""
    mesh = meshes.block(1.0, 0.5, 0.5, divisions=(3, 2, 2), cell=cell, comm=MPI.COMM_SELF)
    p = j2.Parameters(**STEEL, hardening=law or j2.LinearHardening(2e9))
    if form is hencky:
        p = hencky.Parameters(**STEEL, hardening=p.hardening)
    body = NonlinearModel(mesh, form, p, degree=1, cell_means=True)
    x, u = body.layout.node_x, np.zeros(body.layout.n_local)
    u[body.displacement_dofs] = 2e-2 * np.column_stack([x[:, 0] * x[:, 2], x[:, 1] ** 2, -0.5 * x[:, 0] ** 2])
    body.step(0.7 * u)
    return body, u


def by_dolfinx(body):
    """Means, forces, and the history at the step's end, each by a pass of its own."""
    (history,), (group,) = body._histories, body.groups
    given = history._given(history._z)
    averaged, measure = (fem.assemble_vector(fem.form(form)).array for form in history.mean_forms())
    forces = sum(fem.assemble_vector(fem.form(term)).array for term in history.terms)
    points, _ = basix.make_quadrature(
        basix.CellType[body.mesh.mesh.topology.cell_name()], history.rule.degree,
        rule=basix.quadrature.string_to_type(history.rule.scheme),
    )
    update = fem.Expression(group.formulation.update(body._u, history._state, group.symbols, **given), points)
    return averaged / measure, forces, update.eval(body.mesh.mesh, group.cells).ravel()


CASES = {
    "linear hardening": (j2, None, "hexahedron"),
    "Voce": (j2, j2.VoceHardening(0.1e9, 200.0), "hexahedron"),
    "pieces apart": (skipping(), None, "tetrahedron"),
}


@pytest.mark.parametrize("case", CASES.values(), ids=CASES)
def test_the_pass_is_what_dolfinx_assembles_and_evaluates(case):
    form, law, cell = case
    body, u = moved(form, law, cell=cell)
    force = body.force(0.3 * u)
    (history,) = body._histories
    mean, expected, new = by_dolfinx(body)
    assert abs(history.mean.x.array - mean).max() <= 1e-14 * abs(mean).max()
    assert abs(force - expected).max() <= 1e-14 * abs(expected).max()
    assert abs(history._pass.trial - new).max() <= 1e-14 * abs(new).max()
    # it moves, and where there is hardening it yields
    assert abs(new - history.accepted.ravel()).max() > 1e-4


def test_local_unknowns_are_solved_at_every_point():
    body, u = moved(j2, j2.VoceHardening(0.1e9, 200.0))
    body.force(0.3 * u)
    (history,), (group,) = body._histories, body.groups
    lack = j2.local_residual(history._z, body._u, history._state, group.symbols)
    assert abs(history.evaluate(lack)).max() < 1e-12
    assert history._z.x.array.max() > 1e-4


def test_shared_parts_are_one_object_and_worth_the_same():
    """Two expressions built apart, of tensors with indices: what they have in common is found, nothing else is."""
    domain = meshes.block(1.0, 1.0, 1.0, divisions=(1, 1, 1), comm=MPI.COMM_SELF).mesh
    u = fem.Function(fem.functionspace(domain, ("Lagrange", 1, (3,))))
    u.interpolate(lambda x: np.array([0.1 * x[0] * x[1], 0.2 * x[2], 0.3 * x[0] - 0.1 * x[1]]))

    def built(turned):
        f = ufl.Identity(3) + ufl.grad(u)
        b = ufl.variable(f * f.T)
        return ufl.inner(b * b, f.T if turned else f) + ufl.diff(ufl.tr(b * b), b)[0, 1]

    both = [built(False), built(False), built(True)]
    one, again, other = share_parts(both)
    assert one is again
    assert one is not other
    points = np.array([[0.3, 0.2, 0.6]])
    for before, after in zip(both, (one, again, other), strict=True):
        values = [fem.Expression(e, points).eval(domain, np.zeros(1, dtype=np.int32)) for e in (before, after)]
        np.testing.assert_allclose(values[1], values[0], rtol=1e-14)
    # a sum whose parts were compared all the way down would not end
    assert len({id(part) for part in ufl.corealg.traversal.pre_traversal(again)}) < 200


def test_parts_that_divide_by_the_same_divide_once():
    """An inverse, a derivative of a quotient and quotients by numbers are worth the same, with one reciprocal each."""
    domain = meshes.block(1.0, 1.0, 1.0, divisions=(1, 1, 1), comm=MPI.COMM_SELF).mesh
    u = fem.Function(fem.functionspace(domain, ("Lagrange", 1, (3,))))
    u.interpolate(lambda x: np.array([0.1 * x[0] * x[1], 0.2 * x[2], 0.3 * x[0] - 0.1 * x[1]]))
    f = ufl.Identity(3) + ufl.grad(u)
    i, j = ufl.indices(2)
    c = ufl.variable(f.T * f)
    expressions = [
        ufl.inner(ufl.inv(f), f * f) + ufl.tr(f) / ufl.det(f),
        ufl.diff(ufl.tr(c * c) / ufl.tr(c), c)[0, 1],
        u[0] / 3 + u[1] / 7 + u[2] / 3 + f[0, 1] / 2.5,
        ufl.as_tensor(f[i, j] / (1 + u[0] ** 2), (i, j))[1, 2],
    ]
    points = np.array([[0.3, 0.2, 0.6]])
    for before, after in zip(expressions, share_parts(expressions), strict=True):
        values = [fem.Expression(e, points).eval(domain, np.zeros(1, dtype=np.int32)) for e in (before, after)]
        np.testing.assert_allclose(values[1], values[0], rtol=1e-14)
        divisions = [
            part for part in ufl.corealg.traversal.unique_pre_traversal(after) if isinstance(part, ufl.classes.Division)
        ]
        assert all(isinstance(one.ufl_operands[0], ufl.classes.ScalarValue) for one in divisions)
        assert len(divisions) <= 2
