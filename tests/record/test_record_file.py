"""The record's file: bit for bit, all or nothing, and one clear error for whatever is not ours."""

import hashlib
import io
import os
import subprocess
import sys

import h5py
import numpy as np
import pytest

from flexmbd.errors import RecordError
from flexmbd.files.tree_file import read_tree, write_tree
from flexmbd.record.file_kind import RECORD

TREE = {
    "gram": np.array([[1.0, np.pi, -0.0], [5e-324, np.inf, np.nan]]),
    "node": np.array([0, 2**62, -(2**63)], dtype=np.int64),
    "empty": np.zeros((0, 3)),
    "scalar": np.array(1.0 / 3.0),
    "frame": "",
    "names": ("pleuel", "Kurbelwange \u00e4\u00df\u4e2d"),
    "no names": (),
    "provenance": {"form": "solid_linear", "of": {"what": "text\nof two lines"}, "none": {}},
}


def assert_same(found, expected):
    assert type(found) is type(expected)
    if isinstance(expected, dict):
        assert set(found) == set(expected)
        for key in expected:
            assert_same(found[key], expected[key])
    elif isinstance(expected, np.ndarray):
        assert (found.dtype, found.shape) == (expected.dtype, expected.shape)
        assert found.tobytes() == expected.tobytes()
    else:
        assert found == expected


def test_round_trip_is_bit_for_bit(tmp_path):
    write_tree(tmp_path / "a.h5", TREE, kind=RECORD)
    assert_same(read_tree(tmp_path / "a.h5", kind=RECORD), TREE)
    assert [path.name for path in tmp_path.iterdir()] == ["a.h5"]


def test_strided_arrays_are_written_in_order(tmp_path):
    array = np.arange(12.0).reshape(3, 4).T[::2]
    write_tree(tmp_path / "a.h5", {"a": array}, kind=RECORD)
    assert np.array_equal(read_tree(tmp_path / "a.h5", kind=RECORD)["a"], array)


def test_other_readers_see_hdf5(tmp_path):
    write_tree(tmp_path / "a.h5", TREE, kind=RECORD)
    with h5py.File(tmp_path / "a.h5") as file:
        assert file.attrs["format"] == "flexmbd record"
        assert file.attrs["version"] == 1
        assert file["gram"].dtype == "<f8"
        assert file["node"].dtype == "<i8"
    assert (tmp_path / "a.h5").read_bytes().startswith(b"flexmbd record, version 1\n")


def test_symbolic_link_is_followed(tmp_path):
    (tmp_path / "there").mkdir()
    (tmp_path / "link.h5").symlink_to(tmp_path / "there" / "a.h5")
    write_tree(tmp_path / "link.h5", {"frame": "root"}, kind=RECORD)
    assert (tmp_path / "link.h5").is_symlink()
    assert read_tree(tmp_path / "there" / "a.h5", kind=RECORD) == {"frame": "root"}


def test_of_a_foreign_file_the_head_alone_is_read(tmp_path):
    """A terabyte of holes, and a pipe without a writer."""
    with open(tmp_path / "a.h5", "wb") as file:
        file.truncate(2**40)
    with pytest.raises(RecordError, match="is not a flexmbd record"):
        read_tree(tmp_path / "a.h5", kind=RECORD)
    os.mkfifo(tmp_path / "b.h5")
    with pytest.raises(RecordError, match="not a regular file"):
        read_tree(tmp_path / "b.h5", kind=RECORD)


def test_every_truncation_is_found(tmp_path):
    write_tree(tmp_path / "a.h5", TREE, kind=RECORD)
    data = (tmp_path / "a.h5").read_bytes()
    for size in [*range(0, 600, 7), *range(600, len(data), 211), len(data) - 1]:
        (tmp_path / "cut.h5").write_bytes(data[:size])
        with pytest.raises(RecordError, match=r"cut\.h5 is truncated"):
            read_tree(tmp_path / "cut.h5", kind=RECORD)


def test_every_damaged_byte_is_found(tmp_path):
    write_tree(tmp_path / "a.h5", {"a": np.arange(4.0)}, kind=RECORD)
    data = (tmp_path / "a.h5").read_bytes()
    used = len(data[:512].rstrip(b"\0"))
    for position in [*range(used), *range(512, len(data), 13), len(data) - 1]:
        damaged = bytearray(data)
        damaged[position] ^= 0x10
        (tmp_path / "bad.h5").write_bytes(damaged)
        with pytest.raises(RecordError, match=r"bad\.h5"):
            read_tree(tmp_path / "bad.h5", kind=RECORD)


def test_other_version_is_named(tmp_path):
    write_tree(tmp_path / "a.h5", TREE, kind=RECORD)
    data = (tmp_path / "a.h5").read_bytes().replace(b"version 1\n", b"version 7\n", 1)
    (tmp_path / "a.h5").write_bytes(data)
    with pytest.raises(RecordError, match="of version 7, and this flexmbd reads version 1"):
        read_tree(tmp_path / "a.h5", kind=RECORD)


@pytest.mark.parametrize(
    "content", [b"\x89HDF\r\n\x1a\n" + bytes(2000), b"solid rod\nfacet normal"]
)
def test_foreign_file_is_refused(tmp_path, content):
    (tmp_path / "a.h5").write_bytes(content)
    with pytest.raises(RecordError, match=r"a\.h5 is not a flexmbd record"):
        read_tree(tmp_path / "a.h5", kind=RECORD)


def test_foreign_hdf5_is_refused(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["gram"] = np.eye(4)
    with pytest.raises(RecordError, match="is not a flexmbd record"):
        read_tree(tmp_path / "a.h5", kind=RECORD)


@pytest.mark.parametrize(("parts", "size"), [(1, 10**12), (1000, 10**4)])
def test_claimed_size_beyond_the_file_is_refused(tmp_path, parts, size):
    """A file that says it holds 8 TB, or many parts of almost its length, with its check sum right: not believed."""
    buffer = io.BytesIO()
    with h5py.File(buffer, "w", userblock_size=512) as file:
        for number in range(parts):
            file.create_dataset(f"gram{number}", shape=(size,), dtype="<f8")
    body = buffer.getvalue()[512:]
    head = f"flexmbd record, version 1\nHDF5 after 512 bytes\nbytes {len(body)}\n"
    head += f"sha256 {hashlib.sha256(body).hexdigest()}\n"
    (tmp_path / "a.h5").write_bytes(head.encode().ljust(512, b"\0") + body)
    assert parts == 1 or len(body) > 8 * size
    with pytest.raises(RecordError, match=f"claims {8 * parts * size} bytes of data, and has"):
        read_tree(tmp_path / "a.h5", kind=RECORD)


def test_missing_file(tmp_path):
    with pytest.raises(RecordError, match=r"cannot read .*a\.h5: No such file"):
        read_tree(tmp_path / "a.h5", kind=RECORD)


@pytest.mark.parametrize(
    ("where", "why"),
    [
        ("nowhere/a.h5", "No such file"),
        ("file/a.h5", "Not a directory"),
        ("folder", "not a regular file"),
        ("n" * 300 + ".h5", "File name too long"),
        ("/proc/a.h5", "No such file|not permitted|Permission denied"),
    ],
)
def test_unwritable_destination(tmp_path, where, why):
    (tmp_path / "file").write_text("here before")
    (tmp_path / "folder").mkdir()
    with pytest.raises(RecordError, match=rf"(?s)cannot write .*({why}).*choose a folder"):
        write_tree(tmp_path / where, TREE, kind=RECORD)
    assert (tmp_path / "file").read_text() == "here before"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file", "folder"]


FULL = """
import resource
import sys
from pathlib import Path
import numpy as np
from flexmbd.errors import RecordError
from flexmbd.files.tree_file import write_tree
from flexmbd.record.file_kind import RECORD
resource.setrlimit(resource.RLIMIT_FSIZE, (20000, 20000))
try:
    write_tree(Path(sys.argv[1]), {"a": np.ones(10000)}, kind=RECORD)
except RecordError as error:
    print(error)
"""


def test_full_destination_leaves_the_old_file(tmp_path):
    """The limit on a file's size stops the write in the middle, as a full disk does."""
    path = tmp_path / "a.h5"
    write_tree(path, TREE, kind=RECORD)
    done = subprocess.run(
        [sys.executable, "-c", FULL, str(path)], capture_output=True, text=True, check=True
    )
    assert f"cannot write {path}: File too large; nothing was changed there" in done.stdout
    assert_same(read_tree(path, kind=RECORD), TREE)
    assert [found.name for found in tmp_path.iterdir()] == ["a.h5"]


@pytest.mark.parametrize(
    ("tree", "message"),
    [
        ({"a": np.zeros(2, dtype=np.float16)}, "item /a is float16"),
        ({"a": {"b": [1.0]}}, "item /a/b is list"),
        ({"a": np.array([object()])}, "item /a is object"),
        ({"a": ("text", 1)}, "item /a is tuple"),
        ({"a": "nul\0"}, "texts without NUL"),
        ({"a/b": "text"}, "cannot have an item named 'a/b'"),
        ({"": "text"}, "cannot have an item named ''"),
        ({1: "text"}, "cannot have an item named 1"),
    ],
)
def test_what_a_record_cannot_hold(tmp_path, tree, message):
    with pytest.raises(RecordError, match=message):
        write_tree(tmp_path / "a.h5", tree, kind=RECORD)
    assert not list(tmp_path.iterdir())


def test_h5py_loads_on_call_only():
    code = "import sys, flexmbd.files.tree_file, flexmbd.record.reduced_body; assert 'h5py' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True)


def test_what_is_no_file_is_not_replaced(tmp_path):
    os.mkfifo(tmp_path / "fifo")
    with pytest.raises(RecordError, match="it is not a regular file"):
        write_tree(tmp_path / "fifo", TREE, kind=RECORD)
    assert (tmp_path / "fifo").is_fifo()
