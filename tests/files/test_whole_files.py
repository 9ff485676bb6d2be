"""Files are whole at any instant: no planted link is followed, and what killed writers left is removed by the next."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from exported_bodies import small_body

from flexmbd.ensemble.results_file import new_file
from flexmbd.errors import ExportError, RecordError
from flexmbd.export.record_arrays import npz, read_npz
from flexmbd.files import whole_file
from flexmbd.files.array_file import read_arrays, write_arrays
from flexmbd.files.whole_file import write_file

WRITERS = {
    "text": lambda path: write_file(path, "x" * 100),
    "arrays": lambda path: write_arrays(path, {"version": 1, "x": np.zeros(3)}),
    "record": lambda path: small_body().save(path),
    "ensemble": lambda path: new_file(path, 3, {"peak": ()}, {"m": np.zeros(3)}, "digest").close(),
}

_KILLED = """
import os, signal, sys
from pathlib import Path
from flexmbd.files.whole_file import part_file
with part_file(Path(sys.argv[1])) as (part, file):
    os.write(file, b"half")
    print(part, flush=True)
    signal.pause()
"""


@pytest.mark.parametrize("name", WRITERS)
def test_no_link_is_followed_and_the_next_writer_clears_up(name, tmp_path):
    target, victim = tmp_path / "out.file", tmp_path / "victim"
    victim.write_text("mine")
    # the names that were made of the target's and the process's
    for guess in (f"out.file.{os.getpid()}.part", "out.file.part", ".out.file.part"):
        (tmp_path / guess).symlink_to(victim)
    process = subprocess.Popen([sys.executable, "-c", _KILLED, str(target)], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    left = Path(process.stdout.readline().strip())
    WRITERS[name](target)
    assert left.exists()  # its writer lives
    process.send_signal(signal.SIGKILL)
    process.wait()
    other = tmp_path / f".other.file.{'0' * 16}.part"  # of another target
    other.touch()
    WRITERS[name](target)
    assert not left.exists()
    assert other.exists()
    assert victim.read_text() == "mine"
    assert target.stat().st_size > 0
    assert not [path for path in tmp_path.iterdir() if path.name.startswith(".out.file.") and path.suffix != ".part"]


def test_names_as_long_as_they_can_be(tmp_path):
    path = tmp_path / ("ä" * 125 + ".npz")
    write_arrays(path, {"version": 1})
    assert read_arrays(path, version=1)["version"] == 1
    assert list(tmp_path.iterdir()) == [path]


def test_a_disk_that_is_read_only_or_full(tmp_path, monkeypatch):
    def refuse(path, *args, **keywords):
        raise OSError(30, "Read-only file system")

    path = tmp_path / "kept.npz"
    write_arrays(path, {"version": 1})
    before = path.read_bytes()
    monkeypatch.setattr(os, "open", refuse)
    with pytest.raises(RecordError, match=r"cannot be written to .*: Read-only file system; a file that was there is"):
        write_arrays(path, {"version": 1})
    with pytest.raises(ExportError, match="Read-only file system; nothing was changed there"):
        npz(small_body(), path)
    assert path.read_bytes() == before


def test_an_archive_without_provenance_is_read_back(tmp_path):
    body = small_body()
    assert not body.provenance
    npz(body, tmp_path / "body.npz")
    np.testing.assert_array_equal(read_npz(tmp_path / "body.npz").gram, body.gram)


@pytest.mark.parametrize("name", WRITERS)
def test_where_no_open_file_can_be_renamed(name, tmp_path, monkeypatch):
    """As on Windows: the part is closed before it takes its name, and what grows goes on in the renamed file."""
    monkeypatch.setattr(whole_file, "WINDOWS", True)
    replace, renamed = os.replace, []

    def unless_open(source, target):
        inode = os.stat(source).st_ino
        opened = [os.stat(f"/proc/self/fd/{one}") for one in os.listdir("/proc/self/fd") if alive(one)]
        assert inode not in [one.st_ino for one in opened]
        renamed.append(target)
        replace(source, target)

    def alive(descriptor):
        return os.path.exists(f"/proc/self/fd/{descriptor}")

    monkeypatch.setattr(os, "replace", unless_open)
    before = len(os.listdir("/proc/self/fd"))
    WRITERS[name](tmp_path / "out.file")
    assert len(renamed) == 1
    assert len(os.listdir("/proc/self/fd")) == before
    expected = tmp_path / "expected.file"
    monkeypatch.undo()
    WRITERS[name](expected)
    assert (tmp_path / "out.file").stat().st_size == expected.stat().st_size
