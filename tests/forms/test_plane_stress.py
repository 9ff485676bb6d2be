"""Plane elements as bodies in space: closed forms in their plane, a solid as thick, and a planar machine."""

from mpi4py import MPI

import numpy as np
import pytest

import flexmbd as fm
from flexmbd import meshes
from flexmbd.continuum import ContinuumModel, Interface
from flexmbd.forms import beam_timoshenko, plane_stress, solid_linear
from flexmbd.reduction import craig_bampton, guyan

SELF = MPI.COMM_SELF
E, NU, RHO, T = 7e10, 0.3, 2700.0, 0.004
LENGTH, HEIGHT = 0.5, 0.025
ENDS = [Interface("x_min"), Interface("x_max")]


def material(**more):
    return plane_stress.Parameters(E=E, nu=NU, rho=RHO, t=T, **more)


def strip(p, *, divisions=(20, 2), cell="quadrilateral", turned=None):
    mesh = meshes.sheet(LENGTH, HEIGHT, divisions=divisions, cell=cell, comm=SELF)
    if turned is not None:
        mesh.mesh.geometry.x[:] = mesh.mesh.geometry.x @ turned.T
    return ContinuumModel(mesh, plane_stress, p, degree=2, interfaces=ENDS)


def rectangle(width=HEIGHT):
    return beam_timoshenko.Parameters.rectangle(E, NU, RHO, width=width, height=T, orientation=(0.0, 1.0, 0.0))


def tip_flexibility(body):
    """(6, 6) of the frame at x_max, the other held."""
    rows = body.interface("x_max").modes
    return (rows / body.stiffness) @ rows.T


@pytest.mark.parametrize("cell", ["triangle", "quadrilateral"])
@pytest.mark.parametrize("plane_strain", [False, True])
def test_a_cantilever_in_its_plane_is_timoshenkos(cell, plane_strain):
    """L / E A, L^3 / 3 E I + L / k G A, L^2 / 2 E I, L / E I; in plane strain with E / (1 - nu^2). Rigid ends: 1 %."""
    section, modulus = rectangle(), E / (1 - NU**2) if plane_strain else E
    found = tip_flexibility(guyan(strip(material(plane_strain=plane_strain), cell=cell), frame="x_min"))
    bend, shear = modulus * section.Iz, section.ky * E / (2 * (1 + NU)) * section.A
    exact = np.array(
        [LENGTH / (modulus * section.A), LENGTH**3 / (3 * bend) + LENGTH / shear, LENGTH**2 / (2 * bend), LENGTH / bend]
    )
    np.testing.assert_allclose([found[0, 0], found[1, 1], found[1, 5], found[5, 5]], exact, rtol=0.01)
    # loads in the plane move nothing out of it, and the other way round
    size = np.sqrt(np.outer(np.diag(found), np.diag(found)))
    assert abs(found / size)[np.ix_([0, 1, 5], [2, 3, 4])].max() < 1e-9


def test_it_is_as_flexible_in_its_plane_as_a_solid_of_that_thickness():
    """Whose modes move through the thickness freely; a tenth as thick as it is high, to 1 %."""
    mesh = meshes.block(LENGTH, HEIGHT, HEIGHT / 10, divisions=(20, 4, 1), cell="hexahedron", comm=SELF)
    p = solid_linear.Parameters(E=E, nu=NU, rho=RHO)
    solid = guyan(ContinuumModel(mesh, solid_linear, p, degree=2, interfaces=ENDS), frame="x_min")
    thin = plane_stress.Parameters(E=E, nu=NU, rho=RHO, t=HEIGHT / 10)
    plane = guyan(strip(thin), frame="x_min")
    kept = np.ix_([0, 1, 5], [0, 1, 5])
    np.testing.assert_allclose(np.diag(tip_flexibility(plane)[kept]), np.diag(tip_flexibility(solid)[kept]), rtol=0.01)
    assert plane.mass == pytest.approx(solid.mass, rel=1e-12)
    np.testing.assert_allclose(np.diag(plane.inertia), np.diag(solid.inertia), rtol=1e-9)


def test_held_flat_its_modes_are_those_of_a_beam_in_the_plane():
    """Clamped at one end: Timoshenko's beam of many elements; and no mode leaves the plane, in any plane of space."""
    turned = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
    turned *= np.linalg.det(turned)
    flat = craig_bampton(strip(material(out_of_plane=1e6), turned=turned), modes=4, frame="x_min")
    line = meshes.line(LENGTH, divisions=40, comm=SELF)
    ends = [Interface("start"), Interface("end")]
    beam = ContinuumModel(line, beam_timoshenko, rectangle(), degree=2, interfaces=ends)
    bending = craig_bampton(beam, modes=20, frame="start").frequencies(clamped=["start"])
    section = rectangle()
    wave = np.sqrt(E * section.Iz / (RHO * section.A)) / (2 * np.pi * LENGTH**2)
    low = np.array([1.87510407, 4.69409113]) ** 2 * wave
    in_plane = [bending[np.argmin(abs(bending / one - 1))] for one in low]
    np.testing.assert_allclose(in_plane, low, rtol=0.02)  # Euler and Bernoulli's, without shear
    np.testing.assert_allclose(flat.frequencies(clamped=["x_min"])[:2], in_plane, rtol=5e-3)


def four_bar(record, *, ends):
    """Two cranks and a coupler that hangs in a square of them, in the plane z = 0 under gravity along -y."""
    scene = fm.System(gravity=(0.0, -9.81, 0.0))
    pin = fm.joint.Revolute("z")
    low = scene.ground.frame()
    crank = scene.add(fm.RigidBody(0.2, np.array([3e-4, 3e-4, 4e-4]), (0.0, 0.1, 0.0)), name="crank")
    coupler = scene.add(fm.FlexibleBody(record), name="coupler")
    rocker = scene.add(fm.RigidBody(0.3, np.array([5e-4, 5e-4, 8e-4]), (0.0, 0.15, 0.0)), name="rocker")
    drive = scene.connect(pin, low, crank.frame())
    scene.connect(pin, crank.frame(p=(0.0, 0.2, 0.0)), coupler.frame(ends[0]))
    scene.connect(pin, coupler.frame(ends[1]), rocker.frame(p=(0.0, 0.2, 0.0)))
    scene.connect(pin, scene.ground.frame(p=(LENGTH, 0.0, 0.0)), rocker.frame())
    drive.velocity = 20.0
    return scene, drive, coupler


def test_a_flexible_coupler_of_a_planar_four_bar():
    """A strip of plane elements against one of beam elements: angle of the crank, and how far the middle bends."""
    line = meshes.line(LENGTH, divisions=20, comm=SELF)
    ends = [Interface("start"), Interface("end")]
    beam = ContinuumModel(line, beam_timoshenko, rectangle(), degree=2, interfaces=ends)
    records = [
        (craig_bampton(strip(material(out_of_plane=1e6)), modes=3, frame="x_min"), ("x_min", "x_max")),
        (craig_bampton(beam, modes=8, frame="start"), ("start", "end")),
    ]
    angles, bends = [], []
    t = np.linspace(0.0, 0.15, 31)
    for record, names in records:
        scene, drive, coupler = four_bar(record, ends=names)
        run = scene.simulate(t[-1], rtol=1e-6, integrator=fm.RadauIIA())
        total = run.energy().total
        assert np.ptp(total) < 1e-4 * np.ptp(run.energy().kinetic)
        angles.append(run.beta(drive, t=t))
        far = run.position(coupler.frame(names[1]), t=t)
        assert abs(far[:, 2]).max() < 1e-9
        near, other = (run.rotation(coupler.frame(name), t=t) for name in names)
        turn = near.transpose(0, 2, 1) @ other
        bends.append(np.arctan2(turn[:, 1, 0], turn[:, 0, 0]))
    assert np.ptp(angles[1]) > 1.0
    assert abs(angles[0] - angles[1]).max() < 2e-3
    assert abs(bends[1]).max() > 1e-4
    assert abs(bends[0] - bends[1]).max() < 0.05 * abs(bends[1]).max()


@pytest.mark.parametrize("plane_strain", [False, True])
def test_stress_of_a_stretch(plane_strain):
    """E e or E e / (1 - nu^2) along, nothing or nu times that across; along the normal nu times their sum."""
    import ufl
    from dolfinx import fem

    model = strip(material(plane_strain=plane_strain), divisions=(2, 1))
    u = fem.Function(model.space)
    u.x.array[model.displacement_dofs[:, 0]] = 1e-3 * model.node_x[:, 0]
    found = plane_stress.stress(u, None, model.groups[0].parameters)
    area = LENGTH * HEIGHT
    values = np.array(
        [[fem.assemble_scalar(fem.form(found[i, j] * ufl.dx)) / area for j in range(3)] for i in range(3)]
    )
    strain = 1e-3 + 1e-6 / 2  # Green and Lagrange's
    along = strain * E / ((1 + NU) * (1 - 2 * NU)) * (1 - NU) if plane_strain else strain * E / (1 - NU**2)
    across = along * NU / (1 - NU) if plane_strain else NU * along
    expected = np.diag([along, across, NU * (along + across) if plane_strain else 0.0])
    np.testing.assert_allclose(values, expected, atol=1e-9 * along)


def test_bad_values():
    with pytest.raises(ValueError, match="out_of_plane must be positive and finite, got 0"):
        material(out_of_plane=0.0)
    with pytest.raises(ValueError, match="plane_strain must be True or False, got 1"):
        material(plane_strain=1)
