"""Craig-Bampton and Guyan against the unreduced model."""

import types
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest
import scipy.linalg
import scipy.sparse.linalg
import ufl
from bracket import bracket, transformation
from full_model import FullModel
from machine_side import dynamic_stiffness, motions, relative

from flexmbd import meshes
from flexmbd.continuum import ContinuumModel, Interface
from flexmbd.continuum.grid import tagged_mesh
from flexmbd.continuum.grid.tagged_mesh import from_arrays
from flexmbd.continuum.matrices import eigen
from flexmbd.coupling import Coupling
from flexmbd.errors import ConvergenceError, InterfaceError, ReductionError
from flexmbd.forms import solid_linear
from flexmbd.record.reduced_body import FRAME_DOFS
from flexmbd.reduction import Keep, craig_bampton, guyan
from flexmbd.reduction.modes import fixed_modes

DATA = Path(__file__).parents[1] / "data"


@pytest.fixture(scope="module")
def model():
    return bracket(comm=MPI.COMM_SELF)


@pytest.fixture(scope="module")
def full(model):
    return FullModel(model)


def reduced_matrices(full, *, axes):
    """K and M of the unreduced model with rigid interfaces, interfaces first; sparse."""
    t = transformation(full, axes=axes)
    return (t.T @ full.K @ t).tocsc(), (t.T @ full.M @ t).tocsc()


def elastic_frequencies(k, m, count):
    """By dense matrices; rigid-body modes have some 1e-9 of the first elastic eigenvalue here."""
    eigenvalues = scipy.linalg.eigh(k, m, eigvals_only=True)
    return np.sqrt(eigenvalues[eigenvalues > 1e-5 * eigenvalues[6]][:count]) / (2 * np.pi)


@pytest.mark.parametrize("frame", ["root", "tip", "pad"])
@pytest.mark.parametrize("modes", [0, 5])
def test_static_response_to_interface_loads_is_exact(model, full, frame, modes):
    """Unit forces and moments on the other interfaces, the frame's held."""
    body = craig_bampton(model, modes=modes, frame=frame)
    j = motions(body)[6:, 6:]
    assert body.interfaces[0].name == body.frame == frame
    found = (j / body.stiffness) @ j.T

    k, _ = reduced_matrices(full, axes=model.interface(frame).R)
    order = [one.name for one in model.interfaces]
    held = np.zeros(k.shape[0], dtype=bool)
    held[6 * order.index(frame) : 6 * order.index(frame) + 6] = True
    loads = np.eye(k.shape[0], 18)[~held][:, ~held[:18]]
    response = scipy.sparse.linalg.spsolve(k[~held][:, ~held], loads)
    assert relative(found, response[: loads.shape[1]]) < 1e-9


def test_frequencies_fall_to_those_of_the_full_model(model, full):
    axes = model.interface("root").R
    k, m = (matrix.toarray() for matrix in reduced_matrices(full, axes=axes))
    held = slice(6, None)
    for clamped, exact in (
        ((), elastic_frequencies(k, m, 6)),
        (("root",), elastic_frequencies(k[held, held], m[held, held], 6)),
    ):
        errors = []
        for modes in (0, 1, 2, 4, 8, 16, 32, 64, 128):
            body = craig_bampton(model, modes=modes, frame="root", geometric_stiffness=False)
            found = body.frequencies(clamped)[:6]
            errors.append(found / exact - 1.0)
        # from above and never rising, round-off apart
        assert np.min(errors) > -1e-11
        assert np.max(np.diff(errors, axis=0)) < 1e-11
        assert np.max(errors[0]) > 0.05
        assert np.max(errors[-1]) < 1e-4


SUPPORTS = [
    {"tip": ("x", "y", "z", "rx", "ry", "rz"), "root": ("y", "rz")},
    {"root": ("x", "y", "z", "rx", "ry")},
    {"root": ("z",), "tip": ("x", "ry")},
]


@pytest.mark.parametrize("clamped", SUPPORTS)
def test_supports_along_the_axes_of_an_interface(clamped):
    """With all modes, against the full model held along those axes."""
    model = bracket("root", "tip", comm=MPI.COMM_SELF, degree=1)
    full = FullModel(model)
    k, m = (matrix.toarray() for matrix in reduced_matrices(full, axes=np.eye(3)))
    turn = np.eye(len(k))
    held = []
    for i, interface in enumerate(model.interfaces):
        turn[6 * i : 6 * i + 6, 6 * i : 6 * i + 6] = np.kron(np.eye(2), interface.R)
        held += [6 * i + FRAME_DOFS.index(dof) for dof in clamped.get(interface.name, ())]
    free = np.delete(turn, held, axis=1)
    exact = elastic_frequencies(free.T @ k @ free, free.T @ m @ free, 8)
    body = craig_bampton(model, modes=len(k) - 12, frame="tip")
    assert body.frequencies(clamped)[:8] == pytest.approx(exact, rel=1e-9)


@pytest.mark.parametrize("names", [("root", "tip"), ("tip",)])
def test_all_modes_are_the_full_model(names):
    """Nothing is lost: frequencies and the interfaces' dynamic stiffness are those of all dofs."""
    model = bracket(*names, comm=MPI.COMM_SELF, degree=1)
    full = FullModel(model)
    axes = model.interface("tip").R
    k, m = (matrix.toarray() for matrix in reduced_matrices(full, axes=axes))
    b = 6 * len(names)
    body = craig_bampton(model, modes=len(k) - b, frame="tip")
    assert body.n_modes == len(k) - 6
    exact = scipy.linalg.eigh(k, m, eigvals_only=True)[6:]
    assert body.frequencies() == pytest.approx(np.sqrt(exact) / (2 * np.pi), rel=1e-9)

    # the record lists the frame first
    order = np.concatenate([6 * names.index(one.name) + np.arange(6) for one in body.interfaces])
    for omega in 2 * np.pi * np.array([10.0, 300.0, 2000.0, 9000.0]):
        dynamic = k - omega**2 * m
        inner = np.linalg.solve(dynamic[b:, b:], dynamic[b:, :b])
        exact = (dynamic[:b, :b] - dynamic[:b, b:] @ inner)[np.ix_(order, order)]
        assert relative(dynamic_stiffness(body, omega), exact) < 1e-8


def test_guyan_is_craig_bampton_without_modes(model, full):
    one, other = guyan(model, frame="root"), craig_bampton(model, modes=0, frame="root")
    assert one.fingerprint() == other.fingerprint()
    assert one.n_modes == 12

    # by hand: condense all dofs but the interfaces', hold the root
    k, m = (matrix.toarray() for matrix in reduced_matrices(full, axes=model.interface("root").R))
    t = np.vstack([np.eye(18), -np.linalg.solve(k[18:, 18:], k[18:, :18])])
    exact = scipy.linalg.eigh(t.T @ k @ t, t.T @ m @ t, eigvals_only=True)[6:]
    assert one.frequencies() == pytest.approx(np.sqrt(exact) / (2 * np.pi), rel=1e-10)


def test_normal_form_and_partition(model):
    body = craig_bampton(model, modes=7, frame="root", geometric_stiffness=False)
    assert abs(body.modal_mass() - np.eye(19)).max() < 1e-12
    assert (np.diff(body.stiffness) > 0).all()
    assert body.partition_names[:7] == (
        "tip.x",
        "tip.y",
        "tip.z",
        "tip.rx",
        "tip.ry",
        "tip.rz",
        "pad.x",
    )
    assert body.partition_names[-1] == "fixed-interface 7"
    # the first coordinates are the interfaces' own motions
    assert np.array_equal(np.vstack([f.modes for f in body.interfaces[1:]]), body.partition[:12])
    back = np.linalg.inv(body.partition)
    k = back.T @ np.diag(body.stiffness) @ back
    size = np.sqrt(np.diag(k))
    off = k / np.outer(size, size) - np.eye(19)
    assert abs(off[12:]).max() < 1e-10
    assert abs(off[:12, :12]).max() > 1e-3


def test_six_rigid_body_modes(model):
    """Free, in the coordinates of the full model: the rigid motions have no energy in the record."""
    body = craig_bampton(model, modes=4, frame="root")
    k = np.zeros((6 + body.n_modes,) * 2)
    k[6:, 6:] = np.diag(body.stiffness)
    eigenvalues = scipy.linalg.eigh(k, body.mass_matrix(), eigvals_only=True)
    assert abs(eigenvalues[:6]).max() < 1e-8 * eigenvalues[6]
    assert np.sqrt(eigenvalues[6:]) / (2 * np.pi) == pytest.approx(body.frequencies(), rel=1e-8)


def beam_19k():
    """The beam of tests/data/beam_tet10, faces x = 0 and x = 1 rigid."""
    arrays = np.load(DATA / "beam_tet10" / "beam_19k_tet10_netgen.npz")
    groups = {"root": lambda x: np.isclose(x[0], 0.0), "tip": lambda x: np.isclose(x[0], 1.0)}
    mesh = from_arrays(MPI.COMM_WORLD, arrays["points"], arrays["tet10"], facet_groups=groups)
    soft = solid_linear.Parameters(E=2.1e9, nu=0.3, rho=7850.0)
    interfaces = [Interface("root"), Interface("tip")]
    return ContinuumModel(mesh, solid_linear, soft, degree=2, interfaces=interfaces)


@pytest.mark.mpi
def test_beam_of_another_program(monkeypatch):
    """Frequencies of exudyn and NGSolve on the same mesh, and the box's mass properties.

    Their fourteen modes have the first of a pair alone.
    """
    monkeypatch.setattr(fixed_modes, "_EQUAL", 0.0)
    body = craig_bampton(beam_19k(), modes=14, frame="root")
    clamped = body.frequencies(["root"])
    assert clamped[0] == pytest.approx(4.18074, abs=5e-6)
    assert clamped[2] == pytest.approx(25.90, abs=5e-3)
    # held at the body frame the modes are those of the normal form, to the last digits
    assert clamped == pytest.approx(np.sqrt(body.stiffness) / (2 * np.pi), rel=2e-13)
    hinged = body.frequencies({"root": ("x", "y", "z", "rx", "rz")})
    assert hinged[1] == pytest.approx(18.20436, abs=6e-6)

    assert body.mass == pytest.approx(19.625, rel=1e-10)
    assert body.com == pytest.approx([0.5, 0.0, 0.0], abs=1e-10)
    across, along = 19.625 * (1.0 + 0.05**2) / 12, 19.625 * 2 * 0.05**2 / 12
    assert abs(body.inertia - np.diag([along, across, across])).max() < 1e-10 * across


def parallel_and_alone(**arguments):
    return (
        craig_bampton(bracket(comm=comm), **arguments) for comm in (MPI.COMM_WORLD, MPI.COMM_SELF)
    )


@pytest.mark.mpi
def test_record_does_not_depend_on_the_number_of_ranks():
    world, alone = parallel_and_alone(modes=6, frame="tip", keep=Keep(modes=True, surface=True))
    for clamped in ((), ("tip",), ("root", "pad")):
        assert world.frequencies(clamped) == pytest.approx(alone.frequencies(clamped), rel=1e-10)
    # not much lower: at 1 Hz the inertia of the free body is all, and the inverse loses ten digits of the stiffness
    for hertz in (30.0, 100.0, 700.0, 2500.0, 6000.0):
        omega = 2 * np.pi * hertz
        assert relative(dynamic_stiffness(world, omega), dynamic_stiffness(alone, omega)) < 1e-8
    # signs too, by the rule; eigenvectors carry more of the round-off
    assert abs(world.partition - alone.partition).max() < 1e-7 * abs(alone.partition).max()
    assert np.array_equal(world.modes.node, alone.modes.node)
    assert abs(world.modes.phi - alone.modes.phi).max() < 1e-7 * abs(alone.modes.phi).max()
    assert np.array_equal(world.surface.triangle, alone.surface.triangle)
    assert abs(world.surface.x - alone.surface.x).max() < 1e-12


@pytest.mark.mpi
def test_every_rank_has_the_same_bits():
    body = craig_bampton(bracket(), modes=6, frame="tip", keep=Keep(modes=True, surface=True))
    parts = [body.gram, body.stiffness, body.partition, body.modes.phi, body.surface.phi]
    parts += [frame.modes for frame in body.interfaces]
    mine = b"".join(part.tobytes() for part in parts)
    assert all(other == mine for other in MPI.COMM_WORLD.allgather(mine))


def square_bar(comm, cut):
    """A bar of square section, whose bending frequencies come in exact pairs."""
    mesh = meshes.block(1.0, 0.1, 0.1, divisions=(8, 2, 2), comm=comm)
    steel = solid_linear.Parameters(E=2.1e11, nu=0.3, rho=7850.0)
    model = ContinuumModel(mesh, solid_linear, steel, degree=1, interfaces=[Interface("x_min")])
    return craig_bampton(model, modes=cut, frame="x_min", geometric_stiffness=False)


@pytest.mark.filterwarnings("ignore::flexmbd.errors.ModesWarning")  # pairs are kept whole
@pytest.mark.mpi
@pytest.mark.parametrize("cut", [1, 4, 6, 7])
def test_equal_frequencies_are_turned_by_the_rule(cut):
    """Also where the last mode is one of a pair."""
    world, alone = square_bar(MPI.COMM_WORLD, cut), square_bar(MPI.COMM_SELF, cut)
    assert world.stiffness == pytest.approx(alone.stiffness, rel=1e-10)
    assert abs(world.gram - alone.gram).max() < 1e-7 * abs(alone.gram).max()
    if cut > 1:
        assert world.stiffness[0] == pytest.approx(world.stiffness[1], rel=1e-10)


def test_interface_nodes_move_as_their_frame_says(model):
    """Nodal modes at an interface are the rigid motion of its mode rows, all in B's axes."""
    body = craig_bampton(model, modes=5, frame="tip", keep=Keep(modes=True))
    carrier = model.interface("tip")
    for frame in body.interfaces:
        nodes = model.interface(frame.name).nodes
        x = (model.space.tabulate_dof_coordinates()[nodes] - carrier.p) @ carrier.R
        rows = [np.argmin(np.linalg.norm(body.modes.x - at, axis=1)) for at in x]
        assert abs(body.modes.x[rows] - x).max() < 1e-13
        moved = frame.modes[:3] + np.cross(frame.modes[3:].T, (x - frame.p_BI_B)[:, None]).swapaxes(
            1, 2
        )
        assert abs(body.modes.phi[rows] - moved).max() < 1e-10 * abs(body.modes.phi).max()


def test_surface_is_part_of_the_nodal_modes(model):
    body = craig_bampton(model, modes=2, frame="root", keep=Keep(modes=True, surface=True))
    for x, phi in zip(body.surface.x, body.surface.phi, strict=True):
        row = np.argmin(np.linalg.norm(body.modes.x - x, axis=1))
        assert np.array_equal(body.modes.phi[row], phi)
    a, b, c = np.moveaxis(body.surface.x[body.surface.triangle], 1, 0)
    volume = np.einsum("ti,ti", np.cross(b - a, c - a), a + b + c) / 18
    assert volume == pytest.approx(0.4 * 0.06 * 0.1, rel=1e-12)


def test_groups_are_there_only_where_asked_for(model):
    body = craig_bampton(model, modes=2, frame="root")
    assert body.modes is None
    assert body.surface is None


def test_provenance(model):
    body = craig_bampton(model, modes=2, frame="root")
    assert body.provenance["reduction"] == "Craig-Bampton"
    assert body.provenance["form"] == "flexmbd.forms.solid_linear"
    assert body.provenance["mesh"] == model.mesh.fingerprint()
    assert float(body.provenance["rigid motion error"]) < 1e-10
    assert float(body.provenance["orthonormality error"]) < 1e-10
    assert guyan(model, frame="root").provenance["reduction"] == "Guyan"


@pytest.mark.mpi
@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"frame": "bore"}, InterfaceError, "no interface 'bore'; it has: 'root', 'tip', 'pad'"),
        ({"modes": -1}, ReductionError, "from 0 on, got -1"),
        ({"modes": 2.5}, ReductionError, "from 0 on, got 2.5"),
        ({"modes": True}, ReductionError, "from 0 on, got True"),
        ({"modes": 100}, ReductionError, "100 fixed-interface modes .* the interior has 60 dofs"),
    ],
)
def test_what_cannot_be_reduced_is_refused_on_all_ranks(arguments, error, message):
    with pytest.raises(error, match=message):
        craig_bampton(bracket(degree=1), **{"modes": 3, "frame": "root", **arguments})


@pytest.mark.mpi
def test_eigensolver_that_does_not_converge(monkeypatch):
    process = eigen.BlockLanczos
    monkeypatch.setattr(eigen, "BlockLanczos", lambda *given, **how: process(*given, **{**how, "limit": 18}))
    message = r"found [0-4] of 5 fixed-interface modes to a relative residual of 1e-12 in 2 steps and 16 vectors"
    with pytest.raises(ConvergenceError, match=message):
        craig_bampton(bracket(), modes=3, frame="root")


def two_blocks(gap, monkeypatch, interfaces):
    """Two cubes, the second at a distance from the first or on it; only the first has a group.

    As a mesh made by other means than ours, which refuse it.
    """
    monkeypatch.setattr(tagged_mesh, "check_connected", lambda mesh: None)
    corner = np.array([(x, y, z) for z in (0, 1) for y in (0, 1) for x in (0, 1)], dtype=float)
    points = np.concatenate([corner, corner + np.array([1.0 + gap, 0.0, 0.0])])
    cells = np.arange(16).reshape(2, 8)
    if gap == 0.0:
        cells[1, ::2] = cells[0, 1::2]
        keep = np.unique(cells)
        points, cells = points[keep], np.searchsorted(keep, cells)
    groups = {"held": lambda x: x[0] < 1e-9}
    mesh = from_arrays(
        MPI.COMM_WORLD, points, cells, cell="hexahedron", degree=1, facet_groups=groups
    )
    return ContinuumModel(
        mesh,
        solid_linear,
        solid_linear.Parameters(E=1.0, nu=0.3, rho=1.0),
        degree=1,
        interfaces=interfaces,
    )


@pytest.mark.mpi
@pytest.mark.parametrize("frame", ["held", None])
@pytest.mark.parametrize("coupling", Coupling)
def test_part_that_hangs_on_nothing_is_refused(coupling, frame, monkeypatch):
    held = [Interface("held", coupling=coupling)]
    assert guyan(two_blocks(0.0, monkeypatch, held), frame=frame).n_modes == 0
    with pytest.raises(ReductionError, match="a part of the body is connected to no"):
        guyan(two_blocks(0.5, monkeypatch, held), frame=frame)


@pytest.mark.mpi
def test_two_pieces_without_interfaces_are_refused(monkeypatch):
    sound = two_blocks(0.0, monkeypatch, [])
    assert craig_bampton(sound, modes=1, frame=None, geometric_stiffness=False).n_modes == 1
    with pytest.raises(ReductionError, match="a part of the body is connected to no"):
        craig_bampton(two_blocks(0.5, monkeypatch, []), modes=1, frame=None)


def test_rigid_motion_that_costs_energy_is_refused():
    """A form whose energy resists translation is caught by the check of the static shapes."""
    form = types.ModuleType("on_a_bed")
    content = dict(vars(solid_linear))
    content["strain_energy"] = lambda u, p: [
        *solid_linear.strain_energy(u, p),
        (1e6 * p.E * ufl.inner(u, u), solid_linear.Quadrature(2)),
    ]
    form.__dict__.update({**content, "__name__": "on_a_bed"})
    mesh = meshes.block(1.0, 0.1, 0.1, divisions=(3, 1, 1), comm=MPI.COMM_SELF)
    model = ContinuumModel(
        mesh,
        form,
        solid_linear.Parameters(E=1.0, nu=0.3, rho=1.0),
        degree=1,
        interfaces=[Interface("x_min")],
    )
    with pytest.raises(ReductionError, match="miss a rigid motion"):
        guyan(model, frame="x_min")
