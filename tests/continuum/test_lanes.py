"""Cells evaluated several at a time, in threads: the same numbers as one by one, to the bit."""

import subprocess
import types
from functools import cache
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest
import ufl
from running_away import running_away
from von_mises_law import STATE, STEEL, Metal, von_mises

from flexmbd import meshes
from flexmbd.continuum import ExplicitRun, NonlinearModel, law_form, load_form, plane_form
from flexmbd.continuum.history import lane_library, lane_pass
from flexmbd.continuum.history.lane_code import NotRewrittenError, lane_code
from flexmbd.errors import FormulationError
from flexmbd.forms import hencky_plasticity as hencky
from flexmbd.forms import j2_plasticity as j2
from flexmbd.forms import neo_hookean, solid_shell

METAL = {"E": 210e9, "nu": 0.3, "rho": 7800.0, "yield_stress": 0.24e9}
SOIL = load_form(Path(__file__).parents[1] / "data" / "mohr_coulomb.py")


def choosing():
    """A form whose history chooses by parameters, by places and by both, and is a truth among numbers."""
    module = types.ModuleType("choosing")
    vars(module).update({name: value for name, value in vars(j2).items() if name[:2] not in ("__", "lo")})

    def update(u, state, p, *, mean=None):
        x, d = ufl.SpatialCoordinate(u.ufl_function_space().ufl_domain()), ufl.div(u)
        hard, right, wide = ufl.gt(p.E, 1e11), ufl.lt(x[0], 0.4), ufl.ge(d, 1e-3)
        return ufl.as_vector([
            ufl.conditional(hard, d, -d),
            ufl.conditional(ufl.And(hard, ufl.Not(right)), 2.0, d),
            ufl.conditional(ufl.Or(wide, right), ufl.sin(d), ufl.exp(-x[1]) ** 1.5),
            ufl.max_value(d, 0) * ufl.min_value(x[2], p.nu) + ufl.atan2(x[1], 1 + x[0]) + ufl.sqrt(p.nu) * ufl.sign(d),
        ])

    module.state = lambda p: ufl.as_vector([0.0] * 4)  # type: ignore[attr-defined]
    module.update = update  # type: ignore[attr-defined]
    module.residual = lambda u, v, state, p, *, mean=None: [  # type: ignore[attr-defined]
        (p.E * ufl.inner(ufl.sym(ufl.grad(u)), ufl.grad(v)), j2.rule(u))
    ]
    module.stress = lambda u, state, p, *, mean=None: p.E * ufl.sym(ufl.grad(u))  # type: ignore[attr-defined]
    del module.energies, module.state_names
    return module


def two_rules():
    """A form without history whose terms have rules, and so kernels, of their own."""
    module = types.ModuleType("two_rules")
    vars(module).update({name: value for name, value in vars(neo_hookean).items() if name[:2] != "__"})
    module.strain_energy = lambda u, p: [  # type: ignore[attr-defined]
        *neo_hookean.strain_energy(u, p),
        (p.E * ufl.det(ufl.Identity(3) + ufl.grad(u)) ** 2, neo_hookean.Quadrature(1)),
    ]
    return module


def metal(form, **more):
    return form.Parameters(**METAL, **more)


PLANE = plane_form(j2, plane_strain=False)
CASES = {
    "finite strain": (hencky, metal(hencky, hardening=j2.LinearHardening(2e9)), "hexahedron"),
    "a local unknown": (j2, metal(j2, hardening=j2.VoceHardening(0.1e9, 200.0)), "hexahedron"),
    "a table": (j2, metal(j2, hardening=j2.TabulatedHardening((0.0, 0.01, 0.1), (2.4e8, 3e8, 4e8))), "tetrahedron"),
    "seven local unknowns": (
        SOIL,
        SOIL.Parameters(E=6.778e9, nu=0.25, rho=2000.0, cohesion=3.45e6, friction=0.5, dilatancy=0.3),
        "hexahedron",
    ),
    "Newton steps that run away": (running_away(), metal(j2), "hexahedron"),
    "choices": (choosing(), metal(j2), "hexahedron"),
    "plane stress": (
        PLANE, PLANE.Parameters(metal(j2, hardening=j2.VoceHardening(0.1e9, 200.0)), 0.01), "quadrilateral"
    ),
    "no history": (neo_hookean, neo_hookean.Parameters(1e6, 0.4, 1000.0), "tetrahedron"),
    "two rules": (two_rules(), neo_hookean.Parameters(1e6, 0.4, 1000.0), "hexahedron"),
}


@cache
def compiled_law():
    return law_form(von_mises, Metal, trial=STEEL, state=STATE)


def built(form, parameters, cell, *, lanes, threads=1, heated=False, monkeypatch):
    """A block whose cells are no multiple of any number of lanes."""
    monkeypatch.setattr(lane_pass, "LEAST_WORK", 0 if lanes else 10**12)
    if lanes:
        monkeypatch.setattr(lane_pass, "common_lanes", lambda comm: lanes)
    if cell == "quadrilateral":
        mesh = meshes.sheet(1.0, 0.5, divisions=(33, 17), comm=MPI.COMM_SELF)
    elif cell == "wall":
        mesh = meshes.wall(meshes.sheet(1.0, 0.5, divisions=(29, 19), comm=MPI.COMM_SELF), 0.02)
    else:
        divisions = (11, 7, 7) if cell == "hexahedron" else (5, 5, 5)
        mesh = meshes.block(1.0, 0.5, 0.5, divisions=divisions, cell=cell, comm=MPI.COMM_SELF)
    body = NonlinearModel(mesh, form, parameters, degree=1, threads=threads, heated=heated)
    assert (body._histories[0]._pass._blocks is not None) == (lanes > 0)
    return body


def stepped(body):
    """Forces, history and local unknowns of two steps that bend it."""
    x, u = body.layout.node_x, np.zeros(body.layout.n_local)
    u[body.displacement_dofs] = 1e-2 * np.column_stack([x[:, 0] * x[:, 2] + x[:, 1], x[:, 1] ** 2, -x[:, 0] ** 2])
    u[body.held_dofs] = 0.0
    (history,) = body._histories
    found = []
    for part in (0.6, 0.3):
        if body.temperature is not None:
            body.temperature.x.array[:] = 300.0 * part * x[:, 0]
        found += [body.force(part * u), np.zeros(0) if history._z is None else history._z.x.array.copy()]
        body.commit(part * u)
        found.append(history.accepted.copy())
    assert abs(found[0]).max() > 0.0
    return found


def ours():
    """Lanes that this processor's registers can hold."""
    return [lanes for lanes in (2, 4, 8) if lanes <= lane_library.processor_lanes()[0]]


@pytest.mark.parametrize("case", CASES.values(), ids=CASES)
def test_lanes_change_no_bit(case, monkeypatch):
    alone = stepped(built(*case, lanes=0, monkeypatch=monkeypatch))
    before: list[np.ndarray] = []
    for lanes in (1, *ours()):
        body = built(*case, lanes=lanes, monkeypatch=monkeypatch)
        blocks = body._histories[0]._pass._blocks
        assert blocks._lanes == lanes  # FFCx's code was rewritten
        found = stepped(body)
        assert not before or all(map(np.array_equal, found, before))
        before = found
        for one, many in zip(alone, found, strict=True):
            if blocks._left.any():  # cells whose whole Newton steps fail are summed last
                assert abs(many - one).max() <= 1e-15 * abs(one).max()
            else:
                np.testing.assert_array_equal(many, one)


def test_lanes_change_no_bit_of_a_compiled_law(monkeypatch):
    alone, many = (
        stepped(built(compiled_law(), STEEL, "hexahedron", lanes=lanes, monkeypatch=monkeypatch))
        for lanes in (0, ours()[-1])
    )
    assert alone[-1].max() > 1e-4  # it yields
    for one, other in zip(alone, many, strict=True):
        np.testing.assert_array_equal(other, one)


@pytest.mark.parametrize(
    ("form", "parameters"),
    [
        (j2, metal(j2, hardening=j2.LinearHardening(2e9), alpha=1.2e-5)),
        (j2, metal(j2, hardening=j2.VoceHardening(0.1e9, 200.0), alpha=1.2e-5)),
        (neo_hookean, neo_hookean.Parameters(1e6, 0.4, 1000.0, alpha=1e-4)),
    ],
    ids=["history", "a local unknown", "no history"],
)
def test_lanes_change_no_bit_of_a_heated_body(form, parameters, monkeypatch):
    """Neither its forces and history, nor, but for the order of the sum, its energies."""
    bodies = [
        built(form, parameters, "hexahedron", lanes=lanes, heated=True, monkeypatch=monkeypatch)
        for lanes in (0, ours()[-1])
    ]
    for one, other in zip(*map(stepped, bodies), strict=True):
        np.testing.assert_array_equal(other, one)
    one, many = (body.energies() for body in bodies)
    assert many == pytest.approx(one, rel=1e-13)
    assert one["elastic"] > 0.0


ENHANCED = load_form(Path(__file__).parents[1] / "data" / "enhanced_plasticity.py")
OF_CELLS = {
    "elastic": (solid_shell, solid_shell.Parameters(E=2e11, nu=0.3, rho=7800.0)),
    "yields": (ENHANCED, metal(ENHANCED, hardening=j2.LinearHardening(2e9))),
    "yields, a local unknown": (ENHANCED, metal(ENHANCED, hardening=j2.VoceHardening(0.1e9, 200.0))),
}


@pytest.mark.parametrize("case", OF_CELLS.values(), ids=OF_CELLS)
def test_lanes_and_threads_change_no_bit_of_fields_of_one_cell(case, monkeypatch):
    """Nor of their values, solved for implicitly and, at the end, as explicit steps do; nor of energies, but sums."""
    found: list[list[np.ndarray]] = []
    energies: list[dict[str, float]] = []
    for lanes, threads in ((0, 1), (1, 1), (ours()[-1], 1), (2, 3)):
        body = built(*case, "wall", lanes=lanes, threads=threads, monkeypatch=monkeypatch)
        if lanes:
            assert body._histories[0]._pass._blocks._lanes == lanes
        ends = stepped(body)
        ends += [body.step(1e-4 * np.sin(np.arange(body.layout.n_local))), body._histories[0].solved.accepted.copy()]
        found.append(ends)
        energies.append(body.energies())
        assert (body._histories[0]._totals is not None) == (lanes > 0)
    assert abs(found[0][-1]).max() > 0.0
    assert energies[0]["elastic"] > 0.0
    for other in energies[1:]:
        assert other == pytest.approx(energies[0], rel=1e-12)
    for others in found[1:]:
        for one, many in zip(found[0], others, strict=True):
            np.testing.assert_array_equal(many, one)


@pytest.mark.parametrize("name", ["finite strain", "Newton steps that run away", "no history", "two rules"])
def test_threads_change_no_bit(name, monkeypatch):
    one = stepped(built(*CASES[name], lanes=2, monkeypatch=monkeypatch))
    for threads in (2, 3):
        many = stepped(built(*CASES[name], lanes=2, threads=threads, monkeypatch=monkeypatch))
        for first, second in zip(one, many, strict=True):
            np.testing.assert_array_equal(second, first)


def test_a_run_is_the_same_in_threads(monkeypatch):
    def ran(threads):
        body = built(*CASES["finite strain"], lanes=ours()[-1], threads=threads, monkeypatch=monkeypatch)
        run = ExplicitRun(body, velocity=lambda x: 200.0 * x[:, [1, 2, 0]])
        run.simulate(3e-5, outputs=1)
        return run.motion.x

    np.testing.assert_array_equal(ran(2), ran(1))


def test_work_is_what_loops_repeat(tmp_path):
    """Two statements, five times one and three times another, twenty times one in a loop in the first."""
    code = """
void tabulate_tensor_x(double* restrict A)
{
// x = 1;
static const double t[1] = {1.0};
double a = 0.0;
for (int iq = 0; iq < 5; ++iq)
{
  double b = a;
  for (int i = 0; i < 4; ++i)
  {
    A[i] += b;
  }
}
for (int i = 0; i < 3; ++i)
{
  A[i] += a;
}
A[0] = a;
}
double other = 1.0;
"""
    (tmp_path / "made.c").write_text(code)
    module = types.ModuleType("made")
    module.__file__ = str(tmp_path / "made.cpython.so")
    assert lane_library.work_of_kernel(module) == 2 + 5 + 20 + 3
    module.__file__ = str(tmp_path / "none.so")
    assert lane_library.work_of_kernel(module) == 0


def test_heavy_cells_are_taken_in_lanes_from_few_on():
    """A hundred bricks of finite plastic strain have as much to do as thousands of elastic tetrahedra."""
    bodies = [
        NonlinearModel(
            meshes.block(1.0, 0.5, 0.5, divisions=(5, 5, 5), cell=cell, comm=MPI.COMM_SELF), form, parameters, degree=1
        )
        for form, parameters, cell in (CASES["finite strain"], CASES["no history"])
    ]
    few, many = (len(body.groups[0].cells) for body in bodies)
    assert many > 4 * few
    assert [body._histories[0]._pass._blocks is None for body in bodies] == [False, True]


@pytest.mark.parametrize("threads", [0, -1, 1.5, True, 10**6])
def test_a_wrong_number_of_threads_is_refused(threads):
    with pytest.raises(FormulationError, match="threads"):
        NonlinearModel(
            meshes.block(1.0, 1.0, 1.0, divisions=(1, 1, 1), comm=MPI.COMM_SELF), j2, metal(j2), degree=1,
            threads=threads,
        )


def test_without_a_compiler_cells_are_taken_one_by_one(monkeypatch):
    """As where the compiler has no vectors, or the cache cannot be written to: the same, slower."""

    def refuses(*_, **__):
        raise subprocess.CalledProcessError(1, "cc")

    monkeypatch.setattr(lane_library, "_compiled", refuses)
    monkeypatch.setattr(lane_library, "_NAME", "of_another_name")  # not in the cache
    monkeypatch.setattr(lane_library, "_OPTIONS", ("-other",))
    body = built(*CASES["finite strain"], lanes=ours()[-1], monkeypatch=monkeypatch)
    assert body._histories[0]._pass._blocks._lanes == 1


@pytest.mark.parametrize(
    "body", ["while (1) {}", "A[0] += y;", "A[0] += cbrt(w[0]);", "int i = 0; i += 1;", "A[0] = w["]
)
def test_code_that_is_not_known_is_not_rewritten(body):
    code = f"void tabulate_tensor_x(double* restrict A, const double* restrict w)\n{{\n{body}\n}}\n"
    with pytest.raises(NotRewrittenError):
        lane_code(code, "many", lanes=2)
