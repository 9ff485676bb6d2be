"""Bodies that are pressed at their contact patches: the unreduced body, Hertz, a bar that bounces."""

import functools

from mpi4py import MPI

import numpy as np
import pytest
import scipy.optimize
import scipy.sparse.linalg
from bracket import turned
from full_model import FullModel
from patch_loads import loads_of

from flexmbd import contact, meshes
from flexmbd.continuum import ContinuumModel, Interface, SymmetryPlane
from flexmbd.continuum.compat import cell_nodes
from flexmbd.continuum.grid.node_order import NodeOrder, node_permutation
from flexmbd.continuum.grid.tagged_mesh import from_arrays
from flexmbd.errors import RecordError
from flexmbd.forms import solid_linear
from flexmbd.reduction import Patch, craig_bampton, guyan

STEEL = solid_linear.Parameters(E=2.1e11, nu=0.3, rho=7850.0)


@functools.cache
def block():
    mesh = meshes.block(0.04, 0.04, 0.02, divisions=(8, 8, 4), comm=MPI.COMM_SELF)
    return ContinuumModel(mesh, solid_linear, STEEL, degree=2, interfaces=[FOOT])


FOOT = Interface("z_min", axes=turned(0.2, -0.4, 0.1))
PAD = Patch("pad", size=0.01, facets="z_max")


@functools.cache
def pressed_block(modes):
    return craig_bampton(block(), modes=modes, frame="z_min", contact=[PAD])


@functools.cache
def unreduced_flexibility():
    """(3 p, 3 p) m/N of the patches on the full model."""
    full = FullModel(block())
    free = np.repeat(full.x[:, 2] > -0.0099, 3)
    loads = loads_of(pressed_block(0), full)[free]
    return loads.T @ scipy.sparse.linalg.spsolve(full.K[free][:, free].tocsc(), loads)


@pytest.mark.parametrize("modes", [0, 2, 20])
def test_a_pressed_block_is_the_unreduced_one(modes):
    """Forces by least squares without negative ones, of a flexibility that knows nothing of modes; in any direction."""
    body = pressed_block(modes)
    rng, count = np.random.default_rng(5), len(body.contact.area)
    drawn = [body.R_MB.T @ [0, 0, -3.0], rng.normal(size=3), rng.normal(size=(count, 3)), rng.normal(size=3)]
    for pushes in drawn:
        outward = np.sign(np.einsum("pb,pb->p", body.contact.axes[:, :, 0], np.broadcast_to(pushes, (count, 3))))
        normals = -outward[:, None] * pushes  # an obstacle pushes against the surface
        gap = rng.normal(size=count) * 1e-5
        units = np.broadcast_to(normals / np.linalg.norm(normals, axis=-1, keepdims=True), (count, 3))
        across = np.zeros((3 * count, count))
        for i, (axes, unit) in enumerate(zip(body.contact.axes, units, strict=True)):
            across[3 * i : 3 * i + 3, i] = axes.T @ unit
        A = across.T @ unreduced_flexibility() @ across
        root = np.linalg.cholesky(A)
        force = scipy.optimize.nnls(root.T, -np.linalg.solve(root, gap))[0]
        assert 0 < np.count_nonzero(force) < count
        found = contact.press(body, gap=gap, normal=normals)
        np.testing.assert_allclose(found.force, force, atol=1e-8 * force.max())
        np.testing.assert_allclose(found.gap, A @ force + gap, atol=1e-8 * abs(gap).max())
        np.testing.assert_allclose(found.pressure, found.force / body.contact.area)
        assert not (found.force * found.gap).any()


def test_a_plane_that_does_not_touch():
    body = pressed_block(2)
    found = contact.press(body, gap=np.full(len(body.contact.area), 1e-6), normal=(0, 0, 1))
    assert not found.force.any()
    assert not found.q.any()
    np.testing.assert_array_equal(found.gap, 1e-6)


@functools.cache
def quarter_of_a_block(size):
    """A quarter of a block of 2 x 2 x 1, fine where it is touched, with patches of a size there."""
    fine = np.linspace(0.0, 0.25, 9)
    side = np.concatenate([fine, 0.25 * 4.0 ** (np.arange(1, 5) / 4)])
    depth = -np.concatenate([[0.0], np.cumsum(np.geomspace(1.0, 7.0, 8))])
    depth /= -depth[-1]
    grid = meshes.block(1.0, 1.0, 1.0, divisions=(12, 12, 8), comm=MPI.COMM_SELF).mesh
    back = np.argsort(node_permutation("hexahedron", 1, NodeOrder.VTK))
    places = np.rint((grid.geometry.x + np.array([0, 0.5, 0.5])) * (12, 12, 8)).astype(int)
    x = np.column_stack([side[places[:, 0]], side[places[:, 1]], depth[8 - places[:, 2]]])
    groups = {
        "foot": lambda x: x[2] < -1 + 1e-9,
        "across_x": lambda x: x[0] < 1e-9,
        "across_y": lambda x: x[1] < 1e-9,
    }
    mesh = from_arrays(
        MPI.COMM_SELF, x, cell_nodes(grid)[:, back], cell="hexahedron", degree=1, order=NodeOrder.VTK,
        facet_groups=groups,
    )  # fmt: skip
    planes = [SymmetryPlane("across_x", (1, 0, 0)), SymmetryPlane("across_y", (0, 1, 0))]
    steel = solid_linear.Parameters(E=1.0e7, nu=0.3, rho=1000.0)
    model = ContinuumModel(
        mesh, solid_linear, steel, degree=2, interfaces=[Interface("foot", origin=(0, 0, -1))], supports=planes
    )
    spot = Patch("spot", size=size, facets=lambda x: (x[2] > -1e-9) & (x[0] < 0.26) & (x[1] < 0.26))
    return guyan(model, frame="foot", contact=[spot], geometric_stiffness=False)


RADIUS, MODULUS = 1.0, 1.0e7 / (1 - 0.3**2)


def ball(body, approach):
    """Four times the force, N, and the pressures of a rigid ball that is pressed in by so much, m."""
    x = body.contact.x
    gap = (x[:, 0] ** 2 + x[:, 1] ** 2) / (2 * RADIUS) - approach
    found = contact.press(body, gap=gap, normal=(0, 0, -1))
    return 4 * found.force.sum(), found.pressure.max()


def approach_of(body, force):
    return scipy.optimize.brentq(lambda d: ball(body, d)[0] - force, 1e-4, 0.2, xtol=1e-12)


def test_a_ball_on_a_block_is_that_of_hertz():
    """What is far off gives in proportion, and drops out of two loads; patches twice as large change two per cent."""
    radii = 0.12, 0.24  # of the contact
    forces = [4 * MODULUS * a**3 / (3 * RADIUS) for a in radii]
    fine, coarse = quarter_of_a_block(0.03125), quarter_of_a_block(0.0625)
    assert len(fine.contact.area) == 4 * len(coarse.contact.area) == 64
    low, high = (approach_of(fine, force) for force in forces)
    # with the far part c: low = dent + c P, high = 4 dent + 8 c P
    assert (8 * low - high) / 4 == pytest.approx(radii[0] ** 2 / RADIUS, rel=0.02)
    peak = ball(fine, high)[1]
    assert peak == pytest.approx(2 * MODULUS * radii[1] / (np.pi * RADIUS), rel=0.01)
    other = approach_of(coarse, forces[1])
    assert other == pytest.approx(high, rel=0.01)
    assert ball(coarse, other)[1] == pytest.approx(peak, rel=0.02)


def bar(modes):
    """Of 10 m, E = 900 Pa, rho = 1 kg/m^3, section 1 m^2, that strains along itself alone; it flies."""
    mesh = meshes.block(10.0, 1.0, 1.0, divisions=(40, 1, 1), comm=MPI.COMM_SELF)
    model = ContinuumModel(mesh, solid_linear, solid_linear.Parameters(E=900.0, nu=0.0, rho=1.0), degree=2)
    end = Patch("end", size=1.0, facets="x_min")
    return craig_bampton(model, modes=modes, geometric_stiffness=False, contact=[end])


def axial(body):
    """Frequencies, rad/s, and displacements of the end outwards, per unit of the axial modes."""
    phi = body.contact.phi[0, 0]
    along = abs(phi) > 1e-6 * abs(phi).max()
    return np.sqrt(body.stiffness[along]), phi[along]


@pytest.mark.parametrize("modes", [21, 60])
def test_residual_flexibility_of_a_bar_in_closed_form(modes):
    """2 L / (pi^2 E A) times the sum of 1 / n^2 over the axial modes that are left out."""
    body = bar(modes)
    omega, phi = axial(body)
    n = np.arange(1, len(omega) + 1)
    np.testing.assert_allclose(omega, np.pi * n * 30.0 / 10.0, rtol=2e-4)
    left_out = np.pi**2 / 6 - (1.0 / n**2).sum()
    assert body.contact.G[0, 0] == pytest.approx(2 * 10.0 / (np.pi**2 * 900.0) * left_out, rel=2e-3)
    assert body.contact.G[0, 0] + (phi**2 / omega**2).sum() == pytest.approx(10.0 / (3 * 900.0), rel=1e-9)


def test_a_bar_bounces():
    """Doyen, Ern & Piperno 2011: dropped by 5 m it meets a wall from 1 s to 5/3 s, with the impulse 800/3 N s."""
    body = bar(60)
    omega, outwards = axial(body)
    wave = np.append(omega, 0.0)
    towards = np.append(-outwards, 1.0 / np.sqrt(10.0))  # away from the wall; the last: it moves as a whole
    pull = np.append(np.zeros(len(omega)), 10.0 * np.sqrt(10.0))
    compliance = body.contact.G[0, 0]
    dt = 0.3 * 2.0 / omega.max()
    q, v = np.append(np.zeros(len(omega)), 5.0 * np.sqrt(10.0)), np.zeros(len(wave))
    steps = []
    v -= dt / 2 * pull
    for step in range(1, int(2.6 / dt)):
        q = q + dt * v
        # 0 <= gap + G f, 0 <= f, one of them zero
        force = max(0.0, -(towards @ q) / compliance)
        v = v + dt * (towards * force - wave**2 * q - pull)
        steps.append((step * dt, force))
    times, forces = np.array(steps).T
    met = times[forces > 0.0]
    assert met[0] == pytest.approx(1.0, abs=0.01)
    assert met[met < 2.0][-1] == pytest.approx(5.0 / 3.0, abs=0.02)
    assert forces.sum() * dt == pytest.approx(800.0 / 3.0, rel=0.01)
    energy = 0.5 * v @ v + 0.5 * (wave**2 * q) @ q + pull @ q
    assert energy == pytest.approx(10.0 * 10.0 * 5.0, rel=0.01)


def test_what_cannot_be_pressed():
    body = pressed_block(2)
    flat = np.zeros(len(body.contact.area))
    with pytest.raises(RecordError, match=r"no contact patches; reduce the part again with .* which no record holds"):
        contact.press(guyan(block(), frame="z_min"), gap=[0.0], normal=(0, 0, 1))
    with pytest.raises(RecordError, match="floats on the mean axis"):
        contact.press(guyan(block(), contact=[PAD]), gap=flat, normal=(0, 0, 1))
    with pytest.raises(RecordError, match=r"gap must be \(16,\) finite numbers"):
        contact.press(body, gap=[0.0], normal=(0, 0, 1))
    with pytest.raises(RecordError, match=r"normal must be \(3,\) or \(16, 3\)"):
        contact.press(body, gap=flat, normal=(0, 0, 0))
    for normal in (body.contact.axes[0, :, 0], body.contact.axes[0, :, 1]):
        with pytest.raises(RecordError, match=r"would pull patch \d+, .* against the patch's outward normal"):
            contact.press(body, gap=flat - 1e-6, normal=normal)
    with pytest.raises(RecordError, match="body must be a ReducedBody"):
        contact.press("rod", gap=flat, normal=(0, 0, 1))
