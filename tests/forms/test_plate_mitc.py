"""The flat shell against plate theory: thin and thick, straight and distorted meshes, vibration and buckling."""

from mpi4py import MPI

import numpy as np
import pytest
import scipy.sparse.linalg
from dof_keys import keys
from full_model import gather
from scipy.spatial.transform import Rotation

from flexmbd import meshes
from flexmbd.continuum import ContinuumModel
from flexmbd.forms import plate_mitc as plate

CELLS = ("triangle", "quadrilateral")
# Deflections of thin square plates in the middle, by q a^4 / D (Timoshenko & Woinowsky-Krieger 1959).
CLAMPED, SUPPORTED = 0.00126532, 0.00406235


def steel(t):
    return plate.Parameters(E=2.1e11, nu=0.3, rho=7800.0, t=t)


def bending_stiffness(p):
    return p.E * p.t**3 / 12 / (1 - p.nu**2)


def square(cell, n, p, *, distorted=False, turned=None):
    """A plate of 1 m by 1 m; its matrices, and where each dof lies and which it is."""
    mesh = meshes.sheet(1.0, 1.0, divisions=(n, n), cell=cell, comm=MPI.COMM_SELF)
    x = mesh.mesh.geometry.x
    if distorted:
        # neither the boundary nor the middle moves
        bump = 0.24 / n * np.sin(2 * np.pi * x[:, 0]) * np.cos(np.pi * x[:, 1])
        along = np.stack([np.sin(13 * x[:, 0] * x[:, 1] + 3 * x[:, 1]), np.cos(11 * x[:, 1] + 5 * x[:, 0])])
        x[:, :2] += (bump * along).T
    if turned is not None:
        x[:] = turned.apply(x)
    body = ContinuumModel(mesh, plate, p, degree=1)
    return gather(body.K).tocsc(), gather(body.M).tocsc(), keys(body)[:, 1:4], keys(body)[:, 4].astype(int)


def on_edge(x):
    return (abs(x[:, 0] * (x[:, 0] - 1)) < 1e-9) | (abs(abs(x[:, 1]) - 0.5) < 1e-9)


def held(matrix, fixed):
    free = np.flatnonzero(~fixed)
    return matrix[free][:, free]


def lowest(k, m, count):
    found = scipy.sparse.linalg.eigsh(k, count, m, sigma=0.0, return_eigenvectors=False)
    return np.sort(found)


def deflections(cell, n, t, *, distorted=False):
    """In the middle under a uniform load, edges clamped and simply supported, as parts of the thin plate's."""
    p = steel(t)
    k, m, x, c = square(cell, n, p, distorted=distorted)
    load = m @ (c == 2) / (p.rho * t)
    middle = np.flatnonzero((abs(x - (0.5, 0, 0)).max(axis=1) < 1e-9) & (c == 2)).item()
    found = []
    for fixed, thin in ((on_edge(x), CLAMPED), (on_edge(x) & (c < 3), SUPPORTED)):
        u = np.zeros(len(c))
        u[~fixed] = scipy.sparse.linalg.spsolve(held(k, fixed), load[~fixed])
        found.append(u[middle] * bending_stiffness(p) / thin)
    return np.array(found)


@pytest.mark.parametrize("distorted", [False, True], ids=["regular", "distorted"])
@pytest.mark.parametrize("cell", CELLS)
def test_no_locking_down_to_a_hundred_thousandth(cell, distorted):
    """With 16 cells an edge within 2 % of Kirchhoff's plate, and no thinness makes it worse."""
    thin, thinner = (deflections(cell, 16, t, distorted=distorted) for t in (1e-3, 1e-5))
    assert thin == pytest.approx(1.0, abs=0.02)
    assert thinner == pytest.approx(thin, rel=2e-4)


@pytest.mark.parametrize("cell", CELLS)
def test_deflections_converge_with_order_two(cell):
    errors = np.array([deflections(cell, n, 1e-3) - 1.0 for n in (8, 16, 32)])
    ratios = errors[:-1] / errors[1:]
    # triangles cut corners; the soft support of thin plates has a layer of the thickness
    assert (ratios[:, 0] > 3.2).all()
    assert abs(errors[2]).max() < 6e-3


def test_a_thick_clamped_plate_shears():
    """0.001505 q a^4 / D where the thickness is a tenth (Liew, Han & Xiao, by Mindlin's theory)."""
    assert deflections("quadrilateral", 32, 0.1)[0] * CLAMPED == pytest.approx(0.001505, rel=2e-3)


@pytest.mark.parametrize("cell", CELLS)
def test_constant_strains_on_a_distorted_mesh_are_exact(cell):
    """Stretching, and constant curvature with its parabolic deflection: found inside from the edges."""
    k, _, x, c = square(cell, 4, steel(0.02), distorted=True)
    a, b, d = 1e-2, -2e-2, 3e-2
    w = a * x[:, 0] ** 2 / 2 + b * x[:, 0] * x[:, 1] + d * x[:, 1] ** 2 / 2
    slope = a * x[:, 0] + b * x[:, 1], b * x[:, 0] + d * x[:, 1]
    exact = np.select(
        [c == i for i in range(6)],
        [1e-3 * x[:, 0] + 2e-3 * x[:, 1], -2e-3 * x[:, 1], w, slope[1], -slope[0], -1e-3],
    )
    fixed = on_edge(x)
    free = ~fixed
    found = scipy.sparse.linalg.spsolve(held(k, fixed), -(k @ np.where(fixed, exact, 0.0))[free])
    assert abs(found - exact[free]).max() < 1e-11


def supported(cell, n):
    """Squares of the lowest angular frequencies of bending, by pi^4 D / (rho t)."""
    p = steel(0.002)
    k, m, x, c = square(cell, n, p)
    # Navier's support: the edge does not turn along itself
    across = abs(x[:, 0] * (x[:, 0] - 1)) < 1e-9
    along = abs(abs(x[:, 1]) - 0.5) < 1e-9
    fixed = (on_edge(x) & (c < 3)) | (across & (c == 3)) | (along & (c == 4))
    return lowest(held(k, fixed), held(m, fixed), 6) * p.rho * p.t / bending_stiffness(p) / np.pi**4


@pytest.mark.parametrize("cell", CELLS)
def test_navier_frequencies(cell):
    """omega = pi^2 (m^2 + n^2) sqrt(D / (rho t)), with order two."""
    exact = np.array([2, 5, 5, 8, 10, 10]) ** 2
    errors = np.array([np.sqrt(supported(cell, n) / exact) - 1 for n in (16, 32)])
    assert abs(errors[1]).max() < 0.015
    assert abs(errors[1]).max() < abs(errors[0]).max() / 3.5


def test_cantilever_plate():
    """One edge clamped: Hz, by the Ritz method, whose values are high by up to 0.7 %."""
    k, m, x, _ = square("quadrilateral", 24, steel(0.01))
    fixed = abs(x[:, 0]) < 1e-9
    found = np.sqrt(lowest(held(k, fixed), held(m, fixed), 6)) / (2 * np.pi)
    assert found == pytest.approx([8.7266, 21.3042, 53.5542, 68.2984, 77.7448, 136.0471], rel=0.011)
    # the same by series of higher order (Leissa's k with more terms)
    assert found[:2] == pytest.approx(np.array([3.471, 8.507]) * 8.7266 / 3.492, rel=3e-3)


def test_nothing_depends_on_where_the_plate_looks():
    turned = Rotation.from_rotvec((0.4, -1.1, 0.7))
    p = steel(0.01)
    found = []
    for how in (None, turned):
        k, m, x, _ = square("triangle", 6, p, turned=how)
        fixed = on_edge(x if how is None else how.inv().apply(x))
        found.append(lowest(held(k, fixed), held(m, fixed), 6))
    assert found[1] == pytest.approx(found[0], rel=1e-8)


def test_buckling_under_compression():
    """Simply supported, pressed along x: N = 4 pi^2 D / b^2, from the geometric stiffness at a state."""
    p = steel(0.002)
    mesh = meshes.sheet(1.0, 1.0, divisions=(24, 24), comm=MPI.COMM_SELF)
    body = ContinuumModel(mesh, plate, p, degree=1)
    x, c = keys(body)[:, 1:4], keys(body)[:, 4].astype(int)
    strain = 1e-6
    u = strain * np.select([c == 0, c == 1], [-x[:, 0], p.nu * x[:, 1]], 0.0)
    tangent = body.tangent(u)
    k, geometric = gather(body.K).tocsc(), (gather(tangent) - gather(body.K)).tocsc()
    tangent.destroy()
    bending = np.flatnonzero((c == 3) | (c == 4) | ((c == 2) & ~on_edge(x)))
    k, geometric = (matrix[bending][:, bending] for matrix in (k, geometric))
    load = 1 / scipy.sparse.linalg.eigsh(-geometric, 1, k, which="LA", return_eigenvectors=False)[0]
    exact = 4 * np.pi**2 * bending_stiffness(p)
    assert load * p.E * strain * p.t == pytest.approx(exact, rel=0.01)
