"""Loads that jump, bend or pulse: where steps end, what they see there, what becomes of the order and of the error."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp
from scipy.interpolate import PPoly

import flexmbd as fm
from flexmbd.errors import SceneError
from flexmbd.multibody.functions.breaks import find_breaks, stretches
from flexmbd.multibody.functions.time_function import as_row

MASS, STIFFNESS, END, STOP = 1.0, 4.0, 3.0, 0.7317
OMEGA = np.sqrt(STIFFNESS / MASS)


def step_load(t):
    return 3.0 if t < STOP else 0.0


def late_step(t):
    """The same, but that it has its old value at the break."""
    return 3.0 if t <= STOP else 0.0


def pulse_load(t):
    return 3.0 * max(0.0, 1.0 - abs(t - STOP / 2) / (STOP / 2))


STEP_DATA = PPoly([[3.0, 0.0]], [0.0, STOP, 10.0])
PULSE_DATA = PPoly([[6.0 / STOP, -6.0 / STOP, 0.0], [0.0, 3.0, 0.0]], [0.0, STOP / 2, STOP, 10.0])
DECLARED = {
    "data": STEP_DATA,
    "compiled": fm.compiled(step_load, breaks=[STOP]),
    "python": fm.Piecewise(step_load, breaks=[STOP]),
    "late": fm.Piecewise(late_step, breaks=[STOP]),
}
METHODS = {
    "radau": fm.RadauIIA(),
    "alpha": fm.GeneralizedAlpha(),
    "energy": fm.EnergyMomentum(),
    "central": fm.CentralDifference(),
    "5": fm.ExplicitRungeKutta(),
    "8": fm.ExplicitRungeKutta(fm.Pair.DORMAND_PRINCE_8),
}


def oscillator(load, *, scale=1.0):
    """A mass on a spring under a load, its displacement in units of ``scale``."""
    scene = fm.System()
    body = scene.add(fm.RigidBody(MASS, (1.0, 1.0, 1.0)), name="body")
    slide = scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(), body.frame(), name="slide")
    scene.add_force(fm.force.JointSpring(slide, STIFFNESS, 0.0))
    scene.add_force(fm.force.JointForce(slide, load))
    return scene, slide


def duhamel(load, t, *, points=(0.0, STOP / 2, STOP)):
    """Displacement under a load that vanishes beyond the last of ``points``, between which it is smooth."""
    parts = [(a, min(b, t)) for a, b in pairwise(points) if a < t]
    return sum(
        quad(lambda s: load(s) * np.sin(OMEGA * (t - s)), a, b * (1.0 - 1e-15), epsabs=1e-14)[0] for a, b in parts
    ) / (MASS * OMEGA)


def end_error(load, exact, method, **how):
    run = oscillator(load)[0].simulate(END, integrator=method, **how)
    return abs(run.x[-1, 0] - exact), run


@pytest.mark.parametrize("how", DECLARED)
@pytest.mark.parametrize("method", METHODS)
def test_a_step_ends_on_a_declared_jump_and_sees_the_near_side(method, how):
    """The row at the jump is that of before it: 3 - 4 x; the motion between the steps goes on with -4 x."""
    scene, slide = oscillator(DECLARED[how])
    run = scene.simulate(END, rtol=1e-5, integrator=METHODS[method])
    (row,) = np.flatnonzero(run.t == STOP)
    assert (np.diff(run.t) > 0.0).all()
    assert run.a[row, 0] == pytest.approx(3.0 - 4.0 * run.x[row, 0], abs=1e-4)
    (departure,) = run.departures
    assert departure.row == row
    assert departure.a[0] == pytest.approx(-4.0 * run.x[row, 0], abs=1e-9)
    between = np.linspace(STOP, run.t[row + 1], 5)
    exact = [duhamel(step_load, t) for t in between]
    np.testing.assert_allclose(run.beta(slide, t=between), exact, atol=3e-4)


@pytest.mark.parametrize("rtol", [1e-4, 1e-6, 1e-8])
@pytest.mark.parametrize("method", ["radau", "5", "8"])
@pytest.mark.parametrize("load", [STEP_DATA, PULSE_DATA, DECLARED["compiled"]], ids=["jump", "kink", "declared"])
def test_errors_are_those_of_smooth_motion(method, load, rtol):
    """Against Duhamel's integral: below rtol, as without a jump, over the six radians of the motion."""
    exact = duhamel(pulse_load if load is PULSE_DATA else step_load, END)
    error, _ = end_error(load, exact, METHODS[method], rtol=rtol)
    assert error < rtol


@pytest.mark.parametrize("method", ["alpha", "energy", "central"])
@pytest.mark.parametrize("load", [STEP_DATA, PULSE_DATA], ids=["jump", "kink"])
def test_methods_of_order_two_keep_their_tolerance(method, load):
    exact = duhamel(pulse_load if load is PULSE_DATA else step_load, END)
    error, _ = end_error(load, exact, METHODS[method], rtol=1e-6)
    assert error < 4e-6


@pytest.mark.parametrize("rtol", [1e-4, 1e-6, 1e-8])
@pytest.mark.parametrize(("load", "shape"), [(step_load, "jump"), (pulse_load, "kink")])
def test_an_undeclared_jump_is_met_by_radau_as_by_scipys(load, shape, rtol):
    """No worse than scipy's Radau with the same rtol."""
    exact = duhamel(load, END)
    peer = solve_ivp(
        lambda t, y: [y[1], load(t) - 4.0 * y[0]], (0.0, END), [0.0, 0.0], method="Radau", rtol=rtol, atol=rtol
    )
    error, _ = end_error(fm.compiled(load), exact, fm.RadauIIA(), rtol=rtol)
    assert error < max(abs(peer.y[0, -1] - exact), rtol), shape


@pytest.mark.parametrize(("method", "peer"), [("5", "RK45"), ("8", "DOP853")])
@pytest.mark.parametrize("rtol", [1e-4, 1e-7, 1e-10])
def test_explicit_pairs_go_over_undeclared_jumps(method, peer, rtol):
    """Wherever they lie, however large they are; at the worst of ten no worse than scipy's pairs at the same rtol."""
    random = np.random.default_rng(3)
    errors = []
    for stop, force in zip(random.uniform(0.1, 2.9, 10), 10.0 ** random.uniform(-1.0, 4.0, 10), strict=True):
        size = force / STIFFNESS
        exact = size * (np.cos(OMEGA * (END - stop)) - np.cos(OMEGA * END))
        load = lambda t, force=force, stop=stop: force if t < stop else 0.0  # noqa: E731
        error, _ = end_error(load, exact, METHODS[method], rtol=rtol)
        other = solve_ivp(
            lambda t, y, load=load: [y[1], load(t) - 4.0 * y[0]], (0.0, END), [0.0, 0.0],
            method=peer, rtol=max(rtol, 1e-13), atol=rtol * size,
        )  # fmt: skip
        errors.append([error / size, abs(other.y[0, -1] - exact) / size])
    ours, theirs = np.max(errors, axis=0)
    assert ours < max(theirs, 10.0 * rtol)


@pytest.mark.parametrize("offset", [0.0, 0.37], ids=["on a step", "inside a step"])
@pytest.mark.parametrize(("method", "order"), [("radau", 5), ("alpha", 2), ("energy", 2), ("central", 2), ("5", 5)])
def test_fixed_steps_keep_their_order_across_a_jump(method, order, offset):
    """Halved steps leave an error 2^order times smaller, and rows where equal steps put them."""
    coarse = 0.25 if order == 5 else 0.05
    jump = 1.0 + offset * coarse / 4.0
    load = PPoly([[3.0, 0.0]], [0.0, jump, 10.0])
    exact = duhamel(lambda t: 3.0, END, points=(0.0, jump))
    errors = []
    for h in (coarse, coarse / 2.0, coarse / 4.0):
        error, run = end_error(load, exact, METHODS[method], h=h, rtol=1e-10)
        errors.append(error)
        grid = h * np.arange(round(END / h) + 1)
        assert len(run.t) == len(grid) + (offset > 0.0)
        assert np.abs(run.t[:, None] - grid).min(axis=0).max() < 1e-12
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert orders[-1] > order - 0.25


def held_back(method):
    """The share of the impulse of true accelerations 0, 1, 0 that generalized-alpha gives after the last of them.

    By its recursion (Chung & Hulbert 1993, eq. 8 to 10), where later accelerations vanish.
    """
    alpha_m, alpha_f, _, gamma = method.coefficients()
    auxiliary, speed = [0.0], 0.0
    for before, now in ((0.0, 1.0), (1.0, 0.0)):
        auxiliary.append(((1.0 - alpha_f) * now + alpha_f * before - alpha_m * auxiliary[-1]) / (1.0 - alpha_m))
        speed += (1.0 - gamma) * auxiliary[-2] + gamma * auxiliary[-1]
    return 1.0 - speed


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("how", ["rtol", "h"])
@pytest.mark.parametrize("monotone", [True, False])
def test_a_short_pulse_of_data_is_not_stepped_over(method, how, monotone):
    """0.1 ms in a table of 3 s: its impulse of 0.5 N s sets the mass going.

    Of two fixed steps up to the peak and down it generalized-alpha still holds a part back, where the next step begins
    anew.
    """
    given = {"h": 0.05} if how == "h" else {"rtol": 1e-5}
    width, begin = 1e-4, 1.2345
    near = begin + 0.5 * width * np.arange(-12, 15)
    t = np.concatenate([[0.0, 0.6], near, [2.0, END]])
    y = np.where(np.arange(len(t)) == 15, 1.0 / width, 0.0)
    table = fm.Table(t, y, monotone=monotone)
    scene, slide = oscillator(table)
    run = scene.simulate(END, integrator=METHODS[method], **given)
    load = as_row(table, "pulse", motion=False)
    pieces = PPoly(load.data[load.count + 2 :].reshape(load.count, 4).T, load.data[1 : load.count + 2])
    moment = sum(
        quad(lambda s: pieces(s) * np.sin(OMEGA * (END - s)), a, b, epsabs=1e-12)[0]
        for a, b in pairwise(t)
    ) / (MASS * OMEGA)
    bound = 0.01 + held_back(METHODS[method]) if (method, how) == ("alpha", "h") else 0.02
    assert abs(run.beta(slide)[-1] - moment) < bound * abs(moment)


@pytest.mark.parametrize("method", ["radau", "alpha", "energy", "5", "8"])
@pytest.mark.parametrize("rtol", [1e-4, 1e-5, 1e-6])
def test_a_pulse_between_breaks_is_as_exact_as_what_follows(method, rtol):
    """10 kN for 0.1 ms: accelerations of the pulse say nothing about the machine's own rate afterwards."""
    begin, end = 0.5, 0.5001
    load = PPoly([[0.0, 1e4, 0.0]], [0.0, begin, end, 10.0])
    swing = np.cos(OMEGA * (END - end)) - np.cos(OMEGA * (END - begin))
    error, _ = end_error(load, 1e4 / STIFFNESS * swing, METHODS[method], rtol=rtol)
    assert error < 6.0 * rtol


def test_dense_tables_force_no_steps():
    """A hundred thousand points of two sines take few more steps at a loose rtol than the sines; both end alike."""
    t = np.linspace(0.0, END, 100_001)
    tables = fm.Table(t, np.sin(3.0 * t) + 0.2 * np.sin(20.0 * t))
    smooth = fm.compiled(lambda t: np.sin(3.0 * t) + 0.2 * np.sin(20.0 * t))
    method = fm.ExplicitRungeKutta()
    runs = [oscillator(load)[0].simulate(END, rtol=1e-4, integrator=method) for load in (tables, smooth)]
    assert runs[0].stats.steps < 1.5 * runs[1].stats.steps + 10
    assert runs[0].x[-1, 0] == pytest.approx(runs[1].x[-1, 0], abs=1e-4)


def test_straight_pieces_that_follow_a_curve_closely_are_one_stretch():
    """Linear pieces of a cosine: their corners show where rtol is below what they miss of the curve, h^2 / 8."""
    x = np.linspace(0.0, 1.0, 2001)
    y = np.cos(x)
    poly = PPoly([np.diff(y) / np.diff(x), y[:-1]], x)
    assert len(stretches(poly, 1e-5)) == 0
    assert len(stretches(poly, 1e-10)) == 1999


def test_breaks_are_told_from_knots():
    """A spline bends without a jump of its slope; where a table is held beyond its ends the slope jumps there."""
    table = fm.Table([0.0, 1.0, 2.0, 3.0], [0.0, 1.0, 0.0, 5.0], monotone=True)
    found = find_breaks([as_row(table, "table", motion=False)], [7.0], rtol=1e-6)
    np.testing.assert_allclose(found.knots, [0.0, 1.0, 2.0, 3.0, 7.0])
    assert set(found.jumps) <= {0.0, 3.0, 7.0}
    assert {3.0, 7.0} <= set(found.jumps)


def test_breaks_that_rounding_alone_tells_apart_are_one():
    found = find_breaks([], [0.3, 0.1 + 0.2, 1.0], rtol=1e-6)
    assert len(found.jumps) == 2


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("how", [{"rtol": 1e-5}, {"h": 0.03}], ids=["rtol", "h"])
def test_a_restart_from_a_checkpoint_at_the_jump(method, how, tmp_path):
    """To the bit."""
    scene, _ = oscillator(STEP_DATA)
    whole = scene.simulate(END, integrator=METHODS[method], checkpoints=[STOP], **how)
    path = whole.checkpoints[0].save(tmp_path / "jump.npz")
    rest = scene.simulate(END, integrator=METHODS[method], restart=fm.Checkpoint.load(path), **how)
    assert rest.t[0] == STOP
    np.testing.assert_array_equal(rest.x[-1], whole.x[-1])
    assert rest.departures[0].row == 0


def test_an_event_in_the_step_after_a_jump_is_found():
    """The mass passes x = 0.9 after the load has gone; by Duhamel."""
    scene, slide = oscillator(STEP_DATA)
    run = scene.simulate(END, rtol=1e-9, events=[fm.Event(lambda m: m.beta(slide) - 0.9)])
    assert all(abs(duhamel(step_load, one.t) - 0.9) < 1e-8 for one in run.events)
    assert [run.t[one.row] for one in run.departures] == [STOP]
    assert len(run.events) == 2


def test_a_law_and_a_force_of_the_state_may_declare_breaks():
    """The same load as a law on the coordinate and as a force of the whole state."""
    exact = duhamel(step_load, END)

    def law(t, beta, rate):
        return 3.0 if t < STOP else 0.0 * beta * rate

    def force(t, _x, _v):
        return [3.0 if t < STOP else 0.0]

    for given in (fm.compiled(law, breaks=[STOP]), fm.Piecewise(law, [STOP])):
        scene, slide = oscillator(0.0)
        scene.add_force(fm.force.JointLaw(slide, given))
        run = scene.simulate(END, rtol=1e-8, integrator=fm.RadauIIA())
        assert STOP in run.t
        assert abs(run.x[-1, 0] - exact) < 1e-8
    scene, _ = oscillator(0.0)
    scene.add_force(fm.force.StateForce(fm.Piecewise(force, [STOP])))
    run = scene.simulate(END, rtol=1e-8, integrator=fm.RadauIIA())
    assert abs(run.x[-1, 0] - exact) < 1e-8


def test_a_motion_whose_acceleration_jumps():
    """A slider is driven by a parabola, then at a constant speed; a pendulum on it, against scipy."""
    drive = PPoly([[1.0, 0.0], [0.0, 2.0 * STOP], [0.0, STOP**2]], [0.0, STOP, 10.0])
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    cart = scene.add(fm.RigidBody(1.0, (1.0, 1.0, 1.0)), name="cart")
    bob = scene.add(fm.RigidBody(1.0, (0.0, 1e-9, 1e-9), (0.0, 0.0, -1.0)), name="bob")
    slide = scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(), cart.frame())
    slide.prescribe(drive)
    hinge = scene.connect(fm.joint.Revolute("y"), cart.frame(), bob.frame())
    run = scene.simulate(2.0, rtol=1e-8, integrator=fm.RadauIIA())

    def equation(a):
        return lambda t, y: [y[1], (a * np.cos(y[0]) - 9.81 * np.sin(y[0])) / (1.0 + 1e-9)]

    first = solve_ivp(equation(2.0), (0.0, STOP), [0.0, 0.0], rtol=1e-12, atol=1e-13, method="DOP853").y[:, -1]
    last = solve_ivp(equation(0.0), (STOP, 2.0), first, rtol=1e-12, atol=1e-13, method="DOP853").y[:, -1]
    assert STOP in run.t
    assert abs(abs(run.beta(hinge)[-1]) - abs(last[0])) < 2e-8


@pytest.mark.parametrize("breaks", [[np.nan], "soon", [[1.0]]])
def test_breaks_that_are_none_are_refused(breaks):
    with pytest.raises(SceneError, match="breaks must be"):
        fm.Piecewise(step_load, breaks=breaks)
    with pytest.raises(SceneError, match="breaks must be"):
        fm.compiled(step_load, breaks=breaks)
