"""Each stress update follows the rate it names: simple shear, turns, closed cycles, on one driven brick."""

from itertools import pairwise

import numpy as np
import pytest
from driven import Driven, turn

from flexmbd.forms import hencky_plasticity, updated_lagrangian
from flexmbd.forms.j2_plasticity import LinearHardening

FORMS = {"Truesdell": updated_lagrangian, "logarithmic": hencky_plasticity}

# sigma_12 and sigma_11 of a simple shear with G = 1.
TRUESDELL = {0.1: (0.1, 0.01), 0.5: (0.5, 0.25), 1: (1, 1), 2: (2, 4), 4: (4, 16), 8: (8, 64)}
LOGARITHMIC = {
    0.1: (0.099833666, 0.0049916833),
    0.5: (0.480155463, 0.120038866),
    1: (0.860817882, 0.430408941),
    2: (1.24645048, 1.24645048),
    4: (1.29122682, 2.58245365),
    8: (1.01608483, 4.06433934),
}


def elastic(form, *, nu=0.0):
    """A brick with G = 1 that never yields; without cell means, where a pressure follows volumes alone."""
    return Driven(form, form.Parameters(E=2 * (1 + nu), nu=nu, rho=1.0, yield_stress=1e6), means=False)


def shear(gamma):
    return np.array([[1.0, gamma, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])


def yielding(form):
    """E, nu, yield stress and plastic slope of the objectivity problem, MPa; hardening is H = E E_t / (E - E_t)."""
    slope = 2e5 * 2000.0 / (2e5 - 2000.0)
    return Driven(form, form.Parameters(E=2e5, nu=0.3, rho=1.0, yield_stress=200.0, hardening=LinearHardening(slope)))


def test_truesdells_rate_in_small_steps():
    """Second order in the step: halving it quarters the error, and what is extrapolated is the column."""
    gammas = [gamma for gamma in TRUESDELL if 0.5 <= gamma <= 2]
    found = {}
    for steps in (20, 40):
        brick = elastic(updated_lagrangian)
        for k in range(1, 2 * steps + 1):
            stress = brick.go(shear(k / steps))
            found[steps, k / steps] = stress[0, 1], stress[0, 0]
    for gamma in gammas:
        exact = np.array(TRUESDELL[gamma], dtype=float)
        coarse, fine = (np.array(found[steps, gamma]) - exact for steps in (20, 40))
        assert coarse / fine == pytest.approx(np.full(2, 4.0), abs=0.2)
        assert (4 * fine - coarse) / 3 == pytest.approx(np.zeros(2), abs=3e-5 * gamma**2)


def test_truesdells_rate_in_one_step():
    """Off by the third order: of half the shear by an eighth."""
    found = {gamma: elastic(updated_lagrangian).go(shear(gamma)) for gamma in (0.1, 0.05)}
    errors = [abs(stress[:2, 0] - [gamma**2, gamma]).max() for gamma, stress in found.items()]
    assert errors[0] < 0.5 * 0.1**3
    assert errors[0] / errors[1] == pytest.approx(8.0, abs=0.3)


def winding(t):
    """A motion that shears and stretches along axes that wander, keeps the volume, and turns."""
    squeeze = 0.3 * np.sin(2 * t)
    return turn([1.0, 2.0, 0.5], 1.5 * t) @ shear(0.6 * t) @ np.diag([np.exp(squeeze), np.exp(-squeeze), 1.0])


def wound(form, steps, *, means=False, turning=0.0):
    """Stress and plastic strain at the end, with a further rotation in each step, which is taken back from them."""
    yield_stress = 200.0
    brick = Driven(form, form.Parameters(E=2e5, nu=0.3, rho=1.0, yield_stress=yield_stress), means=means)
    for t in np.linspace(0.0, 1.0, steps + 1)[1:]:
        rotation = turn([-1.0, 0.3, 0.8], turning * t)
        brick.go(rotation @ winding(t))
    return rotation.T @ brick.stress @ rotation / yield_stress, brick.alpha


@pytest.mark.parametrize("steps", [5, 10])
@pytest.mark.parametrize("means", [True, False])
def test_a_shear_that_flows_makes_no_pressure(steps, means):
    """Strains of two thirds, a thousand times that of first yield, at constant volume: any steps do.

    The pressure is that of the elastic strain by Truesdell's rate, |dev tau|^2 / (6 mu), and what else the two rates
    differ by is of the order of yield stress over modulus.
    """
    stress, alpha = wound(updated_lagrangian, steps, means=means)
    other, beta = wound(hencky_plasticity, steps, means=means)
    ratio = 200.0 / (2e5 / 2.6)  # of the yield stress and mu
    assert np.trace(stress) / 3 == pytest.approx(ratio / 9, rel=1e-2)
    assert abs(stress - other).max() < ratio
    assert alpha == pytest.approx(beta, rel=ratio)


@pytest.mark.parametrize("means", [True, False])
def test_a_rotation_within_steps_that_flow_turns_the_stress_alone(means):
    plain, alpha = wound(updated_lagrangian, 5, means=means)
    turned, beta = wound(updated_lagrangian, 5, means=means, turning=4.0)
    assert abs(turned - plain).max() < 1e-11
    assert beta == pytest.approx(alpha, rel=1e-12)


@pytest.mark.parametrize("steps", [1, 16])
def test_the_logarithmic_rate(steps):
    """An energy's: the same by any steps, up to a shear of eight; one rise and one fall, no oscillation."""
    for gamma, table in LOGARITHMIC.items():
        brick = elastic(hencky_plasticity, nu=0.3)
        for k in range(1, steps + 1):
            stress = brick.go(shear(gamma * k / steps))
        h, length = np.arcsinh(gamma / 2), np.sqrt(4 + gamma**2)
        found, exact = (stress[0, 1], stress[0, 0]), (4 * h / length, 2 * h * gamma / length)
        # the logarithm's error, as the form's docstring states it
        off = 4 * np.pi * np.tanh(h / 8) ** 9 / h
        assert found == pytest.approx(exact, rel=1.1 * off + 1e-12)
        assert found == pytest.approx(table, rel=1.1 * off + 1e-7)
        assert np.trace(stress) == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("rate", FORMS)
def test_no_rate_oscillates(rate):
    """Along the shear sigma_11 only grows, and sigma_12 keeps its sign."""
    brick = elastic(FORMS[rate])
    stresses = np.array([brick.go(shear(0.2 * k))[:2, :2] for k in range(1, 41)])
    assert (np.diff(stresses[:, 0, 0]) > 0).all()
    assert stresses[:, 0, 1].min() > 0
    # Jaumann's sin(gamma) would turn twice
    assert np.count_nonzero(np.diff(np.sign(np.diff(stresses[:, 0, 1])))) <= 1


@pytest.mark.parametrize("rate", FORMS)
def test_objectivity(rate):
    """Four cycles of a traction and a turn by 45 degrees: in turned axes what an unturned brick has."""
    turned, plain = yielding(FORMS[rate]), yielding(FORMS[rate])
    axis = [1.0, 2.0, -0.5]
    for k in range(4):
        rotation, stretch = turn(axis, np.pi / 4 * k), np.diag([1 + 0.004 * (k + 1), 1 - 0.001 * k, 1.0])
        pulled = turned.go(rotation @ stretch)
        expected = plain.go(stretch)
        before = turned.alpha
        assert before == pytest.approx(plain.alpha, abs=1e-13)
        assert before > 0.001
        assert np.allclose(rotation.T @ pulled @ rotation, expected, rtol=0, atol=1e-10 * 200)
        further = turn(axis, np.pi / 4 * (k + 1))
        after = turned.go(further @ stretch)
        assert turned.alpha == pytest.approx(before, abs=1e-14)
        assert np.allclose(further.T @ after @ further, expected, rtol=0, atol=1e-10 * 200)


@pytest.mark.parametrize("rate", FORMS)
def test_a_thousand_turns_of_thirty_degrees_keep_the_stress(rate):
    brick = yielding(FORMS[rate])
    stretch = np.diag([1.01, 1.0, 0.998])
    begin, alpha = brick.go(stretch), brick.alpha
    for k in range(1, 1001):
        brick.body.commit(brick.increment(turn([2.0, -1.0, 1.0], np.pi / 6 * k) @ stretch))
    rotation = turn([2.0, -1.0, 1.0], np.pi / 6 * 1000)
    assert abs(rotation.T @ brick.stress @ rotation - begin).max() < 1e-10 * np.linalg.norm(begin)
    assert brick.alpha == pytest.approx(alpha, abs=1e-12)


@pytest.mark.parametrize("degrees", [30, 90])
@pytest.mark.parametrize("rate", FORMS)
def test_a_thousand_revolutions_give_no_strain(rate, degrees):
    """Driven through a rigid rotation, large steps; relative to the modulus the stress is the strain."""
    brick = yielding(FORMS[rate])
    for k in range(1, 1000 * 360 // degrees + 1):
        brick.body.commit(brick.increment(turn([0.3, 1.0, 0.2], np.radians(degrees) * k)))
    assert abs(brick.stress).max() < 1e-10 * 2e5
    assert brick.alpha == 0.0
    assert abs(brick.body.force(np.zeros(24))).max() < 1e-10 * 2e5


def cycle_work(form, steps):
    """Work, J, of a closed cycle of shear and stretch, by the trapezoidal rule."""
    brick, work = elastic(form, nu=0.3), 0.0
    corners = [(0.0, 1.0), (0.8, 1.0), (0.8, 1.5), (0.0, 1.5), (0.0, 1.0)]
    zero = np.zeros(24)
    force = brick.body.force(zero)
    for begin, end in pairwise(corners):
        for k in range(1, steps + 1):
            gamma, stretch = np.array(begin) + (np.array(end) - begin) * k / steps
            increment = brick.increment(shear(gamma) @ np.diag([1.0, stretch, 1.0]))
            brick.body.commit(increment)
            last, force = force, brick.body.force(zero)
            work += increment @ (last + force) / 2
    return work, brick.body.energies()["elastic"]


def test_a_closed_elastic_cycle():
    """Without work by the logarithmic law, whose stress is an energy's; Truesdell's rate makes some."""
    (coarse, left), (fine, _) = (cycle_work(hencky_plasticity, steps) for steps in (20, 40))
    assert coarse / fine == pytest.approx(4.0, abs=0.2)
    assert abs(4 * fine - coarse) / 3 < 1e-4
    assert abs(left) < 1e-20
    # work of Truesdell's is no error of the rule: it does not fall with the step
    (coarse, _), (fine, _) = (cycle_work(updated_lagrangian, steps) for steps in (40, 80))
    assert abs(fine) > 0.05
    assert fine == pytest.approx(coarse, rel=0.2)
