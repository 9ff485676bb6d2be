"""Welds: what they join is as if meshed in one, moves as one, hands momentum on; and what is refused."""

from mpi4py import MPI

import numpy as np
import pytest
from interior_momentum import linear_momentum
from scipy.spatial.transform import Rotation

import flexmbd as fm
from flexmbd import meshes
from flexmbd.continuum import (
    BodyAcceleration,
    ContinuumModel,
    ExplicitContinuum,
    ExplicitRun,
    ImplicitContinuum,
    Interface,
    MpiTeam,
    NodalInterface,
    NonlinearModel,
    PressureOnFacets,
    RegularCheckpoints,
    Roller,
    Support,
    TractionOnFacets,
    Weld,
    clamped_dofs,
    equilibrium_path,
    follow,
    node_numbers,
)
from flexmbd.continuum.grid.pieces import check_connected
from flexmbd.errors import FormulationError, MeshError, ReductionError, SceneError
from flexmbd.forms import solid_linear, solid_shell, solid_shell_plasticity, st_venant_kirchhoff
from flexmbd.reduction import ModalDerivatives, Traction, craig_bampton, linear_buckling, prestressed

E, NU, RHO = 2.1e9, 0.3, 7850.0
SOFT = st_venant_kirchhoff.Parameters(E, NU, RHO)
SHELL = solid_shell.Parameters(E, NU, RHO)
STEEL = solid_linear.Parameters(E, NU, RHO)
LENGTH, WIDTH, DEPTH = 0.2, 0.1, 0.02


def plate(length=LENGTH, *, divisions=(4, 2), p=(0.0, 0.0, 0.0), R=None, thickness=DEPTH, comm=MPI.COMM_WORLD):
    sheet = meshes.sheet(length, WIDTH, divisions=divisions, comm=comm)
    return meshes.placed(meshes.wall(sheet, thickness), p=p, R=R)


def halves(first=(4, 2), second=(4, 2), **told):
    one = plate(divisions=first, **told)
    return meshes.join({"a": one, "b": plate(divisions=second, p=(LENGTH, 0.0, 0.0), **told)})


SEAM = [Weld("b.x_min", "a.x_max")]


def butted(**told):
    """A plate of two halves that are welded, and the same in one piece; the names of root, end and the top."""
    return (
        (halves(**told), SEAM, ("a.x_min", "b.x_max")),
        (plate(2 * LENGTH, divisions=(8, 2), **told), [], ("x_min", "x_max")),
    )


def tip(model):
    """The mean deflection of the end."""
    x, u = model.layout.node_x, model.layout.displacements(model.displacement)
    n = model.layout.n_owned_nodes
    at = np.isclose(x[:n, 0], 2 * LENGTH)
    return model.comm.allreduce(u[:n][at].sum(axis=0)) / model.comm.allreduce(int(at.sum()))


@pytest.mark.mpi
def test_a_seam_of_like_meshes_is_no_seam_in_a_record():
    """Held at the root, and flying: frequencies, mass, inertia, loads, stretch by a spin, and buckling."""
    found = []
    for mesh, welds, (root, end) in butted():
        pull = Traction("pull", end, (1.0, 0.0, 0.0))
        model = ContinuumModel(mesh, solid_linear, STEEL, degree=1, welds=welds, interfaces=[Interface(root)])
        body = craig_bampton(model, modes=5, frame=root, loads=[pull])
        free = craig_bampton(ContinuumModel(mesh, solid_linear, STEEL, degree=1, welds=welds), modes=4)
        buckled = linear_buckling(model, clamped=[root], loads=[(pull, -1.0)], count=2)
        spin = body.geometric.loads.index("angular velocity yy")
        spun = np.linalg.eigvalsh(body.geometric.K[spin])
        found.append((body.stiffness, free.stiffness, body.mass, body.inertia, buckled.factors, spun))
    for one, whole in zip(*found, strict=True):
        np.testing.assert_allclose(one, whole, rtol=1e-6, atol=1e-9 * np.abs(whole).max())


def machine(given, kind, integrator, **run):
    """A plate that swings and is pulled by loads that follow; energies and the root's wrench at the end."""
    mesh, welds, (root, end) = given
    body = NonlinearModel(mesh, st_venant_kirchhoff, SOFT, degree=1, welds=welds, interfaces=[Interface(root)])
    loads = [PressureOnFacets(end, -2e4), TractionOnFacets(end, (0.0, 0.0, -2e3), follows=True, name="side")]
    scene = fm.System(gravity=(0.0, 0.0, -9.81), team=MpiTeam(MPI.COMM_WORLD))
    part = scene.add(fm.ContinuumBody(kind(body, loads=[*loads, BodyAcceleration((0.0, 0.0, 1.0))])), name="part")
    hinge = scene.connect(fm.joint.Revolute("y"), scene.ground.frame(), part.frame(root))
    hinge.velocity = (3.0,)
    found = scene.simulate(integrator=integrator, **run)
    return np.array([series[-1] for series in found.energies(part).values()]), found.interior_wrench(part, root)[-1]


@pytest.mark.mpi
@pytest.mark.parametrize(
    ("kind", "integrator", "run"),
    [
        (ImplicitContinuum, fm.GeneralizedAlpha(), {"t_end": 0.004, "h": 1e-3}),
        (ImplicitContinuum, fm.GeneralizedAlpha(), {"t_end": 0.002, "rtol": 1e-3}),
        (ExplicitContinuum, fm.CentralDifference(), {"t_end": 2e-4, "h": 4e-6}),
    ],
)
def test_a_seam_of_like_meshes_is_no_seam_in_motion(kind, integrator, run):
    one, whole = (machine(given, kind, integrator, **run) for given in butted())
    for found, wanted in zip(one, whole, strict=True):
        np.testing.assert_allclose(found, wanted, rtol=1e-7, atol=1e-9 * np.abs(wanted).max())


@pytest.mark.mpi
def test_a_seam_of_like_meshes_is_no_seam_in_slow_loading():
    found = []
    for mesh, welds, (root, end) in butted():
        loads = [PressureOnFacets(end, lambda s: -8e4 * s), TractionOnFacets(end, (0.0, 0.0, 4e3), factor=lambda s: s,
                                                                           follows=True, name="side")]
        bodies = [NonlinearModel(mesh, st_venant_kirchhoff, SOFT, degree=1, welds=welds) for _ in range(2)]
        held = clamped_dofs(bodies[0], [root])
        path = follow(bodies[0], [0.5, 1.0], prescribed=held, loads=loads)
        equilibrium_path(bodies[1], fm.Continuation(to=1.0), prescribed=held, loads=loads)
        steps = [len(step.residuals) for step in path.steps]
        found.append((tip(bodies[0]), tip(bodies[1]), steps))
    np.testing.assert_allclose(found[0][0], found[1][0], rtol=1e-8, atol=1e-12)
    np.testing.assert_allclose(found[0][1], found[0][0], rtol=1e-6, atol=1e-12)
    assert found[0][2] == found[1][2]  # loads that follow are in the tangent: Newton's method is as quick


@pytest.mark.mpi
def test_unlike_meshes_converge():
    """The lowest frequencies of halves of unlike meshes come to those of the plate in one piece, as that by itself."""

    def frequencies(mesh, root, welds):
        model = ContinuumModel(mesh, solid_shell, SHELL, degree=1, welds=welds, interfaces=[Interface(root)])
        return craig_bampton(model, modes=4, frame=root, geometric_stiffness=False).stiffness[:4] ** 0.5

    exact = frequencies(plate(2 * LENGTH, divisions=(32, 8), thickness=0.004), "x_min", [])
    found = []
    for n in (1, 2):
        welded = frequencies(halves((4 * n, 2 * n), (4 * n, 3 * n), thickness=0.004), "a.x_min", SEAM)
        found.append(abs(welded / exact - 1.0).max())
    np.testing.assert_allclose(found, [0.114, 0.0217], rtol=0.05)  # in one piece 0.114, 0.0217


def stretched(first, second):
    """How far stress across a seam is from uniform where boundaries are stretched uniformly, over it."""
    mesh = meshes.join({
        "a": meshes.block(0.1, 0.1, 0.1, divisions=first),
        "b": meshes.placed(meshes.block(0.1, 0.1, 0.1, divisions=second), p=(0.1, 0.0, 0.0)),
    })
    body = NonlinearModel(mesh, solid_linear, STEEL, degree=1, welds=[Weld("b.x_min", "a.x_max")], cell_means=False)
    slope = 1e-6 * np.array([[1.0, 0.3, -0.2], [0.1, -0.5, 0.4], [0.2, 0.6, 0.8]])
    x, n = body.layout.node_x, body.layout.n_owned_nodes
    outside = np.isclose(x[:n], [0.0, -0.05, -0.05]).any(axis=1) | np.isclose(x[:n], [0.2, 0.05, 0.05]).any(axis=1)
    given = np.sort(body.displacement_dofs[np.flatnonzero(outside)].reshape(-1)).astype(np.int32)
    wanted = (x @ slope.T)[:n].reshape(-1)
    follow(body, [1.0], prescribed=given, displacement=lambda s: s * wanted[given])
    stress = np.concatenate([part.reshape(-1, 3, 3) for part in body.stress()])
    strain = 0.5 * (slope + slope.T)
    sigma = STEEL.E / (1 + STEEL.nu) * (strain + STEEL.nu / (1 - 2 * STEEL.nu) * np.trace(strain) * np.eye(3))
    return abs(stress - sigma).max() / abs(sigma).max()


def test_a_uniform_stress_passes_a_seam():
    """Exactly where the grid that follows divides the other's facets; else off beside the seam, the finer the less."""
    assert stretched((2, 2, 2), (3, 4, 4)) < 1e-12
    three, five, nine = (stretched((2, 2, 2), (3, n, n)) for n in (3, 5, 9))
    assert nine < 0.02 < five < 0.05 < three < 0.12


def tee(gap=0.0):
    """A web on two flanges that are welded with a gap between them; meshes unlike each other."""
    turned = Rotation.from_euler("y", -90, degrees=True).as_matrix()
    web = plate(0.05, divisions=(2, 5), p=(0.1, 0.0, DEPTH / 2 + gap), R=turned)
    return (
        meshes.join({"a": plate(divisions=(5, 4)), "b": plate(divisions=(4, 3), p=(LENGTH + gap, 0.0, 0.0)), "w": web}),
        [Weld("a.x_max", "b.x_min"), Weld("w.x_min", "a.top")],
    )


@pytest.mark.mpi
@pytest.mark.parametrize("gap", [0.0, 2e-3])
def test_rigid_motions_cost_nothing_and_tangents_are_derivatives(gap):
    mesh, welds = tee(gap)
    body = NonlinearModel(mesh, solid_shell, SHELL, degree=1, welds=welds)
    x, n = body.layout.node_x, body.n_owned
    turn = Rotation.from_rotvec([0.7, -1.1, 2.0]).as_matrix()
    strained = body.complete(1e-3 * np.sin(37.0 * x[:, [1, 2, 0]]).reshape(-1))
    size = body.norm(body.force(strained))
    assert body.norm(body.force((x @ turn.T - x + [0.1, 0.2, 0.3]).reshape(-1))) < 1e-11 * size
    along = body.complete(np.cos(19.0 * x[:, [2, 0, 1]]).reshape(-1))
    matrix = body.tangent(strained)
    right, left = matrix.createVecs()
    right.array[:] = along[:n]
    right.array[body.ties.dofs] = 0.0
    matrix.mult(right, left)
    step = 1e-7
    slope = (body.force(strained + step * along) - body.force(strained - step * along)) / (2.0 * step)
    assert body.norm(left.array_r - slope) < 1e-7 * body.norm(slope)


def tumbling(x):
    """(n, 3) m/s at places (n, 3) m."""
    return np.asarray(np.cross([5.0, 80.0, 3.0], x) + np.array([1.0, 2.0, 3.0]), dtype=np.float64)


@pytest.mark.mpi
def test_momentum_is_kept_in_flight():
    mesh, welds = tee(gap=2e-3)
    body = NonlinearModel(mesh, solid_shell, SHELL, degree=1, welds=welds)
    flight = ExplicitRun(body, velocity=tumbling)
    motion = flight.motion
    motion.start(0.9 * flight.stable_step)
    before = motion.momentum(np.zeros(3))
    account = flight.simulate(150 * flight.stable_step)
    np.testing.assert_allclose(motion.momentum(np.zeros(3)), before, atol=1e-12 * np.abs(before).max())
    assert account.error < 4e-3  # that of the steps, as of a plate in one piece
    assert motion.mass == pytest.approx(RHO * DEPTH * WIDTH * (2 * LENGTH + 0.05), rel=1e-12)
    apart = body.complete_nodes(motion.x.copy()) - motion.x
    assert np.abs(apart).max(initial=0.0) < 1e-14


def test_a_flight_goes_on_to_the_bit_after_a_restart(tmp_path):
    def flight():
        mesh, welds = tee()
        body = NonlinearModel(mesh, solid_shell, SHELL, degree=1, welds=welds)
        return ExplicitRun(body, velocity=tumbling)

    whole, first, second = flight(), flight(), flight()
    h = 0.9 * whole.stable_step
    whole.simulate(20 * h, h=h, outputs=2)
    file = RegularCheckpoints(tmp_path / "flight.npz", every=10 * h)
    first.simulate(20 * h, h=h, outputs=2, checkpoints=file)
    second.simulate(20 * h, h=h, outputs=2, restart=file.path)
    np.testing.assert_array_equal(first.motion.x, whole.motion.x)
    np.testing.assert_array_equal(second.motion.x, whole.motion.x)


def test_what_hits_a_seam_gets_what_it_gives():
    """A ball on nodes that follow: momentum and energy of both, explicit steps."""
    mesh, welds, (root, _) = butted()[0]
    body = NonlinearModel(mesh, st_venant_kirchhoff, SOFT, degree=1, welds=welds, interfaces=[Interface(root)])
    interior = ExplicitContinuum(body)
    scene = fm.System()
    part = scene.add(fm.ContinuumBody(interior), name="part")
    scene.connect(fm.joint.Free(), scene.ground.frame(), part.frame(root))
    ball = scene.add(fm.RigidBody(1.0, (1e-3,) * 3), name="ball")
    fall = scene.connect(fm.joint.Free(), scene.ground.frame(p=(0.199, 0.01, DEPTH / 2 + 0.0452)), ball.frame())
    fall.velocity = (0.3, 0.0, -1.0, 0.0, 0.0, 0.0)
    scene.touch(fm.contact.Nodes(part, "b.top"), fm.contact.Sphere(ball.frame(), 0.045), fm.contact.Hard(mu=0.2))
    run = scene.simulate(1.5e-3, h=4e-6, integrator=fm.CentralDifference())
    energy = run.energy().total + sum(run.energies(part).values())
    assert np.ptp(energy) < 1e-4 * energy[0]
    (force,) = run.outer_forces(part).values()
    assert np.abs(force).max() > 500.0
    given = ball.mass * (run.velocity(ball.frame())[-1] - run.velocity(ball.frame())[0])
    begun = ball.mass * run.velocity(ball.frame())[0]
    np.testing.assert_allclose(linear_momentum(interior, run, part.frame(root)), -given, atol=1e-10 * abs(begun).max())


def grid_of(cells, size):
    """Points and bricks of a set of cells (i, j, k) of a regular grid with the edges ``size`` (3,)."""
    corners = np.array([(a, b, c) for c in (0, 1) for b in (0, 1) for a in (0, 1)])
    every = (np.array(sorted(cells))[:, None] + corners).reshape(-1, 3)
    points, rows = np.unique(every, axis=0, return_inverse=True)
    return points * size, rows.reshape(-1, 8)


def test_three_plates_make_a_tee():
    """Two flanges and a web, welded where the grids agree: as in one mesh of the same bricks."""
    size = np.array([0.02, 0.02, 0.01])
    flanges = {(i, j, 0) for i in range(8) for j in range(4)}
    web = {(4, j, k) for j in range(4) for k in (1, 2, 3)}
    ends = {"x_min": lambda x: np.isclose(x[0], 0.0), "x_max": lambda x: np.isclose(x[0], 0.16)}

    def part(cells, **groups):
        return meshes.from_arrays(
            MPI.COMM_WORLD, *grid_of(cells, size), cell="hexahedron", degree=1, facet_groups=groups
        )

    whole = ContinuumModel(part(flanges | web, **ends), solid_linear, STEEL, degree=1, interfaces=[Interface("x_min")])
    middle, top = (lambda x: np.isclose(x[0], 0.06)), (lambda x: np.isclose(x[2], 0.01))
    parts = {
        "left": part({c for c in flanges if c[0] < 3}, x_min=ends["x_min"], seam=middle),
        "right": part({c for c in flanges if c[0] >= 3}, seam=middle, top=top, x_max=ends["x_max"]),
        "web": part(web, foot=top),
    }
    welds = [Weld("left.seam", "right.seam"), Weld("web.foot", "right.top")]
    welded = ContinuumModel(meshes.join(parts), solid_linear, STEEL, degree=1, welds=welds,
                            interfaces=[Interface("left.x_min")])  # fmt: skip
    one, other = craig_bampton(welded, modes=6, frame="left.x_min"), craig_bampton(whole, modes=6, frame="x_min")
    np.testing.assert_allclose(one.stiffness, other.stiffness, rtol=1e-8)
    np.testing.assert_allclose(one.inertia, other.inertia, rtol=1e-10, atol=1e-14)


@pytest.mark.parametrize("order", [(0, 1, 2), (2, 1, 0)])
def test_a_rib_in_a_corner(order):
    """Nodes of a rib that lie on both of the plates that it stands on: as in one mesh of the same bricks."""
    size = np.array([0.02, 0.02, 0.01])
    base, wall = {(i, j, 0) for i in range(4) for j in range(3)}, {(0, j, k) for j in range(3) for k in (1, 2)}
    rib = {(i, 1, k) for i in (1, 2) for k in (1, 2)}
    inner, top = (lambda x: np.isclose(x[0], 0.02)), (lambda x: np.isclose(x[2], 0.01))

    def part(cells, **groups):
        return meshes.from_arrays(
            MPI.COMM_WORLD, *grid_of(cells, size), cell="hexahedron", degree=1, facet_groups=groups
        )

    end = lambda x: np.isclose(x[0], 0.08)  # noqa: E731
    parts = {"base": part(base, top=top, end=end), "wall": part(wall, foot=top, inner=inner)}
    parts["rib"] = part(rib, foot=top, side=inner)
    welds = [Weld("wall.foot", "base.top"), Weld("rib.foot", "base.top"), Weld("rib.side", "wall.inner")]
    one = ContinuumModel(
        meshes.join(parts), solid_linear, STEEL, degree=1, welds=[welds[k] for k in order],
        interfaces=[Interface("base.end")],
    )  # fmt: skip
    other = ContinuumModel(
        part(base | wall | rib, end=end), solid_linear, STEEL, degree=1, interfaces=[Interface("end")]
    )
    found = craig_bampton(one, modes=4, frame="base.end"), craig_bampton(other, modes=4, frame="end")
    np.testing.assert_allclose(found[0].stiffness, found[1].stiffness, rtol=1e-8)


@pytest.mark.parametrize("unit", [1.0, 1e3])
def test_seams_of_thin_walls_and_of_small_parts_hold(unit):
    """An edge ten thousand times as long as it is thick, and a patch a thousandth as long as the machine."""
    long, thin = 10.0 * unit, 1e-3 * unit

    def part(length, width, n, p, R=None):
        sheet = meshes.sheet(length, width, divisions=(n, 2))
        return meshes.placed(meshes.wall(sheet, thin), p=np.array(p) * unit, R=R)

    web = part(long, 0.1 * unit, 20, (0.0, 0.0, 0.0505), [[1, 0, 0], [0, 0, -1], [0, 1, 0]])
    parts = {"flange": part(long, 0.1 * unit, 20, (0.0, 0.0, 0.0)), "web": web}
    parts["patch"] = part(0.01 * unit, 0.01 * unit, 1, (9.9, 0.0, -1e-3))
    welds = [Weld("web.y_min", "flange.top"), Weld("patch.top", "flange.bottom")]
    assert len(made(meshes.join(parts), welds).ties.numbers) == 2 * 21 + 2 * 3
    with pytest.raises(MeshError, match=f"part around \\[{9.905 * unit:.4g}.* free to move"):
        made(meshes.join(parts), welds[:1])


GAP = 1e-3  # of the girth, between the edges of a rolled sheet


def rolled(around, along, radius, thickness, length):
    """A sheet rolled to a tube along z, whose edges, "first" and "last", nearly meet in x = radius."""
    i, j = (v.ravel() for v in np.meshgrid(np.arange(around + 1), np.arange(along + 1), indexing="ij"))
    row = np.arange((around + 1) * (along + 1)).reshape(around + 1, along + 1)
    angle = 2 * np.pi * (1.0 - GAP) * i / around
    points = np.stack([radius * np.cos(angle), radius * np.sin(angle), length * j / along], axis=1)
    cells = np.stack([row[a : a + around, b : b + along].ravel() for b in (0, 1) for a in (0, 1)], axis=1)
    edges = {
        "first": lambda x: np.isclose(x[1], 0.0) & (x[0] > 0.0),
        "last": lambda x: np.isclose(x[1], -radius * np.sin(2 * np.pi * GAP)) & (x[0] > 0.0),
    }
    ends = {"start": lambda x: np.isclose(x[2], 0.0), "end": lambda x: np.isclose(x[2], length)}
    surface = meshes.from_arrays(
        MPI.COMM_WORLD, points, cells, cell="quadrilateral", degree=1, facet_groups={**edges, **ends}
    )
    return meshes.wall(surface, thickness, normals=lambda x: np.stack([x[0], x[1], 0.0 * x[2]]))


def torque(mesh, welds, centre, turn=1e-5):
    """N m about an axis along z that turns the end by so much, the sections' shape kept and warping free."""
    body = NonlinearModel(mesh, solid_shell, SHELL, degree=1, welds=welds)
    x, layout = body.layout.node_x[: body.layout.n_owned_nodes], body.layout
    ends = [layout.nodes_on(2, mesh.facets(name)) for name in ("start", "end")]
    nodes = np.concatenate(ends)
    dofs = body.displacement_dofs[nodes][:, :2]
    arms = x[nodes] - centre
    share = np.repeat([0.0, turn], [len(one) for one in ends])[:, None]
    moved = share * np.stack([-arms[:, 1], arms[:, 0]], axis=1)
    far = body.displacement_dofs[np.argmin(x[:, 0] + 1e-3 * x[:, 2]), 2]  # holds what is left, the way along z
    given, values = np.append(dofs.ravel(), far), np.append(moved.ravel(), 0.0)
    order = np.argsort(given)
    path = follow(body, [1.0], prescribed=given[order].astype(np.int32), displacement=lambda s: s * values[order])
    pulled = np.zeros(len(given))
    pulled[order] = path.steps[-1].reactions
    forces = pulled[:-1].reshape(-1, 2)[len(ends[0]) :]
    arm = arms[len(ends[0]) :]
    return float(arm[:, 0] @ forces[:, 1] - arm[:, 1] @ forces[:, 0]) / turn


def test_a_weld_closes_a_tube():
    """A slit tube that is twisted, and one whose slit is welded: G 4 A^2 t / s (Bredt) and G s t^3 / 3, by length."""
    around, radius, thickness, length = 24, 0.05, 0.004, 0.4
    mesh = rolled(around, 16, radius, thickness, length)
    area = 0.5 * around * radius**2 * np.sin(2 * np.pi / around)
    girth = 2 * around * radius * np.sin(np.pi / around)
    shear = E / (2 * (1 + NU))
    closed = torque(mesh, [Weld("first", "last")], np.zeros(3))
    assert closed == pytest.approx(shear * 4 * area**2 * thickness / girth / length, rel=0.02)
    open_one = torque(mesh, [], np.array([-2.0 * radius, 0.0, 0.0]))
    assert open_one == pytest.approx(shear * girth * thickness**3 / 3 / length, rel=0.1)


def strap(**told):
    """Two sheets that overlap by half of their length, 1 mm apart, on spots or all over."""
    thickness = 2e-3
    low = plate(divisions=(12, 8), thickness=thickness)
    high = plate(divisions=(10, 6), p=(LENGTH / 2, 0.0, thickness + 1e-3), thickness=thickness)
    return NonlinearModel(
        meshes.join({"low": low, "high": high}), solid_shell, SHELL, degree=1,
        welds=[Weld("high.bottom", "low.top", within=0.5, **told)],
        interfaces=[Interface("low.x_min"), Interface("high.x_max")],
    )  # fmt: skip


SPOTS = [(0.125, -0.03, 1e-3), (0.125, 0.03, 1e-3), (0.18, 0.0, 1e-3)]


@pytest.mark.mpi
def test_spots_join_what_lies_in_them():
    body = strap(points=SPOTS, radius=0.021)
    apart = np.linalg.norm(body.ties.places[:, None] - np.array(SPOTS), axis=2).min(axis=1)
    assert len(apart) > 9
    assert apart.max() < 0.021
    x = body.layout.node_x
    turn = Rotation.from_rotvec([0.7, -1.1, 2.0]).as_matrix()
    size = body.norm(body.force((1e-2 * x).reshape(-1)))  # of a strain of a hundredth
    assert body.norm(body.force((x @ turn.T - x).reshape(-1))) < 1e-10 * size
    # the more spots, the stiffer against a pull; what passes is the same on both ends
    pulls = []
    for points in (SPOTS[:2], SPOTS):
        body = strap(points=points, radius=0.021)
        ends = [body.layout.nodes_on(2, body.mesh.facets(name)) for name in ("low.x_min", "high.x_max")]
        own = [nodes[nodes < body.layout.n_owned_nodes] for nodes in ends]
        given = np.sort(body.displacement_dofs[np.concatenate(own)].reshape(-1)).astype(np.int32)
        whole = np.zeros(body.n_owned)
        whole[body.displacement_dofs[own[1], 0]] = 1e-5
        path = follow(body, [1.0], prescribed=given, displacement=lambda s, given=given, whole=whole: s * whole[given])
        force = np.zeros(body.n_owned)
        force[given] = path.steps[-1].reactions
        force = body.layout.displacements(force)
        one, other = (body.comm.allreduce(force[nodes].sum(axis=0)) for nodes in own)
        np.testing.assert_allclose(one, -other, atol=1e-9 * abs(one).max())
        pulls.append(other[0])
    assert pulls[1] > 1.02 * pulls[0] > 0.0


def test_a_chain_of_ties_is_one_tie():
    """The nodes of a third plate follow those of the second that follow the first."""
    parts = {
        "a": plate(divisions=(4, 2)),
        "b": plate(divisions=(4, 3), p=(LENGTH, 0.0, 0.0)),
        "c": plate(0.02, divisions=(1, 4), p=(LENGTH, 0.0, DEPTH)),
    }
    welds = [Weld("c.bottom", "b.top"), Weld("b.x_min", "a.x_max")]
    body = NonlinearModel(meshes.join(parts), solid_shell, SHELL, degree=1, welds=welds)
    x = body.layout.node_x
    u = x @ np.array([[0.1, 0.2, 0.3], [0.4, 0.5, 0.6], [0.7, 0.8, 0.9]])
    np.testing.assert_allclose(body.complete_nodes(u.copy()), u, atol=1e-13)
    assert (body.ties.places[:, 2] > DEPTH / 4).sum() == 10 + 4  # the third plate's foot, the second's upper edge
    assert not np.isin(body.ties.numbers, node_numbers(body)[body.ties.leaders]).any()


def apart(gap):
    return meshes.join({"a": plate(), "b": plate(p=(LENGTH + gap, 0.0, 0.0))})


def made(mesh, welds, kind=NonlinearModel, **told):
    return kind(mesh, solid_shell, SHELL, degree=1, welds=welds, **told)


REFUSED = {
    "edges that do not meet": (
        lambda: made(apart(0.05), SEAM), MeshError,
        r"6 of 6 nodes lie off the facets; the greatest gap is 0.05 m, of node \d+ at \[0.25, .*within=",
    ),
    "another edge": (
        lambda: made(halves(), [Weld("b.y_min", "a.x_max")]), MeshError, r"greatest gap is 0\.2.* at \[0.4, -0.05",
    ),
    "nothing joins them": (lambda: made(halves(), []), MeshError, "2 parts that nothing joins"),
    "no list": (lambda: made(halves(), SEAM[0]), MeshError, "welds must be a list"),
    "no weld": (lambda: made(halves(), ["b.x_min"]), MeshError, "welds must be a list"),
    "no group": (lambda: made(halves(), [Weld("c", "a.x_max")]), MeshError, "no group 'c' of facets, edges"),
    "no facets": (lambda: made(halves(), [Weld("b.x_min", "c")]), MeshError, "no group 'c' of facets; it has"),
    "the same side": (lambda: made(plate(), [Weld("x_min", "x_min")]), MeshError, "nodes of 'x_min' already"),
    "tied twice": (
        lambda: made(halves(), [*SEAM, *SEAM]), MeshError, "6 nodes follow already, by the weld of 'b.x_min'",
    ),
    "in a circle": (
        lambda: made(halves((4, 2), (4, 3)), [*SEAM, Weld("a.x_max", "b.x_min")]), MeshError, "itself; turn one",
    ),
    "on an interface": (
        lambda: made(halves(), SEAM, interfaces=[Interface("b.x_min")]), MeshError, "is one of interface 'b.x_min'",
    ),
    "on a nodal interface": (
        lambda: made(halves(), SEAM, ContinuumModel, interfaces=[NodalInterface("b.x_min")]), fm.InterfaceError,
        "the following side of a weld",
    ),
    "few nodes": (
        lambda: strap(points=[(0.15, 0.0, 0.0)], radius=0.003), MeshError, "needs three that are not in one line",
    ),
    "points alone": (lambda: Weld("a", "b", points=SPOTS), MeshError, "spots have both"),
    "no points": (lambda: Weld("a", "b", points=[1.0], radius=1.0), MeshError, r"places \(n, 3\)"),
    "no radius": (lambda: Weld("a", "b", points=SPOTS, radius=0.0), MeshError, "radius of spots must be positive"),
    "no distance": (lambda: Weld("a", "b", within=0.0), MeshError, "within must be positive"),
    "a support on one side": (
        lambda: made(halves(), SEAM, ContinuumModel, supports=[Roller("b.x_min", (1, 0, 0))],
                     interfaces=[Interface("a.x_min")]), MeshError, "supports hold node",
    ),
    "a support of explicit steps": (
        lambda: ExplicitRun(made(halves(), SEAM), supports=[Support("b.x_min", z=True)]), SceneError,
        "supports hold node",
    ),
    "further mass": (
        lambda: ExplicitRun(made(halves(), SEAM), scaled_thickness=1.0), FormulationError,
        "scaled_thickness= goes by edges",
    ),
    "prestress": (
        lambda: prestressed(made(halves(), SEAM, ContinuumModel, interfaces=[Interface("a.x_min")]), frame="a.x_min"),
        ReductionError, "welds are those of a part at rest",
    ),
    "derivatives": (
        lambda: craig_bampton(
            ContinuumModel(halves(), solid_linear, STEEL, degree=1, welds=SEAM, interfaces=[Interface("a.x_min")]),
            modes=2, frame="a.x_min", nonlinear=ModalDerivatives({"a.x_min.y": 1.0})),
        ReductionError, "no welds",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_refused_welds(case):
    make, kind, told = REFUSED[case]
    with pytest.raises(kind, match=told):
        make()


@pytest.mark.mpi
def test_what_is_refused_is_told_on_all_ranks():
    with pytest.raises(MeshError, match=r"greatest gap is 0\.05 m"):
        made(apart(0.05), SEAM)
    with pytest.raises(MeshError, match="all of its 6 nodes follow already"):
        made(halves(), [*SEAM, *SEAM])


def hinged():
    """A plate on another one whose edge alone, a line of nodes, is welded."""
    edge = {"line": lambda x: np.isclose(x[0], 0.0) & np.isclose(x[2], 0.0)}
    sides = {"foot": lambda x: np.isclose(x[2], 0.0), "lid": lambda x: np.isclose(x[2], 0.01)}
    brick = grid_of({(0, 0, 0), (1, 0, 0)}, np.array([0.02, 0.02, 0.01]))
    part = meshes.from_arrays(
        MPI.COMM_WORLD, *brick, cell="hexahedron", degree=1, facet_groups=sides, edge_groups=edge
    )
    return meshes.join({"a": part, "b": meshes.placed(part, p=(0.01, 0.0, 0.01))})


def test_a_hinge_is_no_weld():
    with pytest.raises(MeshError, match="free to move, or to turn about a line"):
        made(hinged(), [Weld("b.line", "a.lid")])
    assert made(hinged(), [Weld("b.foot", "a.lid", within=9.0)]).ties is not None


def test_displacements_that_tear_a_weld():
    body = made(halves((4, 2), (4, 3)), SEAM)
    with pytest.raises(FormulationError, match="prescribed dofs hold node"):
        follow(body, [1.0], prescribed=clamped_dofs(body, ["b.x_min"]))
    both = clamped_dofs(body, ["b.x_min", "a.x_max"])
    x = body.layout.node_x.repeat(3, axis=0)
    torn = 1e-3 * (x[both, 0] + (x[both, 1] > 0.01) * 0.1)
    with pytest.raises(FormulationError, match="away from the facets that they follow"):
        follow(body, [1.0], prescribed=both, displacement=lambda s: s * torn)
    follow(body, [1.0], prescribed=both, displacement=lambda s: s * 1e-5 * x[both, 1])


@pytest.mark.mpi
def test_joined_meshes_keep_groups_and_volumes():
    part = plate(divisions=(3, 2))
    turned = Rotation.from_euler("z", 90, degrees=True).as_matrix()
    moved = meshes.placed(part, p=(1.0, 2.0, 3.0), R=turned)
    joined = meshes.join({"one": part, "two": moved})
    assert set(joined.facet_groups) == {f"{n}.{g}" for n in ("one", "two") for g in part.facet_groups}
    assert set(joined.cell_groups) == {"one.sheet", "two.sheet"}
    assert joined.in_pieces
    low = np.min(joined.comm.allgather(joined.mesh.geometry.x.min(axis=0)), axis=0)
    high = np.max(joined.comm.allgather(joined.mesh.geometry.x.max(axis=0)), axis=0)
    np.testing.assert_allclose(low, [0.0, -WIDTH / 2, -DEPTH / 2], atol=1e-15)
    np.testing.assert_allclose(high, [1.0 + WIDTH / 2, 2.0 + LENGTH, 3.0 + DEPTH / 2], rtol=1e-15)
    count = joined.comm.allreduce(len(joined.facets("two.top")))
    assert count >= 6
    with pytest.raises(MeshError, match=r"falls into 2 pieces.*weld them"):
        check_connected(joined.mesh)


def tetrahedra():
    return meshes.block(1.0, 1.0, 1.0, divisions=(1, 1, 1), cell="tetrahedron")


@pytest.mark.parametrize(
    ("parts", "told"),
    [
        (lambda: {"one": plate()}, "two meshes or more"),
        (lambda: {"one": plate(), "": plate()}, "a part has no name"),
        (lambda: {"one": plate(), "two": meshes.sheet(1.0, 1.0, divisions=(1, 1))}, "solids alone are welded"),
        (lambda: {"one": plate(), "two": tetrahedra()}, "'two' has"),
        (
            lambda: {"a": meshes.join({"b": plate(), "c": plate()}), "a.b": plate()},
            "two groups would be 'a.b.bottom', of part 'a' and of part 'a.b'",
        ),
    ],
)
def test_parts_that_are_not_joined(parts, told):
    with pytest.raises(MeshError, match=told):
        meshes.join(parts())


def test_places_that_are_none():
    with pytest.raises(MeshError, match="p must be three lengths"):
        meshes.placed(plate(), p=(1.0, 2.0))
    with pytest.raises(MeshError, match="R must be a rotation"):
        meshes.placed(plate(), R=np.diag([1.0, 1.0, -1.0]))


@pytest.mark.parametrize("form", [solid_shell, solid_shell_plasticity], ids=["elastic", "with a history"])
def test_what_is_seen_of_a_wall_is_the_stress_of_its_faces(form, tmp_path):
    """A strip that bends, welded in its middle: the recorded stress at top and bottom is 6 F (L - x) / (w t^2)."""
    force, thickness = 0.01, 0.002
    limit = {} if form is solid_shell else {"yield_stress": 1e9}
    parts = {"a": plate(divisions=(10, 2), thickness=thickness)}
    parts["b"] = plate(divisions=(10, 2), p=(LENGTH, 0.0, 0.0), thickness=thickness)
    body = NonlinearModel(
        meshes.join(parts), form, form.Parameters(E=E, nu=0.0, rho=RHO, **limit), degree=1, welds=SEAM,
        interfaces=[Interface("a.x_min")],
    )  # fmt: skip
    load = TractionOnFacets("b.x_max", (0.0, 0.0, -force / (WIDTH * thickness)))
    follow(body, [1.0], prescribed=clamped_dofs(body, ["a.x_min"]), loads=[load])
    scene = fm.System()
    strip = scene.add(fm.ContinuumBody(ImplicitContinuum(body, loads=[load])), name="strip")
    scene.connect(fm.joint.Fixed(), scene.ground.frame(), strip.frame("a.x_min"))
    run = scene.simulate(1e-7, h=1e-7, recording=fm.Recording(tmp_path / "strip.h5", every=1e-7))
    x, sigma = body.layout.node_x[np.argsort(node_numbers(body))], run.recorded(strip).values("stress", row=0)[:, 0]
    for place in (0.1, LENGTH, 0.3):
        exact = 6.0 * force * (2 * LENGTH - place) / (WIDTH * thickness**2)
        for side in (1.0, -1.0):
            at = np.isclose(x[:, 0], place) & np.isclose(x[:, 2], side * thickness / 2)
            np.testing.assert_allclose(sigma[at].mean(), side * exact, rtol=5e-3)
