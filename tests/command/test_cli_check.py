"""`flexmbd check`: what it prints and its exit codes, on any number of ranks."""

import re
import subprocess
import sys
from pathlib import Path

from mpi4py import MPI

import pytest

import flexmbd.forms
from flexmbd.cli import main
from flexmbd.continuum import CheckResult, Verdict
from flexmbd.continuum.contract_suite.outcome import Raised

COMM = MPI.COMM_WORLD
GOOD = (
    (Path(__file__).parents[1] / "data" / "own_solid.py")
    .read_text()
    .replace('CELLS = ("tetrahedron", "hexahedron")', 'CELLS = ("tetrahedron",)')
    .replace("ORDER = {1: 2, 2: 3}", "ORDER = {1: 2}")
)
ENERGY = "return [(energy, Quadrature(degree))]"


@pytest.fixture
def check(shared_path, capfd):
    """Runs the command on a text as a form file; the exit code, and what is printed on all ranks. Collective."""

    def run(text, *, there=True):
        path = shared_path / "my_form.py"
        if COMM.rank == 0 and there:
            path.write_text(text)
        COMM.barrier()
        code = main(["check", str(path)])
        out, err = capfd.readouterr()
        codes = COMM.allgather(code)
        assert codes == [code] * COMM.size
        return code, "".join(COMM.allgather(out)), "".join(COMM.allgather(err))

    return run


@pytest.mark.mpi
def test_a_sound_form(check):
    code, out, err = check(GOOD)
    assert (code, err) == (0, "")
    lines = out.splitlines()
    assert re.match(r"\S*my_form\.py is Python code and runs now", lines[0])
    assert lines[1] == "my_form: tetrahedron 1"
    assert lines[2].startswith("PASS  names, signatures and results")
    assert len(lines) == 27
    assert [line[:4] for line in lines[-5:-2]] == ["PASS"] * 3
    assert re.search("energy changed by .*\n.*angular momentum by", out)
    ranks = "needs two ranks: mpirun -n 2 flexmbd check ..." if COMM.size == 1 else "K, off by"
    assert ranks in lines[-2]
    assert lines[-1] == f"my_form: {19 if COMM.size == 1 else 20} passed, 0 failed"


def test_elements_that_fail_alike_share_a_line():
    same, other = (Raised(Verdict.FAIL, text) for text in ("ValueError: nu", "ValueError: E"))
    places = [("tetrahedron", 1), ("tetrahedron", 2), ("hexahedron", 1)]
    found = CheckResult("symmetry", dict(zip(places, (same, other, same), strict=True)), "").text().splitlines()
    assert found[1:] == ["      tetrahedron 1, hexahedron 1: ValueError: nu", "      tetrahedron 2: ValueError: E"]


@pytest.mark.mpi
def test_a_check_that_fails(check):
    code, out, err = check(GOOD.replace("return _small_strain_stress(u, p)", "return 2 * _small_strain_stress(u, p)"))
    assert (code, err) == (1, "")
    told = r"^FAIL  stress does the energy's work  failed\n +tetrahedron 1: work off by 1, at.*\n +remedy: stress must"
    assert re.search(told, out, re.M)
    assert out.endswith(" 1 failed\n")


def test_a_form_that_no_part_of_can_be_reduced(check):
    """All of the suite passes; the reduction refuses it, as it would with any part, and nothing is moved."""
    text = (Path(flexmbd.forms.__file__).parent / "solid_micropolar.py").read_text()
    text = text.replace('CELLS = ("tetrahedron", "hexahedron")', 'CELLS = ("hexahedron",)')
    text = text.replace("ORDER = {1: 2, 2: 3}", "ORDER = {1: 2}")
    code, out, _ = check(text.replace("def motion(", "def _motion(").replace("def section_inertia(", "def _section_i("))
    assert code == 1
    assert re.search(r"^FAIL  reduction +failed\n +hexahedron 1: FormulationError: ", out, re.M)
    assert re.search(r"^SKIP  pendulum, reduced +not run: see 'reduction'", out, re.M)
    assert out.endswith(" 1 failed\n")


def test_a_form_with_history_is_loaded_and_moved(check):
    text = (Path(flexmbd.forms.__file__).parent / "j2_plasticity.py").read_text()
    text = text.replace('CELLS = ("tetrahedron", "hexahedron")', 'CELLS = ("hexahedron",)')
    text = text.replace("ORDER = {1: 2, 2: 3}", "ORDER = {1: 2}")
    code, out, _ = check(text)
    assert code == 0
    assert re.search(r"^PASS  slow loading +reactions out of balance by", out, re.M)
    assert re.search(r"^PASS  motion, full body +energy gained", out, re.M)


BROKEN = {
    "two rules": ((ENERGY, "return [energy * ufl.dx(degree=0) + energy * ufl.dx(degree=2)]"), "a form with 2 rules"),
    "a term on facets": (
        (ENERGY, "return [(energy * ufl.ds(degree=2), Quadrature(2))]"), r"over facets \(ds\): .*surface_energy\(u, p\)"
    ),
    "inner facets": ((ENERGY, "return energy * ufl.dS(degree=2)"), r"over inner facets \(dS\), which no term has"),
    "no degree": ((ENERGY, "return [(energy, None)]"), "must state a quadrature degree"),
    "not finite": ((ENERGY, "return [(ufl.sqrt(energy), Quadrature(2))]"), "first derivative at u = 0 is not finite"),
    "import": (("import ufl\n", "import ufl\nimport numpy\n"), "imports 'numpy'"),
    "import inside": (("    lam, mu", "    import dolfinx\n    lam, mu"), "imports 'dolfinx'"),
    "syntax": (("def element(", "def def element("), r"my_form\.py: cannot be read as Python: .*line \d+"),
}


@pytest.mark.mpi
@pytest.mark.parametrize("fault", BROKEN)
def test_a_broken_form_is_one_message(check, fault):
    (old, new), message = BROKEN[fault]
    assert old in GOOD
    code, out, err = check(GOOD.replace(old, new))
    assert code == 2
    # what is refused before it runs is not said to run
    runs = "" if fault in ("import", "import inside", "syntax") else r"\S*my_form\.py is Python code and runs now.*\n"
    assert re.fullmatch(runs, out)
    assert err.startswith("flexmbd: ")
    assert err.count("flexmbd: ") == 1
    assert re.search(message, err)
    assert "Traceback" not in err


@pytest.mark.mpi
def test_a_file_that_is_not_there(check):
    code, out, err = check("", there=False)
    assert (code, out) == (2, "")
    assert re.fullmatch(r"flexmbd: .*my_form\.py: cannot be read: No such file or directory.*\n", err)


@pytest.mark.mpi
@pytest.mark.skipif(COMM.size == 1, reason="needs two ranks")
def test_a_file_that_one_rank_alone_cannot_read(shared_path, tmp_path, capfd):
    """A folder that the ranks do not share: each has a file, the last one's is broken."""
    path = shared_path / f"{COMM.rank}.py"
    path.write_text(GOOD if COMM.rank < COMM.size - 1 else "def element(:")
    assert main(["check", str(path)]) == 2
    err = COMM.gather(capfd.readouterr().err)
    if err is not None:
        assert re.search(rf"{COMM.size - 1}\.py: cannot be read as Python.*on rank {COMM.size - 1} of", "".join(err))


def test_a_name_that_is_no_form_of_flexmbd(capsys):
    assert main(["check", "my_form"]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert re.search("no 'my_form', only .*solid_linear.*a path that ends in .py", err)


def test_the_command_ends_with_the_code(tmp_path):
    """In a process of its own, as a shell sees it."""
    command = [sys.executable, "-m", "flexmbd", "check", str(tmp_path / "nowhere.py")]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stdout == ""
    assert done.stderr == f"flexmbd: {tmp_path}/nowhere.py: cannot be read: No such file or directory\n"
