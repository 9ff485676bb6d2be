"""Loads on bodies with history: against closed forms, in slow loading, in explicit runs and in machines."""

import re

from mpi4py import MPI

import numpy as np
import pytest
from interior_momentum import linear_momentum
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

import flexmbd as fm
from flexmbd import meshes
from flexmbd.continuum import (
    BodyAcceleration,
    CentrifugalLoad,
    ExplicitContinuum,
    ExplicitRun,
    ForceAtNodes,
    Heating,
    ImplicitContinuum,
    Interface,
    MpiTeam,
    NonlinearModel,
    PressureOnFacets,
    TractionOnFacets,
    Voltage,
    follow,
    prescribed_dofs,
)
from flexmbd.continuum.history.applied_loads import AppliedLoads
from flexmbd.continuum.history.loads import told
from flexmbd.errors import MeshError, SceneError
from flexmbd.forms import hencky_plasticity, j2_plasticity, neo_hookean, solid_linear
from flexmbd.multibody.bodies.continuum_body import FrameMotion, Scheme

COMM = MPI.COMM_WORLD
FACES = ("x_min", "x_max", "y_min", "y_max", "z_min", "z_max")
RUBBER = neo_hookean.Parameters(E=1e6, nu=0.3, rho=1000.0)
SUPPORTS = {"x_min": "x", "y_min": "y", "z_min": "z"}


def cube(cell="hexahedron", degree=1, *, form=neo_hookean, parameters=RUBBER, size=1.0, comm=COMM, **options):
    mesh = meshes.block(size, size, size, divisions=(2, 2, 2), cell=cell, comm=comm)
    return NonlinearModel(mesh, form, parameters, degree=degree, **options)


def bent(X):
    return X + 0.1 * np.sin(3.0 * X[:, [1, 2, 0]]) * X[:, [2, 0, 1]]


def total(comm, values):
    return np.asarray(sum(comm.allgather(values)))


@pytest.mark.mpi
@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
def test_a_pressure_that_follows_a_closed_surface_has_no_resultant(cell, degree):
    """Gauss: of any shape its force and its moment are zero, and its work is p times the change of volume."""
    body = cube(cell, degree)
    loads = AppliedLoads(body, [PressureOnFacets(face, 1.0) for face in FACES])
    x = bent(body.layout.node_x[: body.layout.n_owned_nodes])
    force = loads.following(np.ones(6), x)
    size = total(COMM, abs(force).sum())
    assert size > 5.0
    assert abs(total(COMM, force.sum(axis=0))).max() < 1e-14 * size
    assert abs(total(COMM, np.cross(x, force).sum(axis=0))).max() < 1e-14 * size
    # of a motion along x the volume grows by 3, and -x . f is three volumes
    grown = 1e-3
    larger = loads.following(np.ones(6), (1.0 + grown) * x)
    volumes = [-total(COMM, (place * f).sum()) / 3.0 for place, f in ((x, force), ((1.0 + grown) * x, larger))]
    assert volumes[1] / volumes[0] == pytest.approx((1.0 + grown) ** 3, rel=1e-13)


@pytest.mark.mpi
@pytest.mark.parametrize(("cell", "degree"), [("hexahedron", 1), ("tetrahedron", 2)])
def test_slopes_of_loads_that_follow_are_derivatives(cell, degree):
    body = cube(cell, degree)
    given = [
        PressureOnFacets("x_max", 1.0, name="p"),
        TractionOnFacets("y_max", (1.0, -2.0, 0.5), follows=True, name="t"),
        CentrifugalLoad((1.0, 2.0, -1.0), point=(0.3, 0.0, 0.0), name="c"),
    ]
    loads = AppliedLoads(body, given)
    n = body.layout.n_owned_nodes
    x, move = bent(body.layout.node_x[:n]), np.cos(7.0 * body.layout.node_x[:n] + 1.0)
    for values in np.eye(3):
        matrix = body.tangent(np.zeros(body.layout.n_local))
        matrix.zeroEntries()
        loads.add_slopes(matrix, values, x)
        right, left = matrix.createVecs()
        right.array[:] = move.reshape(-1)
        matrix.mult(right, left)
        step = 1e-5
        found = (loads.following(values, x + step * move) - loads.following(values, x - step * move)) / (2 * step)
        most = COMM.allreduce(abs(found).max(), op=MPI.MAX)
        assert most > 0.0
        assert abs(found.reshape(-1) + left.array).max() < 2e-8 * most


@pytest.mark.mpi
@pytest.mark.parametrize("follows", [True, False])
def test_a_block_of_rubber_under_pressure_shrinks_as_the_closed_form(follows):
    """The stretch s is that of sigma(s) = -p, or where the load is dead of s^2 sigma(s) = -p."""
    body = cube()
    p, mu, lam = 4e5, 1e6 / 2.6, 0.3e6 / (1.3 * 0.4)
    loads = [PressureOnFacets(face, lambda t: t * p, follows=follows) for face in ("x_max", "y_max", "z_max")]
    path = follow(body, [0.5, 1.0], prescribed=prescribed_dofs(body, SUPPORTS), loads=loads)

    def lacking(s):
        stress = (mu * (s**2 - 1.0) + 3.0 * lam * np.log(s)) / s**3
        return stress * (1.0 if follows else s**2) + p

    s = brentq(lacking, 0.5, 1.0)
    n = body.layout.n_owned_nodes
    corner = np.array([0.0, -0.5, -0.5])
    assert abs(body.node_x[:n] - corner - s * (body.layout.node_x[:n] - corner)).max() < 1e-8
    # quadratic: the slopes of the load are in the tangent
    assert max(len(step.residuals) for step in path.steps) <= 6


def test_a_thick_cylinder_under_pressure_is_lames():
    inner, outer, E, nu, p = 0.1, 0.2, 210e9, 0.3, 1e6
    mesh = meshes.quarter_ring(0.02, outer, inner, divisions=(12, 16, 1), comm=COMM)
    body = NonlinearModel(mesh, solid_linear, solid_linear.Parameters(E=E, nu=nu, rho=7800.0), degree=1)
    held = prescribed_dofs(body, {"x_min": "x", "y_min": "y", "bottom": "z", "top": "z"})
    follow(body, [1.0], prescribed=held, loads=[PressureOnFacets("inner", p)])
    nodes = body.layout.nodes_on(2, mesh.facets("outer"))
    radial = np.linalg.norm(body.node_x[nodes, :2], axis=1) - np.linalg.norm(body.layout.node_x[nodes, :2], axis=1)
    exact = 2.0 * (1.0 - nu**2) * p * inner**2 * outer / (E * (outer**2 - inner**2))
    assert radial == pytest.approx(exact, rel=3e-3)


def test_a_cantilever_sags_under_its_weight():
    """rho A g L^4 / 8 EI, and L^2 / 2 of shear."""
    L, a, E, rho, g = 1.0, 0.05, 2e9, 1000.0, 9.81
    mesh = meshes.block(L, a, a, divisions=(10, 1, 1), comm=COMM)
    body = NonlinearModel(mesh, solid_linear, solid_linear.Parameters(E=E, nu=0.0, rho=rho), degree=2)
    held = prescribed_dofs(body, {"x_min": "xyz"})
    follow(body, [1.0], prescribed=held, loads=[BodyAcceleration((0.0, 0.0, -g), factor=lambda t: t)])
    tip = body.layout.nodes_on(2, mesh.facets("x_max"))
    w, area = rho * a * a * g, a * a
    exact = w * L**4 / (8.0 * E * a**4 / 12.0) + w * L**2 / (2.0 * 5.0 / 6.0 * E / 2.0 * area)
    assert body.layout.node_x[tip, 2] - body.node_x[tip, 2] == pytest.approx(exact, rel=2e-3)


def test_a_rod_that_turns_steadily_is_pulled_long():
    """u(L) = rho w^2 L^3 / 3E for small strain; about an axis beside its end by more."""
    L, E, rho, w, beside = 1.0, 2e9, 1000.0, 50.0, 0.2
    mesh = meshes.block(L, 0.05, 0.05, divisions=(6, 1, 1), comm=COMM)
    body = NonlinearModel(mesh, solid_linear, solid_linear.Parameters(E=E, nu=0.0, rho=rho), degree=2)
    held = prescribed_dofs(body, {"x_min": "xyz"})
    axis = CentrifugalLoad((0.0, 0.0, w), point=(-beside, 0.0, 0.0), factor=lambda t: t)
    follow(body, [1.0], prescribed=held, loads=[axis])
    tip = body.layout.nodes_on(2, mesh.facets("x_max"))
    exact = rho * w**2 / E * (L**3 / 3.0 + beside * L**2 / 2.0)
    # the load grows with the displacement, by rho w^2 L^2 / E
    assert body.node_x[tip, 0] - L == pytest.approx(exact, rel=2.0 * rho * w**2 * L**2 / E)


@pytest.mark.mpi
def test_a_thrown_body_takes_up_the_impulses_of_its_loads():
    """Momentum by central differences is that of the trapezoidal sum of forces; the account closes to round-off."""
    body = cube(form=hencky_plasticity, parameters=hencky_plasticity.Parameters(1e7, 0.3, 1000.0, 1e3))
    pulse = fm.Sine(amplitude=300.0, omega=40.0)
    loads = [
        TractionOnFacets("x_max", (0.0, 1.0, 0.5), factor=pulse, name="shear"),
        PressureOnFacets("z_min", 2000.0, name="blow"),
        ForceAtNodes([0, 5, 5], (10.0, 0.0, 0.0), name="pull"),
        BodyAcceleration((0.0, 0.0, -3.0), name="apparent"),
    ]
    run = ExplicitRun(body, loads=loads, gravity=(0.0, 0.0, -9.81))
    account = run.simulate(0.02)
    momentum = run.motion.momentum(np.zeros(3))[:3]
    mass, t_end = 1000.0, 0.02
    swing = 300.0 / 40.0 * (1.0 - np.cos(40.0 * t_end))
    known = np.array([30.0 * t_end, swing, 0.5 * swing - 12.81 * mass * t_end])
    blow = momentum - known
    # the pressure pushes along z, and aside as far as the face turns
    assert blow[2] == pytest.approx(2000.0 * t_end, rel=1e-2)
    assert abs(blow[:2]).max() < 1e-2 * 2000.0 * t_end
    assert account["plastic"][-1] > 0.0
    kept = sum(account[name] for name in ("kinetic", "gravitational", "loads")) + account.internal
    # what is left is of the factor, which is asked for a millionth of a step beside
    assert abs(kept - kept[0]).max() < 1e-8 * np.ptp(account["loads"])


def freely_flying(interior, t_end, *, comm, **options):
    """A block between two frames, free in a machine."""
    scene = fm.System(gravity=(0.0, 0.0, -9.81), **({} if comm.size == 1 else {"team": MpiTeam(comm)}))
    block = scene.add(fm.ContinuumBody(interior), name="block")
    scene.connect(fm.joint.Free(), scene.ground.frame(p=interior.frames[0].p_BI_B), block.frame("x_min"))
    return scene, block, scene.simulate(t_end, **options)


JUMP = 1.3e-3
STEPPED = {
    "explicit": (ExplicitContinuum, {"integrator": fm.CentralDifference()}),
    "implicit": (ImplicitContinuum, {"rtol": 1e-4}),
}


@pytest.mark.mpi
@pytest.mark.parametrize("way", STEPPED)
def test_a_force_that_begins_at_an_instant_gives_its_impulse_in_a_machine(way):
    """The step ends where it begins; momentum in flight is that of weight and force, whatever the body deforms."""
    kind, options = STEPPED[way]
    parameters = hencky_plasticity.Parameters(1e8, 0.3, 1000.0, 1e6)
    body = cube(form=hencky_plasticity, parameters=parameters, size=0.2, interfaces=[Interface("x_min")])
    force = fm.Piecewise(lambda t: 4e4 if t >= JUMP else 0.0, breaks=[JUMP])
    interior = kind(body, loads=[TractionOnFacets("x_max", (0.0, 0.0, 1.0), factor=force, name="push")])
    _, block, run = freely_flying(interior, 3e-3, comm=COMM, **options)
    assert np.isclose(run.t, JUMP, rtol=0.0, atol=1e-15).any()
    pushed = run.outer_forces(block)["push"]
    assert not pushed[run.t < JUMP + 1e-15].any()  # a row has what acted up to it
    assert pushed[-1] == pytest.approx([0.0, 0.0, 1600.0], rel=1e-12)
    momentum = linear_momentum(interior, run, block.frame("x_min"))
    exact = 1600.0 * (3e-3 - JUMP) - 9.81 * 8.0 * 3e-3
    assert momentum == pytest.approx([0.0, 0.0, exact], abs={"explicit": 2e-4, "implicit": 2e-3}[way] * exact)


@pytest.mark.parametrize("way", STEPPED)
def test_the_account_of_a_pushed_body_closes_in_a_machine(way):
    kind, options = STEPPED[way]
    parameters = hencky_plasticity.Parameters(1e8, 0.3, 1000.0, 2e5)
    ends = [Interface("x_min")]
    body = cube(form=hencky_plasticity, parameters=parameters, size=0.2, interfaces=ends, comm=MPI.COMM_SELF)
    loads = [
        PressureOnFacets("x_max", fm.Sine(3e5, 500.0), name="blow"),
        TractionOnFacets("y_max", (5e4, 0.0, 0.0), follows=True, name="shear"),
    ]
    _, block, run = freely_flying(kind(body, loads=loads), 4e-3, comm=MPI.COMM_SELF, **options)
    parts = run.energies(block)
    whole = run.energy().total + sum(parts.values())
    assert np.ptp(parts["loads"]) > 10.0
    assert parts["plastic"][-1] > 0.0
    assert abs(whole - whole[0]).max() < 1e-2 * np.ptp(parts["loads"])


STEP = 2e-3


def generalized_alpha(rho=0.8):
    alpha_m, alpha_f = (2 * rho - 1) / (1 + rho), rho / (1 + rho)
    return Scheme(alpha_m, alpha_f, 0.25 * (1 - alpha_m + alpha_f) ** 2, 0.5 - alpha_m + alpha_f)


def test_the_condensed_tangent_knows_the_loads():
    """Against differences of the wrenches; loads a hundred times those that the frames' motion calls for."""
    mesh = meshes.block(1.0, 0.1, 0.1, divisions=(4, 1, 1), comm=MPI.COMM_SELF)
    ends = [Interface("x_min"), Interface("x_max")]
    body = NonlinearModel(mesh, solid_linear, solid_linear.Parameters(2e9, 0.3, 7800.0), degree=1, interfaces=ends)
    loads = [
        PressureOnFacets("z_max", 4e6),
        TractionOnFacets("y_min", (1e6, 0.0, 2e6), follows=True),
        TractionOnFacets("x_max", (3e6, 0.0, 2e6)),
        BodyAcceleration((1e3, 0.0, 2e3)),
    ]
    interior = ImplicitContinuum(body, loads=loads)
    R = Rotation.from_rotvec([0.3, 0.5, -0.2]).as_matrix()
    origins = np.array([frame.p_BI_B for frame in interior.frames]) @ R.T
    axes = np.array([R, R])
    zero = np.zeros((2, 3))
    interior.begin(0.0, FrameMotion(origins, axes, zero, zero, zero, zero), np.array([0.0, 0.0, -9.81]))
    per_x, per_v = generalized_alpha().slopes(STEP)

    size = 1e-4 * np.random.default_rng(1).normal(size=12)
    begun = np.einsum("kab,kbc->kac", Rotation.from_rotvec(size.reshape(2, 6)[:, 3:]).as_matrix(), axes)

    def moved(y):
        move, turn = np.split((size + y).reshape(2, 6), 2, axis=1)
        turned = np.einsum("kab,kbc->kac", Rotation.from_rotvec(y.reshape(2, 6)[:, 3:]).as_matrix(), begun)
        speed = per_v / per_x
        return FrameMotion(origins + move, turned, speed * move, speed * turn, move / per_x, turn / per_x)

    _, slopes = interior.trial(STEP, STEP, generalized_alpha(), moved(np.zeros(12)))
    step, found = 1e-7, np.zeros((12, 12))
    for j, unit in enumerate(step * np.eye(12)):
        there, back = (
            interior.trial(STEP, STEP, generalized_alpha(), moved(sign * unit))[0] for sign in (1.0, -1.0)
        )
        found[:, j] = (there - back).reshape(-1) / (2 * step)
    bare = ImplicitContinuum(body)
    bare.begin(0.0, FrameMotion(origins, axes, zero, zero, zero, zero), np.array([0.0, 0.0, -9.81]))
    _, without = bare.trial(STEP, STEP, generalized_alpha(), moved(np.zeros(12)))
    lever = slice(9, 12)
    assert abs(found - slopes).max() < 2e-6 * abs(slopes).max()
    assert abs(slopes - without)[lever].max() > 20.0 * abs(found - slopes)[lever].max()


@pytest.mark.mpi
def test_bad_loads_are_told_on_every_rank():
    body = cube()

    def refused(kind, match, *loads):
        with pytest.raises(kind, match=match):
            AppliedLoads(body, list(loads))

    refused(MeshError, "'lid': the mesh has no such group of facets", PressureOnFacets("lid", 1.0))
    refused(MeshError, r"no node of the numbers \[77\]", ForceAtNodes([0, 77], (1.0, 0.0, 0.0)))
    refused(SceneError, "two loads are called 'x_min'", PressureOnFacets("x_min", 1.0), PressureOnFacets("x_min", 2.0))
    refused(SceneError, "a load on a body with history is a PressureOnFacets", 3.0)
    with pytest.raises(SceneError, match="loads must be a list"):
        AppliedLoads(body, PressureOnFacets("x_min", 1.0))
    for build, match in (
        (lambda: PressureOnFacets("x_min", float("nan")), "not a finite number"),
        (lambda: PressureOnFacets("x_min", "much"), "is not a function of time"),
        (lambda: TractionOnFacets("x_min", (1.0, 2.0)), "traction must be three finite numbers"),
        (lambda: ForceAtNodes([], (1.0, 2.0, 3.0)), "nodes must be a list of node numbers"),
        (lambda: BodyAcceleration((np.nan, 0.0, 0.0)), "acceleration must be three finite numbers"),
    ):
        with pytest.raises(SceneError, match=match):
            build()
    loads = AppliedLoads(body, [PressureOnFacets("x_min", lambda t: np.nan)])
    with pytest.raises(SceneError, match=re.escape("load 'x_min': at t = 0.5 s: it gave nan")):
        loads.values(0.5)
    wrong = AppliedLoads(body, [PressureOnFacets("x_min", lambda t: (t, t))])
    with pytest.raises(SceneError, match=r"gave shape \(2,\), not one number"):
        wrong.values(0.5)
    turning = CentrifugalLoad((0.0, 0.0, 1.0))
    with pytest.raises(SceneError, match="a centrifugal load would count twice"):
        ExplicitRun(body, loads=[turning])


@pytest.mark.parametrize(
    "load",
    [
        lambda k: PressureOnFacets("x_min", 1.0, follows=k == 0),
        lambda k: TractionOnFacets("x_min", (1.0, 0.0, 2.0 + k)),
        lambda k: ForceAtNodes([0, 1 + k], (1.0, 0.0, 0.0)),
        lambda k: BodyAcceleration((0.0, 0.0, 2.0 + k)),
        lambda k: CentrifugalLoad((0.0, 0.0, 1.0), point=(2.0 + k, 0.0, 0.0)),
        lambda k: Heating(2.0 + k),
        lambda k: Heating(np.arange(1000) + k),
        lambda k: Voltage("x_min" if k == 0 else "x_max", 1.0, name="port"),
    ],
)
def test_loads_that_differ_are_told_apart(load):
    assert told(load(0)) == told(load(0))
    assert told(load(0)) != told(load(1))


@pytest.mark.mpi
def test_loads_that_differ_between_the_ranks_are_refused():
    if COMM.size == 1:
        pytest.skip("on several ranks")
    with pytest.raises(SceneError, match="give the same on all ranks"):
        AppliedLoads(cube(), [BodyAcceleration((0.0, 0.0, 1.0 + COMM.rank))])


def test_a_load_that_fails_on_one_rank_is_told_on_all():
    if COMM.size == 1:
        pytest.skip("on several ranks")
    body = cube()
    loads = AppliedLoads(body, [PressureOnFacets("x_min", lambda t: np.nan if COMM.rank == 1 else t)])
    with pytest.raises(SceneError, match="on rank 1"):
        loads.values(0.5)


def test_j2_of_a_loaded_strip_yields_where_the_load_says():
    """Uniaxial: beyond the yield stress the strain is that of the hardening."""
    p = j2_plasticity.Parameters(2e11, 0.3, 7800.0, 2e8, hardening=j2_plasticity.LinearHardening(2e9))
    body = cube(form=j2_plasticity, parameters=p)
    pull = TractionOnFacets("x_max", (1.0, 0.0, 0.0), factor=lambda t: t)
    follow(body, [1e8, 3e8], prescribed=prescribed_dofs(body, SUPPORTS), loads=[pull])
    n = body.layout.n_owned_nodes
    far = body.layout.node_x[:n, 0] > 0.99
    exact = 3e8 / 2e11 + 1e8 / 2e9
    assert (body.node_x[:n] - body.layout.node_x[:n])[far, 0] == pytest.approx(exact, rel=1e-9)
