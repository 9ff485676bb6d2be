"""The record as bare arrays: bit for bit, and no archive from outside that harms."""

import io
import pickle
import zipfile

import numpy as np
import pytest
from exported_bodies import damped_rod, soft_bar
from mutations import survive

import flexmbd as fm
from flexmbd.errors import ExportError


@pytest.mark.parametrize("make", [soft_bar, damped_rod])
def test_round_trip_is_bit_for_bit(tmp_path, make):
    body = make()
    assert fm.export.npz(body, tmp_path / "tëst body.npz") == ()
    assert fm.export.read_npz(tmp_path / "tëst body.npz").fingerprint() == body.fingerprint()
    assert [path.name for path in tmp_path.iterdir()] == ["tëst body.npz"]


def test_numpy_alone_reads_it(tmp_path):
    fm.export.npz(damped_rod(), tmp_path / "rod.npz")
    with np.load(tmp_path / "rod.npz", allow_pickle=False) as file:
        assert np.array_equal(file["gram"], damped_rod().gram)
        assert list(file["interface_names"]) == ["big_end", "small_end"]


def test_damaged_files(tmp_path):
    fm.export.npz(damped_rod(), tmp_path / "rod.npz")
    data = (tmp_path / "rod.npz").read_bytes()
    bodies = survive(fm.export.read_npz, tmp_path / "x.npz", data, count=2000)
    assert bodies < 200


def archive(path, members):
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
        for name, content in members.items():
            file.writestr(name, content)


def header(shape, kind="<f8"):
    stream = io.BytesIO()
    np.lib.format.write_array_header_1_0(stream, {"descr": kind, "fortran_order": False, "shape": shape})
    return stream.getvalue()


def test_a_bomb_is_not_unpacked(tmp_path):
    with zipfile.ZipFile(tmp_path / "bomb.npz", "w", zipfile.ZIP_DEFLATED) as file, file.open(
        "gram.npy", "w", force_zip64=True
    ) as item:
        for _ in range(2200):
            item.write(bytes(2**20))
    assert (tmp_path / "bomb.npz").stat().st_size < 2**22
    with pytest.raises(ExportError, match="claims 1 arrays of 2306867200 bytes"):
        fm.export.read_npz(tmp_path / "bomb.npz")


def test_a_shape_without_its_bytes_is_refused(tmp_path):
    archive(tmp_path / "claim.npz", {"gram.npy": header((2**40, 2**20))})
    with pytest.raises(ExportError, match=r"claims \(1099511627776, 1048576\) of float64, and has 0 bytes"):
        fm.export.read_npz(tmp_path / "claim.npz")


def test_no_pickle_is_opened(tmp_path):
    archive(tmp_path / "object.npz", {"gram.npy": header((), "|O") + pickle.dumps(np.zeros(3))})
    with pytest.raises(ExportError, match=r"Python objects"):
        fm.export.read_npz(tmp_path / "object.npz")


def test_an_unknown_format_is_answered_with_those_there_are():
    with pytest.raises(ExportError, match=r"no format 'adams'; choose from .*npz"):
        fm.export.format_named("adams")
