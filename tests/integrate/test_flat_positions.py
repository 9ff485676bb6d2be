"""Parallel cranks through flat positions, where the loops lose rank and other motions branch off.

So do, of a plate on three cranks, the rows that are kept, though all of them together never do.  The reference is the
pendulum that all cranks together are, by scipy: I angle'' = - g lever cos(angle).
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import flexmbd as fm

G = 9.81
T_END = 2.0
#: How each goes, and by how much it may be off per radian that the cranks turn.
WAYS = {
    "radau-4": ({"integrator": fm.RadauIIA(), "rtol": 1e-4}, 1e-3),
    "radau-6": ({"integrator": fm.RadauIIA(), "rtol": 1e-6}, 1e-5),
    "radau-8": ({"integrator": fm.RadauIIA(), "rtol": 1e-8}, 1e-7),
    "radau-fixed": ({"integrator": fm.RadauIIA(), "h": 5e-3}, 1e-7),
    "alpha": ({"integrator": fm.GeneralizedAlpha(), "h": 2e-3}, 1e-4),
    "energy-momentum": ({"integrator": fm.EnergyMomentum(), "h": 2e-3}, 1e-4),
    "explicit": ({"integrator": fm.ExplicitRungeKutta(), "rtol": 1e-6}, 1e-5),
}


def machine(n, seed, *, plate=False):
    """n equal cranks under a rod or a plate, of random sizes, turning over from a random angle; inertia and lever."""
    rng = np.random.default_rng(seed)
    length, base = rng.uniform(0.3, 1.5), rng.uniform(0.5, 2.0)
    masses = rng.uniform(0.2, 3.0, n + 1)
    angle, rate = rng.uniform([0.3, 2.0], [2.8, 4.0]) * rng.choice([-1, 1], 2) * [1.0, np.sqrt(G / length)]
    scene = fm.System(gravity=(0.0, -G, 0.0))
    turn = fm.joint.Revolute("z")
    places = base * np.column_stack([np.arange(n), np.zeros((n, 2))])
    if plate:
        places[1:, :2] += 0.5 * base * rng.standard_normal((n - 1, 2))
    whole = masses[n] * (n - 1) ** 2 * base**2
    rod = scene.add(fm.RigidBody(masses[n], (whole, whole, whole), com=tuple(places.mean(axis=0))), name="rod")
    feet = []
    for k in range(n):
        inertia = masses[k] * length**2 / 12
        body = fm.RigidBody(masses[k], (1e-3, inertia, inertia), com=(length / 2, 0, 0))
        crank = scene.add(body, name=f"crank {k}")
        foot = scene.connect(turn, scene.ground.frame(places[k]), crank.frame(), name=f"foot {k}")
        foot.position, foot.velocity = angle, rate
        pin = scene.connect(turn, crank.frame((length, 0, 0)), rod.frame(places[k]), name=f"pin {k}")
        if k == 0:
            pin.position, pin.velocity = -angle, -rate
        feet.append(foot)
    inertia = masses[:n].sum() * length**2 / 3 + masses[n] * length**2
    return scene, feet, inertia, (masses[:n].sum() / 2 + masses[n]) * length


@pytest.mark.parametrize("way", sorted(WAYS))
@pytest.mark.parametrize(("n", "seed"), [*((2, seed) for seed in range(6)), (3, 6), (4, 7)])
def test_cranks_pass_flat_positions_in_parallel(way, n, seed):
    turn_over(way, *machine(n, seed))


@pytest.mark.parametrize("way", sorted(WAYS))
@pytest.mark.parametrize("seed", range(4))
def test_kept_rows_lose_rank_and_get_it_back(way, seed):
    turn_over(way, *machine(3, seed, plate=True))


def turn_over(way, scene, feet, inertia, lever):
    """Run one of the ways and compare with the pendulum."""
    options, tolerance = WAYS[way]
    run = scene.simulate(T_END, **options)
    pull = -G * lever / inertia
    start = [run.beta(feet[0])[0], run.beta_rate(feet[0])[0]]
    exact = solve_ivp(
        lambda t, y: [y[1], pull * np.cos(y[0])], (0.0, T_END), start, "DOP853", t_eval=run.t, rtol=1e-12, atol=1e-12
    ).y[0]
    passed = np.count_nonzero(np.diff(np.floor(exact / np.pi)))
    assert passed > 0
    for foot in feet:
        np.testing.assert_allclose(run.beta(foot), exact, rtol=0.0, atol=tolerance * np.ptp(exact))
