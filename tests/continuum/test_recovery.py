"""Nodal modes from the record, on any number of ranks."""

import functools

from mpi4py import MPI

import numpy as np
import pytest
from full_model import FullModel

from flexmbd import meshes
from flexmbd.continuum import ContinuumModel, Interface
from flexmbd.continuum.finite_elements.nodes import node_numbers
from flexmbd.continuum.finite_elements.recovery import nodal_modes
from flexmbd.continuum.matrices.blocks import inner, multiply
from flexmbd.errors import RecordError
from flexmbd.forms import solid_linear, solid_mixed, st_venant_kirchhoff
from flexmbd.record.reduced_body import ReducedBody
from flexmbd.reduction import Keep, ModalDerivatives, craig_bampton, prestressed

MATERIAL = solid_linear.Parameters(E=3.0e9, nu=0.28, rho=1200.0)
AXES = [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]


def model(*, comm=MPI.COMM_WORLD, length=0.6, degree=2):
    mesh = meshes.block(length, 0.1, 0.2, divisions=(4, 1, 1), cell="tetrahedron", comm=comm)
    interfaces = [Interface("x_min", axes=AXES), Interface("x_max")]
    return ContinuumModel(mesh, solid_linear, MATERIAL, degree=degree, interfaces=interfaces)


def reduced(body_model, **arguments):
    return craig_bampton(body_model, modes=3, frame="x_min", **arguments)


@pytest.mark.mpi
def test_modes_are_those_of_the_matrices():
    """In the mesh's axes and the model's order: phi^T M phi = 1, phi^T K phi = the stiffness."""
    body_model = model()
    body = reduced(body_model, keep=Keep(modes=True))
    modes = nodal_modes(body, body_model)
    full = FullModel(body_model)
    rows = (3 * node_numbers(body_model)[:, None] + np.arange(3)).reshape(-1)
    whole = np.zeros((full.K.shape[0], body.n_modes))
    whole[rows[: body_model.n_owned]] = modes[: body_model.n_owned]
    whole = body_model.comm.allreduce(whole)
    # the ghosts' values are those of their owners
    assert np.array_equal(whole[rows], modes)
    assert abs(whole.T @ full.M @ whole - np.eye(body.n_modes)).max() < 1e-11
    size = np.sqrt(body.stiffness)
    off = whole.T @ full.K @ whole / np.outer(size, size) - np.eye(body.n_modes)
    assert abs(off).max() < 1e-10


@pytest.mark.mpi
@pytest.mark.parametrize("reduced_on", [MPI.COMM_WORLD, MPI.COMM_SELF])
def test_other_ranks_find_the_same(shared_path, reduced_on):
    """Also when the body was reduced on another number of ranks, and read from a file."""
    first = model(comm=reduced_on)
    body = reduced(first, keep=Keep(modes=True))
    path = shared_path / "body.h5"
    if MPI.COMM_WORLD.rank == 0:
        body.save(path)
    MPI.COMM_WORLD.barrier()
    loaded = ReducedBody.load(path)
    other = model()
    found = nodal_modes(loaded, other)

    expected = np.full((3 * len(loaded.modes.node), body.n_modes), np.nan)
    rows = (3 * node_numbers(first)[:, None] + np.arange(3)).reshape(-1)
    expected[rows] = nodal_modes(body, first)
    rows = (3 * node_numbers(other)[:, None] + np.arange(3)).reshape(-1)
    there = ~np.isnan(expected[rows, 0])
    assert there.mean() > 0.3
    assert abs(found[there] - expected[rows][there]).max() < 1e-9 * np.nanmax(abs(expected))


@pytest.mark.mpi
def test_no_modes_anywhere(shared_path):
    body = reduced(model())
    with pytest.raises(RecordError, match=r"reduce the body with keep=Keep\(modes=True\)"):
        nodal_modes(body, model())


@pytest.mark.mpi
def test_record_of_another_mesh():
    body = reduced(model(), keep=Keep(modes=True))
    with pytest.raises(RecordError, match="of another mesh"):
        nodal_modes(body, model(length=0.7))


def layered(face, core, *, form=solid_linear, comm=MPI.COMM_WORLD):
    mesh = meshes.block(
        0.6, 0.1, 0.2, divisions=(4, 1, 2), layers=("face", "core"), cell="tetrahedron", comm=comm
    )
    pairs = {"face": (form, form.Parameters(**face)), "core": (form, form.Parameters(**core))}
    return ContinuumModel(mesh, pairs, degree=2, interfaces=[Interface("x_min"), Interface("x_max")])


STIFF, SOFT = {"E": 3.0e9, "nu": 0.28, "rho": 1200.0}, {"E": 1.0e9, "nu": 0.28, "rho": 1200.0}


@pytest.mark.mpi
@pytest.mark.parametrize("nonlinear", [None, ModalDerivatives({"x_max.y": 100.0})])
@pytest.mark.parametrize("frame", ["x_min", None])
def test_record_of_another_body(nonlinear, frame):
    """Another material anywhere, by a hundredth of a per cent too, is told by how much it is stiffer or heavier."""
    body = craig_bampton(layered(STIFF, SOFT), modes=2, frame=frame, nonlinear=nonlinear, keep=Keep(modes=True))
    for same in (layered(STIFF, SOFT), layered(STIFF, SOFT, form=st_venant_kirchhoff)):
        assert nodal_modes(body, same).shape[1] == body.n_modes
    others = {
        "2 times the stiffness and 1 times": ({**STIFF, "E": 6e9}, {**SOFT, "E": 2e9}),
        r"1 times the stiffness and 2\.5 times": ({**STIFF, "rho": 3000.0}, {**SOFT, "rho": 3000.0}),
        "record states": (SOFT, STIFF),
        "record states: ": ({**STIFF, "nu": 0.2801}, SOFT),
        "that the record states": (STIFF, {**SOFT, "E": 1.0001e9}),
    }
    for message, (face, core) in others.items():
        with pytest.raises(RecordError, match=f"the record is of another body than the model.*{message}"):
            nodal_modes(body, layered(face, core))


@pytest.mark.mpi
def test_record_of_another_state():
    """A model at rest has not the stiffness of a body that is loaded."""
    rest = model()
    loaded = prestressed(rest, frame="x_min", forces={"x_max": (2e6, 0, 0, 0, 0, 0)})
    body = reduced(loaded, keep=Keep(modes=True))
    assert nodal_modes(body, loaded).shape[1] == body.n_modes
    with pytest.raises(RecordError, match="the loaded state with which the body was reduced"):
        nodal_modes(body, rest)


@pytest.mark.mpi
def test_record_of_another_degree():
    body = reduced(model(degree=1), keep=Keep(modes=True))
    with pytest.raises(RecordError, match=r"lack nodes of the model: .*another degree than 2"):
        nodal_modes(body, model(degree=2))


@pytest.mark.mpi
@pytest.mark.parametrize("reduced_on", [MPI.COMM_WORLD, MPI.COMM_SELF])
def test_pressures_and_rotations_come_back(reduced_on):
    """Of forms with unknowns beside displacements all are in the record: the modes are orthonormal by K as well."""
    mixed = solid_mixed.Parameters(E=3.0e9, nu=0.4999, rho=1200.0)

    def rubber(comm):
        mesh = meshes.block(0.6, 0.1, 0.2, divisions=(4, 1, 1), cell="tetrahedron", comm=comm)
        return ContinuumModel(mesh, solid_mixed, mixed, degree=2, interfaces=[Interface("x_min"), Interface("x_max")])

    body = reduced(rubber(reduced_on), keep=Keep(modes=True))
    body = MPI.COMM_WORLD.bcast(body)  # signs of equal modes may be a rank's own
    body_model = rubber(MPI.COMM_WORLD)
    modes = nodal_modes(body, body_model)
    assert body.unknowns is not None
    size = np.sqrt(body.stiffness)
    own = np.asfortranarray(modes[: body_model.n_owned])
    off = inner(body_model.comm, own, multiply(body_model.K, own)) / np.outer(size, size) - np.eye(body.n_modes)
    assert abs(off).max() < 1e-8


@pytest.mark.mpi
def test_reducing_changes_nothing_of_the_model():
    """Nothing of it is another object afterwards, and nothing new but what is computed once and kept."""
    body_model = model()
    before = dict(vars(body_model))
    reduced(body_model)
    after = vars(body_model)
    assert all(after[name] is value for name, value in before.items())
    kept = {name for name, value in vars(type(body_model)).items() if isinstance(value, functools.cached_property)}
    assert set(after) - set(before) <= kept
