"""`flexmbd check --report` and `flexmbd inspect --report`: what they write, and what ends them, on ranks too."""

import csv
import re
import subprocess
import sys
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest
from full_model import FullModel
from two_crosses_body import two_crosses

from flexmbd import forms, meshes
from flexmbd.cli import main
from flexmbd.continuum import ContinuumModel, Interface
from flexmbd.continuum.contract_suite.studies import FormStudies
from flexmbd.record.reduced_body import ReducedBody
from flexmbd.reduction import Keep, craig_bampton

COMM = MPI.COMM_WORLD
GOOD = (
    (Path(__file__).parents[1] / "data" / "own_solid.py")
    .read_text()
    .replace('CELLS = ("tetrahedron", "hexahedron")', 'CELLS = ("tetrahedron",)')
    .replace("ORDER = {1: 2, 2: 3}", "ORDER = {1: 2}")
)


@pytest.fixture
def check(shared_path, capfd):
    """Runs the command with a report on a text as a form file; code, output and page's text. Collective."""

    def run(text):
        path, folder = shared_path / "my_form.py", shared_path / "report"
        if COMM.rank == 0:
            path.write_text(text)
        COMM.barrier()
        code = main(["check", str(path), "--report", str(folder)])
        out, err = ("".join(COMM.allgather(text)) for text in capfd.readouterr())
        assert COMM.allgather(code) == [code] * COMM.size
        COMM.barrier()
        return code, out, err, (folder / "index.html").read_text()

    return run


def rows_of(path):
    with open(path, newline="") as file:
        return list(csv.DictReader(file))


@pytest.mark.mpi
def test_a_sound_form(check, shared_path):
    code, out, err, page = check(GOOD)
    assert (code, err) == (0, "")
    assert out.endswith(f"report: {shared_path}/report/index.html\n")
    assert out.count("report: ") == 1
    assert '<p class="verdict good">PASS</p>' in page
    orders = rows_of(shared_path / "report/tables/orders.csv")
    assert [one["meshes"] for one in orders] == ["regular", "distorted", "trapezoidal", "curved"]
    np.testing.assert_allclose([float(one["order"]) for one in orders], 2.0, atol=0.1)
    errors = rows_of(shared_path / "report/tables/errors.csv")
    assert len(errors) == 16
    verdicts = {one["check"]: one["verdict"] for one in rows_of(shared_path / "report/tables/checks.csv")}
    assert verdicts["the same matrices on all ranks"] == ("SKIP" if COMM.size == 1 else "PASS")
    assert "my_form.py" in (shared_path / "report/digest.json").read_text()
    assert {path.name for path in shared_path.iterdir()} == {"my_form.py", "report"}


def test_a_form_that_fails_has_its_report(check, monkeypatch):
    monkeypatch.setattr("flexmbd.command.form_report.study_form", lambda form, tell: FormStudies([], [], [], []))
    told = "return _small_strain_stress(u, p)"
    code, _, err, page = check(GOOD.replace(told, told.replace("return", "return 2 *")))
    assert (code, err) == (1, "")
    assert '<p class="verdict bad">FAIL</p>' in page
    assert "These checks failed: stress does the energy&#x27;s work." in page
    assert '<td class="bad">FAIL</td>' in page


@pytest.mark.mpi
def test_a_form_that_breaks_the_contract_has_a_page_that_says_so(check):
    code, out, err, page = check(GOOD.replace("import ufl\n", "import ufl\nimport numpy\n"))
    assert code == 2
    assert "report: " in out
    assert re.search("imports 'numpy'", err)
    assert '<p class="verdict bad">STOPPED</p>' in page
    assert "imports &#x27;numpy&#x27;" in page


@pytest.mark.mpi
def test_a_folder_that_is_not_empty_is_refused_before_anything_runs(shared_path, capfd):
    if COMM.rank == 0:
        (shared_path / "my_form.py").write_text(GOOD)
    COMM.barrier()
    assert main(["check", str(shared_path / "my_form.py"), "--report", str(shared_path)]) == 2
    out, err = ("".join(COMM.allgather(text)) for text in capfd.readouterr())
    assert out == ""
    assert re.fullmatch(r"flexmbd: .* is not empty; give a folder for the report that is not there, or empty.*\n", err)


def test_a_record_by_itself(tmp_path, capsys):
    two_crosses().save(tmp_path / "a.h5")
    code = "import sys; from flexmbd.cli import main; main(['inspect', sys.argv[1], '--report', sys.argv[2]]); "
    code += "print([name for name in ('dolfinx', 'petsc4py', 'gmsh', 'ufl') if name in sys.modules])"
    words = [sys.executable, "-c", code, tmp_path / "a.h5", tmp_path / "report"]
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    assert done.stdout.endswith("report/index.html\n[]\n")
    page = (tmp_path / "report/index.html").read_text()
    assert "it was not compared with the full model. Give --mesh" in page
    mass = {one["what"]: float(one["record"]) for one in rows_of(tmp_path / "report/tables/mass.csv")}
    body = two_crosses()
    assert mass["mass [kg]"] == body.mass
    first = [mass[f"first moment {axis} [kg m]"] for axis in "xyz"]
    np.testing.assert_allclose(first, body.mass * body.com, atol=1e-12 * body.mass)
    assert main(["inspect", str(tmp_path / "a.h5"), "--report", str(tmp_path)]) == 2
    assert "is not empty" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        main(["inspect", str(tmp_path / "a.h5"), "--mesh", "a.msh"])


@pytest.fixture(scope="module")
def bar():
    """A bar of eight cells with two rigid ends as model, mesh and record with its modes."""
    mesh = meshes.block(0.4, 0.1, 0.08, divisions=(4, 2, 1), cell="tetrahedron", comm=MPI.COMM_SELF)
    steel = forms.solid_linear.Parameters(E=2.1e11, nu=0.3, rho=7850.0)
    ends = [Interface("x_min"), Interface("x_max", origin=(0.4, 0.02, 0.01), axes=[[0, 0, 1], [1, 0, 0], [0, 1, 0]])]
    model = ContinuumModel(mesh, forms.solid_linear, steel, degree=2, interfaces=ends)
    return model, craig_bampton(model, modes=6, frame="x_min", keep=Keep(modes=True))


@pytest.fixture
def bar_files(bar, tmp_path):
    model, record = bar
    record.save(tmp_path / "bar.h5")
    meshes.write(model.mesh, tmp_path / "mesh.h5")
    (tmp_path / "steel.toml").write_text(
        'form = "solid_linear"\n[parameters]\nE = 2.1e11\nnu = 0.3\nrho = 7850.0\n'
    )
    return [str(tmp_path / name) for name in ("bar.h5", "mesh.h5", "steel.toml")]


def test_a_record_beside_its_full_model(bar, bar_files, tmp_path, capfd):
    (model, body), (record, mesh, steel) = bar, bar_files
    folder = tmp_path / "report"
    assert main(["inspect", record, "--report", str(folder), "--mesh", mesh, "--material", steel]) == 0
    rows = rows_of(folder / "tables/frequencies.csv")
    found = [float(one["free, full model [Hz]"]) for one in rows if one["free, full model [Hz]"]]
    full = FullModel(model)
    bound = full.bound([(np.isclose(full.x[:, 0], x), np.array([x, 0.0, 0.0])) for x in (0.0, 0.4)])
    np.testing.assert_allclose(found, full.frequencies(bound, len(found)), rtol=1e-8)
    np.testing.assert_allclose([float(one["free [Hz]"]) for one in rows], body.frequencies(), rtol=1e-14)
    mac = rows_of(folder / "tables/mac.csv")
    assert [one["most like full mode"] for one in mac[:2]] == ["1", "2"]
    assert all(0.99 < float(one["MAC"]) < 1.0 for one in mac[:2])
    assert all(float(one["MAC"]) < 1.0 for one in mac)
    masses = rows_of(folder / "tables/mass.csv")
    assert float(masses[0]["full model"]) == pytest.approx(7850.0 * 0.4 * 0.1 * 0.08)
    for one in masses:
        assert float(one["record"]) == pytest.approx(float(one["full model"]), abs=1e-9)
    for k in (1, 2):
        response = rows_of(folder / f"tables/response_{k}.csv")
        off = [float(one["largest difference over the largest response"]) for one in response]
        assert max(off[:8]) < 2e-2  # below the first frequency
        omega = 2 * np.pi * float(response[0]["frequency [Hz]"])
        # by another way: all of it dense
        loads = np.zeros((bound.shape[1], 3))
        arm = body.p_MB_M + body.R_MB @ body.interfaces[k - 1].p_BI_B - (0.4 * (k - 1), 0.0, 0.0)
        R = body.R_MB @ body.interfaces[k - 1].R_BI
        loads[6 * (k - 1) : 6 * k] = np.vstack([R, np.cross(arm, R, axisb=0, axisc=0)])
        dense = (bound.T @ (full.K - omega**2 * full.M) @ bound).toarray()
        exact = np.einsum("ij,ij->j", loads, np.linalg.solve(dense, loads))
        told = [float(response[0][f"{axis}, full model [m/N]"]) for axis in "xyz"]
        np.testing.assert_allclose(told, exact, rtol=1e-6)


def test_another_mesh_or_material_is_refused(bar_files, tmp_path, capfd):
    record, mesh, steel = bar_files
    words = ["inspect", record, "--report", str(tmp_path / "report"), "--mesh", mesh, "--material", steel]
    assert main([*words, "--scale", "2"]) == 2
    assert "the record is of another mesh than" in capfd.readouterr().err
    Path(steel).write_text(Path(steel).read_text().replace("2.1e11", "7e10"))
    assert main(words) == 2
    assert "the record is of another body than the model" in capfd.readouterr().err
    assert not (tmp_path / "report").exists()


def test_bodies_that_were_reduced_with_more_are_not_compared(bar, bar_files, tmp_path):
    import dataclasses

    record, mesh, steel = bar_files
    body = ReducedBody.load(record)
    more = {**body.provenance, "supports": "symmetry plane"}
    dataclasses.replace(body, provenance=more).save(tmp_path / "held.h5")
    words = ["inspect", str(tmp_path / "held.h5"), "--report", str(tmp_path / "report")]
    assert main([*words, "--mesh", mesh, "--material", steel]) == 0
    assert "It was not compared: it was reduced with supports" in (tmp_path / "report/index.html").read_text()
