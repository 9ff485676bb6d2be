"""A mesh written by all ranks and read share by share: the same mesh, groups and reduced body."""

from mpi4py import MPI

import h5py
import numpy as np
import pytest
from measures import area, n_owned, volume

from flexmbd import meshes
from flexmbd.continuum import ContinuumModel, Interface
from flexmbd.continuum.compat import geometry_degree
from flexmbd.continuum.grid.mesh_blocks import mesh_blocks
from flexmbd.continuum.grid.mesh_input import create_mesh, untagged
from flexmbd.continuum.grid.row_exchange import blocks_on_root, fetch, send, share_of
from flexmbd.continuum.grid.tagged_mesh import TaggedMesh, from_arrays
from flexmbd.coupling import Coupling
from flexmbd.errors import MeshError
from flexmbd.files.tree_file import HEAD, seal
from flexmbd.forms import solid_linear
from flexmbd.meshes import mesh_file
from flexmbd.meshes.h5_file import MESH
from flexmbd.reduction import Keep, craig_bampton

pytestmark = pytest.mark.mpi

COMM = MPI.COMM_WORLD
STEEL = solid_linear.Parameters(E=2.1e11, nu=0.3, rho=7850.0)


def beam(cell="tetrahedron", degree=2, comm=COMM):
    return meshes.beam(0.4, 0.05, 0.03, h=0.03, cell=cell, degree=degree, comm=comm)


def arrays(path):
    """All that the file holds, on rank 0."""
    with h5py.File(path) as file:
        found = {name: data[()] for name, data in file.items()}
        return found | {name: value for name, value in file.attrs.items()}


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("cell", ["tetrahedron", "hexahedron"])
def test_round_trip(shared_path, cell, degree):
    part = beam(cell, degree)
    meshes.write(part, shared_path / "part.h5")
    back = meshes.read(shared_path / "part.h5")
    assert back.fingerprint() == part.fingerprint()
    assert back.mesh.topology.cell_name() == cell
    assert geometry_degree(back.mesh) == degree
    assert (back.facet_groups, back.cell_groups) == (part.facet_groups, part.cell_groups)
    assert volume(back) == pytest.approx(0.4 * 0.05 * 0.03, rel=1e-13)
    for name in part.facet_groups:
        assert area(back, name) == pytest.approx(area(part, name), rel=1e-13)
    assert n_owned(back, 3, back.cells("beam")) == n_owned(part, 3, part.cells("beam"))


@pytest.mark.parametrize(
    ("part", "facets"),
    [
        (lambda: meshes.sheet(0.6, 0.2, divisions=(4, 3), cell="triangle", degree=2), {"x_min": 3, "y_max": 4}),
        (lambda: meshes.line(2.0, divisions=5, degree=2), {"start": 1, "end": 1}),
    ],
)
def test_shells_and_lines(shared_path, part, facets):
    part = part()
    meshes.write(part, shared_path / "part.h5")
    back = meshes.read(shared_path / "part.h5")
    assert back.fingerprint() == part.fingerprint()
    assert back.facet_groups == part.facet_groups
    for name, count in facets.items():
        assert n_owned(back, part.dim - 1, back.facets(name)) == count
    assert back.vertex_groups.keys() == part.vertex_groups.keys()
    for name in part.vertex_groups:
        assert n_owned(back, 0, back.vertices(name)) == 1


def test_the_file_does_not_depend_on_the_ranks(shared_path):
    meshes.write(beam(), shared_path / "all.h5")
    if COMM.rank == 0:
        meshes.write(beam(comm=MPI.COMM_SELF), shared_path / "one.h5")
        every, one = arrays(shared_path / "all.h5"), arrays(shared_path / "one.h5")
        assert every.keys() == one.keys()
        for name, values in one.items():
            assert np.array_equal(every[name], values), name
        assert [path.name for path in sorted(shared_path.iterdir())] == ["all.h5", "one.h5"]


def test_the_record_is_the_same(shared_path):
    """From the mesh and from its file, read on all ranks and on one."""
    meshes.write(beam("hexahedron", 2), shared_path / "part.h5")

    def reduced(part):
        ends = [Interface("start"), Interface("end", coupling=Coupling.AVERAGED)]
        model = ContinuumModel(part, solid_linear, STEEL, degree=2, interfaces=ends)
        return craig_bampton(model, modes=4, frame="start", keep=Keep(modes=True))

    body, back = reduced(beam("hexahedron", 2)), reduced(meshes.read(shared_path / "part.h5"))
    alone = reduced(meshes.read(shared_path / "part.h5", comm=MPI.COMM_SELF))
    for other in (back, alone):
        assert other.provenance["mesh"] == body.provenance["mesh"]
        assert other.stiffness == pytest.approx(body.stiffness, rel=1e-8)
        assert abs(other.gram - body.gram).max() < 1e-8 * abs(body.gram).max()
        assert np.array_equal(other.modes.node, body.modes.node)
        assert abs(other.modes.phi - body.modes.phi).max() < 1e-6 * abs(body.modes.phi).max()


def test_groups_of_all_kinds(shared_path):
    x = np.array([(i, j, k) for k in (0, 1) for j in (0, 1) for i in range(7)], dtype=float)
    x = np.vstack((x[:5], (9, 9, 9), x[5:]))  # row 5 belongs to no cell
    first = np.array([0, 1, 7, 8, 14, 15, 21, 22])
    cells = first + np.arange(6)[:, None]
    cells[cells >= 5] += 1
    part = from_arrays(
        COMM, x, cells, cell="hexahedron", degree=1,
        facet_groups={"left": lambda x: np.isclose(x[0], 0)},
        cell_groups={"soft": lambda x: x[0] < 2.5},
        edge_groups={"spine": lambda x: np.isclose(x[1] + x[2], 0), "long": lambda x: np.isclose(x[1], 0)},
        vertex_groups={"tip/1": lambda x: np.isclose(x[0], 6) & np.isclose(x[1] + x[2], 2)},
    )  # fmt: skip
    meshes.write(part, shared_path / "part.h5")
    back = meshes.read(shared_path / "part.h5")
    assert back.fingerprint() == part.fingerprint()
    assert n_owned(back, 2, back.facets("left")) == 1
    assert n_owned(back, 3, back.cells("soft")) == 2
    assert n_owned(back, 1, back.edges("spine")) == 6
    assert n_owned(back, 1, back.edges("long")) == 2 * 6 + 7
    assert n_owned(back, 0, back.vertices("tip/1")) == 1
    one = meshes.read(shared_path / "part.h5", facet_groups=[], cell_groups=[])
    assert (one.facet_groups, one.cell_groups) == ({}, {})
    assert len(one.cell_tags.indices) == len(one.facet_tags.indices) == 0
    with pytest.raises(MeshError, match="no facet group 'top'; its facet groups are: 'left'"):
        meshes.read(shared_path / "part.h5", facet_groups=["top"])


def test_no_rank_reads_more_than_its_share(shared_path, monkeypatch):
    """Of the points and cells; and what rank 0 gets to hash and to write is one share at a time."""
    part = beam()
    meshes.write(part, shared_path / "part.h5")
    seen = []
    monkeypatch.setattr(mesh_file, "spread", lambda comm, share: seen.append(share))
    meshes.read(shared_path / "part.h5")
    (share,) = seen
    topology, geometry = part.mesh.topology, part.mesh.geometry
    assert len(share.cells) <= topology.index_map(3).size_global // COMM.size + 1
    assert len(share.points) <= geometry.index_map().size_global // COMM.size + 1
    assert COMM.allreduce(len(share.cells)) == topology.index_map(3).size_global
    for name, block in mesh_blocks(part):
        if name in ("points", "cells", "cell_tags"):
            assert len(block) <= COMM.allreduce(len(block)) // COMM.size + 1


def test_rows_sent_and_fetched():
    rng = np.random.default_rng(COMM.rank)
    total = 17
    mine = share_of(COMM.rank, COMM.size, total)
    block = np.arange(mine.start, mine.stop)[:, None] * [1.0, 10.0]
    wanted = rng.integers(0, total, size=5 * COMM.rank)
    assert np.array_equal(fetch(COMM, block, wanted), wanted[:, None] * [1.0, 10.0])
    keys = np.arange(COMM.rank, total, COMM.size)
    got, rows = send(COMM, keys, keys * 2, total=total)
    assert sorted(got) == list(range(mine.start, mine.stop))
    assert np.array_equal(rows, got * 2)
    if COMM.rank == 0:
        assert np.array_equal(np.concatenate(list(blocks_on_root(COMM, block)))[:, 0], np.arange(total))
    else:
        assert list(blocks_on_root(COMM, block)) == []


@pytest.fixture
def spoil(shared_path):
    """Writes a mesh, changes the file on rank 0, and says where it is."""

    def spoiled(change):
        path = shared_path / "part.h5"
        meshes.write(beam("hexahedron", 1), path)
        if COMM.rank == 0:
            change(path)
        COMM.barrier()
        return path

    return spoiled


def change(name, value):
    def changed(path):
        with h5py.File(path, "r+") as file:
            if name in file.attrs:
                file.attrs[name] = value
            else:
                values = file[name][()]
                del file[name]
                if value is not None:
                    file[name] = value(values)
        with open(path, "r+b") as file:
            seal(file.fileno(), MESH)

    return changed


def as_old(path):
    """As meshes were written before they had a checksum."""
    path.write_bytes(path.read_bytes()[HEAD:])


def with_head(old, new):
    return lambda path: path.write_bytes(path.read_bytes().replace(old, new, 1))


@pytest.mark.parametrize(
    ("spoiler", "pattern"),
    [
        (lambda path: path.write_bytes(b"nothing"), r"part\.h5 is not a flexmbd mesh"),
        (lambda path: path.write_bytes(path.read_bytes()[:-400]), r"part\.h5 is truncated"),
        (lambda path: path.write_bytes(path.read_bytes()[:-1] + b"x"), r"part\.h5 is damaged: its SHA-256"),
        (as_old, "had no checksum and are written again from their source"),
        (with_head(b"version 2", b"version 7"), "of version 7, and this flexmbd reads version 2"),
        (change("cells", None), "not a whole file of a flexmbd mesh"),
        (change("cells", lambda x: x + 1), "cells names points that are not there"),
        (change("cells", lambda x: x[:, :4]), "cells must have 8 columns, got"),
        (change("facets", lambda x: x[:, :3]), "facets must have 4 columns, got"),
        (change("facet_tags", lambda x: x[1:]), "facets names points that are not there, or lack tags"),
        (change("points", lambda x: x * np.nan), "coordinates that are not finite, the first in row 0"),
        (change("points", lambda x: x * [0.0, 1.0, 1.0]), "cells are inverted or flat"),
    ],
)  # fmt: skip
def test_files_that_are_no_such_mesh(spoil, spoiler, pattern):
    path = spoil(spoiler)
    with pytest.raises(MeshError, match=pattern):
        meshes.read(path)
    assert COMM.allreduce(1) == COMM.size


def test_a_file_that_one_rank_cannot_open(shared_path, monkeypatch):
    """As one of a disk that not all machines see."""
    meshes.write(beam("hexahedron", 1), shared_path / "part.h5")
    if COMM.rank == COMM.size - 1:

        def fail(*args, **keywords):
            raise FileNotFoundError("No such file")

        monkeypatch.setattr(h5py, "File", fail)
    with pytest.raises(MeshError, match=r"part\.h5: .*No such file"):
        meshes.read(shared_path / "part.h5")
    assert COMM.allreduce(1) == COMM.size


def test_places_that_cannot_be_written(shared_path):
    part = beam("hexahedron", 1)
    with pytest.raises(MeshError, match=r"part\.msh: a mesh is written to a file that ends in \.h5"):
        meshes.write(part, shared_path / "part.msh")
    with pytest.raises(MeshError, match="there is no folder"):
        meshes.write(part, shared_path / "nowhere" / "part.h5")
    if COMM.size > 1:
        with pytest.raises(MeshError, match=r"on rank 0 and .* on rank 1"):
            meshes.write(part, shared_path / f"part-{COMM.rank}.h5")
    (shared_path / "full.h5").mkdir(exist_ok=True)
    with pytest.raises(MeshError, match=r"cannot write .*full\.h5: .*; nothing was changed there"):
        meshes.write(part, shared_path / "full.h5")
    COMM.barrier()
    assert [path.name for path in shared_path.iterdir()] == ["full.h5"]


def test_a_disk_that_fills_up(shared_path, monkeypatch):
    """Rank 0 fails while the others hand it their shares: all raise, and the file that was there stays."""
    path = shared_path / "part.h5"
    meshes.write(beam("hexahedron", 1), path)
    before = path.read_bytes()
    if COMM.rank == 0:

        def fail(*args, **keywords):
            raise OSError("No space left on device")

        monkeypatch.setattr(h5py.Dataset, "__setitem__", fail)
    with pytest.raises(MeshError, match=r"cannot write .* No space left on device; nothing was changed"):
        meshes.write(beam(), path)
    assert COMM.allreduce(1) == COMM.size
    assert path.read_bytes() == before
    assert [found.name for found in shared_path.iterdir()] == ["part.h5"]


def test_a_mesh_of_dolfinx_alone():
    """Untagged meshes have a fingerprint too, and it is that of the input."""
    points, cells = np.array([(0.0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)]), np.array([[0, 1, 2, 3]])
    share = untagged(points, cells, "tetrahedron", 1)
    if COMM.rank > 0:
        share = share.nothing()
    mesh = create_mesh(COMM, share)
    part = TaggedMesh(mesh, None, {}, None)
    same = from_arrays(MPI.COMM_SELF, points, cells, degree=1, facet_groups={})
    assert part.fingerprint() == same.fingerprint()
