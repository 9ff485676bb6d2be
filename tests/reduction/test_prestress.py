"""Bodies about a loaded static state: closed forms of bars and beams, and finite differences of the state itself."""

import re
import types

from mpi4py import MPI

import numpy as np
import pytest
import ufl
from bracket import ALUMINIUM, LENGTH, SHIFT, TURN, bracket
from scipy.integrate import solve_bvp
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

import flexmbd as fm
from flexmbd import meshes
from flexmbd.continuum import ContinuumModel, Interface
from flexmbd.errors import ConvergenceError, InterfaceError, MeshError, ReductionError
from flexmbd.forms import beam_timoshenko, solid_linear, solid_mixed
from flexmbd.reduction import (
    BodyForce,
    Keep,
    KelvinVoigtDamping,
    Pressure,
    Traction,
    craig_bampton,
    guyan,
    prestressed,
)

# no lateral contraction: what the rigid ends would hinder
MATERIAL = solid_linear.Parameters(E=7.0e10, nu=0.0, rho=2700.0)


def bar(length, *, width, height, cells, form=solid_linear, material=MATERIAL, comm=MPI.COMM_WORLD):
    mesh = meshes.block(length, width, height, divisions=(cells, 1, 1), comm=comm)
    interfaces = [Interface("x_min"), Interface("x_max")]
    return ContinuumModel(mesh, form, material, degree=2, interfaces=interfaces)


def along(model):
    """Positions and displacements of this rank's nodes along x, of a prestressed model."""
    own = slice(0, model.n_owned_nodes)
    u = model.state.displacement[model.displacement_dofs[own, 0]]
    return model.layout.base.node_x[own, 0], u


def small_strain():
    """The linear solid with a quadratic energy."""

    def strain_energy(u, p):
        (_, rule), *_ = solid_linear.strain_energy(u, p)
        strain = ufl.sym(ufl.grad(u))
        return [(p.E / 2 * ufl.inner(strain, strain), rule)]

    form = types.ModuleType("small_strain")
    form.__dict__.update(vars(solid_linear), strain_energy=strain_energy, __name__="small_strain")
    return form


@pytest.mark.mpi
def test_rotating_bar():
    """u = sin(a x) / (a cos(a L)) - x with the force at the displaced points, a^2 = rho w^2 / E.

    Without it, that is for small w, u = rho w^2 / (2 E) (x L^2 - x^3 / 3).  The bar is as high as long, since a slender
    one of quadratic energy gives way sideways; by symmetry of the stiffness that does not touch the end's mean.
    """
    length = 1.2
    model = bar(length, width=0.1, height=length, cells=6, form=small_strain())

    def state(a_l):
        omega = a_l / length * np.sqrt(MATERIAL.E / MATERIAL.rho)
        return prestressed(model, frame="x_min", angular_velocity=(0.0, omega, 0.0))

    def stretch(loaded):
        return loaded.interface("x_max").p[0] - model.interface("x_max").p[0]

    slow = stretch(state(1e-3))
    assert slow == pytest.approx(1e-6 * length / 3, rel=1e-5)
    fast = state(0.7)
    assert stretch(fast) == pytest.approx(length * (np.tan(0.7) / 0.7 - 1.0), rel=1e-5)
    assert stretch(fast) > 1.2 * 0.7**2 * length / 3
    assert fast.state.note.endswith("no change of the stiffness, as of a quadratic strain energy")


def test_rotating_bar_of_finite_strain():
    """St Venant-Kirchhoff in one dimension, (F (F^2 - 1) / 2)' E + rho w^2 (x + u) = 0, by another solver."""
    length, a_l = 1.2, 0.6
    # narrow, so that what lies off the axis hardly counts
    model = bar(length, width=0.04, height=0.04, cells=8, comm=MPI.COMM_SELF)
    omega = a_l / length * np.sqrt(MATERIAL.E / MATERIAL.rho)
    x, u = along(prestressed(model, frame="x_min", angular_velocity=(0.0, 0.0, omega)))

    def slopes(x, y):
        # y: place x + u, and F
        return np.array([y[1], -((a_l / length) ** 2) * y[0] / (1.5 * y[1] ** 2 - 0.5)])

    grid = np.linspace(0.0, length, 200)
    start = np.array([grid, np.ones_like(grid)])
    exact = solve_bvp(slopes, lambda y0, y1: np.array([y0[0], y1[1] - 1.0]), grid, start, tol=1e-9)
    assert exact.success
    assert abs(u - (exact.sol(x)[0] - x)).max() < 1e-5 * abs(u).max()


LONG, SQUARE = 1.0, (0.04, 0.02)
BENDING = MATERIAL.E * SQUARE[0] * SQUARE[1] ** 3 / 12
PER_LENGTH = MATERIAL.rho * SQUARE[0] * SQUARE[1]
BUCKLING = np.pi**2 * BENDING / (4 * LONG**2)


def beam(**more):
    return bar(LONG, width=SQUARE[0], height=SQUARE[1], cells=16, **more)


def first_frequency(axial):
    """Of a cantilever by Euler and Bernoulli under an axial force (tension positive) of fixed direction, rad/s."""

    def determinant(omega):
        # w = A (cosh a x - cos b x) + B (sinh a x / a - sin b x / b)
        half, root = axial / (2 * BENDING), np.sqrt((axial / (2 * BENDING)) ** 2 + PER_LENGTH * omega**2 / BENDING)
        a, b = np.sqrt(root + half), np.sqrt(root - half)
        ch, sh, c, s = np.cosh(a * LONG), np.sinh(a * LONG), np.cos(b * LONG), np.sin(b * LONG)
        slope = np.array([a * sh + b * s, ch - c])
        curvature = np.array([a**2 * ch + b**2 * c, a * sh + b * s])
        third = np.array([a**3 * sh - b**3 * s, a**2 * ch + b**2 * c])
        return np.linalg.det([curvature, third - axial / BENDING * slope])

    guess = 3.516 * np.sqrt(BENDING / PER_LENGTH / LONG**4 * (1.0 + axial / BUCKLING))
    return brentq(determinant, 0.7 * guess, 1.3 * guess)


def test_the_closed_form():
    assert first_frequency(1e-9) == pytest.approx(3.51602 * np.sqrt(BENDING / PER_LENGTH / LONG**4), rel=1e-5)


def beam_of_sections(comm):
    """The same beam by its axis."""
    section = beam_timoshenko.Parameters.rectangle(
        MATERIAL.E, MATERIAL.nu, MATERIAL.rho, width=SQUARE[0], height=SQUARE[1], orientation=(0.0, 1.0, 0.0)
    )
    mesh = meshes.line(LONG, divisions=16, comm=comm)
    interfaces = [Interface("start"), Interface("end")]
    return ContinuumModel(mesh, beam_timoshenko, section, degree=2, interfaces=interfaces)


def of_solids(comm):
    return beam(comm=comm)


@pytest.mark.parametrize(
    ("made", "ends", "part"),
    [
        *((of_solids, ("x_min", "x_max"), part) for part in (1.0, 4.0, -0.5, -0.9)),
        *((beam_of_sections, ("start", "end"), part) for part in (4.0, -0.9)),
    ],
)
def test_frequency_under_an_axial_force(made, ends, part):
    model, (root, tip) = made(MPI.COMM_SELF), ends
    plain = craig_bampton(model, modes=4, frame=root, geometric_stiffness=False)
    loaded = prestressed(model, frame=root, forces={tip: (part * BUCKLING, 0, 0, 0, 0, 0)})
    body = craig_bampton(loaded, modes=4, frame=root)
    found = np.sqrt(body.stiffness[0] / plain.stiffness[0])
    # ratios, in which shear takes part by (h / L)^2
    expected = first_frequency(part * BUCKLING) / first_frequency(1e-9)
    assert found == pytest.approx(expected, rel=2e-3)
    assert np.array_equal(body.R_MB, plain.R_MB)
    stretch = part * BUCKLING / (MATERIAL.E * SQUARE[0] * SQUARE[1]) * LONG
    assert body.interface(tip).p_BI_B[0] - LONG == pytest.approx(stretch, rel=1e-3)
    assert body.mass == pytest.approx(plain.mass, rel=1e-12)
    assert body.com[0] - LONG / 2 == pytest.approx(stretch / 2, rel=1e-3)
    # the sections' own inertia has not gone
    assert body.inertia[0, 0] == pytest.approx(plain.inertia[0, 0], rel=1e-3)


def enclosed(error):
    """The part of the loads that a body bears, and that which it does not, after an error."""
    found = re.search(r"one up to (\S+) of the loads and none was found at (\S+):", str(error.value))
    bears, fails = map(float, found.groups())
    assert 0.0 < fails - bears < 0.008
    assert len(set(MPI.COMM_WORLD.allgather(str(error.value)))) == 1
    return bears, fails


@pytest.mark.parametrize(
    ("form", "end"),
    [pytest.param(solid_linear, True, marks=pytest.mark.mpi), (solid_linear, False), (solid_mixed, True)],
)
def test_buckling_load(form, end):
    """Enclosed between two parts of the load, by an interface at the end and without."""
    material = form.Parameters(E=MATERIAL.E, nu=MATERIAL.nu, rho=MATERIAL.rho)
    model = beam(form=form, material=material)
    given = {"forces": {"x_max": (-1.3 * BUCKLING, 0, 0, 0, 0, 0)}}
    if not end:
        model = ContinuumModel(model.mesh, form, material, degree=2, interfaces=[Interface("x_min")])
        given = {"loads": [(Traction("push", "x_max", (-1, 0, 0)), 1.3 * BUCKLING / (SQUARE[0] * SQUARE[1]))]}
    with pytest.raises(ConvergenceError, match="the body buckles") as raised:
        prestressed(model, frame="x_min", **given)
    bears, fails = enclosed(raised)
    # shear takes 0.03 % of it
    assert 1.3 * bears - 0.01 < 1.0 < 1.3 * fails + 0.01


def test_critical_speed():
    """Without the stiffening by tension a beam gives way in the plane of its spin at its first frequency there."""
    lateral = 3.51602 * np.sqrt(MATERIAL.E * SQUARE[1] * SQUARE[0] ** 3 / 12 / PER_LENGTH / LONG**4)
    with pytest.raises(ConvergenceError, match="the body buckles") as raised:
        prestressed(beam(form=small_strain()), frame="x_min", angular_velocity=(0.0, 0.0, 1.2 * lateral))
    bears, fails = enclosed(raised)
    assert 1.2**2 * bears - 0.005 < 1.0 < 1.2**2 * fails + 0.005


def test_spinning_beam_out_of_its_plane():
    """The first flapping frequency, 4.1373 and 5.5850 at 2 and 4 (Wright et al. 1982, doi:10.1115/1.3161966)."""
    model = beam(comm=MPI.COMM_SELF)
    plain = craig_bampton(model, modes=3, frame="x_min", geometric_stiffness=False)
    unit = np.sqrt(BENDING / PER_LENGTH / LONG**4)
    for speed, expected in ((2.0, 4.1373), (4.0, 5.5850)):
        # about y, the axis of the wider side: the beam flaps along z, which is the softer, not about the spin
        loaded = prestressed(model, frame="x_min", angular_velocity=(0.0, 0.0, speed * unit))
        body = craig_bampton(loaded, modes=3, frame="x_min", geometric_stiffness=False)
        assert np.sqrt(body.stiffness[0] / plain.stiffness[0]) == pytest.approx(expected / 3.5160, rel=1e-3)


def test_bent_to_an_arc():
    """A moment bends the beam to a circle; its end turns by M L / (E I) and lies where that circle ends."""
    angle = 1.0
    model = beam(comm=MPI.COMM_SELF)
    loaded = prestressed(model, frame="x_min", forces={"x_max": (0, 0, 0, 0, -angle * BENDING / LONG, 0)})
    tip = guyan(loaded, frame="x_min").interface("x_max")
    assert Rotation.from_matrix(tip.R_BI).as_rotvec() == pytest.approx([0.0, -angle, 0.0], abs=2e-3)
    arc = LONG / angle * np.array([np.sin(angle), 0.0, 1.0 - np.cos(angle)])
    assert tip.p_BI_B == pytest.approx(arc, abs=2e-3)
    # rigid: the distances on the end are what they were
    x = loaded.node_x[loaded.interface("x_max").nodes]
    assert np.ptp(np.linalg.norm(x - loaded.interface("x_max").p, axis=1)[:4]) < 1e-12


WRENCH = 8e5 * (TURN @ np.array([0.6, 0.3, -1.0]))


LOADS = [(Pressure("p", "pad"), 2e7), (BodyForce("b", (0.3, 1.0, 0.0)), 1e7)]


def turn_between(one, other):
    return Rotation.from_matrix(one.R @ other.R.T).as_rotvec()


def test_flexibility_against_neighbouring_states():
    """The reduced body's static response is the derivative of the loaded state by the load, about a bent one.

    The frame lies off its facets, so that its turning moves the force.
    """
    model = bracket("root", "tip", comm=MPI.COMM_SELF, degree=1)

    def state(extra):
        return prestressed(model, frame="root", loads=LOADS, forces={"tip": np.array([*WRENCH, 0, 0, 0]) + extra})

    middle = state(np.zeros(6))
    frame = middle.interface("tip")
    assert 0.05 < np.linalg.norm(turn_between(frame, model.interface("tip"))) < 0.5
    body = craig_bampton(middle, modes=2, frame="root")
    rows = body.interface("tip").modes
    flexibility = rows @ np.diag(1.0 / body.stiffness) @ rows.T
    axes = np.kron(np.eye(2), body.R_MB)
    flexibility = axes @ flexibility @ axes.T
    assert body.interface("tip").p_BI_B == pytest.approx(body.R_MB.T @ (frame.p - body.p_MB_M), abs=1e-14)
    found = np.empty((6, 6))
    for i, step in enumerate(np.repeat([1e3, 1e2], 3)):
        plus, minus = (state(sign * step * np.eye(6)[i]).interface("tip") for sign in (1, -1))
        found[:3, i] = (plus.p - minus.p) / (2 * step)
        found[3:, i] = turn_between(plus, minus) / (2 * step)
    size = np.sqrt(np.diag(flexibility))
    assert abs((found - flexibility) / np.outer(size, size)).max() < 1e-5


@pytest.mark.mpi
@pytest.mark.parametrize("averaged", ["tip", "root"])
def test_averaged_interface_against_neighbouring_states(averaged):
    """A uniform traction is a force on the average, so that the reduced body follows it exactly."""
    couplings = {"root": fm.Coupling.RIGID, "tip": fm.Coupling.RIGID, averaged: fm.Coupling.AVERAGED}
    model = bracket(interfaces=[Interface(name, coupling=one) for name, one in couplings.items()], degree=1)
    traction = Traction("t", "tip", WRENCH)
    size = np.linalg.norm(WRENCH) / 0.006

    def state(factor):
        return prestressed(model, frame="root", loads=[*LOADS, (traction, factor * size)])

    middle = state(1.0)
    assert 0.05 < np.linalg.norm(turn_between(middle.interface("tip"), model.interface("tip"))) < 0.5
    body = craig_bampton(middle, modes=2, frame="root", loads=[traction])
    response = body.interface("tip").modes @ (body.loads.modal[0] / body.stiffness)
    expected = np.kron(np.eye(2), body.R_MB) @ response
    plus, minus = (state(factor).interface("tip") for factor in (1.003, 0.997))
    step = 0.006 * size
    found = np.concatenate([plus.p - minus.p, turn_between(plus, minus)]) / step
    assert abs(found - expected)[:3].max() < 2e-5 * abs(expected[:3]).max()
    assert abs(found - expected)[3:].max() < 2e-5 * abs(expected[3:]).max()


@pytest.mark.mpi
def test_any_number_of_ranks():
    def reduced(comm):
        loaded = prestressed(
            bracket("root", "tip", "pad", comm=comm, degree=2),
            frame="root",
            loads=[(Traction("t", "tip", TURN[:, 0]), 2e8), (BodyForce("b", TURN[:, 2]), 1e6)],
            forces={"pad": (1e4, 0.0, 2e4, 0.0, 100.0, 0.0)},
            angular_velocity=(100.0, 200.0, 50.0),
        )
        return craig_bampton(loaded, modes=3, frame="root", damping=KelvinVoigtDamping(1e-5), keep=Keep(modes=True))

    world, alone = reduced(MPI.COMM_WORLD), reduced(MPI.COMM_SELF)
    assert len(set(MPI.COMM_WORLD.allgather(world.fingerprint()))) == 1
    assert abs(world.stiffness / alone.stiffness - 1.0).max() < 1e-9
    assert abs(world.damping - alone.damping).max() < 1e-7 * alone.damping.max()
    for one, other in zip(world.interfaces, alone.interfaces, strict=True):
        assert one.p_BI_B == pytest.approx(other.p_BI_B, abs=1e-12)
        assert one.R_BI == pytest.approx(other.R_BI, abs=1e-11)
    assert abs(world.modes.x - alone.modes.x).max() < 1e-12
    # viscous stress has no part of the prestress
    assert abs(world.damping - 1e-5 * np.diag(world.stiffness)).max() > 1e-3 * world.damping.max()


def test_without_loads_nothing_changes():
    model = bracket("root", "tip", comm=MPI.COMM_SELF)
    plain = craig_bampton(model, modes=3, frame="root")
    same = craig_bampton(prestressed(model, frame="root"), modes=3, frame="root")
    assert abs(same.stiffness / plain.stiffness - 1.0).max() < 1e-10
    assert abs(same.gram - plain.gram).max() < 1e-12 * abs(plain.gram).max()
    assert same.provenance["prestress"].splitlines()[0] == "no loads"


def test_stress_of_the_loaded_state():
    """The picture has the stress that is there at q = 0, and the deformation from there."""
    model = bar(0.5, width=0.1, height=0.1, cells=2, comm=MPI.COMM_SELF)
    force = 1e5
    loaded = prestressed(model, frame="x_min", forces={"x_max": (force, 0, 0, 0, 0, 0)})
    body = guyan(loaded, frame="x_min", keep=Keep(modes=True))
    picture = loaded.stress_field(body, np.zeros(body.n_modes))
    assert picture.von_mises == pytest.approx(force / 0.01, rel=1e-3)
    assert not picture.displacement.any()
    stretched = 0.5 * (1.0 + force / 0.01 / MATERIAL.E)
    assert picture.x[:, 0].max() == pytest.approx(stretched, abs=1e-7)
    assert model.stress_field(guyan(model, frame="x_min", keep=Keep(modes=True)), np.zeros(6)).max == 0.0


PUSH = {"forces": {"tip": (1.0, 0, 0, 0, 0, 0)}}


@pytest.mark.mpi
@pytest.mark.parametrize(
    ("given", "error", "match"),
    [
        ({"forces": {"lid": (1.0, 0, 0, 0, 0, 0)}}, InterfaceError, "no interface 'lid'"),
        ({"forces": {"root": (1.0, 0, 0, 0, 0, 0)}}, ReductionError, "'root' is held"),
        ({"forces": {"tip": (1.0, 0, 0)}}, ReductionError, "force on 'tip' must be finite, 6 in number"),
        ({"forces": {"tip": (np.nan, 0, 0, 0, 0, 0)}}, ReductionError, "forces must be a mapping of a text to finite"),
        ({"angular_velocity": 3.0}, ReductionError, "angular_velocity must be finite, 3 in number"),
        ({"loads": [Pressure("p", "pad")]}, ReductionError, "loads must be a list, each a tuple of 2: a Pressure"),
        ({"loads": [(Pressure("p", "pad"), np.inf)]}, ReductionError, "TemperatureRise, a finite number, got"),
        ({"loads": [(Pressure("p", "lid"), 1.0)]}, MeshError, "no facet group 'lid'"),
        ({"frame": "lid"}, InterfaceError, "no interface 'lid'"),
    ],
)
def test_bad_loads_are_refused_on_every_rank(given, error, match):
    with pytest.raises(error, match=match):
        prestressed(bracket("root", "tip", degree=1), **{"frame": "root", **given})


@pytest.mark.mpi
def test_bad_use_is_refused_on_every_rank():
    model = bracket("root", "tip", degree=1)
    loaded = prestressed(model, frame="root", **PUSH)
    for frame in ("tip", None):
        with pytest.raises(ReductionError, match="held at 'root'"):
            craig_bampton(loaded, modes=1, frame=frame)
    with pytest.raises(ReductionError, match="stress modes cannot hold"):
        guyan(loaded, frame="root", keep=Keep(stress=True))
    with pytest.raises(ReductionError, match="prestressed already"):
        prestressed(loaded, frame="root", **PUSH)
    given = [Interface("root"), Interface("tip", coupling=fm.Coupling.AVERAGED)]
    mixed = bracket(interfaces=given, degree=1)
    with pytest.raises(ReductionError, match="'tip' is averaged: load its facets"):
        prestressed(mixed, frame="root", **PUSH)
    sections = beam_of_sections(MPI.COMM_WORLD)
    with pytest.raises(ReductionError, match=r"rotations .* reach 0\.0\d+ rad in the loaded state"):
        prestressed(sections, frame="start", forces={"end": (0.0, 0.0, 0.05 * BUCKLING, 0.0, 0.0, 0.0)})
    averaged = bracket(interfaces=[Interface("root", coupling=fm.Coupling.AVERAGED)], degree=1)
    with pytest.raises(ReductionError, match="no interface of the model is rigid"):
        prestressed(averaged, frame="root")


@pytest.mark.mpi
@pytest.mark.skipif(MPI.COMM_WORLD.size == 1, reason="needs several ranks")
def test_loads_that_differ_between_the_ranks_are_refused():
    model = bracket("root", "tip", degree=1)
    last = MPI.COMM_WORLD.rank == MPI.COMM_WORLD.size - 1
    force, spin = {"tip": (1.0 + last, 0, 0, 0, 0, 0)}, "x" if last else (0, 0, 0)
    for name, given in (("forces", force), ("angular_velocity", spin)):
        with pytest.raises(ReductionError, match=f"{name} is .* on rank 0 and .*; give the same on all ranks"):
            prestressed(model, frame="root", **{name: given})


def test_a_load_that_no_state_bears():
    """A compression far beyond the strength of the law itself says up to what part it got, and where it moves most."""
    model = bracket("root", "tip", comm=MPI.COMM_SELF, degree=1)
    with pytest.raises(ConvergenceError) as raised:
        prestressed(model, frame="root", loads=[(Traction("crush", "tip", -TURN[:, 0]), ALUMINIUM.E)])
    text = str(raised.value)
    assert "traction 'crush' along (-0.830455" in text
    place = np.array(re.search(r"of the point \[(.*)\] m", text)[1].split(","), dtype=float)
    assert (TURN.T @ (place - SHIFT))[0] > 0.5 * LENGTH
