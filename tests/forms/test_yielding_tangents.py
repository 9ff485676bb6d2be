"""Forces and tangents of the forms that yield: differences, the paper's matrices, patch test and cell means."""

import functools
from dataclasses import replace

import basix
import numpy as np
import pytest
import ufl
from dolfinx import fem
from driven import Driven, dense

from flexmbd.forms import hencky_plasticity, j2_plasticity, updated_lagrangian
from flexmbd.forms.j2_plasticity import LinearHardening

E, NU, YIELD, H = 200e3, 0.3, 250.0, 2000.0
FORMS = {"small": j2_plasticity, "Truesdell": updated_lagrangian, "logarithmic": hencky_plasticity}

CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
GAUSS = CORNERS / np.sqrt(3)

# Direction of a deviator, from which the points' own differ.
BASE = np.array([1.0, -0.4, -0.6, 0.3, -0.7, 0.5])


def material(form, **more):
    values = {"E": E, "nu": NU, "rho": 1.0, "yield_stress": YIELD, "hardening": LinearHardening(H), **more}
    return form.Parameters(**values)


@functools.cache
def body(name, cell, degree, means):
    """Eight bricks, or quadratic tetrahedra, distorted; after a step in which most of it yields."""
    n = 2 if degree == 1 else 1
    driven = Driven(
        FORMS[name], material(FORMS[name]), cell=cell, n=n, degree=degree, amplitude=0.06, means=means
    )
    noise = np.random.default_rng(3).uniform(-0.002, 0.002, driven.x.size)
    driven.body.commit(driven.increment(np.diag([1.004, 0.998, 1.001])) + noise)
    yielded = driven.body.history()[0][:, 6] > 0
    assert yielded.mean() > 0.8
    return driven


ELEMENTS = (("hexahedron", 1, True), ("hexahedron", 1, False), ("tetrahedron", 2, True))
CASES = [(name, *element) for name in FORMS for element in ELEMENTS]


@pytest.mark.parametrize(("name", "cell", "degree", "means"), CASES)
def test_the_tangent_is_the_derivative_of_the_forces(name, cell, degree, means):
    """Also through the means of the cells, at a further step that yields; symmetric where there is a potential."""
    driven = body(name, cell, degree, means)
    random = np.random.default_rng(4)
    n = driven.x.size
    at = driven.increment(np.diag([1.012, 0.995, 1.002])) + random.uniform(-0.002, 0.002, n)
    way = random.uniform(-1, 1, n)
    tangent = driven.tangent(at)
    h = 2e-6
    points = [driven.body.force(at + k * h * way) for k in (-2, -1, 1, 2)]
    difference = (points[0] - 8 * points[1] + 8 * points[2] - points[3]) / (12 * h)
    assert abs(tangent @ way - difference).max() < 2e-7 * abs(difference).max()
    skew = abs(tangent - tangent.T).max() / abs(tangent).max()
    if name == "Truesdell":
        assert skew > 1e-4
    else:
        assert skew < 1e-12


def test_means_enter_the_tangent():
    with_means, without = (body("small", "hexahedron", 1, means) for means in (True, False))
    zero = np.zeros(with_means.x.size)
    one, other = with_means.tangent(zero), without.tangent(zero)
    assert abs(one - other).max() > 1e-3 * abs(one).max()


def trilinear(x, xi):
    """Gradients of the shape functions of a brick with corners x at xi, (8, 3), and the volume they carry."""
    local = np.empty((8, 3))
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        local[:, i] = CORNERS[:, i] * (1 + CORNERS[:, j] * xi[j]) * (1 + CORNERS[:, k] * xi[k]) / 8
    jacobian = x.T @ local
    return local @ np.linalg.inv(jacobian), np.linalg.det(jacobian)


def engineering(gradient):
    """B of eq. 39: strains xx, yy, zz, yz, xz, xy (twice the tensor's shears) of the nodes' displacements."""
    b = np.zeros((6, 24))
    for a, (gx, gy, gz) in enumerate(gradient):
        b[:, 3 * a : 3 * a + 3] = [[gx, 0, 0], [0, gy, 0], [0, 0, gz], [0, gz, gy], [gz, 0, gx], [gy, gx, 0]]
    return b


def hooke():
    lam, mu = E * NU / ((1 + NU) * (1 - 2 * NU)), E / (2 * (1 + NU))
    c = np.zeros((6, 6))
    c[:3, :3] = lam
    return c + np.diag([2 * mu] * 3 + [mu] * 3)


def tensor(t):
    return np.array([[t[0], t[5], t[4]], [t[5], t[1], t[3]], [t[4], t[3], t[2]]])


def form_points(mesh):
    """Where the points of the form's rule lie in the first cell."""
    points, _ = basix.make_quadrature(basix.CellType.hexahedron, 2)
    places = fem.Expression(ufl.SpatialCoordinate(mesh), points).eval(mesh, np.zeros(1, dtype=np.int32))
    return places.reshape(-1, 3)


class OneBrick:
    """A distorted brick with stresses of its own at each point."""

    def __init__(self, *, size, **more):
        self.driven = Driven(updated_lagrangian, material(updated_lagrangian, **more), amplitude=0.1, means=False)
        body = self.driven.body
        straight = Driven(updated_lagrangian, material(updated_lagrangian, **more), means=False).x
        self.nodes = [int(abs(2 * straight - 1 - corner).sum(axis=1).argmin()) for corner in CORNERS]
        x = self.driven.x[self.nodes]
        self.points = [trilinear(x, xi) for xi in GAUSS]
        places = np.array([(1 + CORNERS * xi).prod(axis=1) @ x / 8 for xi in GAUSS])
        self.order = [int(abs(form_points(body.mesh.mesh) - place).sum(axis=1).argmin()) for place in places]
        stress = BASE + 0.2 * np.random.default_rng(8).normal(size=(8, 6))
        stress[:, :3] -= stress[:, :3].mean(axis=1)[:, None]
        mises = np.sqrt(1.5 * ((stress[:, :3] ** 2).sum(axis=1) + 2 * (stress[:, 3:] ** 2).sum(axis=1)))
        self.stress = size * stress / mises[:, None]
        history = np.zeros((8, 7))
        history[self.order, :6] = self.stress
        kept = body.snapshot()
        body.restore(replace(kept, history=(history.ravel(),)))
        self.dofs = (3 * np.array(self.nodes)[:, None] + np.arange(3)).ravel()

    def matrices(self, elasticity):
        """K_L, K_NL and F of eq. 39-41 in the form's numbering."""
        linear, nonlinear, force = np.zeros((24, 24)), np.zeros((24, 24)), np.zeros(24)
        for (gradient, volume), stress, c in zip(self.points, self.stress, elasticity, strict=True):
            b = engineering(gradient)
            linear += volume * b.T @ c @ b
            nonlinear += volume * np.kron(gradient @ tensor(stress) @ gradient.T, np.eye(3))
            force += volume * b.T @ stress
        return [self._numbered(part) for part in (linear, nonlinear, force)]

    def _numbered(self, values):
        result = np.zeros_like(values)
        result[np.ix_(*[self.dofs] * values.ndim)] = values
        return result


def test_the_papers_matrices():
    """F, and K_L + K_NL, written out with B matrices (eq. 39-41), below yield."""
    brick = OneBrick(size=0.9 * YIELD)
    linear, nonlinear, force = brick.matrices([hooke()] * 8)
    zero = np.zeros(24)
    assert np.allclose(brick.driven.body.force(zero), force, rtol=0, atol=1e-12 * abs(force).max())
    tangent = brick.driven.tangent(zero)
    assert np.allclose(tangent, linear + nonlinear, rtol=0, atol=1e-12 * abs(linear).max())
    assert abs(nonlinear).max() > 1e-4 * abs(linear).max()


def voigt(strain):
    """The tensor of six engineering strains."""
    return np.array(tensor([*strain[:3], *(strain[3:] / 2)]))


def continuum(stress, parameters):
    """6 x 6 of eq. 64, from the form's own expression."""
    columns = []
    for unit in np.eye(6):
        strain, at = (ufl.as_matrix(values.tolist()) for values in (voigt(unit), tensor(stress)))
        rate = updated_lagrangian.continuum_tangent(strain, at, parameters)
        columns.append([rate[i, j](()) for i, j in ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))])
    return np.array(columns).T


def written_out(stress):
    """Eq. 64 in numpy: C - C f f C / (H + f C f), with f the derivative of the yield function."""
    deviator = stress.copy()
    deviator[:3] -= stress[:3].mean()
    mises = np.sqrt(1.5 * ((deviator[:3] ** 2).sum() + 2 * (deviator[3:] ** 2).sum()))
    normal = 1.5 * deviator / mises * np.array([1, 1, 1, 2, 2, 2])
    driven = hooke() @ normal
    return hooke() - np.outer(driven, driven) / (H + normal @ driven)


def test_the_continuum_tangent_and_the_consistent_one():
    """At a stress that yields, as the step goes to zero they agree, to first order; at a large step they do not.

    In a material whose stress is small against its stiffness: eq. 64 leaves the turning of the stress out.
    """
    limit = 1e-6 * E
    parameters = material(updated_lagrangian, yield_stress=limit)
    brick = OneBrick(size=limit * (1 + 1e-13), yield_stress=limit)
    tensors = [continuum(stress, parameters) for stress in brick.stress]
    for stress, own in zip(brick.stress, tensors, strict=True):
        assert np.allclose(own, written_out(stress), rtol=0, atol=1e-10 * E)
    linear, nonlinear, _ = brick.matrices(tensors)
    # along the stress that they have nearly in common, which loads every point
    gradient = tensor(BASE)
    assert all((gradient * tensor(stress)).sum() > 0 for stress in brick.stress)
    step = (brick.driven.x @ gradient).ravel()

    def off(size):
        difference = brick.driven.tangent(size * step) - (linear + nonlinear)
        return abs(difference).max() / abs(linear).max()

    small, half, large = off(1e-9), off(5e-10), off(1e-5)
    assert small < 2e-3
    assert small / half == pytest.approx(2.0, abs=0.1)
    assert large > 0.1


@pytest.mark.parametrize("name", FORMS)
def test_patch_test_with_cell_means(name):
    """A homogeneous stretch on the boundary of distorted bricks, elastic and far into yield: so it is inside."""
    driven = Driven(FORMS[name], material(FORMS[name]), n=2, amplitude=0.06)
    x = driven.x
    distance = abs(x - x.mean(axis=0)).sum(axis=1)
    inside = int(distance.argmin())
    free = 3 * inside + np.arange(3)
    gradient = np.array([[2.0, -1, 0.5], [0.7, -1, 0.3], [-0.5, 0.8, 0.2]])
    for size in (1e-4, 1e-2):
        exact = driven.increment(np.eye(3) + size * gradient)
        trial = exact.copy()
        trial[free] += 0.05 * size
        for _ in range(12):
            trial[free] -= np.linalg.solve(driven.tangent(trial)[np.ix_(free, free)], driven.body.force(trial)[free])
        assert abs(trial - exact).max() < 1e-13
        driven.body.commit(trial)
        stress = driven.body.stress()[0].reshape(-1, 3, 3)
        assert abs(stress - stress[0]).max() < 1e-9 * YIELD
    assert driven.body.history()[0][:, 6].min() > 0.01


def brick_volume(x):
    return sum(trilinear(x, xi)[1] for xi in GAUSS)


def test_a_cells_mean_is_its_volume():
    """The mean volume strain is the change of a cell's volume over it, whatever its nodes do."""
    for name, scale in (("small", 1e-7), ("logarithmic", 0.05)):
        driven = Driven(FORMS[name], material(FORMS[name]), amplitude=0.1)
        straight = Driven(FORMS[name], material(FORMS[name])).x
        nodes = [int(abs(2 * straight - 1 - corner).sum(axis=1).argmin()) for corner in CORNERS]
        u = scale * np.random.default_rng(5).uniform(-1, 1, 24)
        driven.body.commit(u)
        before, after = brick_volume(driven.x[nodes]), brick_volume((driven.x + u.reshape(8, 3))[nodes])
        if name == "small":
            pressure = np.trace(driven.body.stress()[0][0], axis1=1, axis2=2) / 3
            assert pressure / (E / (3 * (1 - 2 * NU))) == pytest.approx(np.full(8, after / before - 1), rel=1e-5)
        else:
            theta = driven.body.history()[0][:, 7]
            assert theta == pytest.approx(np.full(8, np.log(after / before)), rel=1e-12)


def test_dense_matrices_of_the_driver():
    driven = Driven(j2_plasticity, material(j2_plasticity))
    matrix = driven.body.tangent(np.zeros(24))
    values = dense(matrix)
    x, y = matrix.createVecs()
    x.array[:] = np.arange(24.0)
    matrix.mult(x, y)
    assert np.allclose(values @ np.arange(24.0), y.array)
