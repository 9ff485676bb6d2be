"""Frames of beams from a mesh of lines: joints, kinks, sections by group, rings, viscous damping, a spun bar."""

import dataclasses

from mpi4py import MPI

import numpy as np
import pytest
from scipy.interpolate import PPoly
from stiffness_method import assembled, local_stiffness

import flexmbd as fm
from flexmbd import meshes
from flexmbd.continuum import ContinuumModel, Interface
from flexmbd.errors import FormulationError, MeshError
from flexmbd.forms import beam_timoshenko as beam
from flexmbd.reduction import KelvinVoigtDamping, craig_bampton, guyan

SELF = MPI.COMM_SELF
MAST = beam.Parameters.tube(2.1e11, 0.3, 7850.0, outer_radius=0.03, inner_radius=0.026, orientation=(0, 1, 0))
ARM = beam.Parameters.rectangle(7e10, 0.33, 2700.0, width=0.02, height=0.04, orientation=(0, 0, 1))
STAY = beam.Parameters.i_section(
    2.1e11, 0.3, 7850.0, width=0.02, height=0.03, flange=2e-3, web=1e-3, orientation=(1.0, 1.0, 0.2)
)
POINTS = {
    "foot": (0.0, 0.0, 0.0),
    "head": (0.0, 0.1, 1.2),
    "left": (0.3, 1.5, 1.0),
    "right": (0.3, -1.5, 1.0),
    "tip": (0.4, 2.5, 0.8),
}
BEAMS = {
    "mast": [("foot", "head")],
    "arms": [("head", "left"), ("head", "right"), ("left", "tip")],
    "stays": [("right", "foot")],
}
SECTIONS = {"mast": MAST, "arms": ARM, "stays": STAY}


def model(points, beams, sections, *, divisions=3, geometry=1, interfaces=()):
    mesh = meshes.frame(points, beams, divisions=divisions, degree=geometry, comm=SELF)
    pairs = {name: (beam, sections[name]) for name in beams}
    return ContinuumModel(mesh, pairs, degree=2, interfaces=[Interface(name) for name in interfaces])


def test_a_branched_frame_is_as_flexible_as_by_the_stiffness_method():
    """Unit loads at a joint of two beams, at one of three, and at a free end, and what moves at each."""
    places = ("foot", "head", "left", "tip")
    body = guyan(model(POINTS, BEAMS, SECTIONS, interfaces=places), frame="foot")
    rows = np.vstack([body.interface(name).modes for name in places[1:]])
    found = (rows / body.stiffness) @ rows.T
    names = list(POINTS)
    members = [(names.index(a), names.index(b), SECTIONS[group]) for group, ones in BEAMS.items() for a, b in ones]
    x = np.array(list(POINTS.values()))
    k = assembled(x, [m[:2] for m in members], [m[2] for m in members], local_stiffness)
    exact = np.linalg.inv(k[6:, 6:])
    kept = np.concatenate([6 * names.index(name) - 6 + np.arange(6) for name in places[1:]])
    exact = exact[np.ix_(kept, kept)]
    size = np.sqrt(np.outer(np.diag(exact), np.diag(exact)))
    assert abs((found - exact) / size).max() < 1e-9


def test_mass_of_a_branched_frame():
    body = guyan(model(POINTS, BEAMS, SECTIONS, interfaces=("foot",)), frame="foot")
    parts = [
        (SECTIONS[group].rho * SECTIONS[group].A * np.linalg.norm(np.subtract(POINTS[b], POINTS[a])), a, b)
        for group, ones in BEAMS.items()
        for a, b in ones
    ]
    assert body.mass == pytest.approx(sum(mass for mass, *_ in parts), rel=1e-13)
    moment = sum(mass * np.add(POINTS[a], POINTS[b]) / 2 for mass, a, b in parts)
    assert body.mass * body.com == pytest.approx(moment, rel=1e-12)


@pytest.fixture(scope="module")
def ring():
    """A thin ring of radius 1 m, of two arcs."""
    wire = beam.Parameters.tube(2e11, 0.3, 8000.0, outer_radius=2e-3, orientation=(0, 0, 1))
    points = {"a": (1.0, 0.0, 0.0), "b": (-1.0, 0.0, 0.0)}
    beams = {"ring": [("a", (0.0, 1.0, 0.0), "b"), ("b", (0.0, -1.0, 0.0), "a")]}
    body = craig_bampton(
        model(points, beams, {"ring": wire}, divisions=32, geometry=2), modes=10, frame=None, geometric_stiffness=False
    )
    return wire, body


def test_a_ring_has_the_frequencies_of_hoppe_and_michell(ring):
    """In its plane n (n^2 - 1) / sqrt(n^2 + 1), out of it n (n^2 - 1) / sqrt(n^2 + 1 + nu), of a thin wire."""
    wire, body = ring
    n = np.arange(2, 5)
    unit = np.sqrt(wire.E * wire.Iy / (wire.rho * wire.A)) / (2 * np.pi)
    inside, outside = (unit * n * (n**2 - 1) / np.sqrt(n**2 + more) for more in (1, 1 + wire.nu))
    exact = np.sort(np.tile(np.concatenate([inside, outside]), 2))[:10]
    assert body.frequencies()[:10] == pytest.approx(exact, rel=1e-4)
    assert body.com == pytest.approx(np.zeros(3), abs=1e-9)


UNSYMMETRIC = dataclasses.replace(ARM, orientation=(0.0, 1.0, 0.0))


def turned(p, angle):
    """The same section by axes turned by an angle about the tangent, x."""
    c, s = np.cos(angle), np.sin(angle)
    return dataclasses.replace(
        p,
        Iy=c**2 * p.Iy + s**2 * p.Iz,
        Iz=s**2 * p.Iy + c**2 * p.Iz,
        Iyz=s * c * (p.Iy - p.Iz),
        orientation=(0.0, c, s),
    )


def test_axes_that_are_not_principal_ones():
    """Stiffness, mass and mass integrals do not change with the axes a section is described by.

    y' = c y + s z and z' = c z - s y, so that the integral of y' z' is s c (integral of z^2 - of y^2).
    """
    ends = [Interface("start"), Interface("end")]
    line = meshes.line(1.0, divisions=4, comm=SELF)
    bodies = [
        craig_bampton(
            ContinuumModel(line, beam, p, degree=2, interfaces=ends), modes=4, frame="start", geometric_stiffness=False
        )
        for p in (UNSYMMETRIC, turned(UNSYMMETRIC, 0.7))
    ]
    assert bodies[1].stiffness == pytest.approx(bodies[0].stiffness, rel=1e-9)
    assert bodies[1].inertia == pytest.approx(bodies[0].inertia, rel=1e-9, abs=1e-9)
    flexibility = [(b.interface("end").modes / b.stiffness) @ b.interface("end").modes.T for b in bodies]
    assert abs(flexibility[1] - flexibility[0]).max() < 1e-9 * abs(flexibility[0]).max()


def integrals(inside, reach, count=2001):
    """A, Iy, Iz of a section by counting small squares."""
    at = (np.arange(count) + 0.5) / count * 2 * reach - reach
    y, z = np.meshgrid(at, at, indexing="ij")
    one = inside(y, z) * (2 * reach / count) ** 2
    return one.sum(), (one * z**2).sum(), (one * y**2).sum()


def test_sections():
    steel = (1.0, 0.3, 1.0)
    tube = beam.Parameters.tube(*steel, outer_radius=0.5, inner_radius=0.3, orientation=(0, 1, 0))
    found = integrals(lambda y, z: (y**2 + z**2 < 0.25) & (y**2 + z**2 > 0.09), 0.5)
    assert (tube.A, tube.Iy, tube.Iz) == pytest.approx(found, rel=1e-3)
    assert tube.J == pytest.approx(tube.Iy + tube.Iz)
    # Cowper's table: 0.886 of a solid circle, 0.53 of a thin tube, nu = 0.3
    solid = beam.Parameters.tube(*steel, outer_radius=0.5, orientation=(0, 1, 0))
    assert solid.ky == pytest.approx(0.886, abs=5e-4)
    thin = beam.Parameters.tube(*steel, outer_radius=0.5, inner_radius=0.4999, orientation=(0, 1, 0))
    assert thin.kz == pytest.approx(0.531, abs=5e-4)
    i = beam.Parameters.i_section(*steel, width=0.6, height=1.0, flange=0.1, web=0.04, orientation=(0, 1, 0))
    found = integrals(lambda y, z: ((abs(z) > 0.4) & (abs(y) < 0.3)) | (abs(y) < 0.02), 0.5)
    assert (i.A, i.Iy, i.Iz) == pytest.approx(found, rel=3e-3)
    assert i.J == pytest.approx((2 * 0.6 * 0.1**3 + 0.9 * 0.04**3) / 3)
    # nearly the web's share of the area along the web; without flanges that of a rectangle
    assert i.kz == pytest.approx(0.04 * 0.9 / i.A, rel=0.12)
    bare = beam.Parameters.i_section(*steel, width=0.05, height=1.0, flange=1e-9, web=0.04, orientation=(0, 1, 0))
    assert bare.kz == pytest.approx(13 / (12 + 11 * 0.3), rel=1e-6)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"A": 0.0}, "A must be positive and finite, got 0.0"),
        ({"Iyz": 1.5 * np.sqrt(ARM.Iy * ARM.Iz)}, "Iyz\\^2 must be less than Iy Iz.*no positive energy"),
        ({"Iyz": -np.sqrt(ARM.Iy * ARM.Iz) * 1.001}, "Iyz\\^2 must be less than Iy Iz"),
        ({"Iyz": float("nan")}, "Iyz\\^2 must be less than Iy Iz"),
    ],
)
def test_sections_that_are_none(change, message):
    with pytest.raises(ValueError, match=message):
        dataclasses.replace(ARM, **change)


def test_dimensions_of_sections_that_are_none():
    with pytest.raises(ValueError, match="inner_radius must lie from 0 to below outer_radius"):
        beam.Parameters.tube(1, 0.3, 1, outer_radius=0.1, inner_radius=0.1, orientation=(0, 1, 0))
    with pytest.raises(ValueError, match="has no web"):
        beam.Parameters.i_section(1, 0.3, 1, width=0.1, height=0.1, flange=0.05, web=0.01, orientation=(0, 1, 0))


def test_a_group_whose_orientation_lies_along_one_of_its_beams():
    with pytest.raises(FormulationError, match="orientation along its beam"):
        model({"a": (0, 0, 0), "b": (0, 0, 1)}, {"arm": [("a", "b")]}, {"arm": ARM})


@pytest.mark.mpi
def test_a_frame_with_branches_cannot_be_spread():
    if MPI.COMM_WORLD.size == 1:
        assert meshes.frame(POINTS, BEAMS, divisions=2).facet_groups.keys() == POINTS.keys()
        return
    with pytest.raises(MeshError, match="a mesh with branches cannot be spread over ranks"):
        meshes.frame(POINTS, BEAMS, divisions=2)


HALVES = {"inner": [("root", "middle")], "outer": [("middle", "tip")]}
ROD = {"root": (0.0, 0.0, 0.0), "middle": (0.5, 0.0, 0.0), "tip": (1.0, 0.0, 0.0)}
THIN = beam.Parameters.rectangle(7e10, 0.3, 2700.0, width=0.012, height=0.01, orientation=(0, 1, 0))


@pytest.fixture(scope="module")
def rod():
    return model(ROD, HALVES, {"inner": THIN, "outer": THIN}, divisions=6, interfaces=("root", "tip"))


def test_viscous_damping_has_its_ratios(rod):
    """zeta = eta omega / (2 E) for each mode of a cantilever, and omega that of Euler and Bernoulli."""
    tau = 2e-5
    body = craig_bampton(rod, modes=20, frame="root", geometric_stiffness=False, damping=KelvinVoigtDamping(tau))
    n = body.n_modes
    first_order = np.block([[np.zeros((n, n)), np.eye(n)], [-np.diag(body.stiffness), -body.damping]])
    roots = np.linalg.eigvals(first_order)
    roots = roots[np.argsort(abs(roots))]
    swings = roots[roots.imag > 0][:4]
    omega = np.outer(np.array([1.87510406871, 4.69409113297]) ** 2, np.sqrt([THIN.Iy, THIN.Iz]))
    omega = np.sort((omega * np.sqrt(THIN.E / (THIN.rho * THIN.A))).ravel())
    assert abs(swings) == pytest.approx(omega, rel=2e-3)
    assert -swings.real / abs(swings) == pytest.approx(tau * abs(swings) / 2, rel=1e-9)


def test_viscous_damping_of_one_half_of_a_cantilever(rod):
    """The first mode is damped by the share of its strain energy that lies in that half."""
    tau = 3e-5
    damping = KelvinVoigtDamping({"inner": 0.0, "outer": tau})
    body = craig_bampton(rod, modes=20, frame="root", geometric_stiffness=False, damping=damping)
    b, s = 1.87510406871, np.linspace(0, 1, 2001)
    ratio = (np.cos(b) + np.cosh(b)) / (np.sin(b) + np.sinh(b))
    bent = (np.cosh(b * s) + np.cos(b * s) - ratio * (np.sinh(b * s) + np.sin(b * s))) ** 2
    share = np.trapezoid(bent[1000:], s[1000:]) / np.trapezoid(bent, s)
    assert body.damping[0, 0] / (tau * body.stiffness[0]) == pytest.approx(share, rel=5e-3)


def test_a_spun_bar_stretches():
    """u = sin(a x) / (a cos(a L)) - x with a^2 = rho w^2 / E, of which rho w^2 L^3 / (3 E) is the first term.

    In the machine: the bar turns at a constant speed, and viscous stress brings it to rest; it is wide, so
    that this goes fast for the bending that Coriolis forces start, too.
    """
    speed = 500.0
    wide = beam.Parameters.rectangle(7e10, 0.3, 2700.0, width=0.3, height=0.01, orientation=(0, 1, 0))
    damping = KelvinVoigtDamping(2 / (np.pi / 2 * np.sqrt(wide.E / wide.rho)))
    bar = model(ROD, HALVES, {"inner": wide, "outer": wide}, divisions=6, interfaces=("root", "tip"))
    body = craig_bampton(bar, modes=8, frame="root", damping=damping)
    scene = fm.System()
    bar = scene.add(fm.FlexibleBody(body), name="bar")
    hinge = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), bar.frame("root"))
    hinge.prescribe(PPoly([[speed], [0.0]], [0.0, 1.0]))
    run = scene.simulate(t_end=0.05, rtol=1e-6)
    length = np.linalg.norm(run.position(bar.frame("tip"))[-1])
    a = speed * np.sqrt(wide.rho / wide.E)
    assert length - 1.0 == pytest.approx(np.tan(a) / a - 1.0, rel=1e-4)
