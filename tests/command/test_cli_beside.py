"""`flexmbd inspect --report --beside`: two records of one part, by their common interfaces and nodes."""

import csv
import dataclasses

from mpi4py import MPI

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from two_crosses_body import SPRING, TORSION, two_crosses

from flexmbd import forms, meshes
from flexmbd.cli import main
from flexmbd.continuum import ContinuumModel, Interface
from flexmbd.record.groups import InterfaceFrame
from flexmbd.record.record_comparison import compare_records
from flexmbd.reduction import Keep, craig_bampton

LENGTH = 0.2


def rod_model(h, **small_end):
    """A connecting rod of gmsh, its small end's frame as given."""
    steel = forms.solid_linear.Parameters(E=2.1e11, nu=0.3, rho=7850.0)
    mesh = meshes.connecting_rod(length=LENGTH, h=h, comm=MPI.COMM_SELF)
    ends = [Interface("big_end"), Interface("small_end", **small_end)]
    return ContinuumModel(mesh, forms.solid_linear, steel, degree=2, interfaces=ends)


@pytest.fixture(scope="module")
def rods(tmp_path_factory):
    """Files: few modes; many, from another frame and with the small end's frame elsewhere; a finer mesh."""
    folder = tmp_path_factory.mktemp("rods")
    model = rod_model(0.02)
    turned = rod_model(0.02, origin=(LENGTH, 0.004, -0.003), axes=[[0, 0, 1], [1, 0, 0], [0, 1, 0]])
    kept = {"keep": Keep(modes=True), "geometric_stiffness": False}
    craig_bampton(model, modes=2, frame="big_end", **kept).save(folder / "few.h5")
    craig_bampton(turned, modes=12, frame="small_end", **kept).save(folder / "many.h5")
    craig_bampton(turned, modes=2, frame="small_end", **kept).save(folder / "turned.h5")
    craig_bampton(rod_model(0.012), modes=2, frame="big_end", geometric_stiffness=False).save(folder / "fine.h5")
    meshes.write(model.mesh, folder / "mesh.h5")
    material = 'form = "solid_linear"\n[parameters]\nE = 2.1e11\nnu = 0.3\nrho = 7850.0\n'
    (folder / "steel.toml").write_text(material)
    return folder


def report(rods, tmp_path, one, other, *more):
    """Tables of a report by their names, as columns of texts, and the page."""
    folder = tmp_path / "report"
    assert main(["inspect", str(rods / one), "--report", str(folder), "--beside", str(rods / other), *more]) == 0
    tables = {}
    for path in (folder / "tables").glob("*.csv"):
        with open(path, newline="") as file:
            head, *rows = csv.reader(file)
        tables[path.stem] = dict(zip(head, zip(*rows, strict=True), strict=True))
    return tables, (folder / "index.html").read_text()


def real(column):
    return np.array([float(one) for one in column if one])


def test_few_modes_beside_many_and_the_full_model(rods, tmp_path):
    words = "--mesh", str(rods / "mesh.h5"), "--material", str(rods / "steel.toml")
    tables, page = report(rods, tmp_path, "few.h5", "many.h5", *words)
    found = tables["frequencies"]
    few, many = real(found["free [Hz]"]), real(found["free, other record [Hz]"])
    full = real(found["free, full model [Hz]"])
    assert len(many) == len(few) + 10
    assert (few > full).all()  # Rayleigh and Ritz
    assert (many[: len(few)] > full).all()
    assert (many[: len(few)] < few).all()  # whose deformations are among those of many modes
    assert (many[:4] / full[:4] - 1.0).max() < 1e-3 < (few[:4] / full[:4] - 1.0).max()
    masses = tables["mass"]
    for name in ("other record", "full model"):
        np.testing.assert_allclose(real(masses[name]), real(masses["record"]), atol=1e-9 * real(masses["record"])[0])
    mac = tables["mac_other"]
    assert list(mac["most like mode of the other record"][:3]) == ["1", "2", "3"]
    assert (real(mac["MAC"])[:3] > 0.999).all()
    assert (real(mac["relative difference"]) < 0.0).all()
    # the full model's answer, at the record's place and axes, is nearer to that of many modes
    for k in (1, 2):
        columns = tables[f"response_{k}"]
        own, other, exact = (
            np.array([real(columns[f"{axis}, {whose} [m/N]"]) for axis in "xyz"])[:, :8]
            for whose in ("record", "other record", "full model")
        )
        assert (abs(other - exact).max(axis=1) < abs(own - exact).max(axis=1)).all()
    assert "few.h5" in page
    assert "beside the record many.h5 of" in page
    assert "nodes that both records have of their one mesh" in page


def test_equal_bodies_are_equal_from_whatever_frames(rods, tmp_path):
    """Another body frame, and an interface's frame elsewhere on its rigid face."""
    tables, _ = report(rods, tmp_path, "few.h5", "turned.h5")
    places = tables["places"]
    np.testing.assert_allclose(real(places["way [m]"]), [0.0, 0.005], atol=1e-6)  # of the face's own centre
    np.testing.assert_allclose(real(places["turn [rad]"]), [0.0, 2.0 * np.pi / 3.0], atol=1e-9)
    mac = tables["mac_other"]
    np.testing.assert_allclose(real(mac["MAC with the mode of its number"]), 1.0, rtol=1e-9)
    np.testing.assert_allclose(real(mac["relative difference"]), 0.0, atol=1e-8)
    for k in (1, 2):
        columns = tables[f"response_{k}"]
        for axis in "xyz":
            own, other = (real(columns[f"{axis}, {whose} [m/N]"]) for whose in ("record", "other record"))
            np.testing.assert_allclose(other, own, atol=1e-6 * abs(own).max())


def test_records_of_other_meshes_are_compared_at_their_interfaces(rods, tmp_path):
    tables, page = report(rods, tmp_path, "few.h5", "fine.h5")
    assert "MAC compares motions of the common interfaces" in page
    mac = tables["mac_other"]
    assert list(mac["most like mode of the other record"][:3]) == ["1", "2", "3"]
    assert (real(mac["MAC"])[:3] > 0.999).all()
    softer = real(mac["relative difference"])[:3]
    assert ((softer > -5e-2) & (softer < 0.0)).all()
    assert real(tables["places"]["way [m]"]).max() < 1e-6


def moved(body, p, R):
    """The record with its body frame at p (3,) with axes R (3, 3), seen from the old one."""
    n = body.n_modes
    T = np.eye(4 + 3 * n)
    for k in range(n + 1):
        T[1 + 3 * k : 4 + 3 * k, 1 + 3 * k : 4 + 3 * k] = R.T
    T[1:4, 0] = -R.T @ p
    frames = tuple(
        InterfaceFrame(
            one.name, R.T @ (one.p_BI_B - p), R.T @ one.R_BI, np.vstack([R.T @ one.modes[:3], R.T @ one.modes[3:]])
        )
        for one in body.interfaces
    )
    return dataclasses.replace(body, gram=T @ body.gram @ T.T, interfaces=frames, frame=None)


@pytest.mark.parametrize("size", [1e-3, 1.0, 1e3])
def test_without_meshes_the_first_common_interface_tells_where_the_other_lies(size):
    body = two_crosses()
    again = moved(body, size * np.array([0.4, -0.2, 0.7]), Rotation.from_rotvec([0.3, -1.1, 0.6]).as_matrix())
    found = compare_records(body, again)
    assert not found.by_meshes
    np.testing.assert_allclose(found.other.mass_matrix(), body.mass_matrix(), atol=1e-11 * max(1.0, size) ** 2)
    for name in ("A", "B"):
        way, turn = found.apart(name)
        assert way < 1e-13 * max(1.0, size)
        assert turn < 1e-13
    np.testing.assert_allclose(found.mac(), np.eye(2), atol=1e-12 * max(1.0, size) ** 2)
    for at in body.interfaces:
        np.testing.assert_allclose(
            found.other.interface_motion(at), found.one.interface_motion(at), atol=1e-12 * max(1.0, size)
        )


def test_modes_in_another_order_are_found():
    """An axial and a torsional vibration, of which in the other record the axial one is the lower."""
    soft = dataclasses.replace(two_crosses(), stiffness=two_crosses().stiffness * [1.0, 1e-3 * TORSION / SPRING])
    found = compare_records(two_crosses(), soft)
    np.testing.assert_allclose(found.mac(), [[0.0, 1.0], [1.0, 0.0]], atol=1e-12)


def test_a_mode_that_moves_no_common_interface_has_no_mac(tmp_path):
    """Of a body whose vibrations have no momentum and leave its only interface at rest."""
    gram = two_crosses().gram.copy()
    gram[:4, 4:] = gram[4:, :4] = 0.0
    still = two_crosses(gram=gram, interfaces=two_crosses().interfaces[:1])
    assert np.isnan(compare_records(two_crosses(), still).mac()).all()
    two_crosses().save(tmp_path / "one.h5")
    still.save(tmp_path / "other.h5")
    tables, page = report(tmp_path, tmp_path, "one.h5", "other.h5")
    assert tables["mac_other"]["MAC"] == ("", "")
    assert "the record alone has B" in page


def test_what_cannot_be_compared_is_refused(rods, tmp_path, capsys):
    two_crosses().save(tmp_path / "crosses.h5")
    words = ["inspect", str(rods / "few.h5"), "--report", str(tmp_path / "report")]
    assert main([*words, "--beside", str(tmp_path / "crosses.h5")]) == 2
    told = capsys.readouterr().err
    assert "no interface of the same name: the one has 'big_end', 'small_end', the other 'A', 'B'" in told
    assert main([*words, "--beside", str(tmp_path / "none.h5")]) == 2
    assert "none.h5" in capsys.readouterr().err
    assert not (tmp_path / "report").exists()
    with pytest.raises(SystemExit):
        main(["inspect", str(rods / "few.h5"), "--beside", str(rods / "many.h5")])
    assert "--beside RECORD goes with --report DIR" in capsys.readouterr().err
