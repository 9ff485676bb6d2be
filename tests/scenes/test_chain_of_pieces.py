"""A cantilever of reduced pieces under a dead force at its tip: against a rod with stretch and shear, by shooting."""

from contextlib import nullcontext

from mpi4py import MPI

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import flexmbd as fm
from flexmbd import forms, meshes
from flexmbd.continuum import ContinuumModel, Interface
from flexmbd.errors import ModesWarning, SceneError
from flexmbd.reduction import craig_bampton

L, EI, EA, GA = 80.0, 2.0e7, 3.0e8, 1.2e8
SECTION = forms.beam_timoshenko.Parameters(
    EI, 0.25, 1.0, A=EA / EI, Iy=1.0, Iz=1.0, J=2.0, ky=2.5 * GA / EA, kz=2.5 * GA / EA, orientation=(0, 1.0, 0)
)


def _from_the_tip(angle, force):
    """The clamped end's rotation, and the tip's place from it, of a rod whose tip has turned by an angle."""
    n = force * np.array([np.sin(angle), np.cos(angle)])

    def rate(s, y):
        c, d = np.cos(y[2]), np.sin(y[2])
        stretch, shear = 1.0 + (c * n[0] + d * n[1]) / EA, (-d * n[0] + c * n[1]) / GA
        rx, ry = c * stretch - d * shear, d * stretch + c * shear
        return [-rx, -ry, -y[3] / EI, rx * n[1] - ry * n[0]]

    end = solve_ivp(rate, (0.0, L), [0.0] * 4, rtol=1e-12, atol=1e-12).y[:, -1]
    c, d = np.cos(-end[2]), np.sin(-end[2])
    return -end[2], np.array([-c * end[0] + d * end[1], -d * end[0] - c * end[1]])


def exact(force):
    """(2,) m, the tip."""
    angle = brentq(lambda a: _from_the_tip(a, force)[0] - a, 1e-6, 1.56, xtol=1e-13)
    return _from_the_tip(angle, force)[1]


def chain(pieces, modes, *, stretch=True):
    """The scene, and the tip's frame."""
    line = meshes.line(L / pieces, divisions=8, comm=MPI.COMM_SELF)
    ends = [Interface("start"), Interface("end")]
    model = ContinuumModel(line, forms.beam_timoshenko, SECTION, degree=2, interfaces=ends)
    record = craig_bampton(model, modes=modes, frame="start", geometric_stiffness=stretch)
    scene = fm.System()
    below = scene.ground.frame()
    for k in range(pieces):
        body = scene.add(fm.FlexibleBody(record), name=f"piece {k}")
        scene.connect(fm.joint.Fixed(), below, body.frame("start"))
        below = body.frame("end")
    return scene, below


def error(force, pieces, modes, *, stretch=True):
    scene, tip = chain(pieces, modes, stretch=stretch)
    scene.add_force(fm.force.FrameForce(tip, force=(0.0, force, 0.0)))
    found = scene.equilibrium()
    assert found.unstable == 0
    return np.linalg.norm(found.position(tip)[:2] - exact(force)) / L


@pytest.mark.parametrize(("load", "modes"), [(1.0, 2), (5.0, 0), (10.0, 9)])
def test_order_and_size_of_the_error(load, modes):
    """By more than the square of the pieces' length, and below linear pieces."""
    force, numbers = load * EI / L**2, (8, 16)
    errors = np.array([error(force, pieces, modes) for pieces in numbers])
    assert errors[0] / errors[1] > 6.0
    linear = [error(force, pieces, modes, stretch=False) for pieces in numbers]
    assert (errors < 0.4 * np.array(linear)).all()


def test_pieces_five_times_as_long_as_thick():
    """Where bending and shear are as stiff as stretch the order is the same."""
    force = 5.0 * EI / L**2
    coarse, fine = (error(force, pieces, 0) for pieces in (16, 64))
    assert coarse / fine > 30.0
    assert fine < 0.05 * error(force, 64, 0, stretch=False)


def test_a_heavier_load_from_the_equilibrium_of_a_lighter_one():
    scene, tip = chain(8, 2)
    scene.add_force(fm.force.FrameForce(tip, force=(0.0, lambda t: t * EI / L**2, 0.0)))
    eq = None
    for load in (1.0, 4.0, 7.0, 10.0):
        eq = scene.equilibrium(t=load, about=eq)
    at_once = scene.equilibrium(t=10.0)
    assert eq.position(tip) == pytest.approx(at_once.position(tip), abs=1e-9 * L)
    with pytest.raises(SceneError, match="another scene"):
        chain(4, 2)[0].equilibrium(about=eq)
    with pytest.raises(SceneError, match="about"):
        scene.equilibrium(about=scene)


@pytest.mark.parametrize("part", [0.98, 1.02])
def test_a_column_beyond_its_load_is_found_bent(part):
    """Euler's load of a column with stretch and shear; straight it is an equilibrium beyond it as well."""
    euler = np.pi**2 * EI / (4 * L**2)
    scene, tip = chain(16, 0)
    # P (1 + P / GA - P / EA) = P_E (1 - P / EA)^-1, to first order in the strains
    critical = euler * (1.0 - euler / GA + euler / EA)
    scene.add_force(fm.force.FrameForce(tip, force=(-part * critical, 0.0, 0.0)))
    with pytest.warns(fm.EquilibriumWarning, match="is unstable") if part > 1.0 else nullcontext():
        straight = scene.equilibrium()
    assert (straight.unstable > 0) == (part > 1.0)
    assert np.hypot(*straight.position(tip)[1:]) < 1e-9 * L
    found = scene.equilibrium(stable=True)
    assert found.unstable == 0
    assert (np.hypot(*found.position(tip)[1:]) > 0.05 * L) == (part > 1.0)


def test_an_unstable_start_is_kept_and_told():
    scene = fm.System(gravity=(0.0, -9.81, 0.0))
    bar = scene.add(fm.RigidBody(1.0, (1e-3, 0.1, 0.1), (0.0, 0.5, 0.0)), name="bar")
    scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), bar.frame())
    assert scene.equilibrium().unstable == 1


@pytest.mark.parametrize("modes", [3, 4])
def test_a_square_beam_that_is_thrown_in_a_plane_stays_in_it(modes):
    """Of four pieces; three modes would have half a pair."""
    section = forms.beam_timoshenko.Parameters(
        E=1e6, nu=0.3, rho=1.0, A=1.0, Iy=1e-3, Iz=1e-3, J=2e-3, ky=1.0, kz=1.0, orientation=(0, 1.0, 0)
    )
    line = meshes.line(2.5, divisions=8, comm=MPI.COMM_SELF)
    ends = [Interface("start"), Interface("end")]
    model = ContinuumModel(line, forms.beam_timoshenko, section, degree=2, interfaces=ends)
    with pytest.warns(ModesWarning, match="equal frequencies") if modes == 3 else nullcontext():
        record = craig_bampton(model, modes=modes, frame="start")
    scene = fm.System()
    below, tips = scene.ground.frame(), []
    for k in range(4):
        body = scene.add(fm.FlexibleBody(record), name=f"piece {k}")
        scene.connect(fm.joint.Free() if k == 0 else fm.joint.Fixed(), below, body.frame("start"))
        below = body.frame("end")
        tips.append(below)
    push, turn = fm.compiled(lambda t: 8.0 * t), fm.compiled(lambda t: -20.0 * t)
    scene.add_force(fm.force.FrameForce(tips[0], force=(push, 0.0, 0.0), torque=(0.0, 0.0, turn)))
    run = scene.simulate(0.4, rtol=1e-6)
    assert max(np.abs(run.position(tip)[-1, 1]) for tip in tips) > 0.01
    assert max(np.abs(run.position(tip)[:, 2]).max() for tip in tips) < 1e-11


def test_bent_both_ways_and_twisted():
    """Against linear pieces, whose error falls with the square of their length, so that two numbers give the limit."""
    force, moment = EI / L**2, EI / L

    def place(pieces, *, stretch):
        scene, tip = chain(pieces, 0, stretch=stretch)
        load = {"force": (0.0, force, 0.5 * force), "torque": (0.3 * moment, 0.2 * moment, 0.0)}
        scene.add_force(fm.force.FrameForce(tip, **load))
        return scene.equilibrium().position(tip)

    linear = {pieces: place(pieces, stretch=False) for pieces in (8, 12, 16, 24)}
    limit = (4.0 * linear[24] - linear[12]) / 3.0
    errors = {pieces: np.linalg.norm(place(pieces, stretch=True) - limit) for pieces in (8, 16)}
    assert errors[8] / errors[16] > 3.0
    assert all(errors[pieces] < 0.25 * np.linalg.norm(linear[pieces] - limit) for pieces in errors)
