"""Damaged files: each is read as what it still is, or refused by an error of flexmbd, soon and in little memory.

Formats are found in FORMATS, kinds of HDF5 files by looking for each FileKind of the package: a new one fails here
until it has a case.  What a checksum guards is also changed behind it, array by array.
"""

import importlib
import itertools
import pkgutil
import resource
import warnings
from collections.abc import Callable
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import foreign_decks
import h5py
import lattice
import numpy as np
import pytest
from exported_bodies import small_body
from machines import pendulum, slider_crank
from mutations import mutations

import flexmbd as fm
from flexmbd import meshes
from flexmbd.ensemble.results_file import ENSEMBLE
from flexmbd.errors import FlexmbdError, RecordError
from flexmbd.files.array_file import read_arrays, write_arrays
from flexmbd.files.result_table import ResultTable
from flexmbd.files.tree_file import FileKind, read_tree, tree_image, write_tree
from flexmbd.files.tree_log import read_log
from flexmbd.meshes import trial_read
from flexmbd.meshes.h5_file import MESH
from flexmbd.multibody.interiors.observed import InteriorFields, InteriorMesh
from flexmbd.multibody.team import Alone
from flexmbd.record.file_kind import RECORD
from flexmbd.run import checkpoint
from flexmbd.run.recorded_instants import RECORDING
from flexmbd.run.recording_file import RecordingFile
from flexmbd.run.result_file import TRAJECTORY
from flexmbd.run.stopped import SimulationError
from flexmbd.run.stream_file import STREAM
from flexmbd.scene_file import build, read_scene

MEMORY = 2**30  # bytes, of one file

MSH = """$MeshFormat
2.2 0 8
$EndMeshFormat
$PhysicalNames
2
2 1 "foot"
3 2 "all"
$EndPhysicalNames
$Nodes
5
1 0 0 0
2 1 0 0
3 0 1 0
4 1 1 0
5 0.5 0.5 1
$EndNodes
$Elements
4
1 2 2 1 1 1 2 3
2 2 2 1 1 2 4 3
3 4 2 2 1 1 2 3 5
4 4 2 2 1 2 4 3 5
$EndElements
"""

SCENE = """gravity = [0.0, 0.0, -9.81]
[[body]]
name = "bob"
mass = 2.0
inertia = [0.1, 0.1, 0.1]
[[joint]]
kind = "revolute"
name = "hinge"
axis = "y"
parent = "ground"
child = {body = "bob", p = [-1.0, 0.0, 0.0]}
[[force]]
kind = "joint_spring"
joint = "hinge"
stiffness = 3.0
[simulate]
t_end = 0.5
"""


@dataclass(frozen=True)
class Case:
    """A kind of file: how one comes to be, how it is read, and how many of its bytes' mutants are tried."""

    name: str
    write: Callable[[Path], Any]
    read: Callable[[Path], Any]
    count: int = 200


@cache
def turning():
    scene, _, crank = slider_crank()
    crank.velocity = 50.0
    return scene.compile()


def ran(path):
    return turning().simulate(0.02, integrator=fm.RadauIIA(), stream=path, checkpoints=[0.01])


def go_on(path):
    """From a checkpoint; what kernels are given must not end the process."""
    with suppress(SimulationError):
        turning().simulate(0.02, integrator=fm.RadauIIA(), restart=fm.Checkpoint.load(path), max_steps=2)


def tet(suffix):
    part = lattice.lattice("tetrahedron", 1, program="nastran" if suffix == ".bdf" else "abaqus")
    return lattice.bdf(part, 1) if suffix == ".bdf" else lattice.inp(part, 1)


def archive(path):
    part = lattice.lattice("tetrahedron", 1, map=lattice.shear)
    types, ends = [(285, 1, 0)] * len(part.cells), foreign_decks.component("FOOT", "NODE", part.at(0, 0.0))
    path.write_text(foreign_decks.cdb(part.points, part.cells.tolist(), types=types, components=ends))


def med(path):
    part = lattice.lattice("tetrahedron", 1, map=lattice.shear)
    tip = {"rows": {2: [0, 1]}, "names": {2: ["tip"]}}
    foreign_decks.write_med(path, part.points, [("tetra", part.cells, [-6] * len(part.cells))], {-6: ["part"]}, tip)


def skin(path):
    return meshes.read(path, facet_groups=["skin"])


def table(path):
    return ResultTable(("t", "x"), ("s", "m"), np.arange(20.0).reshape(10, 2)).save(path)


class Cube:
    """An interior that shows eight nodes."""

    def __init__(self):
        self.x = np.array([[i, j, k] for i in (0.0, 1.0) for j in (0.0, 1.0) for k in (0.0, 1.0)])

    def outline(self):
        return InteriorMesh(np.arange(1, 9), self.x, np.array([[0, 1, 2], [1, 3, 2]]))

    def at(self, t):
        stress = np.full((8, 6), 1e6 * t)
        rates = np.zeros((8, 3))
        values = {"stress": stress, "von_mises": stress[:, 0]}
        return InteriorFields(np.zeros(3), np.eye(3), self.x * (1.0 + t), rates, rates, values, 1e6 * t, 3)


def recorded(path, times=((0.0, 0.1), (0.2,), (0.3, 0.4))):
    """Blocks of instants of a cube."""
    cube = Cube()
    file = RecordingFile(fm.Recording(path, every=0.1), {"cube": cube}, Alone())
    file.begin(None)
    for block in times:
        file.append([(t, {"cube": cube.at(t)}) for t in block])
    file.close()


def every_field(path):
    for body in fm.load_recording(path).values():
        for name in body.fields:
            assert len(body.values(name)) == len(body.t)
        with np.errstate(all="ignore"):
            if len(body.t):
                body.stress(0.2)


@cache
def swinging():
    scene, bob, _ = pendulum()
    return scene.compile(parameters={"m": fm.parameter.Mass(bob)})


OUTPUTS = {"end": lambda run: run.x[-1], "path": lambda run: run.v[:2]}


def study(path):
    """Four variants of a machine; those that the file holds are not run again."""
    how = {"integrator": fm.ExplicitRungeKutta(), "h": 0.01}
    with swinging().ensemble({"m": np.arange(1.0, 5.0)}, OUTPUTS, t_end=0.02, workers=1, file=path, **how) as found:
        return found.output("end"), found.output("path")


def mended(path):
    """The same; damage that is mended is not told."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", fm.DamageWarning)
        return study(path)


CASES = [
    *(
        Case(f"{one.name}{one.suffix}", lambda path, one=one: one.write(small_body(), path, lossy=True), one.read)
        for one in fm.export.FORMATS
        if one.read is not None
    ),
    Case("record.h5", lambda path: small_body().save(path), fm.ReducedBody.load),
    Case("trajectory.h5", lambda path: ran(path).save(path), lambda path: fm.Trajectory.load(path, turning())),
    Case("stream.h5", ran, lambda path: fm.Trajectory.load(path, turning())),
    Case("recording.h5", recorded, every_field),
    Case("ensemble.h5", study, mended),
    Case("checkpoint.npz", lambda path: ran(path).checkpoints[0].save(path), go_on, 100),
    Case("table.csv", table, ResultTable.load),
    Case("table.npz", table, ResultTable.load),
    Case("scene.toml", lambda path: path.write_text(SCENE), lambda path: build(read_scene(path)), 400),
    Case("mesh.h5", lambda path: meshes.write(meshes.block(1.0, 1.0, 1.0, divisions=(2, 1, 1)), path), meshes.read),
    Case("mesh.inp", lambda path: path.write_text(tet(".inp")), skin, 150),
    Case("mesh.bdf", lambda path: path.write_text(tet(".bdf")), meshes.read, 150),
    Case("mesh.cdb", archive, meshes.read, 6),
    Case("mesh.med", med, meshes.read, 6),
    Case("mesh.msh", lambda path: path.write_text(MSH), meshes.read, 10),
    Case("part.step", lambda path: path.write_bytes(meshes.BRACKET.read_bytes()), meshes.step_faces, 6),
]
GUARDED = {RECORD: "record.h5", TRAJECTORY: "trajectory.h5", STREAM: "stream.h5", MESH: "mesh.h5",
           RECORDING: "recording.h5", ENSEMBLE: "ensemble.h5"}  # fmt: skip


@contextmanager
def watched(what):
    """No more memory than a file is worth."""
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    before = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (pages * resource.getpagesize() + MEMORY, before[1]))
    try:
        yield
    except FlexmbdError as reason:
        told = reason
    else:
        told = FlexmbdError()
    finally:
        resource.setrlimit(resource.RLIMIT_AS, before)
    assert len(str(told)) < 4000, what
    assert not isinstance(told.__cause__, MemoryError), what


def known_kinds():
    """Each FileKind of the package."""
    found = {}
    for module in pkgutil.walk_packages(fm.__path__, "flexmbd."):
        source = Path(module.module_finder.path) / f"{module.name.rpartition('.')[2]}.py"
        if source.exists() and "FileKind(" in source.read_text():
            values = vars(importlib.import_module(module.name)).values()
            found |= {one.format: one for one in values if isinstance(one, FileKind)}
    return found


def test_every_kind_of_file_has_a_case():
    assert known_kinds() == {one.format: one for one in GUARDED}


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_bytes_changed_cut_and_repeated(case, tmp_path, monkeypatch):
    monkeypatch.setattr(trial_read, "LIMITS", trial_read.TrialLimits(seconds=(2.0, 0.0), bytes=(2.0**31, 0.0)))
    path = tmp_path / case.name
    case.write(path)
    case.read(path)  # and compiles
    for number, damaged in enumerate(mutations(path.read_bytes(), count=case.count)):
        path.write_bytes(damaged)
        with watched(f"{case.name} {number}"):
            case.read(path)


def changed(leaf, random):
    """A value of another shape, kind or size in the place of an array or a text."""
    if not isinstance(leaf, np.ndarray) or leaf.dtype.kind == "U":
        return [np.zeros(3), "x" * 500, ("a", "b"), "", ("",) * 3][random.integers(5)]
    flat = leaf.astype(np.float64).ravel()
    one = flat.copy()
    if one.size:
        one[random.integers(one.size)] = [np.nan, np.inf, -1.0, 1e300, -(2.0**62), 2.0**40][random.integers(6)]
    with np.errstate(all="ignore"):
        other = one.reshape(leaf.shape).astype(leaf.dtype)
        ways = [
            flat, np.zeros((0, 3)), leaf[:-1] if leaf.ndim else np.zeros(2), leaf.T, leaf[..., None], np.array(3.0),
            other, other, other, np.vstack([flat, flat]), flat.astype(np.int64), np.zeros((0,) * max(leaf.ndim, 1)),
            {}, "text",
        ]  # fmt: skip
    return ways[random.integers(len(ways))]


def with_one_changed(tree, random):
    """A copy of a tree with one of its values changed or left out."""
    places = []

    def walk(node, where):
        for name, value in node.items():
            places.append((*where, name))
            if isinstance(value, dict):
                walk(value, (*where, name))

    def copy(node):
        return {name: copy(value) if isinstance(value, dict) else value for name, value in node.items()}

    walk(tree, ())
    *folders, last = places[random.integers(len(places))]
    result = place = copy(tree)
    for folder in folders:
        place = place[folder]
    if random.integers(6) == 0 or isinstance(place[last], dict):
        del place[last]
    else:
        place[last] = changed(place[last], random)
    return result


def storable(tree):
    """As a tree file can hold it."""
    if isinstance(tree, dict):
        return {name: storable(value) for name, value in tree.items()}
    if isinstance(tree, np.ndarray) and tree.dtype not in (np.float64, np.int64):
        return tree.astype(np.float64)
    return tree


@pytest.mark.parametrize("name", ["record.h5", "trajectory.h5", "stream.h5", "recording.h5"])
def test_arrays_changed_behind_the_checksum(name, tmp_path):
    case = next(one for one in CASES if one.name == name)
    kind = next(one for one, known in GUARDED.items() if known == name)
    path, random = tmp_path / name, np.random.default_rng(1)
    case.write(path)
    is_log = kind in (STREAM, RECORDING)
    trees = [tree for tree, _ in read_log(path, kind=kind)] if is_log else [read_tree(path, kind=kind)]
    for number in range(250):
        k = int(random.integers(len(trees)))
        damaged = [*trees[:k], storable(with_one_changed(trees[k], random)), *trees[k + 1 :]]
        path.write_bytes(b"".join(tree_image(tree, kind=kind) for tree in damaged))
        with watched(f"{name} {number}"):
            case.read(path)
    write_tree(path, trees[0], kind=kind)


def test_arrays_of_a_checkpoint_changed(tmp_path):
    path, random = tmp_path / "checkpoint.npz", np.random.default_rng(2)
    ran(tmp_path / "run.h5").checkpoints[0].save(path)
    go_on(path)
    arrays = read_arrays(path, version=checkpoint._VERSION)
    refused = 0
    for number in range(200):
        other = with_one_changed(arrays, random)
        write_arrays(path, {name: value for name, value in other.items() if not isinstance(value, dict)})
        with watched(f"checkpoint {number}"):
            try:
                go_on(path)
            except FlexmbdError:
                refused += 1
    assert refused > 100


def test_damage_of_a_log_is_told_with_its_place(tmp_path):
    """A changed byte of any block; a size too large does not pass for a last block that is cut off."""
    path = tmp_path / "recording.h5"
    recorded(path)
    whole, ends = path.read_bytes(), [end for _, end in read_log(path, kind=RECORDING)]
    assert len(ends) == 4
    for begin, end in itertools.pairwise(ends):
        damaged = bytearray(whole)
        damaged[(begin + end) // 2] ^= 1
        path.write_bytes(damaged)
        with pytest.raises(RecordError, match=f"from byte {begin} on"):
            fm.load_recording(path)
    size = f"bytes {ends[1] - ends[0] - 512}\n".encode()
    assert size in whole
    path.write_bytes(whole.replace(size, b"bytes 9" + size[6:], 1))
    with pytest.raises(RecordError, match=f"from byte {ends[0]} on"):
        fm.load_recording(path)
    path.write_bytes(whole[:-100])  # killed while it wrote the last block
    assert np.array_equal(fm.load_recording(path)["cube"].t, [0.0, 0.1, 0.2])


def test_a_recording_goes_on_from_any_instant(tmp_path):
    """Within a block as well; what is behind it, damaged or not, is written again."""
    path, cube = tmp_path / "recording.h5", Cube()
    for since, left in ((0.1, [0.0, 0.1]), (0.3, [0.0, 0.1, 0.2, 0.3]), (0.35, [0.0, 0.1, 0.2, 0.3]), (-1.0, [])):
        recorded(path)
        file = RecordingFile(fm.Recording(path, every=0.1), {"cube": cube}, Alone())
        assert file.begin(since) == (left[-1] if left else None)
        file.append([(0.5, {"cube": cube.at(0.5)})])
        file.close()
        body = fm.load_recording(path)["cube"]
        assert np.array_equal(body.t, [*left, 0.5])
        assert body.values("position")[:, 7, 0] == pytest.approx(1.0 + body.t)
        assert body.values("von_mises", row=-1) == pytest.approx(np.full(8, 5e5))
        assert body.between("position", [0.45])[0, 7, 2] == pytest.approx(1.45 if left else 1.5)
    recorded(path)
    whole = bytearray(path.read_bytes())
    whole[-50] ^= 1
    path.write_bytes(whole)
    file = RecordingFile(fm.Recording(path, every=0.1), {"cube": cube}, Alone())
    assert file.begin(0.2) == 0.2
    file.close()
    assert len(fm.load_recording(path)["cube"].t) == 3


def test_rows_of_an_ensemble_that_were_changed_are_run_again(tmp_path):
    """In an output, a message, a state; all else that is changed is refused before HDF5 opens the file."""
    path = tmp_path / "study.h5"
    right = study(path)
    whole = path.read_bytes()
    with h5py.File(path) as file:
        offsets = {name: file[name].id.get_offset() for name in ("outputs/end", "state", "message", "check")}
        width = 8 * file["outputs/end"].shape[1]
        begin, rows = file.userblock_size, set[int]()
        for one in (*file["outputs"].values(), file["state"], file["message"], file["check"]):
            rows |= {*range(one.id.get_offset(), one.id.get_offset() + one.id.get_storage_size())}
    for at in (offsets["outputs/end"] + width, offsets["state"] + 1, offsets["message"] + 400, offsets["check"] + 4):
        damaged = bytearray(whole)
        damaged[at] ^= 2
        path.write_bytes(damaged)
        with pytest.warns(fm.DamageWarning, match=r"of the variants 1 \(1 of 4\)"):
            again = study(path)
        assert all(np.array_equal(a, b) for a, b in zip(right, again, strict=True))
        assert path.read_bytes() == whole  # as it was, to the bit
    for at in sorted({*range(begin, len(whole), 97)} - rows):
        damaged = bytearray(whole)
        damaged[at] ^= 1
        path.write_bytes(damaged)
        with pytest.raises(RecordError, match="damaged outside its rows"):
            study(path)


RANGES = {
    "claims.bdf": tet(".bdf").replace(
        "ENDDATA", "SPC1,1,123,1,THRU,999999999999\nPLOAD4,2,1,1.,,,,THRU,99999999999\nENDDATA"
    ),
    "claims.inp": tet(".inp")
    + "*NSET, NSET=all, GENERATE\n1, 999999999999, 1\n*ELSET, ELSET=any, GENERATE\n0, 99999999999\n",
    "circle.bdf": "BEGIN BULK\nINCLUDE 'circle.bdf'\n",
    "missing.bdf": "INCLUDE '/dev/zero'\nBEGIN BULK\n",
}


@pytest.mark.parametrize("name", RANGES)
def test_decks_that_claim_more_than_they_hold(name, tmp_path):
    path = tmp_path / name
    path.write_text(RANGES[name])
    if name.startswith("claims"):
        skin_too = {"facet_groups": ["skin"]} if name.endswith("inp") else {}
        with watched(name):
            assert "all" in meshes.read(path, **skin_too).vertex_groups or name.endswith("bdf")
    else:
        reason = {"circle.bdf": "INCLUDE goes in a circle", "missing.bdf": "INCLUDE '/dev/zero' is not there"}[name]
        with watched(name), pytest.raises(fm.MeshError, match=reason):
            meshes.read(path)
