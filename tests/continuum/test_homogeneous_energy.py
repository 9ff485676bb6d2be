"""Energies written in UFL, compiled for pseudo-rigid bodies, against the same written by hand."""

import re
from pathlib import Path

import numpy as np
import pytest
import ufl
from scipy.integrate import solve_ivp

import flexmbd as fm
from flexmbd.continuum import homogeneous_energy
from flexmbd.errors import FormulationError, SceneError
from flexmbd.forms import neo_hookean, solid_mixed, st_venant_kirchhoff
from flexmbd.multibody.kernels.base.arrays import new_work
from flexmbd.multibody.kernels.inverse_dynamics.residual import residual
from flexmbd.multibody.kernels.tangent.residual_tangent import tangent
from flexmbd.multibody.kernels.tangent.tangent_layout import new_tangent_work

PARAMETERS = neo_hookean.Parameters(E=1.0e5, nu=0.3, rho=1000.0)
BUILT_IN = fm.StVenantKirchhoff(E=1.0e5, nu=0.3)
LAM, MU = BUILT_IN.lame
BOX = fm.Solid.box((0.3, 0.1, 0.2), density=1000.0)
STRETCH = np.array([[1.2, 0.1, -0.05], [0.1, 0.9, 0.08], [-0.05, 0.08, 1.1]])
SPIN = np.array([3.0, -2.0, 5.0])
EIGHT = fm.ExplicitRungeKutta(fm.Pair.DORMAND_PRINCE_8)


@pytest.fixture(scope="module")
def rubber():
    return homogeneous_energy(neo_hookean, PARAMETERS)


def flying(material, **start):
    scene = fm.System()
    body = scene.add(fm.PseudoRigidBody(BOX, material, **start), name="block")
    joint = scene.connect(fm.joint.Free(), scene.ground.frame(), body.frame())
    joint.velocity = np.array([0.0, 0.0, 0.0, *SPIN])
    return scene, body


def test_values_at_a_deformation(rubber):
    F = np.random.default_rng(3).normal(size=(3, 3)) * 0.1 + np.eye(3)
    J, inverse = np.linalg.det(F), np.linalg.inv(F)
    W, P, A = rubber.evaluate(F)
    assert pytest.approx(MU / 2 * (np.sum(F * F) - 3 - 2 * np.log(J)) + LAM / 2 * np.log(J) ** 2, rel=1e-12) == W
    assert pytest.approx(MU * (F - inverse.T) + LAM * np.log(J) * inverse.T, abs=1e-9) == P
    around = LAM * np.einsum("ji,lk->ijkl", inverse, inverse)
    across = (MU - LAM * np.log(J)) * np.einsum("li,jk->ijkl", inverse, inverse)
    straight = MU * np.einsum("ik,jl->ijkl", np.eye(3), np.eye(3))
    assert pytest.approx(around + across + straight, abs=1e-8) == A


def test_the_built_in_energy_written_in_ufl():
    """St Venant-Kirchhoff both ways: the same frequencies, and the same flight with its energies."""
    compiled = homogeneous_energy(st_venant_kirchhoff, PARAMETERS)
    runs = []
    for material in (BUILT_IN, compiled):
        scene, body = flying(material, stretch=STRETCH)
        run = scene.simulate(0.1, rtol=1e-11, integrator=EIGHT)
        frequencies = body.reduced().frequencies()
        runs.append((frequencies, run.deformation_gradient(body)[-1], run.energy().total - run.energy().kinetic, run.t))
    (f, F, stored, t), (f2, F2, stored2, t2) = runs
    assert f2 == pytest.approx(f, rel=1e-10)
    assert pytest.approx(F, abs=1e-9) == F2
    assert stored2[0] == pytest.approx(stored[0], rel=1e-12)
    assert t2[-1] == t[-1]


def test_free_flight_of_rubber(rubber):
    """Against F'' J = -V dW/dF."""
    scene, body = flying(rubber, stretch=STRETCH)
    run = scene.simulate(0.2, rtol=1e-11, integrator=EIGHT)
    inverse = np.linalg.inv(BOX.second)

    def change(_, y):
        F = y[:9].reshape(3, 3)
        back = np.linalg.inv(F).T
        stress = MU * (F - back) + LAM * np.log(np.linalg.det(F)) * back
        return np.concatenate([y[9:], (-BOX.volume * stress @ inverse).ravel()])

    rate = np.cross(SPIN, STRETCH.T).T
    exact = solve_ivp(change, (0.0, 0.2), [*STRETCH.ravel(), *rate.ravel()], method="DOP853", rtol=1e-12, atol=1e-13)
    assert run.deformation_gradient(body)[-1] == pytest.approx(exact.y[:9, -1].reshape(3, 3), abs=1e-8)
    assert np.ptp(run.energy().total) < 1e-9 * run.energy().kinetic[0]
    assert "energy neo_hookean of block" in scene.explain()


def test_energy_momentum_keeps_the_energy(rubber):
    """To rounding, as a discrete gradient does, in steps of any size that Newton takes."""
    scene, _ = flying(rubber, stretch=STRETCH)
    run = scene.simulate(0.01, h=2e-4, integrator=fm.EnergyMomentum())
    assert np.ptp(run.energy().kinetic) > 0.1 * run.energy().total[0]
    assert np.ptp(run.energy().total) < 1e-11 * run.energy().total[0]


def test_tangent(rubber):
    """Its derivatives by the stretches against differences of the residual."""
    scene, body = flying(rubber)
    compiled = scene.compile().scene
    plan, nv = compiled.plan, compiled.nv
    work, matrix, none = new_work(plan), np.zeros((nv, nv)), np.zeros(0)
    place = compiled.index.modes[body]
    x, v, a = compiled.start.copy(), np.zeros(nv), np.zeros(nv)
    x[place.x] = body.coordinates_of(STRETCH)
    tangent(plan, work, new_tangent_work(plan, nv, sizes=np.ones((2, nv))), x, v, a, none, 1.0, 0.0, 0.0, matrix)
    step = 1e-6 * np.sqrt(BOX.mass)
    for k in range(6):
        ends = []
        for sign in (1.0, -1.0):
            moved, out = x.copy(), np.zeros(nv)
            moved[place.x.start + k] += sign * step
            residual(plan, work, moved, v, a, none, out)
            ends.append(out)
        column = (ends[0] - ends[1]) / (2 * step)
        assert matrix[:, place.v.start + k] == pytest.approx(column, abs=1e-7 * abs(matrix).max())


def test_rubber_is_not_pressed_flat(rubber):
    """The load under which St Venant-Kirchhoff's body gives way: rubber comes to rest where its stress bears it."""
    scene = fm.System()
    body = scene.add(fm.PseudoRigidBody(BOX, rubber, damping=1.0), name="block")
    scene.connect(fm.joint.Free(), scene.ground.frame(), body.frame())
    for side in (-1.0, 1.0):
        end = body.frame((side * 0.15, 0.0, 0.0))
        scene.add_force(fm.force.FrameForce(end, force=(-side * 2000.0, 0.0, 0.0)))
    run = scene.simulate(1.0, rtol=1e-8)
    U = run.stretch(body)[-1]
    _, P, _ = rubber.evaluate(U)
    assert BOX.volume * P == pytest.approx(np.diag([-2000.0 * 0.3, 0.0, 0.0]), abs=1e-3)
    assert 0.3 < U[0, 0] < 0.7


@pytest.mark.parametrize(
    ("source", "parameters", "kind", "says"),
    [
        (lambda F: F, None, FormulationError, "must be a UFL scalar"),
        (lambda F: 3.0, None, FormulationError, "must be a UFL scalar, got 3.0"),
        (lambda F: ufl.no_such_function(F), None, FormulationError, "cannot be written as UFL of F"),
        (lambda F: F[0, 0] ** 2, None, SceneError, "changes as the body turns"),
        (lambda F: ufl.ln(ufl.det(F) - 1), None, SceneError, "not finite at F = 1"),
        (lambda F: ufl.det(F), PARAMETERS, FormulationError, "parameters belong to a formulation"),
        (neo_hookean, None, FormulationError, "parameters must be its Parameters"),
        (solid_mixed, solid_mixed.Parameters(E=1e5, nu=0.3, rho=1e3), FormulationError, "displacement alone"),
    ],
)
def test_what_is_no_energy(source, parameters, kind, says):
    with pytest.raises(kind, match=says):
        homogeneous_energy(source, parameters)


def test_an_energy_that_resists_no_shear():
    """A gas: it is refused, for its stretches are no vibrations."""
    gas = homogeneous_energy(lambda F: 1e5 * (ufl.det(F) - 1) ** 2)
    with pytest.raises(SceneError, match="a body must have a positive stiffness against every stretch"):
        fm.PseudoRigidBody(BOX, gas)


def test_the_page_on_other_energies():
    """Its block runs, after the page's first."""
    text = (Path(__file__).parents[2] / "docs" / "pseudo_rigid.md").read_text(encoding="utf-8")
    first, energies, *_ = re.findall(r"^```python\n(.*?)^```$", text, re.DOTALL | re.MULTILINE)
    names = {}
    exec(compile(first.partition("run = ")[0], "pseudo_rigid.md", "exec"), names)
    exec(compile(energies, "pseudo_rigid.md", "exec"), names)
    assert names["W"] > 0.0
    assert names["soft"].reduced().n_modes == 6
