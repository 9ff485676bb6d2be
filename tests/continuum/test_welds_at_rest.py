"""Welds at rest: what they join is in records and under slow loads as if meshed in one."""

from mpi4py import MPI

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from welded_plates import (
    LENGTH,
    NU,
    RHO,
    SEAM,
    SHELL,
    SOFT,
    SPOTS,
    STEEL,
    WIDTH,
    E,
    butted,
    grid_of,
    halves,
    made,
    plate,
    strap,
)

import flexmbd as fm
from flexmbd import meshes
from flexmbd.continuum import (
    ContinuumModel,
    ImplicitContinuum,
    Interface,
    NonlinearModel,
    PressureOnFacets,
    TractionOnFacets,
    Weld,
    clamped_dofs,
    equilibrium_path,
    follow,
    node_numbers,
)
from flexmbd.errors import FormulationError
from flexmbd.forms import solid_linear, solid_shell, solid_shell_plasticity, st_venant_kirchhoff
from flexmbd.reduction import Traction, craig_bampton, linear_buckling


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


def tip(model):
    """The mean deflection of the end."""
    x, u = model.layout.node_x, model.layout.displacements(model.displacement)
    n = model.layout.n_owned_nodes
    at = np.isclose(x[:n, 0], 2 * LENGTH)
    return model.comm.allreduce(u[:n][at].sum(axis=0)) / model.comm.allreduce(int(at.sum()))


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

    def whole(n):
        return frequencies(plate(2 * LENGTH, divisions=(8 * n, 2 * n), thickness=0.004), "x_min", [])

    exact, errors = whole(4), []
    for n in (1, 2):
        welded = frequencies(halves((4 * n, 2 * n), (4 * n, 3 * n), thickness=0.004), "a.x_min", SEAM)
        errors.append([abs(one / exact - 1.0).max() for one in (welded, whole(n))])
        np.testing.assert_allclose(*errors[-1], rtol=0.05)
    assert errors[1][0] < errors[0][0] / 4


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
