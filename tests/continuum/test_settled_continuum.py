"""A body with history in equilibrium, and its linear equations there."""

from mpi4py import MPI

import numpy as np
import pytest
import scipy.signal
from scipy.spatial.transform import Rotation

import flexmbd as fm
from flexmbd import forms, meshes
from flexmbd.continuum import ContinuumModel, ImplicitContinuum, Interface, MpiTeam, NonlinearModel
from flexmbd.errors import SceneError
from flexmbd.multibody.bodies.continuum_body import FrameMotion, Scheme
from flexmbd.reduction import craig_bampton

J2, HENCKY, ELASTIC = forms.j2_plasticity, forms.hencky_plasticity, forms.solid_linear
STEEL = {"E": 2.0e9, "nu": 0.3, "rho": 7800.0}
GRAVITY = np.array([0.0, 1.0, -9.81])
RIGID, AVERAGED = fm.Coupling
HELD = {"both rigid": (RIGID, RIGID), "first averaged": (AVERAGED, RIGID), "last averaged": (RIGID, AVERAGED)}
ALL = fm.InteriorModes(count=1000)
ELASTIC_STEEL = ELASTIC.Parameters(**STEEL)


def ends(couplings=(RIGID, RIGID)):
    return [Interface(name, coupling=how) for name, how in zip(("x_min", "x_max"), couplings, strict=True)]


def block(length=1.0):
    return meshes.block(length, 0.1, 0.1, divisions=(4, 1, 1), comm=MPI.COMM_SELF)


def bar(form=ELASTIC, parameters=ELASTIC_STEEL, couplings=(RIGID, RIGID), length=1.0):
    return ImplicitContinuum(NonlinearModel(block(length), form, parameters, degree=1, interfaces=ends(couplings)))


def reduced():
    model = ContinuumModel(block(), ELASTIC, ELASTIC_STEEL, degree=1, interfaces=ends())
    return fm.FlexibleBody(craig_bampton(model, modes=36, frame="x_min"))  # all there are


def machine(body, *, gravity=9.81, joint=None, force=None, **team):
    """A bar held or hinged at one end, with a lump of iron on the other."""
    scene = fm.System(gravity=(0.0, 0.0, -gravity), **team)
    scene.add(body, name="bar")
    lump = scene.add(fm.RigidBody(5.0, (0.1, 0.1, 0.1), (0.05, 0.0, 0.0)), name="lump")
    held = scene.connect(joint or fm.joint.Fixed(), scene.ground.frame(), body.frame("x_min"), name="held")
    scene.connect(fm.joint.Fixed(), body.frame("x_max"), lump.frame(), name="bond")
    if force is not None:
        scene.add_force(fm.force.FrameForce(lump.frame(), force))
    return scene, held, lump.frame()


def both(**how):
    return [machine(body, **how) for body in (fm.ContinuumBody(bar()), reduced())]


# against the reduced body


def test_at_rest_it_vibrates_as_the_reduced_body_with_all_its_modes():
    lins = [scene.linearize(modes=ALL) for scene, *_ in both(gravity=0.0)]
    assert lins[0].M.shape == lins[1].M.shape == (42, 42)
    assert lins[0].frequencies() == pytest.approx(lins[1].frequencies(), rel=1e-10)
    omega = 2.0 * np.pi * np.array([0.0, 5.0, 60.0])
    found = []
    for scene, _, tip in both(gravity=0.0):
        push = fm.force.FrameForce(tip, (1.0, 2.0, -3.0), (0.0, 0.1, 0.2))
        seen = [fm.output.Position(tip), fm.output.Acceleration(tip)]
        found.append(scene.linearize(inputs=[push], outputs=seen, modes=ALL).frequency_response(omega))
    assert abs(found[0] - found[1]).max(axis=(0, 1)) == pytest.approx(0.0, abs=1e-10 * abs(found[1]).max())


def test_few_modes_are_enough_for_what_is_slow():
    scene, *_ = machine(fm.ContinuumBody(bar()))
    eq = scene.equilibrium()
    whole = scene.linearize(about=eq, modes=ALL).frequencies()[:6]
    errors = []
    for count in (0, 4, 8, 20):
        few = scene.linearize(about=eq, modes=fm.InteriorModes(count))
        assert len(few.coordinates) == 6 + count
        errors.append(few.frequencies()[:6] / whole - 1.0)
    assert few.coordinates[-1] == "bar.q[19]"
    assert (np.diff(errors, axis=0) < 1e-12).all()
    assert max(errors[0]) > 0.1
    assert 1e-10 < max(errors[3]) < 1e-6
    # each from above
    assert min(errors[3]) > -1e-10
    below = scene.linearize(about=eq, modes=fm.InteriorModes(below_hz=700.0))
    limit = scene.linearize(about=eq, modes=fm.InteriorModes(len(below.coordinates) - 6 + 1))
    fixed = np.sqrt(np.diag(limit.K)[6:]) / (2.0 * np.pi)
    assert fixed[-2] < 700.0 < fixed[-1]


def test_under_its_weight_it_differs_by_the_square_of_the_load():
    """Shape, frequencies: of finite strain in the one, of the second order in the other."""
    shapes, frequencies = [], []
    for gravity in (9.81, 98.1):
        pairs = both(gravity=gravity)
        settled = [(scene.equilibrium(), scene, tip) for scene, _, tip in pairs]
        (first, _, tip), (second, _, twin) = settled
        shapes.append(abs(first.position(tip) - second.position(twin)).max())
        found = [scene.linearize(about=eq, modes=ALL).frequencies()[:10] for eq, scene, _ in settled]
        frequencies.append(abs(found[0] / found[1] - 1.0).max())
    assert frequencies[0] < 1e-5
    assert frequencies[1] == pytest.approx(100.0 * frequencies[0], rel=0.1)
    assert shapes[1] == pytest.approx(100.0 * shapes[0], rel=0.2)


def test_a_pendulum_hangs_down_and_swings():
    """From its side, a quarter turn in one increment; hanging strains it by 2e-5."""
    found = []
    for scene, hinge, tip in both(joint=fm.joint.Revolute("y")):
        hinge.position = 0.1
        eq = scene.equilibrium()
        assert eq.beta(hinge) == pytest.approx(np.pi / 2, abs=1e-9)
        assert eq.position(tip)[2] < -1.0
        lin = scene.linearize(about=eq, modes=ALL)
        found.append(lin.frequencies()[:2])
    # as a rigid body, which its elastic modes slow by little
    first = STEEL["rho"] * 0.01 * 0.5 + 5.0 * 1.05
    second = STEEL["rho"] * 0.01 * (1.0 / 3.0 + 0.01 / 12.0) + 5.0 * 1.05**2 + 0.1
    assert found[0][0] == pytest.approx(np.sqrt(9.81 * first / second) / (2.0 * np.pi), rel=5e-4)
    assert found[0] == pytest.approx(found[1], rel=3e-5)


# against differences


def standing(interior, *, size, seed=1):
    """Frames askew and at rest, away from where the undeformed body has them."""
    R = Rotation.from_rotvec([0.3, 0.5, -0.2]).as_matrix()
    rng = np.random.default_rng(seed)
    p = np.array([frame.p_BI_B for frame in interior.frames]) @ R.T
    straight = FrameMotion(p, np.array([R @ frame.R_BI for frame in interior.frames]), *np.zeros((4, 2, 3)))
    return straight, moved(straight, size * rng.normal(size=12) * np.tile([1, 1, 1, 20, 20, 20], 2))


def moved(motion, y):
    move, turn = np.split(np.reshape(y, (2, 6)), 2, axis=1)
    return motion._replace(p=motion.p + move, R=Rotation.from_rotvec(turn).as_matrix() @ motion.R)


CASES = {
    "elastic": (ELASTIC, ELASTIC_STEEL, 5e-4),
    "small strain": (J2, J2.Parameters(**STEEL, yield_stress=1.0e6, hardening=J2.LinearHardening(2.0e8)), 1e-3),
    "logarithmic": (HENCKY, HENCKY.Parameters(**STEEL, yield_stress=1.0e6, hardening=J2.LinearHardening(2.0e8)), 1e-3),
}


@pytest.mark.parametrize("held", HELD)
@pytest.mark.parametrize("name", CASES)
def test_slopes_of_the_balance_are_the_derivative_of_its_wrenches(name, held):
    form, parameters, size = CASES[name]
    interior = bar(form, parameters, HELD[held])
    straight, motion = standing(interior, size=size)
    interior.begin(0.0, straight, GRAVITY)
    wrenches, slopes = interior.equilibrate(0.0, motion)
    # its weight, but for what the frames have of it
    weight = sum(wrench[:3] for wrench in wrenches)
    own = 78.0 - sum(frame.mass for frame in interior.frames)
    assert weight == pytest.approx(own * GRAVITY, abs=1e-6 * abs(wrenches).max())
    step, found = 1e-7, np.zeros((12, 12))
    for j, unit in enumerate(np.eye(12)):
        there, back = (interior.equilibrate(0.0, moved(motion, sign * step * unit))[0] for sign in (1.0, -1.0))
        found[:, j] = (there - back).reshape(-1) / (2 * step)
    assert abs(found - slopes).max(axis=0) == pytest.approx(0.0, abs=3e-6 * abs(slopes).max())


@pytest.mark.parametrize("held", HELD)
def test_linear_equations_are_those_of_small_steps(held):
    """With the scheme's rates: the derivative of an implicit step from a bent state, with all modes."""
    interior = bar(couplings=HELD[held])
    straight, motion = standing(interior, size=5e-3)
    interior.begin(0.0, straight, GRAVITY)
    interior.equilibrate(0.0, motion)
    interior.commit()
    linear = interior.linear(motion, ALL)
    assert abs(linear.lacking[12:]).max() < 1e-8 * abs(linear.lacking[:12]).max()
    for h in (1e-4, 2e-3, 5e-2):
        scheme = Scheme(0.2, 0.4, 0.36, 0.7)
        per_x, _ = scheme.slopes(h)
        _, slopes = interior.trial(h, h, scheme, motion)
        whole = linear.mass / per_x + linear.stiffness
        condensed = whole[:12, :12] - whole[:12, 12:] @ np.linalg.solve(whole[12:, 12:], whole[12:, :12])
        assert abs(condensed + slopes).max() < 1e-7 * abs(slopes).max()
        interior.revert()


@pytest.mark.parametrize("name", ["small strain", "logarithmic"])
def test_what_has_yielded_unloads_elastically(name):
    form, parameters, size = CASES[name]
    interior = bar(form, parameters)
    straight, motion = standing(interior, size=size)
    interior.begin(0.0, straight, GRAVITY)
    interior.equilibrate(0.0, motion)
    interior.commit()
    assert interior.energies()["plastic"] > 0.1 * interior.energies()["elastic"]
    stiffness = interior.linear(motion, ALL).stiffness[:12, :12]
    onwards = np.concatenate([motion.p - straight.p, np.zeros((2, 3))], axis=1)
    for k in range(2):
        onwards[k, 3:] = Rotation.from_matrix(motion.R[k] @ straight.R[k].T).as_rotvec()
    rest, _ = interior.equilibrate(0.0, motion)
    step = 1e-5
    loading, unloading = (
        (interior.equilibrate(0.0, moved(motion, sign * step * onwards))[0] - rest).reshape(-1) / (sign * step)
        for sign in (1.0, -1.0)
    )
    expected = -stiffness @ onwards.reshape(-1)
    assert abs(unloading - expected).max() < 1e-4 * abs(expected).max()
    assert abs(loading - expected).max() > 0.2 * abs(expected).max()


# in the machine


def release(t):
    """From 0 to 1 within 0.02 s from t = 2 s, smoothly."""
    return float(0.5 - 0.5 * np.cos(np.pi * np.clip((t - 2.0) / 0.02, 0.0, 1.0)))


def test_a_yielded_bar_stays_bent_and_springs_back_elastically():
    """Its state goes with the equilibrium into simulations and linear equations, whatever was done before."""
    parameters = HENCKY.Parameters(**STEEL, yield_stress=2.0e6, hardening=J2.LinearHardening(1.0e8))
    body = fm.ContinuumBody(bar(HENCKY, parameters))
    scene, _, tip = machine(body, force=(0.0, 0.0, lambda t: 50.0 * release(t) - 1000.0))
    eq = scene.equilibrium()
    plastic = body.interior.energies()["plastic"]
    assert plastic > 10.0
    still = scene.simulate(0.004, h=1e-3, about=eq, rtol=1e-8, integrator=fm.GeneralizedAlpha())
    assert np.ptp(still.position(tip), axis=0).max() < 1e-9
    push, seen = fm.force.FrameForce(tip, (0.0, 0.0, 1.0)), [fm.output.Position(tip)]
    lin = scene.linearize(about=eq, inputs=[push], outputs=seen)
    run = scene.simulate(2.05, t_start=2.0, h=1e-3, about=eq, rtol=1e-8, integrator=fm.GeneralizedAlpha(0.9))
    # the first wave yields a little more on its way; if it had gone on by the elastoplastic tangent, by percents
    assert run.energies(body)["plastic"][-1] == pytest.approx(plastic, rel=2e-4)
    _, response, _ = scipy.signal.lsim(lin.state_space(), [release(t) for t in run.t], run.t - 2.0)
    rise = run.position(tip)[:, 2] - eq.position(tip)[2]
    assert rise.max() > 1e-4
    assert abs(rise - 50.0 * response[:, 2]).max() < 0.02 * rise.max()


def test_a_bar_that_buckles_between_its_frames_is_refused():
    """Pressed straight along a guide that keeps its ends from turning; the pressed bar is softer before."""
    found = []
    for force in (0.0, 1e6, 2e6):
        scene = fm.System()
        body = scene.add(fm.ContinuumBody(bar(length=2.0)), name="bar")
        near, far = body.frame("x_min"), body.frame("x_max")
        scene.connect(fm.joint.Fixed(), scene.ground.frame(), near)
        guide = scene.connect(fm.joint.Prismatic("x"), near, far)
        guide.position = 2.0
        scene.add_force(fm.force.JointForce(guide, -force))
        eq = scene.equilibrium()
        if force < 1.5e6:
            found.append(scene.linearize(about=eq).frequencies()[0])
            continue
        with pytest.raises(SceneError, match=r"body 'bar' failed to be linearised: .* buckles between its frames"):
            scene.linearize(about=eq)
    assert found[1] < 0.8 * found[0]


@pytest.mark.mpi
def test_spread_over_all_ranks_it_is_the_same():
    found = []
    for comm in (MPI.COMM_SELF, MPI.COMM_WORLD):
        team = {} if comm.size == 1 else {"team": MpiTeam(comm)}
        mesh = meshes.block(1.0, 0.1, 0.1, divisions=(4, 1, 1), comm=comm)
        interfaces = ends((RIGID, AVERAGED))
        body = NonlinearModel(mesh, ELASTIC, ELASTIC_STEEL, degree=1, interfaces=interfaces)
        scene, _, tip = machine(fm.ContinuumBody(ImplicitContinuum(body)), **team)
        eq = scene.equilibrium()
        run = scene.simulate(2e-3, h=1e-3, about=eq, integrator=fm.GeneralizedAlpha())
        assert np.ptp(run.position(tip), axis=0).max() < 1e-9
        found.append(np.append(scene.linearize(about=eq, modes=ALL).frequencies(), eq.position(tip)))
    assert found[1] == pytest.approx(found[0], rel=1e-9, abs=1e-10)


def test_what_no_frame_holds_is_refused():
    """Averages are kept by forces on nodes that stay free."""
    scene, *_ = machine(fm.ContinuumBody(bar(couplings=(AVERAGED, AVERAGED))))
    with pytest.raises(SceneError, match=r"body 'bar' .* averaged interfaces alone"):
        scene.equilibrium()
    with pytest.raises(SceneError, match=r"body 'bar' .* averaged interfaces alone"):
        scene.linearize()
