"""Loading a form file, and each way in which one can break the contract."""

import os
import re
import sys
import types
from pathlib import Path

from mpi4py import MPI

import dolfinx
import numpy as np
import pytest
import ufl
from dolfinx import fem

from flexmbd import meshes
from flexmbd.continuum import ContinuumModel
from flexmbd.continuum.contract import formulation
from flexmbd.errors import FormulationError
from flexmbd.forms import solid_linear

GOOD = (Path(__file__).parents[1] / "data" / "own_solid.py").read_text()
SYMBOLS = r"strain_energy: .*the parameters may be symbols.*not in `if`, float\(\)"
RETURN = "return [(energy, Quadrature(degree))]"


@pytest.fixture
def load_text(tmp_path):
    """Loads a text as a form file."""

    def load(text):
        path = tmp_path / "my_form.py"
        path.write_text(text)
        return formulation.load_form(path)

    return load


def faults(load_text, *changes):
    """The violations listed for solid_linear with some of its text replaced."""
    text = GOOD
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    with pytest.raises(FormulationError) as caught:
        load_text(text)
    lines = str(caught.value).split("\n  - ")
    assert f"({len(lines) - 1} violation{'s' if len(lines) > 2 else ''})" in lines[0]
    return lines[1:]


def test_loads_by_name_path_and_module(load_text):
    assert formulation.load_form("solid_linear") is solid_linear
    assert formulation.load_form(solid_linear) is solid_linear
    mine = load_text(GOOD)
    assert mine is not solid_linear
    assert mine.Parameters(E=1.0, nu=0.25, rho=1.0).nu == 0.25


def test_a_file_is_one_module_until_it_changes(tmp_path):
    """A change that keeps the file's size and time is one too: a file may be rewritten within a second."""
    path = tmp_path / "my_form.py"

    def load(text):
        path.write_text(text)
        os.utime(path, (1.7e9, 1.7e9))
        return formulation.load_form(path)

    first = load(GOOD)
    assert load(GOOD) is first
    second = load(GOOD.replace("E=2.1e11", "E=7.0e10"))
    assert (first.reference().parameters.E, second.reference().parameters.E) == (2.1e11, 7.0e10)


def test_a_module_is_a_formulation():
    form: formulation.Formulation = solid_linear  # mypy holds this too
    assert isinstance(form, formulation.Formulation)
    assert not isinstance(types.ModuleType("empty"), formulation.Formulation)


def test_a_module_without_a_source_file_is_checked():
    with pytest.raises(FormulationError, match=r"empty breaks .*\(1\d violations\)"):
        formulation.load_form(types.ModuleType("empty"))


def test_unknown_name_lists_the_forms():
    with pytest.raises(FormulationError, match=r"no 'solid_lineer', only .*solid_linear.*Path"):
        formulation.load_form("solid_lineer")


def test_missing_file_and_bad_python_name_the_file(tmp_path, load_text):
    with pytest.raises(FormulationError, match=r"nowhere\.py: cannot be read: No such file"):
        formulation.load_form(tmp_path / "nowhere.py")
    with pytest.raises(FormulationError, match="cannot be read: Is a directory"):
        formulation.load_form(tmp_path)
    with pytest.raises(FormulationError, match=r"my_form\.py: cannot be read as Python: invalid.*line 1"):
        load_text("def element(:")
    with pytest.raises(FormulationError, match=r"cannot be read as Python: .*null bytes"):
        load_text("import ufl\0")
    for line, error in (("1 / 0", "ZeroDivisionError"), ("raise SystemExit(3)", "SystemExit: 3")):
        with pytest.raises(FormulationError, match=f"cannot be imported: {error}"):
            load_text(f"import ufl\n{line}")
    (tmp_path / "my_form.txt").write_text(GOOD)
    with pytest.raises(FormulationError, match=r"my_form\.txt breaks(.|\n)*not a Python file \(\.py\)"):
        formulation.load_form(tmp_path / "my_form.txt")
    assert "form_file.my_form" not in sys.modules


def test_all_missing_names_are_listed_at_once(load_text):
    text = "import ufl\nORDER = 2\nclass Parameters: pass\ndef element(cell): pass\n"
    with pytest.raises(FormulationError) as caught:
        load_text(text)
    message = str(caught.value)
    for missing in ("strain_energy", "kinetic_energy", "rigid_motion", "stress", "reference"):
        assert f"{missing} is missing" in message
    for other in ("CELLS must", "ORDER must", "REFERENCE must", "frozen"):
        assert other in message
    assert "element must take 3 positional arguments" in message
    assert "(10 violations)" in message


@pytest.mark.parametrize(
    ("line", "named"),
    [
        ("import numpy", "numpy"),
        ("import dolfinx.fem", "dolfinx.fem"),
        ("from scipy import linalg", "scipy"),
        ("from basix import CellType", "basix.CellType"),
        ("from flexmbd import rotation", "flexmbd"),
        ("def late():\n    import math", "math"),
        ("from . import solid_linear", "."),
        ("import a_module_that_is_not_there", "a_module_that_is_not_there"),
        ('def hidden():\n    return __import__("numpy")', "__import__"),
    ],
)
def test_forbidden_imports_are_named(load_text, line, named):
    assert faults(load_text, ("import basix.ufl", f"import basix.ufl\n{line}")) == [
        f"imports {named!r}; a form file imports only ufl, basix.ufl, dataclasses, typing and other forms"
    ]


def test_nothing_runs_of_a_file_with_a_forbidden_import(load_text, tmp_path):
    ran = tmp_path / "ran"
    assert faults(load_text, ("import basix.ufl", f"import basix.ufl\nopen({str(ran)!r}, 'w').close()\nimport os")) == [
        "imports 'os'; a form file imports only ufl, basix.ufl, dataclasses, typing and other forms"
    ]
    assert not ran.exists()


@pytest.mark.parametrize(
    ("name", "meant"),
    [
        ("scaled_yeild", "scaled_yield"),
        ("incrementsize", "increment_size"),
        ("section_inertias", "section_inertia"),
        ("Motion", "motion"),
        ("updates", "update"),
    ],
)
def test_a_name_that_is_spelt_wrong_is_told(load_text, name, meant):
    """Else the file would be one that has no such function, and nobody would know."""
    (fault,) = faults(load_text, ("def reference(", f"def {name}(*arguments):\n    pass\n\n\ndef reference("))
    assert fault.startswith(f"{name} is not a name of the contract; did you mean {meant}?")
    assert f"as _{name}" in fault


def test_a_wrong_spelling_of_a_name_that_must_be_there_is_told_beside_it(load_text):
    told = faults(load_text, ("def kinetic_energy(", "def kinetic_energies("))
    assert told[0] == "kinetic_energy is missing"
    assert told[1].startswith("kinetic_energies is not a name of the contract; did you mean kinetic_energy?")


@pytest.mark.parametrize("name", ["stresses", "energy", "stretch", "rotation", "strain", "degrees", "rule", "_updates"])
def test_names_of_the_files_own_are_let_through(load_text, name):
    """One letter from a name that is there, or no closer than other words are."""
    load_text(GOOD.replace("def reference(", f"def {name}(*arguments):\n    pass\n\n\ndef reference("))


@pytest.mark.parametrize(
    "line", ["from basix import ufl as elements", "from ufl.classes import Zero"]
)
def test_allowed_imports_pass(load_text, line):
    load_text(GOOD.replace("import basix.ufl", f"import basix.ufl\n{line}"))


@pytest.mark.parametrize(
    ("changes", "pattern"),
    [
        ([('CELLS = ("tetrahedron", "hexahedron")', 'CELLS = ("cube",)')], "CELLS must.*cube"),
        ([("ORDER = {1: 2, 2: 3}", "ORDER = {1: 2.5}")], "ORDER must.*2.5"),
        ([('REFERENCE = "INITIAL"', 'REFERENCE = "CURRENT"')], "REFERENCE must.*CURRENT"),
        ([("(frozen=True)\nclass Parameters", "\nclass Parameters")], "frozen dataclass"),
        ([("def strain_energy(", "def energy_of_strain(")], "strain_energy is missing"),
        ([("def reference()", "def reference(n)")], "reference must take 0 positional"),
        ([("return Reference(", "return Reference(1, ")], "reference.* raises TypeError"),
        ([("def body_force(self, x", "def body_force(self")], "body_force must be a function"),
        ([(RETURN, "return []")], "strain_energy: has no terms"),
        ([(RETURN, "return [energy]")], r"term 0 must be a pair \(integrand, Quadrature\)"),
        ([(RETURN, "return [(energy, None)]")], "term 0 must state a quadrature degree.*None"),
        ([(RETURN, "return [(energy, Quadrature(-1))]")], "must state a quadrature degree"),
        ([(RETURN, "return [(energy, Quadrature(None))]")], "must state a quadrature degree.*degree=None"),
        ([(RETURN, "return [(energy, Quadrature(2.0))]")], r"must state a quadrature degree.*degree=2\.0"),
        ([(RETURN, 'return [(energy, Quadrature(2, "Gauss"))]')], "scheme.*for these cells.*'Gauss'"),
        (
            [(RETURN, 'return [(energy, Quadrature(2, "GLL"))]')],
            r"scheme.*for these cells.*\(tetrahedron 1, tetrahedron 2\)",
        ),
        ([(RETURN, "return [(strain, Quadrature(2))]")], r"must be scalar, has shape \(3, 3\)"),
        ([(RETURN, "return [(1.0, Quadrature(2))]")], "must be a UFL expression, got float"),
        (
            [(RETURN, "return [energy * ufl.dx(degree=0) + energy * ufl.dx(degree=2)]")],
            "term 0 is a form with 2 rules",
        ),
        (
            [(RETURN, "return energy * ufl.dx(degree=0) + energy * ufl.dx(degree=2)")],
            "returns a form with 2 rules; return a list",
        ),
        ([(RETURN, "return [(energy * ufl.dx, Quadrature(2))]")], "already holds a measure with 1 rule:"),
        ([(RETURN, RETURN.replace("energy", "ufl.cell_avg(energy)"))], "cell_avg.*F-bar is not a plain UFL form"),
        ([(RETURN, RETURN.replace("energy", 'energy("+")'))], "has sides of a facet"),
        ([("    energy = lam", "    lam = lam if p.nu > 0 else 0\n    energy = lam")], SYMBOLS),
        ([("return [(p.rho / 2", "return [(float(p.rho) / 2")], "kinetic_energy: .*in UFL arithmetic only"),
        ([(RETURN, "return undefined")], "strain_energy: NameError"),
        (
            [("return [(p.rho / 2 * ", "return [(p.E * v[0].dx(1) + p.rho / 2 * ")],
            "kinetic_energy: term 0: the integrand has a part linear in v: write what is linear in v and in u",
        ),
        ([("return translation +", "return translation[0] +")], "rigid_motion: .*shape"),
        ([("    return _small_strain_stress(u, p)\n", "    return None\n")], "stress: must return"),
    ],
)
def test_each_violation_is_reported_alone(load_text, changes, pattern):
    (fault,) = faults(load_text, *changes)
    assert re.search(pattern, fault, flags=re.DOTALL)


@pytest.mark.parametrize(
    ("energy", "what"),
    [
        ("1 / ufl.tr(strain)", "value"),
        ("ufl.ln(ufl.tr(strain))", "value"),
        ("ufl.sqrt(energy)", "first derivative"),
        ("ufl.sqrt(ufl.inner(strain, strain)) * ufl.tr(strain)", "first derivative"),
        ("ufl.max_value(ufl.tr(strain), 0) ** 1.5", "second derivative"),
        ("ufl.max_value(ufl.tr(strain), 0) ** 2.5", "third derivative"),
    ],
)
def test_energy_that_is_not_finite_at_rest_is_refused(load_text, energy, what):
    (fault,) = faults(load_text, (RETURN, RETURN.replace("energy", energy)))
    assert f"the {what} at u = 0 is not finite" in fault


def test_energy_that_only_a_mesh_can_evaluate_is_let_through(load_text):
    load_text(GOOD.replace(RETURN, RETURN.replace("energy", "energy * (1 + ufl.bessel_J(1, ufl.tr(strain)))")))


# A form with a residual in place of an energy, and a history that nothing changes.
RESIDUAL = GOOD.replace("def strain_energy(", "def _energy(").replace(
    "state: None, p: Parameters)", "state: None, p: Parameters, z=None)"
) + """

def residual(u, v, state, p, z=None):
    return [(ufl.inner(_small_strain_stress(u, p), ufl.grad(v)), Quadrature(2))]


def state(p):
    return ufl.as_vector((0 * p.E, 0.0))


def update(u, state, p, z=None):
    return state + ufl.as_vector((ufl.div(u), 0.0))


def local_unknowns(p):
    return ufl.as_ufl(0.0)


def local_residual(z, u, state, p):
    return z - ufl.div(u) + state[1]
"""


def test_names_that_not_every_form_has(load_text):
    form = load_text(RESIDUAL)
    cube = meshes.block(1.0, 1.0, 1.0, divisions=(1, 1, 1), comm=MPI.COMM_SELF)
    with pytest.raises(FormulationError, match="has a residual and no strain_energy, of which the stiffness"):
        ContinuumModel(cube, form, form.reference().parameters, degree=1)


@pytest.mark.parametrize(
    ("change", "pattern"),
    [
        (("def update(", "def _update("), "state goes with update, which is missing"),
        (("def update(u, state, p, z=None)", "def update(u, p)"), "update must take 3 positional arguments"),
        (("def update(u, state, p, z=None)", "def update(u, state, p)"), "update must take 'z' as a keyword argument"),
        (("def local_unknowns(", "def _unknowns("), "local_residual goes with local_unknowns, which is missing"),
        (("def _energy(", "def strain_energy("), "strain_energy and residual are both there"),
        (("return state + ufl.as_vector((ufl.div(u), 0.0))", "return state[0]"), r"update: .*\(2,\), got \(\)"),
        (("return z - ufl.div(u) + state[1]", "return ufl.as_vector((z, z))"), r"local_residual: .*\(\), got \(2,\)"),
        (("ufl.grad(v)), Q", "ufl.grad(u)), Q"), "residual: term 0: the integrand must be linear in v"),
        (("ufl.grad(v)), Q", "ufl.grad(v)) ** 2, Q"), "residual: term 0: the integrand must be linear in v"),
        (
            ("ufl.grad(v)), Q", "ufl.grad(v)) * ufl.sqrt(ufl.inner(u, u)), Q"),
            "residual: term 0: the first derivative at u = 0 is not finite",
        ),
    ],
)
def test_each_violation_of_such_a_name_is_reported_alone(load_text, change, pattern):
    assert RESIDUAL.count(change[0]) == 1
    with pytest.raises(FormulationError) as caught:
        load_text(RESIDUAL.replace(*change))
    (fault,) = str(caught.value).split("\n  - ")[1:]
    assert re.search(pattern, fault, flags=re.DOTALL)


def test_what_cell_means_are_handed_to_must_take_them(load_text):
    mean = "def cell_mean(u, state, p):\n    return ufl.div(u)\n"
    with pytest.raises(FormulationError) as caught:
        load_text(f"{RESIDUAL}\n\n{mean}")
    found = [fault.split(" ")[0] for fault in str(caught.value).split("\n  - ")[1:] if "'mean' as a keyword" in fault]
    assert found == ["residual", "update", "stress", "local_residual"]


@pytest.mark.parametrize(
    ("text", "patterns"),
    [
        (
            "def state(p):\n    return ufl.as_vector([0.0])\n\ndef update(u, state, p):\n    return state\n",
            ["state needs residual"],
        ),
        ("def motion(u, xi, p):\n    return u\n", ["motion goes with section_inertia"]),
        (
            "def motion(u, xi, p):\n    return u\n\ndef section_inertia(p):\n    return ((p.rho, 0), (0, 1))\n",
            [r"section_inertia: must have .*\(4, 4\), got \(2, 2\)"],
        ),
    ],
)
def test_names_that_do_not_go_with_the_rest(load_text, text, patterns):
    found = faults(load_text, ("def reference(", f"{text}\n\ndef reference("))
    assert len(found) == len(patterns)
    assert all(re.search(pattern, fault, re.DOTALL) for pattern, fault in zip(patterns, found, strict=True))


def test_functions_of_c_are_refused(load_text):
    (fault,) = faults(load_text, ("def stress(", "stress = max\n\n\ndef _stress("))
    assert fault == "stress must take 3 positional arguments"


def test_symbols_take_the_place_of_numbers():
    """The same stiffness; and other values are followed without another form."""
    mesh = dolfinx.mesh.create_unit_cube(MPI.COMM_SELF, 1, 1, 1)
    space = fem.functionspace(mesh, solid_linear.element("tetrahedron", 3, 1))
    u = fem.Function(space)
    p = solid_linear.Parameters(E=3.0, nu=0.2, rho=1.0)
    twin = formulation.symbols(p, mesh=mesh)
    assert isinstance(twin, solid_linear.Parameters)

    def form(parameters):
        ((integrand, rule),) = solid_linear.strain_energy(u, parameters)
        energy = integrand * ufl.dx(domain=mesh, degree=rule.degree)
        return fem.form(ufl.derivative(ufl.derivative(energy, u), u))

    symbolic = form(twin)
    assert np.allclose(matrix(symbolic), matrix(form(p)), rtol=0, atol=1e-14)
    twin.E.value = 6.0  # type: ignore[attr-defined]
    assert np.allclose(matrix(symbolic), 2 * matrix(form(p)), rtol=0, atol=1e-14)


def matrix(form):
    return fem.assemble_matrix(form).to_dense()
