"""The MAT file: scipy and Octave read it, Octave finds the same frequencies; ours comes back; files that are none."""

import dataclasses
import shutil
import struct
import subprocess

import numpy as np
import pytest
import scipy.io
from exported_bodies import damped_rod, floating_bar, small_body, soft_bar
from mutations import survive

import flexmbd as fm
from flexmbd.errors import ExportError
from flexmbd.export import InterfaceNode
from flexmbd.rotation import from_quaternion

OCTAVE = """
s = load("{path}");
K = (s.K + s.K') / 2; M = (s.M + s.M') / 2;
f = sqrt(max(sort(eig(K, M)), 0)) / (2 * pi);
b = rows(s.P);
held = 7:rows(K);
h = sqrt(sort(eig(K(held, held), M(held, held)))) / (2 * pi);
printf("%d %d %s\\n", b, s.n_modes, strtrim(s.names(1, :)));
printf("%.17g ", f); printf("\\n"); printf("%.17g ", h); printf("\\n");
"""


@pytest.mark.parametrize("make", [soft_bar, damped_rod, floating_bar])
def test_octave_finds_the_frequencies(tmp_path, make):
    octave = shutil.which("octave-cli") or shutil.which("octave")
    if octave is None:
        pytest.skip("no octave on the PATH")
    body = make()
    fm.export.simscape(body, tmp_path / "part.mat")
    (tmp_path / "check.m").write_text(OCTAVE.format(path=tmp_path / "part.mat"))
    done = subprocess.run([octave, "--no-gui", "--quiet", tmp_path / "check.m"], capture_output=True, text=True)
    head, free, held = done.stdout.splitlines()
    names = [frame.name for frame in body.interfaces]
    assert head.split() == [str(len(names)), str(body.n_modes - 6 * len(names) + 6), names[0]]
    np.testing.assert_allclose(np.array(free.split(), float)[6:], body.frequencies(), rtol=1e-9)
    np.testing.assert_allclose(np.array(held.split(), float), body.frequencies(names[:1]), rtol=1e-9)


@pytest.mark.parametrize("make", [soft_bar, damped_rod, floating_bar])
def test_scipy_reads_the_variables(tmp_path, make):
    body = make()
    element = fm.export.superelement(body)
    fm.export.simscape(body, tmp_path / "part.mat")
    found = scipy.io.loadmat(tmp_path / "part.mat")
    for name in "PKMD":
        np.testing.assert_array_equal(found[name], element.p if name == "P" else getattr(element, name))
    np.testing.assert_allclose(from_quaternion(found["quaternions"]), element.R, atol=1e-14)
    assert [name.strip() for name in found["names"]] == list(element.names)
    assert found["n_modes"].item() == element.n_modes
    assert found["units"].item().startswith("SI")


def test_the_file_depends_on_the_body_alone(tmp_path):
    for name in ("a.mat", "b.mat"):
        fm.export.simscape(soft_bar(), tmp_path / name)
    assert (tmp_path / "a.mat").read_bytes() == (tmp_path / "b.mat").read_bytes()
    assert b"Created" not in (tmp_path / "a.mat").read_bytes()


def test_names_of_any_letters(tmp_path):
    bar = soft_bar()
    frames = [dataclasses.replace(frame, name=name) for frame, name in zip(bar.interfaces, ("a ü", "b β"), strict=True)]
    named = dataclasses.replace(bar, interfaces=tuple(frames), frame="a ü")
    for one in map(fm.export.format_named, ("simscape", "dmig", "op4")):
        one.write(named, tmp_path / "x")
        back = one.read(tmp_path / "x")
        assert (back.frame, [frame.name for frame in back.interfaces]) == ("a ü", ["a ü", "b β"])


def test_files_of_matlabs_kind(tmp_path):
    """Compressed, without names, quaternions and damping; numbers of other types."""
    bar = soft_bar()
    element = fm.export.superelement(bar)
    P = np.rint(element.p).astype(np.int8)
    variables = {"K": element.K, "M": element.M, "P": P, "more": {"a": 1}}
    scipy.io.savemat(tmp_path / "x.mat", variables, do_compression=True)
    body = fm.export.read_simscape(tmp_path / "x.mat")
    assert [frame.name for frame in body.interfaces] == ["interface 1", "interface 2"]
    np.testing.assert_allclose(body.frequencies(), bar.frequencies(), rtol=1e-10)
    names = {"l": InterfaceNode(), "r": InterfaceNode()}
    named = fm.export.read_simscape(tmp_path / "x.mat", interfaces=names, frame="r")
    assert (named.frame, named.interface("l").p_BI_B.tolist()) == ("r", [-1.0, 0.0, 0.0])


def saved(tmp_path, **changes):
    element = fm.export.superelement(small_body())
    variables = {"K": element.K, "M": element.M, "P": element.p, **changes}
    scipy.io.savemat(tmp_path / "x.mat", {name: value for name, value in variables.items() if value is not None})
    return tmp_path / "x.mat"


@pytest.mark.parametrize(
    ("changes", "match"),
    [
        ({"K": None}, "K and M are needed"),
        ({"P": None}, "does not say which interfaces"),
        ({"K": np.full((8, 8), np.nan)}, "not finite"),
        ({"K": np.ones((7, 8))}, "not the square matrices"),
        ({"K": np.ones((8, 8)) * 1j}, "not a full real matrix"),
        ({"K": scipy.sparse.eye(8).tocsc()}, r"full\(K\)"),
        ({"P": np.zeros((2, 3))}, "not the square matrices"),
        ({"P": np.zeros((1, 2))}, "a position is three"),
        ({"quaternions": np.zeros((1, 4))}, "unit quaternion"),
        ({"K": {"a": 1}}, "not a full real matrix"),
    ],
)
def test_files_that_do_not_fit(tmp_path, changes, match):
    with pytest.raises(ExportError, match=match):
        fm.export.read_simscape(saved(tmp_path, **changes))


def test_bombs_and_claims(tmp_path):
    import zlib

    plain = saved(tmp_path).read_bytes()
    huge = zlib.compress(struct.pack("<II", 14, 2**31 + 8) + bytes(2**26), 9)
    (tmp_path / "bomb.mat").write_bytes(plain[:128] + struct.pack("<II", 15, len(huge)) + huge)
    with pytest.raises(ExportError, match="damaged"):
        fm.export.read_simscape(tmp_path / "bomb.mat")
    at = plain.index(struct.pack("<iiii", 5, 8, 8, 8)) + 8
    (tmp_path / "claim.mat").write_bytes(plain[:at] + struct.pack("<ii", 2**30, 2**30) + plain[at + 8 :])
    with pytest.raises(ExportError, match=r"claims \(1073741824, 1073741824\) numbers, and has 64"):
        fm.export.read_simscape(tmp_path / "claim.mat")
    (tmp_path / "new.mat").write_bytes(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM" + bytes(400))
    with pytest.raises(ExportError, match="save -v7"):
        fm.export.read_simscape(tmp_path / "new.mat")


def test_damaged_files(tmp_path):
    fm.export.simscape(small_body(), tmp_path / "part.mat")
    data = (tmp_path / "part.mat").read_bytes()
    assert survive(fm.export.read_simscape, tmp_path / "x.mat", data, count=2000) < 1000
