"""Stress from modal coordinates: closed forms, axes, and the same on every partition."""


from mpi4py import MPI

import numpy as np
import pytest
from dolfinx import fem

import flexmbd as fm
from flexmbd import meshes
from flexmbd.continuum import ContinuumModel, Interface, compat
from flexmbd.continuum.finite_elements.recovery import nodal_modes
from flexmbd.continuum.finite_elements.stress import StressRecovery
from flexmbd.errors import RecordError
from flexmbd.forms import solid_linear
from flexmbd.reduction import Keep, craig_bampton

# no lateral contraction: what the rigid ends would hinder
MATERIAL = solid_linear.Parameters(E=3.0e9, nu=0.0, rho=1200.0)
SIZE = (0.6, 0.1, 0.2)
AREA = SIZE[1] * SIZE[2]


def bar(*, comm=MPI.COMM_WORLD, size=SIZE, divisions=(6, 1, 2), degree=2, cell="tetrahedron", axes=None):
    mesh = meshes.block(*size, divisions=divisions, cell=cell, degree=min(degree, 2), comm=comm)
    interfaces = [Interface("x_min", axes=axes), Interface("x_max")]
    model = ContinuumModel(mesh, solid_linear, MATERIAL, degree=degree, interfaces=interfaces)
    return model, craig_bampton(model, modes=2, frame="x_min", keep=Keep(modes=True))


def at_rest(body, wrench):
    """Modal coordinates under a static wrench (6,) on the free end, in body axes."""
    return body.interface("x_max").modes.T @ np.asarray(wrench) / body.stiffness


@pytest.mark.mpi
@pytest.mark.parametrize("cell", ["tetrahedron", "hexahedron"])
@pytest.mark.parametrize("degree", [1, 2])
def test_tension(cell, degree):
    model, body = bar(cell=cell, degree=degree)
    force = 5e4
    picture = model.stress_field(body, at_rest(body, (force, 0, 0, 0, 0, 0)))
    exact = np.diag([force / AREA, 0.0, 0.0])
    np.testing.assert_allclose(picture.stress, [exact] * len(picture.x), atol=1e-8 * force / AREA)
    np.testing.assert_allclose(picture.von_mises, force / AREA, rtol=1e-8)
    assert picture.max == pytest.approx(force / AREA, rel=1e-8)
    stretch = force / AREA / MATERIAL.E * picture.x[:, 0]
    np.testing.assert_allclose(picture.displacement[:, 0], stretch, atol=1e-8 * stretch.max())
    assert model.mesh.mesh.geometry.index_map().size_global == len(picture.node)


@pytest.mark.mpi
def test_pictures_are_in_body_axes():
    """The body frame's z axis along the bar, and its origin in the middle of the end."""
    model, body = bar(axes=[[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    force = 5e4
    picture = model.stress_field(body, at_rest(body, (0, 0, force, 0, 0, 0)))
    exact = np.diag([0.0, 0.0, force / AREA])
    np.testing.assert_allclose(picture.stress, [exact] * len(picture.x), atol=1e-8 * force / AREA)
    np.testing.assert_allclose(picture.x.min(axis=0), (-SIZE[1] / 2, -SIZE[2] / 2, 0.0), atol=1e-12)
    np.testing.assert_allclose(picture.x.max(axis=0), (SIZE[1] / 2, SIZE[2] / 2, SIZE[0]), atol=1e-12)
    assert picture.displacement[:, 2].max() == pytest.approx(force * SIZE[0] / AREA / MATERIAL.E, rel=1e-8)


@pytest.mark.mpi
def test_bending():
    """A slender cantilever: sigma = -F (l - x) y / I in the middle."""
    length, side, force = 1.0, 0.05, 100.0
    model, body = bar(size=(length, side, side), divisions=(24, 2, 2))
    picture = model.stress_field(body, at_rest(body, (0, force, 0, 0, 0, 0)))
    x, y, _ = picture.x.T
    middle = np.abs(x - length / 2) < 0.1
    expected = -force * (length - x) * y / (side**4 / 12)
    largest = force * length / 2 * side / 2 / (side**4 / 12)
    np.testing.assert_allclose(picture.stress[middle, 0, 0], expected[middle], atol=0.02 * largest)
    # the largest is where the moment is, at the clamped edge
    assert picture.max > 2.0 * largest
    assert picture.max_x[0] < 0.1
    assert abs(picture.max_x[1]) == pytest.approx(side / 2)


def test_rigid_motion_has_no_stress():
    model, _ = bar()
    motions = model.rigid_motions((0.1, 0.2, 0.3), np.eye(3))
    assert (np.abs(motions).max(axis=0) > 0.1).all()
    recovery = StressRecovery(model)
    for motion in motions.T:
        assert np.abs(recovery.nodal(motion)).max() < 1e-12 * MATERIAL.E


@pytest.mark.mpi
@pytest.mark.parametrize("degree", [1, 2])
def test_largest_value_is_that_of_the_discontinuous_field(degree):
    """Stress of a displacement of degree n, interpolated exactly by discontinuous elements of degree n - 1."""
    model, body = bar(degree=degree)
    q = at_rest(body, (0, 1e3, 0, 0, 0, 300))
    picture = model.stress_field(body, q)
    u = fem.Function(model.space)
    u.x.array[:] = nodal_modes(body, model) @ q
    space = fem.functionspace(model.mesh.mesh, ("DG", degree - 1, (3, 3)))
    field = fem.Function(space)
    points = compat.interpolation_points(space)
    field.interpolate(fem.Expression(solid_linear.stress(u, None, MATERIAL), points))
    sigma = field.x.array.reshape(-1, 3, 3)
    deviator = sigma - np.trace(sigma, axis1=1, axis2=2)[:, None, None] / 3 * np.eye(3)
    largest = model.comm.allreduce(np.sqrt(1.5 * (deviator**2).sum(axis=(1, 2))).max(), op=MPI.MAX)
    assert picture.max == pytest.approx(largest, rel=1e-9)
    # averages over the cells at a node lie below
    assert picture.von_mises.max() < picture.max * (1.0 + 1e-12)


@pytest.mark.mpi
@pytest.mark.parametrize("degree", [1, 2])
def test_partition_does_not_matter(degree):
    pictures = []
    for comm in (MPI.COMM_SELF, MPI.COMM_WORLD):
        model, body = bar(comm=comm, degree=degree)
        pictures.append(model.stress_field(body, at_rest(body, (3e4, 1e4, -2e4, 100, 200, 300))))
    alone, together = pictures
    np.testing.assert_array_equal(together.node, alone.node)
    np.testing.assert_array_equal(together.triangle, alone.triangle)
    np.testing.assert_allclose(together.x, alone.x, atol=1e-12)
    np.testing.assert_allclose(together.stress, alone.stress, atol=1e-9 * alone.max)
    np.testing.assert_allclose(together.von_mises, alone.von_mises, atol=1e-9 * alone.max)
    np.testing.assert_allclose(together.displacement, alone.displacement, atol=1e-9)
    assert together.max == pytest.approx(alone.max, rel=1e-9)
    np.testing.assert_allclose(together.max_x, alone.max_x, atol=1e-12)
    for name in ("x", "triangle", "stress", "displacement", "von_mises"):
        np.testing.assert_array_equal(getattr(together, name), MPI.COMM_WORLD.bcast(getattr(together, name)))


@pytest.mark.mpi
def test_surface_is_closed_and_looks_outwards():
    model, body = bar()
    picture = model.stress_field(body, np.zeros(body.n_modes))
    a, b, c = (picture.x[picture.triangle[:, i]] for i in range(3))
    assert np.einsum("ti,ti->", a, np.cross(b, c)) / 6.0 == pytest.approx(np.prod(SIZE))
    assert np.abs(np.cross(b - a, c - a).sum(axis=0)).max() < 1e-15
    assert picture.max == 0.0


@pytest.mark.mpi
def test_trajectory_asks_the_model():
    model, body = bar()
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    flexible = scene.add(fm.FlexibleBody(body), name="bar")
    scene.connect(fm.joint.Fixed(), scene.ground.frame(), flexible.frame("x_min"))
    run = scene.simulate(2e-3, rtol=1e-4)
    picture = run.stress(flexible, model, t=1.5e-3)
    same = model.stress_field(body, run.q(flexible, t=1.5e-3))
    assert picture.max == same.max > 0.0
    np.testing.assert_array_equal(picture.stress, same.stress)


@pytest.mark.mpi
def test_bad_coordinates_are_refused():
    model, body = bar()
    with pytest.raises(RecordError, match=rf"\({body.n_modes},\), got \(3,\)"):
        model.stress_field(body, np.zeros(3))
