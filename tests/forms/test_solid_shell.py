"""The solid-shell against shells' published numbers, beams' closed forms, the plate: thin, curved, far turned."""

import warnings

from mpi4py import MPI

import numpy as np
import pytest
import scipy.integrate
import scipy.optimize
import scipy.sparse.linalg
from full_model import gather

from flexmbd import meshes
from flexmbd.continuum import ContinuumModel, LinearSolver, NonlinearModel, PressureOnFacets, follow
from flexmbd.continuum.history.nodal_fields import NodalFields
from flexmbd.errors import LockingWarning
from flexmbd.forms import solid_shell
from verification.walls import pinched_cylinder, pinched_hemisphere, scordelis_lo_roof
from verification.walls._wall import Wall, radial


def pulled(part, force, *, steps, **options):
    """(nodes, 3) displacement of a wall by forces (dofs,) that grow in steps, and the path."""
    times = np.linspace(0, 1, steps + 1)[1:]
    path = follow(part.body, times, prescribed=part.held, load=lambda t: t * force, **options)
    return part.body.displacement[part.dofs], path


def test_scordelis_lo_roof():
    found = np.array([scordelis_lo_roof.sagged(n) / 0.3024 for n in (4, 8, 16)])
    assert abs(found[-1] - 1) < 0.006  # the deep shell's number is 0.6 % lower
    assert (np.diff(abs(found - found[-1])) < 0).all()


def test_pinched_hemisphere():
    found = [pinched_hemisphere.pinched(n) / 0.0940 for n in (8, 16)]
    assert abs(found[0] - 1) < 0.02
    assert abs(found[1] - 1) < 0.01


def test_pinched_cylinder_converges():
    short = [1 - pinched_cylinder.pinched(n) / 1.8248e-5 for n in (8, 16)]
    assert 0 < short[1] < 0.08
    assert short[1] < short[0] / 3


@pytest.mark.parametrize("slenderness", [10.0, 1e2, 1e3])
def test_a_strip_does_not_lock_however_thin(slenderness):
    """One brick through the thickness, cells askew: tip of a cantilever by Timoshenko's beam."""
    t, E = 1.0 / slenderness, 1e7
    def place(i, j):
        return i + 0.03 * np.sin(np.pi * i) * np.cos(2 * np.pi * j), 0.1 * j, 0.0 * i

    part = Wall((12, 2), place, t, E=E, nu=0.0)
    part.hold(part.on(0, 0.0), [0, 1, 2])
    end = part.on(0, 1.0)
    middle = abs(part.x[end, 1] - 0.05) < 1e-9
    force = part.forces((end[middle], (0.0, 0.0, 0.5)), (end[~middle], (0.0, 0.0, 0.5)))
    exact = 4 / (E * 0.1 * t**3) + 1.2 / (E / 2 * 0.1 * t)
    assert part.linear(force)[end, 2].mean() == pytest.approx(exact, rel=0.01)


def test_a_cantilever_bends_by_large_rotations():
    """Tip of the elastica, whose curve is integrated by scipy."""
    length, E, load = 10.0, 1.2e6, 4.0
    bending = E * 0.1**3 / 12

    def slope_at_end(curvature):
        curve = scipy.integrate.solve_ivp(
            lambda s, y: (y[1], -load * np.cos(y[0]) / bending, np.cos(y[0]), np.sin(y[0])), (0, length),
            (0.0, curvature, 0.0, 0.0), rtol=1e-10, atol=1e-12,
        )  # fmt: skip
        return curve.y[:, -1]

    root = scipy.optimize.brentq(lambda c: slope_at_end(c)[1], 0.1, 0.41)
    part = Wall((16, 1), lambda i, j: (length * i, j, 0.0), 0.1, E=E, nu=0.0)
    part.hold(part.on(0, 0.0), [0, 1, 2])
    end = part.on(0, length)
    moved, _ = pulled(part, part.forces((end, (0.0, 0.0, load))), steps=2)
    tip = moved[end].mean(axis=0)
    _, _, along, across = slope_at_end(root)
    assert tip[2] == pytest.approx(across, rel=3e-3)
    assert tip[0] == pytest.approx(along - length, rel=3e-3)


def pinched_far(**options):
    """Displacements of a hemisphere pinched by 100 N in two steps, Newton iterations, factors and cuts."""
    part, outwards, inwards = pinched_hemisphere.hemisphere((8, 8))
    force = pinched_hemisphere.opposed(part, outwards, inwards, 100.0)
    moved, path = pulled(part, force, steps=2, **options)
    iterations = sum(len(step.residuals) - 1 for step in path.steps)
    return (moved[outwards, 0].mean(), moved[inwards, 1].mean()), iterations, path.factorisations, path.cuts


def test_predicted_stresses_bend_a_wall_far_in_few_iterations(monkeypatch):
    """The same place as by displacements alone; the default solver as well as a factor of each tangent.

    Membrane forces beside those that bend: 1e4 times as large at the same displacement.
    """
    predicted = pinched_far()
    assert predicted[1] <= 25
    assert predicted[3] == 0
    monkeypatch.setattr(NonlinearModel, "predicts_stress", False)
    by_default, each = pinched_far(), pinched_far(solver=LinearSolver(0))
    assert predicted[0] == pytest.approx(each[0], rel=1e-8)
    assert by_default[0] == pytest.approx(each[0], rel=1e-8)
    assert by_default[1] <= 1.2 * each[1]
    assert by_default[2] < 0.6 * each[2]


def test_a_reduced_plate_vibrates_as_kirchhoffs():
    """A clamped square: lowest frequency 35.985 sqrt(D / (rho t)) / a^2 (Leissa 1973)."""
    t, E, nu, rho = 5e-3, 7e10, 0.3, 2700.0
    mesh = meshes.wall(meshes.sheet(1.0, 1.0, divisions=(16, 16), comm=MPI.COMM_SELF), t)
    model = ContinuumModel(mesh, solid_shell, solid_shell.Parameters(E=E, nu=nu, rho=rho), degree=1)
    K, M = gather(model.K).tocsc(), gather(model.M).tocsc()
    free = np.ones(K.shape[0], dtype=bool)
    x = model.layout.node_x
    rim = (abs(x[:, 0] * (x[:, 0] - 1)) < 1e-9) | (abs(abs(x[:, 1]) - 0.5) < 1e-9)
    free[model.layout.displacement_dofs[rim].ravel()] = False
    K, M = K[free][:, free], M[free][:, free]
    lowest = scipy.sparse.linalg.eigsh(K, 1, M, sigma=0.0, return_eigenvectors=False)[0]
    exact = 35.985 * np.sqrt(E * t**2 / 12 / (1 - nu**2) / rho)
    assert np.sqrt(lowest) == pytest.approx(exact, rel=0.01)


def test_stress_is_told_at_the_faces_of_a_wall_that_bends():
    """Of a strip under its weight: 6 M / t^2, M = q (l - x)^2 / 2; at the points of the rule it is 0.58 of that."""
    length, t, weight = 0.2, 1e-3, 2700.0 * 9.81  # m, m, N/m^3
    part = Wall((40, 2), lambda i, j: (length * i, 0.02 * j, 0.0), t, E=7e10, nu=0.0)
    part.hold(part.on(0, 0.0), [0, 1, 2])
    pulled(part, part.weight((0.0, 0.0, -weight)), steps=1)
    shown = NodalFields(part.body)
    fields, _, _ = shown.evaluate(np.eye(3))
    x, _, z = shown.nodes.x.T
    exact = np.sign(z) * 3.0 * weight * (length - x) ** 2 / t
    inside = (x > 0.01) & (x < 0.15)
    assert fields["stress"][inside, 0] == pytest.approx(exact[inside], rel=0.01)


def test_a_wall_that_is_turned_far_has_the_stress_of_its_bending():
    """A cantilever rolled by 0.9 rad: E times curvature times half the thickness, along its turned axis."""
    length, t, E = 10.0, 0.1, 1.2e6
    part = Wall((20, 1), lambda i, j: (length * i, j, 0.0), t, E=E, nu=0.0)
    angle = 0.9
    bent = part.x.copy()
    radius, s, z = length / angle, part.x[:, 0], part.x[:, 2]
    bent[:, 0], bent[:, 2] = (radius - z) * np.sin(s / radius), radius - (radius - z) * np.cos(s / radius)
    part.hold(np.arange(len(part.x)), [0, 1, 2])
    follow(part.body, [1.0], prescribed=part.held, displacement=lambda f: f * (bent - part.x).ravel())
    shown = NodalFields(part.body)
    fields, _, _ = shown.evaluate(np.eye(3))
    x, _, across = shown.nodes.x.T
    along = np.stack([np.cos(x / radius), np.sin(x / radius)])  # of x and z
    xx, zz, xz = (fields["stress"][:, k] for k in (0, 2, 4))
    axial = along[0] ** 2 * xx + along[1] ** 2 * zz + 2 * along[0] * along[1] * xz
    inside = (x > 0.1) & (x < 9.9)
    assert axial[inside] == pytest.approx(-E * across[inside] / radius, rel=0.02)


def test_a_tube_of_thin_wall_widens_by_a_pressure_that_follows():
    """By p R^2 / (E t) while it is small, and by p of the present radius where it is not."""
    radius, t, E, pressure = 1.0, 0.01, 1e6, 1000.0

    def place(i, j):
        return radius * np.sin(np.pi / 2 * i), 0.2 * j, radius * np.cos(np.pi / 2 * i)

    part = Wall((12, 1), place, t, E=E, nu=0.0, normals=radial)
    for axis in range(3):
        part.hold(part.on(axis, 0.0), [axis])
    follow(part.body, [1.0], prescribed=part.held, loads=[PressureOnFacets("bottom", pressure)])
    u = part.body.displacement[part.dofs]
    grown = 1 + np.hypot(*(part.x + u)[:, ::2].T).mean() - np.hypot(*part.x[:, ::2].T).mean()
    # E t (s^2 - 1) / 2 s = p R s of the stretch s, as the second Piola-Kirchhoff stress is that of its Green strain
    assert E * t / radius * (grown**2 - 1) / 2 == pytest.approx(pressure, rel=0.02)


def test_a_mesh_whose_third_edges_are_no_thickness_is_told():
    steel = solid_shell.Parameters(E=2.1e11, nu=0.3, rho=7850.0)
    block = meshes.block(1.0, 1.0, 0.005, divisions=(4, 4, 1), comm=MPI.COMM_SELF)
    with pytest.warns(LockingWarning, match="16 of 16 cells"):
        ContinuumModel(block, solid_shell, steel, degree=1)
    sheet = meshes.sheet(1.0, 1.0, divisions=(4, 4), comm=MPI.COMM_SELF)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        ContinuumModel(meshes.wall(sheet, 0.005), solid_shell, steel, degree=1)
