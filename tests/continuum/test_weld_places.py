"""Which nodes follow which, by how much, and what is refused."""

from mpi4py import MPI

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from welded_plates import DEPTH, LENGTH, SEAM, SHELL, SPOTS, STEEL, grid_of, halves, made, plate, strap, tee

import flexmbd as fm
from flexmbd import meshes
from flexmbd.continuum import (
    ContinuumModel,
    ExplicitRun,
    Interface,
    NodalInterface,
    NonlinearModel,
    Roller,
    Support,
    Weld,
    node_numbers,
)
from flexmbd.errors import FormulationError, MeshError, ReductionError, SceneError
from flexmbd.forms import solid_linear, solid_shell
from flexmbd.reduction import ModalDerivatives, craig_bampton, prestressed


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
    "a radius in mm": (
        lambda: made(tee()[0], [Weld("a.x_max", "b.x_min"), Weld("w.x_min", "a.top", points=[(0.1, 0, 0)], radius=9)]),
        MeshError, r"spots of the radius 9 m are larger than 'w.x_min', whose nodes lie 0\.102 m apart",
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
