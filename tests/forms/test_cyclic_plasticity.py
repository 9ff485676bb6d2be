"""Uniaxial and other simple paths of the forms that yield, on one brick, against closed forms of the return."""

import numpy as np
import pytest
from driven import Driven
from scipy.optimize import brentq

from flexmbd.forms import hencky_plasticity, j2_plasticity, updated_lagrangian
from flexmbd.forms.j2_plasticity import LinearHardening, TabulatedHardening, VoceHardening

E, NU, YIELD = 200e3, 0.3, 250.0
LEGS = (0.01, -0.01, 0.01, -0.01)

# Stress at the ends of the legs and accumulated plastic strain, by the isotropic and the kinematic modulus.
CYCLES = {
    (0, 0): ((250, -250, 250, -250), (0.00875, 0.02625, 0.04375, 0.06125)),
    (2000, 0): (
        (267.326732673, -301.637094403, 335.268043028, -368.233032275),
        (0.008663366, 0.025818547, 0.042634022, 0.059116516),
    ),
    (0, 2000): (
        (267.326732673, -267.326732673, 267.326732673, -267.326732673),
        (0.008663366, 0.025990099, 0.043316832, 0.060643564),
    ),
    (1000, 1000): (
        (267.326732673, -284.481913538, 301.467241127, -318.284397155),
        (0.008663366, 0.025904323, 0.042974577, 0.059875819),
    ),
}


def cycle(isotropic, kinematic):
    """Stress and accumulated plastic strain at the ends of the legs: the return along one axis."""
    plastic = alpha = back = 0.0
    for strain in LEGS:
        trial = E * (strain - plastic)
        over = abs(trial - back) - YIELD - isotropic * alpha
        growth = max(over, 0.0) / (E + isotropic + kinematic)
        direction = np.sign(trial - back)
        plastic, alpha, back = plastic + growth * direction, alpha + growth, back + kinematic * growth * direction
        yield E * (strain - plastic), alpha


@pytest.mark.parametrize("moduli", CYCLES)
def test_a_cycle_of_small_strain(moduli):
    """To round-off with one step a leg, and as the table says; the strains across are the body's own solution."""
    isotropic, kinematic = moduli
    parameters = j2_plasticity.Parameters(
        E=E, nu=NU, rho=1.0, yield_stress=YIELD, hardening=LinearHardening(isotropic), kinematic_modulus=kinematic
    )
    brick = Driven(j2_plasticity, parameters)
    for strain, exact, *table in zip(LEGS, cycle(*moduli), *CYCLES[moduli], strict=True):
        stress = brick.go(brick.pull(1 + strain))
        assert (stress[0, 0], brick.alpha) == pytest.approx(exact, rel=1e-12)
        assert (stress[0, 0], brick.alpha) == pytest.approx(tuple(table), rel=1e-7)
        assert abs(stress - np.diag([stress[0, 0], 0, 0])).max() < 1e-9


@pytest.mark.parametrize("isotropic", [0, 2000])
def test_a_cycle_of_logarithmic_strain(isotropic):
    """In Kirchhoff stress and logarithmic strain the same figures."""
    law = LinearHardening(isotropic)
    parameters = hencky_plasticity.Parameters(E=E, nu=NU, rho=1.0, yield_stress=YIELD, hardening=law)
    brick = Driven(hencky_plasticity, parameters)
    for strain, exact in zip(LEGS, cycle(isotropic, 0), strict=True):
        stretch = brick.pull(np.exp(strain))
        stress = np.linalg.det(stretch) * brick.go(stretch)
        assert (stress[0, 0], brick.alpha) == pytest.approx(exact, rel=1e-11)
        assert abs(stress - np.diag([stress[0, 0], 0, 0])).max() < 1e-9


def test_a_pull_of_truesdells_rate():
    """Perfectly plastic: the Cauchy stress stands at the yield stress, whatever the step."""
    parameters = updated_lagrangian.Parameters(E=E, nu=NU, rho=1.0, yield_stress=YIELD)
    brick = Driven(updated_lagrangian, parameters)
    for strain in (0.01, 0.02, 0.1, -0.01):
        stress = brick.go(brick.pull(1 + strain))
        assert np.allclose(stress, np.diag([np.copysign(YIELD, strain), 0, 0]), rtol=0, atol=1e-9)


CURVES = {
    "Voce": (VoceHardening(120.0, 35.0, 400.0), lambda a: 120.0 * (1 - np.exp(-35.0 * a)) + 400.0 * a),
    "Table": (
        TabulatedHardening((0.0, 0.01, 0.03, 0.1), (YIELD, 300.0, 330.0, 340.0)),
        lambda a: np.interp(a, [0.0, 0.01, 0.03, 0.1], [0.0, 50.0, 80.0, 90.0]),
    ),
}


def consistency(z, trial, alpha, growth):
    return 3 * E / (2 * (1 + NU)) * z + YIELD + growth(alpha + z) - trial


@pytest.mark.parametrize("law", CURVES)
@pytest.mark.parametrize("form", [j2_plasticity, hencky_plasticity], ids=lambda form: form.__name__.split(".")[-1])
def test_curved_hardening_against_the_root_of_a_scalar(form, law):
    """A stretch at constant volume, forth and back; past the table's end as well."""
    hardening, growth = CURVES[law]
    parameters = form.Parameters(E=E, nu=NU, rho=1.0, yield_stress=YIELD, hardening=hardening)
    brick = Driven(form, parameters)
    large = form is hencky_plasticity
    mu, alpha, plastic, off = E / (2 * (1 + NU)), 0.0, 0.0, 1e-13
    for strain in (0.001, 0.004, 0.02, 0.021, 0.08, 0.07, -0.03, 0.15):
        across = -strain / 2
        stretch = np.exp([strain, across, across]) if large else 1 + np.array([strain, across, across])
        stress = brick.go(np.diag(stretch))
        trial = 3 * mu * (strain - plastic)
        over = abs(trial) - YIELD - growth(alpha)
        z = 0.0
        if over > 0:
            z = brentq(consistency, 0.0, 1.0, args=(abs(trial), alpha, growth), xtol=1e-16)
        plastic, alpha = plastic + np.sign(trial) * z, alpha + z
        # what the exponential of the plastic step is off by, in its own formula of Pade
        off += (2 * z) ** 7 / 100800 if large else 0.0
        assert brick.alpha == pytest.approx(alpha, abs=off)
        assert stress[0, 0] - stress[1, 1] == pytest.approx(3 * mu * (strain - plastic), rel=1e-11, abs=3 * mu * off)
        assert np.trace(stress) == pytest.approx(0.0, abs=1e-8)


@pytest.mark.parametrize("kinematic", [0.0, 1500.0])
def test_elastic_and_plastic_energy_are_the_work_of_small_strain(kinematic):
    parameters = j2_plasticity.Parameters(
        E=E, nu=NU, rho=1.0, yield_stress=YIELD, hardening=LinearHardening(2000.0), kinematic_modulus=kinematic
    )
    account(Driven(j2_plasticity, parameters), lambda strain: 1 + strain)


def test_elastic_and_plastic_energy_are_the_work_of_logarithmic_strain():
    law = LinearHardening(2000.0)
    parameters = hencky_plasticity.Parameters(E=E, nu=NU, rho=1.0, yield_stress=YIELD, hardening=law)
    account(Driven(hencky_plasticity, parameters), np.exp)


def account(brick, stretch_of):
    """On pulls whose steps end where yield begins, one step is exact however long: so its work is."""
    p = brick.body.groups[0].parameters
    work, here = 0.0, 0.0
    for strain in LEGS[:3]:
        held = YIELD + 2000.0 * (brick.alpha if here else 0.0)
        axial = kirchhoff(brick)
        kinematic = getattr(p, "kinematic_modulus", 0.0)
        back = kinematic * (here - axial / E)
        yields = here + (np.sign(strain - here) * held + back - axial) / E
        for end in (yields, strain):
            work += brick.work(stretch_of(here), stretch_of(end))
            brick.go(brick.pull(stretch_of(end)))
            here = end
            energies = brick.body.energies()
            assert energies["elastic"] + energies["plastic"] == pytest.approx(work, rel=1e-9)
    assert energies["plastic"] > 5 * energies["elastic"] > 0


def kirchhoff(brick):
    """Axial Kirchhoff stress (that of Cauchy at small strain)."""
    volume = 1.0
    if brick.body.is_updated:
        x = brick.body.node_x
        volume = np.prod(np.ptp(x, axis=0))
    return volume * brick.stress[0, 0]
