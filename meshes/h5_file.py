"""A mesh in an HDF5 file of our own, of which every rank reads its share alone.

The file (any HDF5 library can read it):

    bytes 0-511     user block: what the file is, its size and SHA-256 (`files.tree_file`)
    /               attributes `format` = "flexmbd mesh", `version` = 2, `cell` (basix's name of the
                    cells) and `degree` (of the geometry, 1 or 2)
    points          (n, 3) f8, m
    cells           (m, k) i8, rows of points, in basix's order of a cell's nodes
    cell_tags       (m,) i4, 0 for none
    facets          (f, v) i8, vertices of the tagged facets, as rows of points, ascending
    facet_tags      (f,) i4
    edges           (e, 2) i8, vertices of the edges in groups; an edge is there once for each group
    edge_tags       (e,) i4
    vertices        (p, 1) i8, and vertex_tags, likewise
    cell_group_names, cell_group_tags       texts, and i4; likewise of facets, edges and vertices

It is the same whatever number of ranks writes it, and rows of points are what they were in the input
of the mesh, so that a mesh read from it has the same fingerprint.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Collection, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from mpi4py import MPI

import basix
import h5py
import numpy as np
import numpy.typing as npt

from flexmbd.continuum.compat import geometry_degree
from flexmbd.continuum.grid.mesh_blocks import BELOW, mesh_blocks, numbered
from flexmbd.continuum.grid.mesh_input import MeshInput
from flexmbd.continuum.grid.row_exchange import blocks_on_root, share_of
from flexmbd.continuum.grid.tagged_mesh import TaggedMesh
from flexmbd.continuum.parallel import on_root, raise_collectively
from flexmbd.errors import MeshError, RecordError
from flexmbd.files.sound_hdf5 import open_hdf5
from flexmbd.files.tree_file import HEAD, FileKind, check_seal, seal
from flexmbd.files.whole_file import first_line, open_part, take_part
from flexmbd.meshes.dimension import check_arguments, checked_part
from flexmbd.meshes.group_choice import chosen

IntArray = npt.NDArray[np.int64]

MESH = FileKind("flexmbd mesh", 2, "flexmbd.meshes.write")

Arrays = Mapping[str, npt.NDArray[Any]]


@checked_part
def write(part: TaggedMesh, path: str | Path) -> None:
    """Write a mesh with its groups to an .h5 file, which `read` reads share by share. Collective.

    Rank 0 writes, and holds no more than its own share and one other at a time, besides the entities
    of all groups below the cells. An existing file survives until the new one is complete.

    Args:
        part: of cells of degree 1 or 2.
        path: ends in .h5.

    Raises:
        MeshError: on all ranks; the file cannot be written there, or paths differ between ranks.
    """
    target = Path(path)

    def check() -> None:
        if target.suffix.lower() != ".h5":
            raise MeshError(f"{path}: a mesh is written to a file that ends in .h5")
        if not target.parent.is_dir():
            raise MeshError(f"{path}: there is no folder {target.parent}")
        if geometry_degree(part.mesh) not in (1, 2):
            raise MeshError(f"{path}: only meshes of degree 1 and 2 are written")

    check_arguments(part.comm, {"path": path}, check)
    destination = Path(os.path.realpath(target))
    fresh: Path | None = None
    descriptor, file = -1, None

    def begin() -> None:
        nonlocal fresh, descriptor, file
        fresh, descriptor = open_part(destination)
        # HDF5 needs no lock of its own: nobody else knows the file
        file = h5py.File(fresh, "w", userblock_size=HEAD, locking=False)
        _write_head(file, part)

    def end() -> None:
        if file is not None and fresh is not None:
            file.close()
            seal(descriptor, MESH)
            take_part(fresh, destination, file=descriptor)

    try:
        _at_root(part.comm, target, begin)
        for name, block in mesh_blocks(part):
            _write_block(part.comm, target, file, name, block)
        _at_root(part.comm, target, end)
    finally:
        if file:  # a closed one is false
            file.close()
        if fresh is not None:
            os.close(descriptor)
            with suppress(OSError):
                fresh.unlink(missing_ok=True)


def _at_root(comm: MPI.Comm, target: Path, function: Callable[[], None]) -> None:
    error: Exception | None = None
    if comm.rank == 0:
        try:
            function()
        except (OSError, RuntimeError, ValueError) as caught:
            error = _not_written(target, caught)
    raise_collectively(comm, error)


def _not_written(target: Path, error: Exception) -> MeshError:
    return MeshError(
        f"cannot write {target}: {first_line(error)}; nothing was changed there: choose a folder that you may write "
        "to and that has the space"
    )


def _write_head(file: Any, part: TaggedMesh) -> None:
    file.attrs["format"], file.attrs["version"] = MESH.format, MESH.version
    file.attrs["cell"] = part.mesh.topology.cell_name()
    file.attrs["degree"] = geometry_degree(part.mesh)
    groups = {
        "cell": part.cell_groups,
        "facet": part.facet_groups,
        "edge": numbered(part.edge_groups),
        "vertex": numbered(part.vertex_groups),
    }
    for kind, tags in groups.items():
        file.create_dataset(f"{kind}_group_names", data=list(tags), dtype=h5py.string_dtype())
        file.create_dataset(f"{kind}_group_tags", data=np.array(list(tags.values()), dtype="<i4"))


def _write_block(
    comm: MPI.Comm, target: Path, file: Any, name: str, block: npt.NDArray[Any]
) -> None:
    """Write an array of which each rank has a block. Collective."""
    shape = (comm.allreduce(len(block)), *block.shape[1:])
    error: Exception | None = None
    dataset, at = None, 0
    for rows in blocks_on_root(comm, block):
        if error is None:  # or the others would wait for ever
            try:
                if dataset is None:
                    dataset = file.create_dataset(name, shape, rows.dtype.newbyteorder("<"))
                dataset[at : at + len(rows)] = rows
            except (OSError, RuntimeError, ValueError) as caught:
                error = _not_written(target, caught)
        at += len(rows)
    raise_collectively(comm, error)


def h5_input(
    path: Path,
    comm: MPI.Comm,
    *,
    cell_groups: Collection[str] | None,
    facet_groups: Collection[str] | None,
) -> MeshInput:
    """This rank's share of a mesh that `write` has written. Collective.

    Each rank opens the file and reads its points, cells and facets alone.

    Args:
        path: the same on all ranks, which all can read it.
        comm: the ranks.
        cell_groups: names of the groups of cells to take; None for all.
        facet_groups: of facets.

    Raises:
        MeshError: on all ranks; a rank cannot open the file, it is no such file, its arrays do not fit
            together, or a name is not there.
    """
    # before the HDF5 library sees a byte: on a damaged file it may never return
    on_root(comm, lambda: _refuse_damaged(path))
    share: MeshInput | None = None
    error: Exception | None = None
    try:
        with open_hdf5(path, size=path.stat().st_size) as file:
            share = _share(path, file, comm, cell_groups, facet_groups)
    except MeshError as caught:
        error = caught
    except (RecordError, OSError, KeyError, TypeError, ValueError, AttributeError, RuntimeError) as caught:
        error = MeshError(f"{path}: not a whole file of a {MESH.format}: {first_line(caught)}")
    raise_collectively(comm, error)
    if share is None:  # for the type checker: without a share there is an error
        raise MeshError(f"{path}: not read")
    return share


def _refuse_damaged(path: Path) -> None:
    try:
        check_seal(path, kind=MESH)
    except RecordError as error:
        raise MeshError(f"{error}; meshes of flexmbd 0.1 had no checksum and are written again from their source"
                        if _is_plain_hdf5(path) else str(error)) from error  # fmt: skip


def _is_plain_hdf5(path: Path) -> bool:
    with open(path, "rb") as file:
        return file.read(4) == b"\x89HDF"


def _share(
    path: Path,
    file: Any,
    comm: MPI.Comm,
    cell_groups: Collection[str] | None,
    facet_groups: Collection[str] | None,
) -> MeshInput:
    cell, degree = str(file.attrs["cell"]), int(file.attrs["degree"])
    names = {
        kind: dict(
            zip(
                file[f"{kind}_group_names"].asstr()[:].tolist(),
                file[f"{kind}_group_tags"][:].tolist(),
                strict=True,
            )
        )
        for kind in ("cell", *BELOW.values())
    }
    mine = {}
    for name, tags in (("cells", "cell_tags"), *((a, f"{b}_tags") for a, b in BELOW.items())):
        here = share_of(comm.rank, comm.size, len(file[name]))
        mine[name], mine[tags] = file[name][here].astype(np.int64), file[tags][here].astype(np.int32)
        top = int(mine[name].max(initial=-1))
        if len(file[tags]) != len(file[name]) or mine[name].min(initial=0) < 0 or top >= len(file["points"]):
            raise MeshError(f"{path}: {name} names points that are not there, or lack tags")
    _check_columns(path, mine, cell, degree)
    cells = chosen("cell", names["cell"], cell_groups, path)
    facets = chosen("facet", names["facet"], facet_groups, path)
    kept = np.isin(mine["facet_tags"], list(facets.values()))
    mine["cell_tags"][~np.isin(mine["cell_tags"], list(cells.values()))] = 0
    return MeshInput(
        cell=cell,
        degree=degree,
        points=file["points"][share_of(comm.rank, comm.size, len(file["points"]))].astype(np.float64),
        cells=mine["cells"],
        cell_tags=mine["cell_tags"],
        cell_groups=cells,
        facets=mine["facets"][kept],
        facet_tags=mine["facet_tags"][kept],
        facet_groups=facets,
        edge_groups={n: mine["edges"][mine["edge_tags"] == tag] for n, tag in names["edge"].items()},
        vertex_groups={
            n: mine["vertices"][mine["vertex_tags"] == tag] for n, tag in names["vertex"].items()
        },
    )


def _check_columns(path: Path, mine: Arrays, cell: str, degree: int) -> None:
    """Refuse arrays that are not as wide as the cells ask for."""
    kind = basix.CellType[cell]
    element = basix.create_element(
        basix.ElementFamily.P, kind, degree, basix.LagrangeVariant.equispaced
    )
    facet = len(basix.topology(kind)[-2][0])
    for name, columns in (("cells", element.dim), ("facets", facet), ("edges", 2), ("vertices", 1)):
        if mine[name].ndim != 2 or mine[name].shape[1] != columns:
            raise MeshError(f"{path}: {name} must have {columns} columns, got {mine[name].shape}")
