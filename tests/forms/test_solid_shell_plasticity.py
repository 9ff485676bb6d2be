"""Solid-shells that yield: bending over points through the thickness, unloading, any law in a wall, rules of layers."""

from dataclasses import dataclass

from mpi4py import MPI

import basix.ufl
import numpy as np
import pytest
import ufl
from full_model import gather

from flexmbd import meshes
from flexmbd.continuum import NonlinearModel, follow, wall_form
from flexmbd.continuum.contract.quadrature import is_rule, points_and_weights
from flexmbd.continuum.contract.ufl_values import evaluate_expanded
from flexmbd.errors import FormulationError
from flexmbd.forms import (
    _thin_wall,
    hencky_plasticity,
    j2_plasticity,
    solid_micropolar,
    solid_shell,
    solid_shell_plasticity,
    st_venant_kirchhoff,
)

E, YIELD, THICKNESS = 2e11, 2e7, 0.1
FIRST_YIELD = YIELD * THICKNESS**2 / 6  # moment of a unit width
ELASTIC = 2 * YIELD / E / THICKNESS  # curvature there


@dataclass(frozen=True)
class Rule:
    degree: int
    scheme: str


class Strip:
    """One brick of unit sides, bent by the turns of its ends, free across."""

    def __init__(self, form, parameters):
        mesh = meshes.wall(meshes.sheet(1.0, 1.0, divisions=(1, 1), comm=MPI.COMM_SELF), THICKNESS)
        self.body = NonlinearModel(mesh, form, parameters, degree=1)
        x, dofs = self.body.layout.node_x, self.body.layout.displacement_dofs
        x = x - x.min(axis=0)
        near, far, side = x[:, 0] < 0.5, x[:, 0] > 0.5, x[:, 1] < 0.5
        self.z, self.end = x[far, 2] - THICKNESS / 2, dofs[far, 0]
        corner = near & side & (x[:, 2] < THICKNESS / 2)
        self.fixed = np.concatenate([self.end, dofs[near, 0], dofs[side, 1], dofs[corner, 2]])
        self.curvature = 0.0

    def bend(self, curvature):
        """Go to a curvature, 1/m; the bending moment, N."""
        body, move = self.body, np.zeros(self.body.layout.n_local)
        move[self.end] = -(curvature - self.curvature) * self.z
        free = np.setdiff1d(np.arange(len(move)), self.fixed)
        at, driven = np.zeros_like(move), move
        for _ in range(20):
            tangent, force = gather(body.tangent(at)).toarray(), body.force(at)
            change = driven.copy()
            change[free] = np.linalg.solve(tangent[np.ix_(free, free)], -(force + tangent @ driven)[free])
            at, driven = at + change, np.zeros_like(move)
            force = body.force(at)
            if abs(force[free]).max() < 1e-9 * abs(force).max():
                break
        body.commit(at)
        self.curvature = curvature
        return -float(force[self.end] @ self.z)


def by_points(n, ratio):
    """M over that of first yield, of fibres at the rule's heights, for a curvature over that of first yield."""
    points, weights = points_and_weights("hexahedron", Rule(3, f"layers {n}"))
    height, share = 2 * points[:n, 2] - 1, weights[:n] / weights[:n].sum()
    return 3 * float(share @ (height * np.clip(ratio * height, -1, 1)))


def exact(ratio):
    return ratio if ratio < 1 else 1.5 - 0.5 / ratio**2


@pytest.mark.parametrize("n", [4, 5, 6, 7, 9])
def test_layers_integrate_elastic_and_wholly_plastic_bending(n):
    assert by_points(n, 0.7) == pytest.approx(0.7, rel=1e-12)
    assert by_points(n, 1e9) == pytest.approx(1.5, rel=1e-8)
    points, weights = points_and_weights("hexahedron", Rule(3, f"layers {n}"))
    assert points.shape == (4 * n, 3)
    assert weights.sum() == pytest.approx(1.0, rel=1e-14)
    assert {points[:, 2].min(), points[:, 2].max()} == {0.0, 1.0}


def test_more_layers_come_closer_between():
    ratios = np.linspace(1.0, 6.0, 60)
    worst = [max(abs(by_points(n, r) / exact(r) - 1) for r in ratios) for n in (2, 3, 5, 7)]
    assert (np.diff(worst) < 0).all()
    assert worst[2:] == pytest.approx([0.09, 0.022], abs=0.015)


def test_rules_of_layers_are_of_hexahedra():
    assert is_rule(Rule(3, "layers 5"), "hexahedron")
    for scheme, cell in (("layers 5", "tetrahedron"), ("layers 1", "hexahedron"), ("layers x", "hexahedron")):
        assert not is_rule(Rule(3, scheme), cell)


@pytest.mark.parametrize("law", ["shipped", "small strain"])
def test_moment_over_curvature_and_back(law):
    """Elastic-perfectly plastic; the moment of fibres at the points, the plastic moment, and stress left behind."""
    form = solid_shell_plasticity if law == "shipped" else wall_form(j2_plasticity, layers=5)
    strip = Strip(form, form.Parameters(E=E, nu=0.3, rho=7850.0, yield_stress=YIELD))
    for ratio in (0.5, 1.2, 1.5, 2.0, 3.0, 5.0):
        moment = strip.bend(ratio * ELASTIC) / FIRST_YIELD
        # across the strip and through it the strain is linear, which plastic flow is not
        assert moment == pytest.approx(by_points(5, ratio), rel=2e-2)
    assert moment == pytest.approx(1.5, rel=5e-3)
    bending = E * THICKNESS**3 / 12
    left = strip.bend(strip.curvature - moment * FIRST_YIELD / bending) / FIRST_YIELD
    assert abs(left) < 1e-2 * moment
    stress = strip.body.stress()[0][0].reshape(4, 5, 3, 3) / YIELD
    # sigma_y less the elastic stress of the plastic moment, 1.5 sigma_y on the surface; less what a strain that is
    # linear across leaves of pressure
    along = stress[..., 0, 0] - stress[..., 1, 1]
    assert along == pytest.approx(np.tile([-0.5, 0.25, 0.0, -0.25, 0.5], (4, 1)), abs=0.13)


def test_bends_far_at_constant_volume():
    """A brick as long as thick is bent to a wedge in plane strain, its faces strained by a third; Hill 1950.

    Fibres keep their volume: thickness goes with one over their length, which is not linear through it. All work is
    that of the yield stress, as of a solid at the rule's heights; what is stored stays that of the yield stress.
    """
    form, size, strain = solid_shell_plasticity, THICKNESS, 0.35
    p = form.Parameters(E=E, nu=0.3, rho=7850.0, yield_stress=YIELD)
    sheet = meshes.sheet(size, size, divisions=(1, 1), comm=MPI.COMM_SELF)
    body = NonlinearModel(meshes.wall(sheet, size), form, p, degree=1)
    x, dofs = body.layout.node_x - body.layout.node_x.mean(axis=0), body.layout.displacement_dofs
    held = np.sort(np.concatenate([dofs[:, 0], dofs[:, 1], dofs[:1, 2]])).astype(np.int32)
    move = np.zeros(body.layout.n_local)
    move[dofs[:, 0]] = strain * x[:, 0] * x[:, 2] / (size / 2)
    follow(body, list(np.linspace(0.0, 1.0, 15)[1:]), prescribed=held, displacement=lambda t: t * move[held])
    height, share = np.linspace(-1, 1, 5), np.array([1, 4, 2, 4, 1]) / 12
    exact = 2 / np.sqrt(3) * share @ abs(np.log(1 + strain * height))
    found = {name: energy / (YIELD * size**3) for name, energy in body.energies().items()}
    assert found["plastic"] == pytest.approx(exact, rel=2e-3)
    assert found["elastic"] < YIELD / E
    # a sheet that does not harden keeps its thickness in pure bending (Hill)
    moved, top = x + body.displacement[dofs], x[:, 2] > 0
    pairs = [(i, np.flatnonzero(~top & (abs(x - x[i])[:, :2].max(axis=1) < 1e-9))[0]) for i in np.flatnonzero(top)]
    thick = [np.linalg.norm(moved[i] - moved[k]) for i, k in pairs]
    assert thick == pytest.approx([size] * 4, rel=YIELD / E)


@pytest.mark.parametrize("by_volume", [False, True])
def test_virtual_work_is_on_the_variation_of_the_strain(by_volume):
    """By differences, of strains and fields of any size at a corner of a cell that is askew."""
    rng = np.random.default_rng(5)
    element = solid_shell.element("hexahedron", 3, 1)
    space = ufl.FunctionSpace(ufl.Mesh(basix.ufl.element("Lagrange", "hexahedron", 1, shape=(3,))), element)
    w, v, n = ufl.Coefficient(space), ufl.Coefficient(space), element.reference_value_size
    corners = np.array([[i & 1, i >> 1 & 1, i >> 2] for i in range(8)]) + 0.2 * rng.uniform(-1, 1, (8, 3))
    edge = np.eye(3) + 0.2 * rng.uniform(-1, 1, (3, 3))
    at, along = [(0.2 * rng.uniform(-1, 1, n), 0.2 * rng.uniform(-1, 1, (n, 3))) for _ in range(2)]
    stress = rng.uniform(-1, 1, (3, 3))
    stress = ufl.as_matrix((stress + stress.T).tolist())
    wall = _thin_wall.assumed_strain(w, ufl.as_ufl(1.0), by_volume=by_volume)
    pairs = (
        (ufl.inner(stress, wall.strain), wall.virtual_work(stress, v)),
        (wall.ties[0][0], wall.virtual_ties(v)[0][0]),
    )

    def value(density, share):
        moved = [a + share * b for a, b in zip(at, along, strict=True)]
        known = {
            ufl.classes.CellVertices: lambda _: corners,
            ufl.classes.SpatialCoordinate: lambda _: corners[5],
            ufl.classes.Jacobian: lambda _: edge,
            ufl.classes.JacobianDeterminant: lambda _: np.linalg.det(edge),
            w: moved.__getitem__,
            v: along.__getitem__,
        }
        return evaluate_expanded(density, known)

    for density, virtual in pairs:
        density, virtual = (ufl.algorithms.expand_derivatives(one) for one in (density, virtual))
        slope = (value(density, 1e-5) - value(density, -1e-5)) / 2e-5
        assert abs(slope) > 1e-3
        assert value(virtual, 0.0) == pytest.approx(slope, rel=1e-7)


def test_a_law_of_an_energy_in_a_wall_is_the_shipped_solid_shell():
    """St Venant-Kirchhoff's energy of Cholesky's factor is that of the assumed strain, far turned as well.

    Of one the change of volume is linear through the thickness, of the other the strain: alike where strains are small.
    """
    p = st_venant_kirchhoff.Parameters(E=E, nu=0.3, rho=7850.0)
    mesh = meshes.wall(meshes.sheet(1.0, 1.0, divisions=(2, 1), comm=MPI.COMM_SELF), THICKNESS)
    own = solid_shell.Parameters(E=E, nu=0.3, rho=7850.0)
    forms = (solid_shell, own), (wall_form("st_venant_kirchhoff", layers=2), p)
    turn = np.array([[0.36, 0.48, -0.8], [-0.8, 0.6, 0.0], [0.48, 0.64, 0.6]])
    bodies = [NonlinearModel(mesh, form, parameters, degree=1) for form, parameters in forms]
    x, dofs = bodies[0].layout.node_x, bodies[0].layout.displacement_dofs
    noise, apart = np.random.default_rng(3).uniform(-1, 1, x.shape), []
    for size in (1e-3, 1e-5):
        found = []
        for body in bodies:
            increment = np.zeros(body.layout.n_local)
            for share in (0.0, size):  # fields of the cells begin at those of the last step
                increment[dofs] = (x + share * noise) @ turn.T - x
                force = body.force(increment)
            found.append(force)
        apart.append(abs(found[1] - found[0]).max() / abs(found[0]).max())
    assert apart[0] < 1e-3 / THICKNESS
    assert apart[1] < 1.1e-2 * apart[0]


@pytest.mark.parametrize("nu", [0.0, 1e-6, 0.3])
@pytest.mark.parametrize("noise", [0.0, 1e-6])
def test_small_strains_of_a_thin_wall_are_those_of_the_elastic_one(nu, noise):
    """Also at a Poisson's ratio of zero, at which some fields of a cell follow round-off of F alone."""
    mesh = meshes.wall(meshes.sheet(0.1, 0.2, divisions=(1, 1), comm=MPI.COMM_SELF), 1e-3)
    found = []
    for form, more in ((solid_shell, {}), (solid_shell_plasticity, {"yield_stress": 1e9})):
        body = NonlinearModel(mesh, form, form.Parameters(E=E, nu=nu, rho=7850.0, **more), degree=1)
        x, dofs = body.layout.node_x, body.layout.displacement_dofs
        along, z = x[:, 0] - x[:, 0].min(), x[:, 2] - x[:, 2].mean()
        increment = np.zeros(body.layout.n_local)
        bent = 1e-3 * np.column_stack([-along * z, 0 * z, along**2 / 2])  # 1e-3/m
        increment[dofs] = bent + 1e-3 * noise * np.random.default_rng(3).uniform(-1, 1, x.shape)
        found.append(body.force(increment))
    assert found[1] == pytest.approx(found[0], abs=1e-4 * abs(found[0]).max())


def test_what_a_wall_does_not_carry_is_named():
    with pytest.raises(FormulationError, match="2 to 99, got 1"):
        wall_form(j2_plasticity, layers=1)
    with pytest.raises(FormulationError, match="unknowns besides the displacement"):
        wall_form(solid_micropolar)
    with pytest.raises(FormulationError, match="no E; say modulus="):
        wall_form("solid_orthotropic")


def test_terms_without_history_have_rules_of_their_own(tmp_path):
    """A tie at the vertices beside history at points; a history at two rules is refused."""
    lines = [
        "import ufl",
        "from flexmbd.forms import j2_plasticity as j2",
        "from flexmbd.forms.j2_plasticity import *",
        "def residual(u, v, state, p, *, z=None, mean=None):",
        "    ((w, rule),) = j2.residual(u, v, state, p, z=z, mean=mean)",
    ]
    own = "    return [(w / 2, rule), (p.E * ufl.inner(ufl.sym(ufl.grad(u)), ufl.grad(v)), Quadrature(4)), (w / 2, {})]"
    mesh = meshes.block(1.0, 1.0, 1.0, divisions=(1, 1, 1), comm=MPI.COMM_SELF)
    p = j2_plasticity.Parameters(E=E, nu=0.3, rho=7850.0, yield_stress=YIELD)
    bodies = []
    for name, rule in (("same", "rule"), ("other", "Quadrature(4)")):
        file = tmp_path / f"{name}.py"
        file.write_text("\n".join([*lines, own.format(rule)]))
        if name == "other":
            with pytest.raises(FormulationError, match="a history needs one set of quadrature points"):
                NonlinearModel(mesh, file, p, degree=1, cell_means=False)
        else:
            bodies = [NonlinearModel(mesh, form, p, degree=1, cell_means=False) for form in (file, j2_plasticity)]
    x, dofs = bodies[0].layout.node_x, bodies[0].layout.displacement_dofs
    increment = np.zeros(bodies[0].layout.n_local)
    gradient = 1e-3 * np.array([[1.0, 0.3, -0.2], [0.1, -0.6, 0.4], [-0.3, 0.2, -0.3]])
    increment[dofs] = x @ gradient.T
    mixed, plain = (body.force(increment) for body in bodies)
    # of a constant strain both rules are exact
    along = np.where(x - x.min(axis=0) > 0.5, 0.25, -0.25)
    tie = E * along @ (gradient + gradient.T) / 2
    assert (mixed - plain)[dofs] == pytest.approx(tie, rel=1e-9)
    for body in bodies:
        body.commit(increment)
    assert bodies[0].history()[0] == pytest.approx(bodies[1].history()[0], rel=1e-9)


def test_the_law_of_a_large_rotation_is_turned_and_pictures_have_its_stress():
    """Of a uniform stretch that flows it has the stress of the solid."""
    form = solid_shell_plasticity
    p = form.Parameters(E=E, nu=0.3, rho=7850.0, yield_stress=YIELD)
    mesh = meshes.wall(meshes.sheet(1.0, 1.0, divisions=(1, 1), comm=MPI.COMM_SELF), THICKNESS)
    turn, stresses = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]]), []
    for law, rotation in ((hencky_plasticity, np.eye(3)), (form, np.eye(3)), (form, turn)):
        body = NonlinearModel(mesh, law, p, degree=1)
        x, dofs = body.layout.node_x, body.layout.displacement_dofs
        increment = np.zeros(body.layout.n_local)
        increment[dofs] = x @ (rotation @ (np.eye(3) + np.diag([1e-3, -2e-4, 0.0]))).T - x
        body.force(increment)
        body.commit(increment)
        stresses.append(rotation.T @ body.stress()[0].reshape(-1, 3, 3) @ rotation)
    for stress in stresses:
        assert stress == pytest.approx(np.broadcast_to(stresses[0][0], stress.shape), abs=1e-8 * YIELD)
    assert float(ufl.as_ufl(form.state(p)).ufl_shape[0]) == 15
