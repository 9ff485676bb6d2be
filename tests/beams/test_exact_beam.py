"""Geometrically exact beams that move: closed forms, a rod's differential equations, another finite element beam."""

import dataclasses
import warnings
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from cantilever import rod_tips
from exact_beam import PlanarBeam, bent_frequencies, clamped_tip
from scipy.interpolate import PPoly
from scipy.linalg import expm
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

import flexmbd as fm
from flexmbd.beams import DiscreteFrame, Section
from flexmbd.errors import MeshError, SceneError
from flexmbd.forms import beam_timoshenko

Parameters = beam_timoshenko.Parameters

STEEL = Parameters.rectangle(2.1e11, 0.3, 7850.0, width=0.02, height=0.02, orientation=(0.0, 1.0, 0.0))

# Kirchhoff's: sections stay normal to the axis
UNSHEARED = SimpleNamespace(**{**dataclasses.asdict(STEEL), "ky": np.inf, "kz": np.inf})


def cantilever(section: Section, n: int, *, length: float = 1.0, joint: fm.joint.Joint | None = None, **more: object):
    """A scene, and a beam along x from the ground."""
    scene = fm.System()
    points = {"clamp": (0.0, 0.0, 0.0), "tip": (length, 0.0, 0.0)}
    beam = scene.add(fm.ExactBeam(points, {"rod": [("clamp", "tip")]}, {"rod": section}, n, **more), name="beam")
    scene.connect(joint or fm.joint.Fixed(), scene.ground.frame(), beam.frame("clamp"))
    return scene, beam


def tip_under(section: Section, n: int, force: np.ndarray, *, length: float, steps: int = 1) -> np.ndarray:
    """(3,) m, displacement of the tip under a dead force, brought up in steps."""
    about = None
    for share in np.arange(1, steps + 1) / steps:
        scene, beam = cantilever(section, n, length=length)
        scene.add_force(fm.force.FrameForce(beam.frame("tip"), tuple(share * np.asarray(force))))
        about = scene.equilibrium(about=about)
    return about.position(beam.frame("tip")) - [length, 0.0, 0.0]


# --- at rest


@pytest.mark.parametrize("n", [1, 3])
def test_a_moment_bends_it_to_an_arc_exactly(n):
    """However few the elements: the strains of a circle are constant."""
    angle = 0.6
    scene, beam = cantilever(STEEL, n)
    moment = angle * STEEL.E * STEEL.Iz
    scene.add_force(fm.force.FrameForce(beam.frame("tip"), torque=(0, 0, moment), axes=fm.force.Axes.FRAME))
    bent = scene.equilibrium()
    circle = np.array([np.sin(angle), 1.0 - np.cos(angle), 0.0]) / angle
    assert bent.position(beam.frame("tip")) == pytest.approx(circle, abs=1e-9)
    R = bent.rotation(beam.frame("tip"))
    assert Rotation.from_matrix(R).as_rotvec() == pytest.approx([0.0, 0.0, angle], abs=1e-9)


@pytest.mark.parametrize("each", [False, True], ids=["all alike", "each element its own"])
def test_a_prescribed_twist_and_curvature_make_a_helix(each):
    """Without loads: the clamped beam follows exp(s [tangent; twist and curvature]), and bears no stress."""
    strain = np.array([0.01, 0.0, 0.0, 0.4, 0.0, 0.9])
    given = np.tile(strain, (3, 1)) if each else strain
    scene, beam = cantilever(STEEL, 3, strain={"rod": given})
    bent = scene.equilibrium()
    screw = np.zeros((4, 4))
    screw[:3, :3] = [[0.0, -0.9, 0.0], [0.9, 0.0, -0.4], [0.0, 0.4, 0.0]]
    screw[:3, 3] = strain[:3] + np.eye(3)[0]
    exact = expm(screw)
    assert bent.position(beam.frame("tip")) == pytest.approx(exact[:3, 3], abs=1e-9)
    assert bent.rotation(beam.frame("tip")) == pytest.approx(exact[:3, :3], abs=1e-9)
    stress = scene.simulate(1e-6, about=bent).resultants(beam, t=np.zeros(1))
    assert np.abs(stress).max() < 1e-8 * STEEL.E * STEEL.A


def test_bad_strains():
    for given, text in (
        ((0.0,) * 5, r"shape \(6,\)"),
        (np.zeros((2, 6)), r"shape \(3, 6\)"),
        ((0.0, 0.0, 0.0, 0.0, 0.0, 10.0), "half a revolution"),
        ((np.nan,) * 6, "finite"),
    ):
        with pytest.raises(SceneError, match=text):
            cantilever(STEEL, 3, strain={"rod": given})
    with pytest.raises(SceneError, match="the groups are 'rod'"):
        cantilever(STEEL, 3, strain={"bar": (0.0,) * 6})


PRINCETON = Parameters.rectangle(71.7e9, 0.31, 2700.0, width=12.3777e-3, height=3.2024e-3, orientation=(0, 1, 0))


def test_the_princeton_beam_in_its_weak_plane():
    """Fourth order in a plane, against the rod's differential equations."""
    force = np.array([0.0, 0.0, 13.345])
    exact = rod_tips(PRINCETON, [force / 4, force / 2, force], length=0.508)[-1]
    errors = [abs(tip_under(PRINCETON, n, force, length=0.508, steps=2) - exact).max() for n in (2, 4, 8)]
    assert errors[1] < errors[0] / 12
    assert errors[2] < errors[1] / 12
    assert errors[2] < 4e-6 * np.linalg.norm(exact)


def test_the_princeton_beam_bent_and_twisted():
    """Second order where moments turn against the sections."""
    force = 13.345 * np.array([0.0, np.cos(np.pi / 6), np.sin(np.pi / 6)])
    exact = rod_tips(PRINCETON, [force / 4, force / 2, force], length=0.508)[-1]
    errors = [abs(tip_under(PRINCETON, n, force, length=0.508, steps=3) - exact).max() for n in (4, 8, 16)]
    assert errors[1] < errors[0] / 3.4
    assert errors[2] < errors[1] / 3.6
    assert errors[2] < 6e-5 * np.linalg.norm(exact)


@pytest.mark.parametrize("n", [1, 4])
def test_a_thin_short_beam_does_not_lock(n):
    """Under a small force the tip gives way as Timoshenko's beam, ten thousand times as long as thick or as long."""
    for thickness in (1e-4, 1.0):
        section = Parameters.rectangle(1e9, 0.3, 1.0, width=thickness, height=thickness, orientation=(0, 1, 0))
        shear = section.E / (2 * (1 + section.nu)) * section.ky * section.A
        gives = 1.0 / (3 * section.E * section.Iz) + 1.0 / shear
        force = 1e-5 / gives
        assert tip_under(section, n, np.array([0.0, force, 0.0]), length=1.0)[1] == pytest.approx(1e-5, rel=1e-8)


def quarter(section: Section, n: int, radius: float) -> tuple[dict, dict, dict, int]:
    """Points, beams, sections and divisions of a quarter of a circle in the plane of x and y."""

    def at(angle: float) -> tuple[float, float, float]:
        return radius * np.sin(angle), radius * (1 - np.cos(angle)), 0.0

    beams = {"arc": [("clamp", at(np.pi / 4), "tip")]}
    return {"clamp": at(0.0), "tip": at(np.pi / 2)}, beams, {"arc": section}, n


def pull_of_quarter(section: Section, radius: float) -> float:
    """m/N, how far the tip goes along x per force along x: the integrals of M^2/EI + N^2/EA + V^2/kGA."""
    shear = section.kz * section.E / (2 * (1 + section.nu)) * section.A
    bend = radius**3 * np.pi / 4 / (section.E * section.Iy)
    return bend + radius * np.pi / 4 * (1 / (section.E * section.A) + 1 / shear)


ACROSS = Parameters.rectangle(2e11, 0.3, 7800.0, width=0.02, height=0.1, orientation=(0.0, 0.0, 1.0))


@pytest.mark.parametrize("n", [1, 3])
def test_curved_elements_are_exact_in_linear_statics(n):
    """Castigliano's integrals along the arc, by which discrete elements and exact ones go."""
    exact = pull_of_quarter(ACROSS, 0.5)
    parts = quarter(ACROSS, n, 0.5)
    lumped = DiscreteFrame(*parts)
    moved = lumped.displaced(lumped.load("tip", force=(1.0, 0.0, 0.0)), clamped=["clamp"])
    assert moved[lumped.node("tip"), 0] == pytest.approx(exact, rel=1e-10)
    scene = fm.System()
    beam = scene.add(fm.ExactBeam(*parts), name="hook")
    scene.connect(fm.joint.Fixed(), scene.ground.frame(), beam.frame("clamp"))
    force = 1e-6 / exact
    scene.add_force(fm.force.FrameForce(beam.frame("tip"), (force, 0.0, 0.0)))
    gone = scene.equilibrium().position(beam.frame("tip"))[0] - 0.5
    assert gone == pytest.approx(1e-6, rel=1e-5)


def test_lumps_of_an_arc_have_its_mass_centre_and_inertia():
    lumped = DiscreteFrame(*quarter(ACROSS, 3, 0.5))
    line = ACROSS.rho * ACROSS.A * 0.5 * np.pi / 2
    total = lumped.moments[:, 0, 0].sum()
    first = (lumped.moments[:, 0, 0, None] * lumped.mesh.x + lumped.moments[:, 0, 1:]).sum(axis=0)
    assert total == pytest.approx(line, rel=1e-12)
    assert first / total == pytest.approx([0.5 * 2 / np.pi, 0.5 * (1 - 2 / np.pi), 0.0], rel=1e-12, abs=1e-14)


def test_a_ring_pulled_apart():
    """A closed frame, cut in no joint: pulled at two ends it widens by the thin ring's closed form."""
    radius = 1.0
    section = Parameters.rectangle(2e11, 0.3, 7800.0, width=0.001, height=0.001, orientation=(0.0, 0.0, 1.0))
    points = {"east": (radius, 0.0, 0.0), "west": (-radius, 0.0, 0.0)}
    beams = {"ring": [("east", (0.0, radius, 0.0), "west"), ("west", (0.0, -radius, 0.0), "east")]}
    scene = fm.System()
    ring = scene.add(fm.ExactBeam(points, beams, {"ring": section}, 4), name="ring")
    scene.connect(fm.joint.Fixed(), scene.ground.frame(p=(-radius, 0, 0)), ring.frame("west"))
    exact = (np.pi / 4 - 2 / np.pi) * radius**3 / (section.E * section.Iy)
    force = 1e-5 / exact
    scene.add_force(fm.force.FrameForce(ring.frame("east"), (force, 0.0, 0.0)))
    wide = scene.equilibrium().position(ring.frame("east"))[0] - radius
    assert wide == pytest.approx(1e-5, rel=1e-4)


def test_resultants_are_those_of_equilibrium():
    scene, beam = cantilever(STEEL, 4)
    scene.add_force(fm.force.FrameForce(beam.frame("tip"), (0.0, 0.0, 3.0), (0.5, 0.0, 0.0)))
    bent = scene.equilibrium()
    run = scene.simulate(1e-6, about=bent)
    found = run.resultants(beam, t=np.zeros(1))[0]
    middle = (np.arange(4) + 0.5) / 4
    assert found[:, 2] == pytest.approx(3.0, rel=1e-5)
    assert found[:, 3] == pytest.approx(0.5, rel=1e-3)
    assert found[:, 4] == pytest.approx(-3.0 * (1 - middle), rel=1e-3)


def test_a_table_tells_of_all_sections_and_elements():
    """At rest under a weight at the tip: the shear force is the weight, the moment grows towards the clamp."""
    scene, beam = cantilever(STEEL, 3)
    scene.add_force(fm.force.FrameForce(beam.frame("tip"), (0.0, 0.0, 3.0)))
    run = scene.simulate(1e-6, about=scene.equilibrium())
    table = run.table(beam)
    moments = [table.column(f"beam.element {k}.my")[0] for k in (1, 2, 3)]
    assert moments == pytest.approx([-2.5, -1.5, -0.5], rel=1e-3)
    assert table.column("beam.element 2.fz")[0] == pytest.approx(3.0, rel=1e-5)
    assert dict(zip(table.names, table.units, strict=True))["beam.element 2.my"] == "N m"
    np.testing.assert_array_equal(table.column("beam.tip.z"), run.position(beam.frame("tip"))[:, 2])
    at = run.table(beam, t=np.array([0.0, 5e-7]))
    np.testing.assert_array_equal(at.column("beam.element 3.fz"), run.resultants(beam, t=at.column("t"))[:, 2, 2])
    _, other = cantilever(STEEL, 3)
    with pytest.raises(SceneError, match="not in this trajectory"):
        run.table(other)


def test_a_line_load_bends_as_a_parabola():
    """Its sections carry Gregory's weights of it; the deflection is q L^4 / 8 E I and shear's."""
    section = UNSHEARED
    for n in (2, 4):
        scene, beam = cantilever(section, n)
        for force in beam.line_load("rod", (0.0, 1e-2, 0.0)):
            scene.add_force(force)
        tip = scene.equilibrium().position(beam.frame("tip"))[1]
        assert tip == pytest.approx(1e-2 / (8 * section.E * section.Iz), rel=1e-9)


# --- vibrations


def frequencies(section: Section, n: int, **more: object) -> np.ndarray:
    """Eigenvalues (1/s) with positive imaginary part, the slowest first, of a cantilever of 1 m."""
    values = cantilever(section, n, **more)[0].linearize().eigenvalues()
    values = values[values.imag > 0.0]
    return values[np.argsort(np.abs(values))]


def test_frequencies_of_a_cantilever():
    """Euler's and Bernoulli's: no shear, and so thin that rotary inertia takes 3e-5 of the second."""
    thin = Parameters.rectangle(2.1e11, 0.3, 7850.0, width=0.005, height=0.005, orientation=(0.0, 1.0, 0.0))
    section = SimpleNamespace(**{**dataclasses.asdict(thin), "ky": np.inf, "kz": np.inf})
    numbers = [brentq(lambda x: np.cosh(x) * np.cos(x) + 1, *ends) for ends in ((1, 3), (4, 6))]
    exact = np.array(numbers) ** 2 * np.sqrt(section.E * section.Iy / (section.rho * section.A))
    errors = [abs(frequencies(section, n).imag[[0, 2]] / exact - 1) for n in (4, 8, 16)]
    assert errors[2][0] < 1e-5
    assert errors[2][1] < 1.2e-4
    assert errors[1][1] < errors[0][1] / 15


def test_frequencies_of_the_princeton_beam_bent_by_its_load():
    """`linearize` about the bent state, in the weak plane, against Simo's and Vu-Quoc's element, extrapolated."""
    p, force = PRINCETON, 13.345
    shear = p.kz * p.E / (2 * (1 + p.nu)) * p.A
    other = PlanarBeam(p.E * p.A, shear, p.E * p.Iy, p.rho * p.A, p.rho * p.Iy, 0.508)
    coarse, fine = (bent_frequencies(other, force, elements=n)[:2] for n in (64, 128))
    exact = fine + (fine - coarse) / 3
    straight = bent_frequencies(other, 0.0, elements=64)[:2]
    assert abs(exact / straight - 1).max() > 0.03
    about = None
    for share in (0.5, 1.0):
        scene, beam = cantilever(PRINCETON, 16, length=0.508)
        scene.add_force(fm.force.FrameForce(beam.frame("tip"), (0.0, 0.0, share * force)))
        about = scene.equilibrium(about=about)
    values = scene.linearize(about=about).eigenvalues()
    found = np.sort(values.imag[values.imag > 0.0])
    for one in exact:
        assert abs(found / one - 1).min() < 2e-4


def test_rotary_inertia_slows_bending():
    """Of a section with its own rho I against one given the same: equal; with four times it: slower."""
    own = {"rod": (STEEL.rho * STEEL.Iy, STEEL.rho * STEEL.Iz)}
    heavy = {"rod": (40 * STEEL.rho * STEEL.Iy, 40 * STEEL.rho * STEEL.Iz)}
    plain = frequencies(STEEL, 4).imag
    assert frequencies(STEEL, 4, rotary_inertia=own).imag == pytest.approx(plain, rel=1e-10)
    assert frequencies(STEEL, 8, rotary_inertia=heavy).imag[0] < (1 - 1e-3) * frequencies(STEEL, 8).imag[0]


def test_viscosity_damps_each_mode_by_half_its_frequency():
    """Kelvin and Voigt: zeta = tau omega / 2, whatever the mode."""
    tau = 1e-6
    values = frequencies(STEEL, 4, viscosity=tau)
    slow = np.abs(values) * tau < 0.5
    assert slow.sum() > 4
    assert -values.real[slow] / np.abs(values[slow]) == pytest.approx(0.5 * tau * np.abs(values[slow]), rel=1e-4)


# --- in motion

RUBBER = Parameters.rectangle(1e5, 0.0, 0.02, width=2.0, height=2.0, orientation=(0.0, 1.0, 0.0))
LENGTH, TIP_MASS, TIP_INERTIA = 20.0, 1.2, 0.6



def triangle(t: float) -> float:
    """N."""
    return 300.0 * max(0.0, 1.0 - abs(t - 0.5) / 0.5)


pulse = fm.compiled(triangle, breaks=(0.5, 1.0))


def thrown(n: int, *, viscosity: float = 0.0) -> tuple[fm.System, fm.Frame]:
    """A soft cantilever with a lump at its tip, which a pulse along y throws over."""
    scene, beam = cantilever(RUBBER, n, length=LENGTH, viscosity=viscosity)
    lump = scene.add(fm.RigidBody(TIP_MASS, TIP_INERTIA * np.ones(3)), name="lump")
    scene.connect(fm.joint.Fixed(), beam.frame("tip"), lump.frame())
    scene.add_force(fm.force.FrameForce(lump.frame(), (0.0, pulse, 0.0)))
    return scene, lump.frame()


def test_a_cantilever_thrown_over_as_another_program_has_it():
    """Simo's and Vu-Quoc's element in absolute coordinates, extrapolated."""
    p = RUBBER
    shear = p.ky * p.E / 2 * p.A
    other = PlanarBeam(p.E * p.A, shear, p.E * p.Iz, p.rho * p.A, p.rho * p.Iz, LENGTH)
    coarse, fine = (
        clamped_tip(other, triangle, tip=(TIP_MASS, TIP_INERTIA), elements=n, h=0.01, end=3.0)
        for n in (12, 24)
    )
    exact = fine + (fine - coarse) / 3
    assert np.linalg.norm(exact - [LENGTH, 0.0]) > 0.3 * LENGTH
    errors = []
    for n in (3, 6, 12):
        scene, tip = thrown(n)
        run = scene.simulate(3.0, rtol=1e-7)
        errors.append(np.abs(run.position(tip)[-1, :2] - exact).max())
    assert max(errors) < 1e-4 * LENGTH  # what the other program's steps leave


def test_a_throw_converges_with_the_elements():
    places = []
    for n in (2, 4, 8, 16):
        scene, tip = thrown(n)
        places.append(scene.simulate(3.0, rtol=1e-9).position(tip)[-1])
    changes = [np.abs(b - a).max() for a, b in pairwise(places)]
    assert changes[1] < changes[0] / 3
    assert changes[2] < changes[1] / 3
    assert changes[2] < 1e-5 * LENGTH


@pytest.mark.parametrize(
    ("integrator", "rtol", "most"),
    [
        (fm.RadauIIA(), 1e-7, 1e-5),
        (fm.GeneralizedAlpha(), 1e-6, 1e-3),
        (fm.ExplicitRungeKutta(), 1e-7, 1e-5),
        (fm.EnergyMomentum(), 1e-5, 1e-4),
        (fm.EnergyMomentum(), 1e-7, 1e-6),
    ],
)
def test_every_integrator_moves_it_alike(integrator, rtol, most):
    scene, tip = thrown(3)
    reference = scene.simulate(2.0, rtol=1e-9, integrator=fm.RadauIIA()).position(tip)[-1]
    found = scene.simulate(2.0, rtol=rtol, integrator=integrator).position(tip)[-1]
    assert np.abs(found - reference).max() < most * LENGTH


def test_a_tight_tolerance_gets_past_a_bend_of_the_load_by_energy_momentum():
    """What Newton's iteration leaves grows against the tolerance of ever shorter steps, and is no error of theirs."""
    section = Parameters.rectangle(1e5, 0.3, 0.02, width=12**0.5, height=12**0.5, orientation=(0.0, 1.0, 0.0))
    scene, beam = cantilever(section, 8, length=60.0)
    cube = scene.add(fm.RigidBody(64.0, 64.0 * 16 / 6 * np.ones(3)), name="cube")
    scene.connect(fm.joint.Fixed(), beam.frame("tip"), cube.frame(p=(-2.0, 0.0, 0.0)))
    bend = fm.compiled(lambda t: 1500.0 * max(0.0, 1.0 - abs(t - 1.0)), breaks=(1.0, 2.0))
    scene.add_force(fm.force.FrameForce(cube.frame(), (0.0, bend, 0.0)))
    found = [scene.simulate(1.2, rtol=1e-6, integrator=one).position(cube.frame())[-1] for one in METHODS]
    assert found[0] == pytest.approx(found[1], abs=1e-5 * 60.0)


METHODS = fm.EnergyMomentum(), fm.RadauIIA()


def test_energy_and_momenta_of_free_flight_are_kept():
    """A curved beam that tumbles and wobbles, for five hundred steps of the energy-momentum method."""
    scene = fm.System()
    soft = dataclasses.replace(ACROSS, E=5e6)
    beam = scene.add(fm.ExactBeam(*quarter(soft, 4, 0.5)), name="boomerang")
    flight = scene.connect(fm.joint.Free(), scene.ground.frame(), beam.frame("clamp"))
    flight.velocity = (0.3, 0.0, 1.0, 9.0, -4.0, 6.0)
    run = scene.simulate(0.5, h=1e-3, integrator=fm.EnergyMomentum())
    energy = run.energy()
    assert np.ptp(energy.spring) > 1e-3 * energy.total[0]
    assert np.ptp(energy.total) < 1e-10 * energy.total[0]
    momentum = run.momentum()
    for part in (momentum.linear, momentum.angular):
        assert np.abs(part - part[0]).max() < 1e-10 * np.abs(part[0]).max()


def test_a_slow_flight_is_not_stopped_by_rounding():
    """Places of 20 m are known to so much that forces of a stiff section are out of balance by it, at any step."""
    scene = fm.System()
    ends = {"near": (0.0, 0.0, 0.0), "far": (LENGTH, 0.0, 0.0)}
    beam = scene.add(fm.ExactBeam(ends, {"rod": [("near", "far")]}, {"rod": RUBBER}, 4), name="rod")
    flight = scene.connect(fm.joint.Free(), scene.ground.frame(), beam.frame("near"))
    flight.velocity = (0.3, 0.0, 1.0, 0.9, -0.4, 0.6)
    total = scene.simulate(1.0, h=1e-3, integrator=fm.EnergyMomentum()).energy().total
    assert np.ptp(total) < 1e-12 * total[0]


def test_viscosity_takes_energy_and_no_momentum():
    scene = fm.System()
    soft = dataclasses.replace(ACROSS, E=5e6)
    beam = scene.add(fm.ExactBeam(*quarter(soft, 4, 0.5), viscosity=1e-2), name="boomerang")
    flight = scene.connect(fm.joint.Free(), scene.ground.frame(), beam.frame("clamp"))
    flight.velocity = (0.3, 0.0, 1.0, 9.0, -4.0, 6.0)
    run = scene.simulate(0.5, rtol=1e-8)
    total = run.energy().total
    assert (np.diff(total) < 1e-6 * total[0]).all()
    assert total[-1] < (1 - 1e-3) * total[0]
    angular = run.momentum().angular
    assert np.abs(angular - angular[0]).max() < 1e-6 * np.abs(angular[0]).max()


def test_joints_in_the_middle_and_a_loop():
    """A beam hinged at both ends and pushed in its middle, by constraints: half of it by symmetry does the same."""
    scene = fm.System()
    points = {"left": (0.0, 0.0, 0.0), "middle": (0.5, 0.0, 0.0), "right": (1.0, 0.0, 0.0)}
    beam = fm.ExactBeam(points, {"rod": [("left", "middle"), ("middle", "right")]}, {"rod": STEEL}, 4)
    scene.add(beam, name="bridge")
    hinge = fm.joint.Revolute("z")
    scene.connect(hinge, scene.ground.frame(), beam.frame("left"))
    scene.connect(fm.joint.PointOnLine("x"), scene.ground.frame(p=(1.0, 0.0, 0.0)), beam.frame("right"))
    scene.add_force(fm.force.FrameForce(beam.frame("middle"), (0.0, -200.0, 0.0)))
    sag = scene.equilibrium().position(beam.frame("middle"))[1]
    rise = tip_under(STEEL, 4, np.array([0.0, 100.0, 0.0]), length=0.5)[1]
    # of second order in the slope, by the dead force on a tip that shortens
    assert -sag == pytest.approx(rise, rel=2e-3)


def test_rtol_is_of_a_beams_length():
    """However fine its elements and thin its section are."""
    for n in (1, 8):
        scene, _ = cantilever(STEEL, n, length=3.0)
        assert scene.compile().scene.extent == pytest.approx(3.0, rel=1e-14)
    section = fm.RigidBody(1.0, (1e-4, 1e-4, 1e-4))
    scene = fm.System()
    scene.add(section, name="section")
    scene.connect(fm.joint.Free(), scene.ground.frame(), section.frame()).position = (0.4, 0, 0, 1, 0, 0, 0)
    element = {"stiffness": np.ones(6), "rest": (0.4, 0.0, 0.0, 0.0, 0.0, 0.0)}
    scene.add_force(fm.force.BeamElement(scene.ground.frame(), section.frame(), **element))
    assert scene.compile().scene.extent == pytest.approx(0.4, rel=1e-14)
    bad = fm.force.BeamElement(scene.ground.frame(), section.frame(), **element, extent=-1.0)
    with pytest.raises(SceneError, match=r"extent = -1\.0 must not be negative"):
        scene.add_force(bad)


def test_a_looser_tolerance_takes_no_more_steps_in_a_loop():
    """What Newton's iteration leaves of stiff deformations is no motion that steps are to follow."""
    crank, coupler, rocker = (0.0, 0.12, 0.0), (0.24, 0.12, 0.0), (0.24, 0.0, 0.0)
    bar = Parameters.rectangle(2.1e11, 0.3, 7850.0, width=0.016, height=0.016, orientation=(0.0, 0.0, 1.0))
    thin = Parameters.rectangle(2.1e11, 0.3, 7850.0, width=0.008, height=0.008, orientation=(0.0, 0.0, 1.0))
    scene = fm.System()
    ends = [((0.0, 0.0, 0.0), crank, bar), (crank, coupler, bar), (rocker, coupler, thin)]
    a, b, c = (
        scene.add(fm.ExactBeam({"from": p, "to": q}, {"bar": [("from", "to")]}, {"bar": section}, 2), name=name)
        for name, (p, q, section) in zip(("crank", "coupler", "rocker"), ends, strict=True)
    )
    drive = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), a.frame("from"))
    drive.prescribe(lambda t: (-0.3 * t * t, -0.6 * t, -0.6))
    scene.connect(fm.joint.Revolute("z"), a.frame("to"), b.frame("from"))
    scene.connect(fm.joint.Revolute("z"), scene.ground.frame(p=rocker), c.frame("from"))
    scene.connect(fm.joint.Revolute((0.0, np.sin(0.09), np.cos(0.09))), b.frame("to"), c.frame("to"))
    loose, tight = (scene.simulate(1.0, rtol=rtol, integrator=fm.RadauIIA()).stats.steps for rtol in (1e-3, 1e-7))
    assert loose < 3 * tight


def test_thin_steel_swings_at_a_tight_tolerance():
    """Vibrations of 1e5 1/s that nothing excites cost no steps; in millimetres the same."""
    thin = Parameters.rectangle(2.1e11, 0.3, 7850.0, width=0.02, height=0.002, orientation=(0.0, 1.0, 0.0))
    small = Parameters.rectangle(2.1e5, 0.3, 7.85e-9, width=20.0, height=2.0, orientation=(0.0, 1.0, 0.0))
    places = []
    for section, unit in ((thin, 1.0), (small, 1e3)):
        scene, beam = cantilever(section, 4, length=unit, joint=fm.joint.Revolute("y"))
        scene.gravity = (0.0, 0.0, -9.81 * unit)
        run = scene.simulate(0.5, rtol=1e-7, max_steps=2000)
        places.append(run.position(beam.frame("tip"))[-1] / unit)
    assert places[0] == pytest.approx(places[1], abs=1e-6)
    assert np.linalg.norm(places[0]) == pytest.approx(1.0, abs=1e-3)


def test_an_element_that_winds_up_by_half_a_revolution_is_told():
    """Of two elements each would bend by 3.6 rad under the moment; of four no one goes as far, and none is told."""
    for n, warned in ((2, 1), (4, 0)):
        scene, beam = cantilever(STEEL, n, viscosity=0.05)
        moment = 7.2 * STEEL.E * STEEL.Iz
        ramp = PPoly([[moment, 0.0], [0.0, moment]], [0.0, 1.0, 2.0])
        scene.add_force(fm.force.FrameForce(beam.frame("tip"), torque=(0.0, 0.0, ramp)))
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always")
            try:
                scene.simulate(1.2, rtol=1e-4, max_steps=2000, integrator=fm.GeneralizedAlpha())
            except fm.FlexmbdError:
                assert warned  # thrown the other way round
        found = [str(one.message) for one in told if issubclass(one.category, fm.RangeWarning)]
        assert len(found) == warned
        assert all("half a revolution apart at t = 0." in one for one in found)


def test_variants_that_wind_up_are_told_in_the_arrays_of_runs_before():
    """By a moment of which an element bends by half a revolution, at a tip that is light enough to get there."""
    rubber = Parameters.rectangle(1e6, 0.3, 1000.0, width=0.1, height=0.1, orientation=(0.0, 1.0, 0.0))
    scene, beam = cantilever(rubber, 2)
    scene.add_force(fm.force.FrameForce(beam.frame("tip"), torque=(0.0, 0.0, 7.2 * rubber.E * rubber.Iz)))
    weight = scene.add(fm.RigidBody(mass=1.0, inertia=(1.0, 1.0, 1.0)), name="weight")
    scene.connect(fm.joint.Fixed(), beam.frame("tip"), weight.frame())
    machine = scene.compile(parameters={"inertia": [fm.parameter.Inertia(weight)]})
    found = []
    for inertia in (1e3, 1e3, 1.0):
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always")
            machine.simulate(0.55, h=2e-3, integrator=fm.ExplicitRungeKutta(), inertia=np.full(3, inertia))
        found.append([str(one.message) for one in told if one.category is fm.RangeWarning])
    assert [len(texts) for texts in found] == [0, 0, 1]
    assert "half a revolution apart at t = 0." in found[-1][0]


# --- bad input


def test_what_no_beam_has_is_refused():
    points, beams = {"a": (0.0, 0, 0), "b": (1.0, 0, 0)}, {"rod": [("a", "b")]}
    with pytest.raises(MeshError, match="coincide"):
        fm.ExactBeam({"a": (0.0, 0, 0), "b": (0.0, 0, 0)}, beams, {"rod": STEEL}, 2)
    with pytest.raises(SceneError, match="sections are given for 'bar'; give one for each group"):
        fm.ExactBeam(points, beams, {"bar": STEEL}, 2)
    with pytest.raises(SceneError, match="section of 'rod': 'int' object has no attribute 'E'; give forms"):
        fm.ExactBeam(points, beams, {"rod": 3}, 2)
    half = SimpleNamespace(**{name: value for name, value in dataclasses.asdict(STEEL).items() if name != "nu"})
    with pytest.raises(SceneError, match=r"section of 'rod': .* no attribute 'nu'"):
        fm.ExactBeam(points, beams, {"rod": half}, 2)
    with pytest.raises(SceneError, match="viscosity of 'bar': the groups are 'rod'"):
        fm.ExactBeam(points, beams, {"rod": STEEL}, 2, viscosity={"bar": 1.0})
    with pytest.raises(SceneError, match="viscosity of 'rod' must be a number of seconds, not negative, got -1"):
        fm.ExactBeam(points, beams, {"rod": STEEL}, 2, viscosity=-1.0)
    with pytest.raises(SceneError, match="rotary_inertia of 'rod' must be two positive numbers"):
        fm.ExactBeam(points, beams, {"rod": STEEL}, 2, rotary_inertia={"rod": (1.0, 0.0)})
    with pytest.raises(SceneError, match="rotary_inertia of 'bar': the groups are 'rod'"):
        fm.ExactBeam(points, beams, {"rod": STEEL}, 2, rotary_inertia={"bar": (1.0, 1.0)})
    with pytest.raises(SceneError, match=r"orientation .* along a beam"):
        fm.ExactBeam(points, beams, {"rod": dataclasses.replace(STEEL, orientation=(1.0, 0.0, 0.0))}, 2)
    beam = fm.ExactBeam(points, beams, {"rod": STEEL}, 2)
    with pytest.raises(SceneError, match="no node 'tip'; the points are: 'a', 'b'"):
        beam.frame("tip")
    with pytest.raises(SceneError, match="its divisions cannot be changed"):
        beam.divisions = 5
    with pytest.raises(SceneError, match="no group 'bar'"):
        beam.line_load("bar", (0, 0, 1))
    _, stranger = cantilever(STEEL, 2)
    run = cantilever(STEEL, 2)[0].simulate(1e-6)
    with pytest.raises(SceneError, match=r"beam .beam. is not in this trajectory"):
        run.resultants(stranger)
    with pytest.raises(SceneError, match=r"line load on .rod., N/m, must be finite numbers"):
        beam.line_load("rod", (0, np.nan, 1))
