"""Files that refer to others, their checksums right: each kind of file is refused before a number of it is read."""

import ast
import os
from functools import partial
from pathlib import Path

import h5py
import numpy as np
import pytest

import flexmbd
from flexmbd import meshes
from flexmbd.ensemble.results_file import ENSEMBLE, new_file, opened_file, results
from flexmbd.errors import FlexmbdError, RecordError
from flexmbd.files.row_file import places_of, seal_rows
from flexmbd.files.sound_hdf5 import open_hdf5
from flexmbd.files.tree_file import read_tree, seal, tree_image, write_tree
from flexmbd.files.tree_log import read_log
from flexmbd.meshes.h5_file import MESH
from flexmbd.record.file_kind import RECORD
from flexmbd.run.recorded_instants import RECORDING
from flexmbd.run.result_file import TRAJECTORY
from flexmbd.run.stream_file import STREAM

TREE = {"state": np.arange(6.0), "text": "a", "group": {"inner": np.arange(3.0)}}


@pytest.fixture
def secret(tmp_path):
    """A file of the user's: as plain bytes, and within HDF5."""
    np.arange(1000.0).tofile(tmp_path / "secret.bin")
    with h5py.File(tmp_path / "secret.h5", "w") as file:
        file["numbers"] = np.arange(1000.0)
    return tmp_path / "secret"


def external_storage(file, name, secret):
    shape, dtype = file[name].shape, file[name].dtype
    del file[name]
    file.create_dataset(name, shape, dtype, external=[(f"{secret}.bin", 0, h5py.h5f.UNLIMITED)])


def virtual_dataset(file, name, secret):
    shape, dtype = file[name].shape, file[name].dtype
    del file[name]
    layout = h5py.VirtualLayout(shape, dtype)
    layout[:] = h5py.VirtualSource(f"{secret}.h5", "numbers", (1000,))[: shape[0]] if len(shape) == 1 else 0.0
    file.create_virtual_dataset(name, layout)


def external_link(file, name, secret):
    del file[name]
    file[name] = h5py.ExternalLink(f"{secret}.h5", "/numbers")


def soft_link(file, name, secret):
    file.move(name, "other")
    file[name] = h5py.SoftLink("/other")


def hard_link_to_itself(file, name, secret):
    file.create_group("loop")["again"] = file["/"]


def second_hard_link(file, name, secret):
    file["other"] = file[name]


def named_type(file, name, secret):
    file["type"] = np.dtype("f8")


def object_reference(file, name, secret):
    reference = file[name].ref
    del file[name]
    file.create_dataset(name, data=reference, dtype=h5py.ref_dtype)


def region_reference(file, name, secret):
    file["region"] = np.array([file[name].regionref[...]], h5py.regionref_dtype)


def compound(file, name, secret):
    file["pair"] = np.zeros(3, [("a", "f8"), ("b", "i8")])


def chunks(file, name, secret):
    file.create_dataset("more", (4,), "f8", maxshape=(None,))


def compression(file, name, secret):
    file.create_dataset("more", data=np.zeros(1000), compression="gzip")


CRAFTS = [
    external_storage, virtual_dataset, external_link, soft_link, hard_link_to_itself, second_hard_link, named_type,
    object_reference, region_reference, compound, chunks, compression,
]  # fmt: skip
OUTSIDE = "in another file|link to elsewhere|second name|neither numbers nor texts|pieces or compressed"


def crafted(path, craft, secret, *, kind, name):
    """Change a file in its place and make its checksum right."""
    with h5py.File(path, "r+") as file:
        craft(file, name, secret)
    with open(path, "r+b") as file:
        seal(file.fileno(), kind)


def tree_file(path, craft, secret, kind):
    write_tree(path, TREE, kind=kind)
    crafted(path, craft, secret, kind=kind, name="state")
    return lambda: read_tree(path, kind=kind)


def tree_log(path, craft, secret, kind):
    """The second of three blocks."""
    write_tree(path, TREE, kind=kind)
    crafted(path, craft, secret, kind=kind, name="state")
    image, block = tree_image(TREE, kind=kind), path.read_bytes()
    path.write_bytes(image + block + image)
    return lambda: list(read_log(path, kind=kind))


def ensemble(path, craft, secret):
    new_file(path, 6, {"end": ()}, {"m": np.arange(6.0)}, "abc").close()
    opened_file(path, 6, "abc").close()
    with h5py.File(path, "r+") as file:
        craft(file, "outputs/end", secret)
        head = file.userblock_size
        inside = [one for one in file["outputs"].values() if isinstance(one, h5py.Dataset) and one.external is None]
        inside = [one for one in inside if not one.is_virtual and one.file == file]
        places = places_of([*inside, *(file[name] for name in ("state", "message", "check"))])
    with open(path, "r+b") as file:
        seal_rows(file.fileno(), ENSEMBLE, head=head, places=places)
    with pytest.raises(RecordError, match=OUTSIDE):
        results(path)
    return lambda: opened_file(path, 6, "abc")


def mesh(path, craft, secret):
    meshes.write(meshes.block(1.0, 1.0, 1.0, divisions=(2, 1, 1)), path)
    crafted(path, craft, secret, kind=MESH, name="cell_tags")
    return lambda: meshes.read(path)


KINDS = {
    "record": partial(tree_file, kind=RECORD),
    "trajectory": partial(tree_file, kind=TRAJECTORY),
    "run": partial(tree_log, kind=STREAM),
    "recording": partial(tree_log, kind=RECORDING),
    "ensemble": ensemble,
    "mesh": mesh,
}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("craft", CRAFTS, ids=lambda craft: craft.__name__)
def test_what_is_not_in_the_file_is_refused(kind, craft, secret, tmp_path):
    read = KINDS[kind](tmp_path / "a.h5", craft, secret)
    with pytest.raises(FlexmbdError, match=rf"(?s)a\.h5.*({OUTSIDE})"):
        read()
    assert not [one for one in os.scandir("/proc/self/fd") if os.path.realpath(one.path).endswith("a.h5")]


def test_a_claim_beyond_the_file_is_refused_of_any_kind(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_dataset("rows", (10**12,), "f8")
    with pytest.raises(RecordError, match="claims 8000000000000 bytes of data"):
        open_hdf5(tmp_path / "a.h5", size=(tmp_path / "a.h5").stat().st_size)


def test_an_ensemble_whose_items_are_others_is_refused(tmp_path):
    """Fewer rows than variants, other numbers, none: its digest is known to whoever knows the study."""
    path = tmp_path / "a.h5"
    for count, digest, ends in ((5, "abc", True), (6, "abc", False), (6, "abd", True)):
        new_file(path, count, {"end": ()}, {"m": np.arange(6.0)}, digest).close()
        if not ends:
            with h5py.File(path, "r+") as file:
                del file["state"]
                places = places_of([*file["outputs"].values(), file["message"], file["check"]])
            with open(path, "r+b") as file:
                seal_rows(file.fileno(), ENSEMBLE, head=512, places=places)
        with pytest.raises(RecordError, match=r"of another ensemble|is not a valid flexmbd ensemble"):
            opened_file(path, 6, "abc")


def test_all_files_are_opened_by_one_function():
    """Whoever calls h5py.File elsewhere writes a new file."""
    package = Path(flexmbd.__file__).parent
    for path in package.rglob("*.py", recurse_symlinks=True):
        if path.name == "sound_hdf5.py" or "h5py.File" not in (text := path.read_text()):
            continue
        for call in ast.walk(ast.parse(text)):
            if isinstance(call, ast.Call) and ast.unparse(call.func) == "h5py.File":
                assert ast.unparse(call.args[1]) == "'w'", (path, call.lineno)
