"""Paths of equilibria of bodies: buckling, snap-through, limit loads, branches, flutter; and what is refused."""

from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest
from cantilever import Cantilever
from scipy.interpolate import CubicSpline
from scipy.optimize import brentq
from scipy.special import ellipe, ellipk
from thick_cylinder import LIMIT, cylinder

import flexmbd as fm
from flexmbd import meshes
from flexmbd.continuum import (
    BodyAcceleration,
    NonlinearModel,
    PressureOnFacets,
    TractionOnFacets,
    clamped_dofs,
    equilibrium_path,
    follow,
    load_form,
    prescribed_dofs,
)
from flexmbd.continuum.history.tangent_solver import TangentSolver
from flexmbd.errors import FlexmbdError, FormulationError, SceneError
from flexmbd.forms import beam_exact, neo_hookean, solid_mixed
from flexmbd.forms import st_venant_kirchhoff as svk

LIMIT_POINT, BIFURCATION = fm.CriticalKind.LIMIT, fm.CriticalKind.BIFURCATION
SIZE = 400.0  # m/s^2, by which the panel's weight is counted


def panel(*, form=svk, thickness=0.01, comm=MPI.COMM_SELF):
    """A shallow arch of 1 m, clamped at both ends, that rises by 30 mm."""
    mesh = meshes.block(1.0, 0.1, thickness, divisions=(16, 1, 1), cell="hexahedron", degree=1, comm=comm)
    x = mesh.mesh.geometry.x
    x[:, 2] += 4.0 * 0.03 * x[:, 0] * (1.0 - x[:, 0])
    body = NonlinearModel(mesh, form, form.Parameters(E=2e9, nu=0.0, rho=1000.0), degree=2)
    return body, clamped_dofs(body, ["x_min", "x_max"])


WEIGHT = [BodyAcceleration((0.0, 0.0, -1.0), lambda t: SIZE * t)]


def at_middle(body, displacement):
    """m, along z, of the upper edge in the middle."""
    x = body.layout.node_x
    middle = np.flatnonzero(abs(x[:, 0] - 0.5) < 1e-9)
    top = middle[x[middle, 2] > x[middle, 2].max() - 1e-9]
    return float(displacement[body.displacement_dofs[top, 2]].mean())


def crown(body):
    """Dofs of the upper edge in the middle along z, and the share of each of its three nodes of a line load."""
    x = body.layout.node_x
    middle = np.flatnonzero(abs(x[:, 0] - 0.5) < 1e-9)
    top = middle[x[middle, 2] > x[middle, 2].max() - 1e-9]
    return body.displacement_dofs[top, 2], np.where(abs(x[top, 1] - x[top, 1].mean()) < 1e-9, 4.0, 1.0) / 6.0


def test_a_panel_snaps_through_at_the_loads_that_displacement_control_finds():
    """Its load is largest and smallest where the force that leads its crown down is."""
    body, held = panel()
    dofs, shares = crown(body)
    led = np.sort(np.concatenate([held, dofs])).astype(np.int32)
    is_crown = np.isin(led, dofs)
    sunk = np.linspace(5e-4, 0.06, 120)
    steps = follow(body, sunk, prescribed=led, displacement=lambda t: np.where(is_crown, -t, 0.0)).steps
    force = -np.array([one.reactions[is_crown].sum() for one in steps])

    loaded, held = panel()
    whole = np.zeros(loaded.n_owned)
    whole[dofs] = -shares
    path = equilibrium_path(loaded, fm.Continuation(to=1.5 * force.max()), prescribed=held, load=lambda t: t * whole)
    assert path.end is fm.PathEnd.REACHED
    # the same curve, wherever the path goes up or down
    curve = CubicSpline(sunk, force)
    for one in path.points:
        down = -at_middle(loaded, one.displacement)
        if sunk[1] < down < sunk[-2]:
            assert one.t == pytest.approx(float(curve(down)), abs=2e-4 * force.max())
    turns = curve.derivative().roots(extrapolate=False)
    assert [one.kind for one in path.critical] == [LIMIT_POINT, LIMIT_POINT]
    assert [one.t for one in path.critical] == pytest.approx(curve(turns), rel=1e-5)


def test_a_panel_snaps_through_under_its_weight():
    """Two bifurcations, at which it would bend to one side, and two limit points; where it is stable between."""
    body, held = panel()
    seen = []
    path = equilibrium_path(
        body, fm.Continuation(to=2.0), prescribed=held, loads=WEIGHT,
        accepted=lambda t: seen.append((t, at_middle(body, body.displacement))),
    )  # fmt: skip
    assert [one.kind for one in path.critical] == [BIFURCATION, LIMIT_POINT, BIFURCATION, LIMIT_POINT]
    first, top, second, bottom = (one.t for one in path.critical)
    assert first < top
    assert bottom < second < first
    assert repr(path.critical[1]) == f"<BodyCriticalPoint: limit point at the factor {top:.9g}>"
    assert "limit point at 0.6696" in repr(path)
    # every point is in balance, and the body stands at the last
    assert [t for t, _ in seen] == list(path.factors[1:])
    whole = BodyAcceleration((0.0, 0.0, -1.0), 2.0 * SIZE)
    again, held_again = panel()
    again.displacement[:] = path.points[-1].displacement
    steps = follow(again, [1.0], prescribed=held_again, loads=[whole]).steps
    assert len(steps) == 1
    assert at_middle(again, again.displacement) == pytest.approx(seen[-1][1], rel=1e-7)
    np.testing.assert_array_equal(body.displacement, path.points[-1].displacement)
    # what the bifurcations leave to the other path: a closed one, from the first to the second and back
    with pytest.warns(fm.PathWarning, match=r"is closed: after \d+ points it came back to where it began"):
        aside = equilibrium_path(body, fm.Continuation(to=2.0), prescribed=held, loads=WEIGHT, about=path.critical[0])
    assert aside.end is fm.PathEnd.CLOSED
    assert [one.t for one in aside.critical] == pytest.approx([second, first], rel=1e-6)
    # of a branch the point beside the bifurcation, and the body stands there
    assert aside.factors[-1] == aside.factors[1]
    scale = abs(aside.points[1].displacement).max()
    assert aside.points[-1].displacement == pytest.approx(aside.points[1].displacement, abs=1e-7 * scale)
    np.testing.assert_array_equal(body.displacement, aside.points[-1].displacement)
    # to each critical point some dozen, not fifty
    assert path.factorisations < 5 * len(path.points) + 15 * len(path.critical)
    left, right = (at_side(body, aside.points[5].displacement, x) for x in (0.25, 0.75))
    assert abs(left - right) > 1e-3


def test_steps_do_not_leap_over_what_happens_in_a_small_part_of_the_range():
    """A thin panel snaps within a fortieth of the range, beside other paths: a closer range finds the same."""
    found = []
    for to in (0.02, 0.5):
        body, held = panel(thickness=0.001)
        path = equilibrium_path(body, fm.Continuation(to=to), prescribed=held, loads=WEIGHT)
        assert path.end is fm.PathEnd.REACHED
        found.append(path.critical)
    assert [one.kind for one in found[0]] == [BIFURCATION, LIMIT_POINT, BIFURCATION, LIMIT_POINT]
    assert [one.kind for one in found[1]] == [one.kind for one in found[0]]
    assert [one.t for one in found[1]] == pytest.approx([one.t for one in found[0]], rel=1e-4)


def at_side(body, displacement, place):
    nodes = np.flatnonzero(abs(body.layout.node_x[:, 0] - place) < 1e-9)
    return float(displacement[body.displacement_dofs[nodes, 2]].mean())


def test_pressure_that_follows_has_no_potential():
    """The same critical points within a few 1e-4: of a shallow panel the pressure hardly turns."""
    body, held = panel()
    half = fm.Continuation(to=1.0, most_points=6)
    with pytest.warns(fm.PathWarning):
        dead = equilibrium_path(body, half, prescribed=held, loads=WEIGHT)
    assert len(dead.critical) == 2
    other, held = panel()
    pressure = PressureOnFacets("z_max", lambda t: 1000.0 * 0.01 * SIZE * t)
    with pytest.warns(fm.PathWarning):
        path = equilibrium_path(other, half, prescribed=held, loads=[pressure])
    assert [one.kind for one in path.critical] == [one.kind for one in dead.critical]
    for one, its in zip(path.critical, dead.critical, strict=True):
        assert one.t == pytest.approx(its.t, rel=3e-3)
        assert one.t != its.t


def column(divisions, *, height=0.02, form=svk):
    """A cantilever of 1 m under a pressing dead force at its end, in units of EI / L^2."""
    mesh = meshes.block(1.0, 0.03, height, divisions=(divisions, 1, 1), cell="hexahedron", degree=2, comm=MPI.COMM_SELF)
    body = NonlinearModel(mesh, form, form.Parameters(E=1e9, nu=0.0, rho=1000.0), degree=2)
    bending = 1e9 * 0.03 * height**3 / 12.0
    load = TractionOnFacets("x_max", (-bending / (0.03 * height), 0.0, 0.0), lambda t: t)
    return body, clamped_dofs(body, ["x_min"]), [load]


@pytest.mark.parametrize(("form", "side"), [(svk, 1), (svk, -1), (neo_hookean, 1)])
def test_a_column_buckles_to_the_elastica(form, side):
    """Tip at 2 E / K - 1 and 2 k / K under K(k)^2 EI / L^2 (Timoshenko & Gere 1961, section 2.7)."""
    body, held, loads = column(20, form=form)
    straight = equilibrium_path(body, fm.Continuation(to=4.0), prescribed=held, loads=loads)
    (critical,) = straight.critical
    assert critical.kind is BIFURCATION
    assert critical.t == pytest.approx(np.pi**2 / 4, rel=1e-3)
    assert [one.unstable for one in straight.points] == [int(one.t > critical.t) for one in straight.points]
    bent = equilibrium_path(
        body, fm.Continuation(to=3.5, side=side), prescribed=held, loads=loads, about=critical
    )
    assert bent.factors[0] == critical.t
    assert all(one.unstable == 0 for one in bent.points[1:])
    end = body.displacement_dofs[body.layout.nodes_on(2, body.mesh.facets("x_max"))]
    for one in bent.points[3:]:
        k = brentq(lambda k, one=one: ellipk(k * k) ** 2 - one.t, 1e-6, 0.999999)
        exact = 2 * ellipe(k * k) / ellipk(k * k) - 2, 2 * k / ellipk(k * k)
        x, _, z = one.displacement[end].mean(axis=0)
        assert (x, abs(z)) == pytest.approx(exact, abs=6e-3)
    other = equilibrium_path(body, fm.Continuation(to=3.5, side=-side), prescribed=held, loads=loads, about=critical)
    first, second = (path.points[5].displacement[end].mean(axis=0)[2] for path in (bent, other))
    assert first == pytest.approx(-second, rel=1e-5)


def test_a_branch_begins_where_the_stiffness_is_singular_to_the_last_bit(monkeypatch):
    """What a factor gives there is not asked for."""
    body, held, loads = column(6)
    (critical,) = equilibrium_path(body, fm.Continuation(to=4.0), prescribed=held, loads=loads).critical
    whole, asked = TangentSolver.solve_block, []

    def singular_at_first(self, block):
        asked.append(len(block))
        return whole(self, block) if len(asked) > 1 else np.full_like(block, np.nan)

    monkeypatch.setattr(TangentSolver, "solve_block", singular_at_first)
    bent = equilibrium_path(body, fm.Continuation(to=2.6), prescribed=held, loads=loads, about=critical)
    assert bent.end is fm.PathEnd.REACHED
    assert abs(at_side(body, bent.points[-1].displacement, 1.0)) > 0.1


def becks_column(divisions, *, height=0.02, unit=1.0, comm=MPI.COMM_SELF):
    """The path of a cantilever whose end is pressed by what follows it, t EI / L^2; ``unit``: m for a length of one."""
    size = [part / unit for part in (1.0, 1.5 * height, height)]
    mesh = meshes.block(*size, divisions=(divisions, 1, 1), cell="hexahedron", degree=2, comm=comm)
    # forces stay in N
    body = NonlinearModel(mesh, svk, svk.Parameters(E=1e9 * unit**2, nu=0.0, rho=1000.0 * unit**4), degree=2)
    pressure = 1e9 * height**2 / 12.0 * unit**2
    load = PressureOnFacets("x_max", lambda t: t * pressure)
    path = equilibrium_path(body, fm.Continuation(to=25.0), prescribed=clamped_dofs(body, ["x_min"]), loads=[load])
    return body, path


def test_becks_column_flutters():
    """At 20.05 EI / L^2 where it is thin (Beck 1952), without ever having another equilibrium.

    Shear, rotary inertia and shortening take of it by the square of the height.
    """
    found = []
    for height in (0.04, 0.02):
        body, path = becks_column(20, height=height)
        (critical,) = path.critical
        assert critical.kind is fm.CriticalKind.FLUTTER
        assert list(path.unstable) == [2 * (one.t > critical.t) for one in path.points]
        found.append(critical.t)
    assert (4.0 * found[1] - found[0]) / 3.0 == pytest.approx(20.0509, rel=4e-3)
    # it bends in the weak plane, as the two lowest vibrations that have met
    end = body.displacement_dofs[body.layout.nodes_on(2, body.mesh.facets("x_max"))]
    assert abs(critical.mode[end[:, 2]]).min() > 0.2
    assert abs(critical.mode[body.displacement_dofs[:, 1]]).max() < 1e-3


def test_becks_column_in_other_units():
    """Of mm, t and s: the same factor."""
    loads = [becks_column(4, unit=unit)[1].critical[0].t for unit in (1.0, 1e-3)]
    assert loads[1] == pytest.approx(loads[0], rel=1e-6)


def test_a_beam_with_rotations_buckles_as_the_exact_beam_does():
    """Euler's load, less what shear and shortening take: P = P_E (1 - P_E / kGA + P_E / EA) to first order."""
    E, A, inertia = 1e9, 2e-3, 2.67e-7
    p = beam_exact.Parameters(
        E=E, nu=0.3, rho=1000.0, A=A, Iy=inertia, Iz=3 * inertia, J=4 * inertia, ky=5 / 6, kz=5 / 6,
        orientation=(0.0, 0.0, 1.0),
    )  # fmt: skip
    beam = Cantilever(p, length=1.0, n=8)
    whole = np.zeros(beam.body.n_owned)
    whole[beam.tip[0]] = -E * inertia
    path = equilibrium_path(beam.body, fm.Continuation(to=4.0), prescribed=beam.held, load=lambda t: t * whole)
    (critical,) = path.critical
    euler = np.pi**2 / 4
    strain = euler * inertia / A
    assert critical.kind is BIFURCATION
    assert critical.t == pytest.approx(euler * (1.0 - strain * (2.6 * 6 / 5 - 1.0)), rel=2e-5)


def test_a_perfectly_plastic_cylinder_stays_at_its_limit_pressure():
    """Beyond the limit it widens under one pressure, which no control of the load follows."""
    body, held, force = cylinder((4, 6))
    with pytest.warns(fm.PathWarning, match="broken off after 25 points"):
        path = equilibrium_path(
            body, fm.Continuation(to=1.5, most_points=25), prescribed=held, load=lambda t: t * LIMIT * force
        )
    assert path.end is fm.PathEnd.POINTS
    assert path.critical == ()
    assert all(one.unstable == 0 for one in path.points)
    assert path.factors[-1] == pytest.approx(1.0, abs=1e-2)
    assert np.ptp(path.factors[-5:]) < 1e-9
    moved = [abs(one.displacement).max() for one in path.points]
    assert moved[-1] > 100.0 * moved[3]


@pytest.mark.parametrize("enhanced", [False, True])
def test_unknowns_without_mass_do_not_count_as_unstable(enhanced):
    """A tangent has a negative eigenvalue for each pressure, and a positive one for each enhanced strain."""
    form = load_form(Path(__file__).parents[1] / "data" / "enhanced_strain.py") if enhanced else solid_mixed
    cell, degree = ("hexahedron", 1) if enhanced else ("tetrahedron", 2)
    mesh = meshes.block(1.0, 0.1, 0.05, divisions=(4, 1, 1), cell=cell, degree=1, comm=MPI.COMM_SELF)
    material = form.Parameters(E=1e6, nu=0.3 if enhanced else 0.4999, rho=1000.0)
    body = NonlinearModel(mesh, form, material, degree=degree, condense=False)
    held, force = clamped_dofs(body, ["x_min"]), np.zeros(body.n_owned)
    force[body.displacement_dofs[body.layout.nodes_on(2, mesh.facets("x_max")), 2]] = 1e-3
    path = equilibrium_path(body, fm.Continuation(to=1.0), prescribed=held, load=lambda t: t * force)
    assert [one.unstable for one in path.points] == [0] * len(path.points)


@pytest.mark.mpi
def test_a_path_is_the_same_on_any_number_of_ranks():
    body, held = panel(comm=MPI.COMM_WORLD)
    alone, held_alone = panel()
    half = fm.Continuation(to=1.0, most_points=6)
    with pytest.warns(fm.PathWarning):
        path = equilibrium_path(body, half, prescribed=held, loads=WEIGHT)
    with pytest.warns(fm.PathWarning):
        same = equilibrium_path(alone, half, prescribed=held_alone, loads=WEIGHT)
    assert len(path.critical) == 2
    assert [one.t for one in path.critical] == pytest.approx([one.t for one in same.critical], rel=1e-6)
    assert path.factors == pytest.approx(same.factors, rel=1e-5, abs=1e-6)
    assert [one.unstable for one in path.points] == [one.unstable for one in same.points]


@pytest.mark.mpi
def test_flutter_is_the_same_on_any_number_of_ranks():
    alone, whole = (becks_column(6, comm=comm)[1] for comm in (MPI.COMM_SELF, MPI.COMM_WORLD))
    assert [one.t for one in whole.critical] == pytest.approx([one.t for one in alone.critical], rel=1e-6)
    assert list(whole.unstable) == list(alone.unstable)


def test_a_path_that_is_lost_keeps_what_it_found():
    """A load that jumps: the body stands where the last equilibrium was."""
    body, held = panel()
    jumps = [BodyAcceleration((0.0, 0.0, -1.0), lambda t: SIZE * t + (1e5 if t > 0.3 else 0.0))]
    with pytest.raises(fm.PathError, match=r"cannot be followed beyond the factor 0\.[123]") as caught:
        equilibrium_path(body, fm.Continuation(to=1.0), prescribed=held, loads=jumps)
    path = caught.value.path
    assert path.end is fm.PathEnd.LOST
    assert path.points[-1].t <= 0.3
    np.testing.assert_array_equal(body.displacement, path.points[-1].displacement)


def test_a_load_that_does_nothing_at_first_is_followed():
    body, held = panel()
    squared = [BodyAcceleration((0.0, 0.0, -1.0), lambda t: SIZE * t * t)]
    path = equilibrium_path(body, fm.Continuation(to=0.5), prescribed=held, loads=squared)
    again, held = panel()
    follow(again, [0.25], prescribed=held, loads=WEIGHT)
    size = abs(again.displacement).max()
    np.testing.assert_allclose(path.points[-1].displacement, again.displacement, rtol=0.0, atol=1e-7 * size)


@pytest.mark.parametrize(
    ("given", "error", "pattern"),
    [
        ({"path": fm.Continuation(to=0.0)}, SceneError, "ends at the load factor 0 at which it begins"),
        ({"path": fm.Continuation(to=1.0, back_to=0.5)}, SceneError, "does not lie on the other side"),
        ({"loads": [BodyAcceleration((0.0, 0.0, -1.0), 1.0)]}, SceneError, "do not change with the load factor"),
        ({"path": 2.0}, FormulationError, "path must be"),
        ({"about": 1.0}, FormulationError, "about must be"),
        ({"reached": np.nan}, FormulationError, "reached must be"),
        ({"loads": [BodyAcceleration((0.0, 0.0, -1.0), lambda t: np.nan)]}, SceneError, "finite"),
    ],
)
def test_what_is_refused(given, error, pattern):
    body, held = panel()
    with pytest.raises(error, match=pattern) as caught:
        equilibrium_path(body, **{"path": fm.Continuation(to=1.0), "prescribed": held, "loads": WEIGHT, **given})
    assert isinstance(caught.value, FlexmbdError)


@pytest.mark.parametrize(
    ("given", "pattern"),
    [
        ({"prescribed": "abc"}, "prescribed must be dofs, as prescribed_dofs"),
        ({"prescribed": None}, "prescribed must be dofs, as"),
        ({"prescribed": np.array([0.5])}, "prescribed must be dofs, as"),
        ({"prescribed": np.array([10**9])}, "prescribed must be dofs that this rank owns"),
        ({"prescribed": np.array([-1])}, "prescribed must be dofs that this rank owns"),
        ({"prescribed": np.array([1, 1])}, "a dof twice"),
        ({"load": lambda t: np.zeros(3)}, r"load gave an array of shape \(3,\)"),
        ({"load": lambda t: "x"}, "load gave"),
        ({"displacement": lambda t: np.zeros(1)}, "displacement gave an array of shape"),
        ({"displacement": lambda t: np.nan}, "displacement gave"),
    ],
)
def test_given_dofs_and_loads_that_are_none(given, pattern):
    """By steps of the load as along the arc."""
    body, held = panel()
    how = {"prescribed": held, "loads": WEIGHT, **given}
    with pytest.raises(FormulationError, match=pattern):
        equilibrium_path(body, fm.Continuation(to=0.1), **how)
    with pytest.raises(FormulationError, match=pattern):
        follow(body, [0.1], **how)


def test_a_load_that_is_no_number_is_no_equilibrium():
    """It converged, with reactions that are none."""
    body, held = panel()
    with pytest.raises(FormulationError, match=r"load gave values that are not finite at 0\.1"):
        follow(body, [0.1], prescribed=held, load=lambda t: np.full(body.n_owned, np.nan))


def test_a_body_that_is_held_by_nothing():
    body, _ = panel()
    for held in (np.zeros(0, dtype=np.int32), prescribed_dofs(body, {"x_min": "xz", "x_max": "xz"})):
        with pytest.raises(SceneError, match=r"the body can move as a whole.*prescribed_dofs"):
            equilibrium_path(body, fm.Continuation(to=1.0), prescribed=held, loads=WEIGHT)
