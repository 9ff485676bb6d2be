"""Parallel cranks through flat positions, where the loops lose rank and other motions branch off.

So do, of a plate on three cranks, the rows that are kept, though all of them together never do.  The reference is the
pendulum that all cranks together are, by scipy: I angle'' = - g lever cos(angle).  The reactions of each stored instant
are compared with the laws of Newton and Euler of every body.
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


def imbalance(run):
    """(nt,) largest sum of forces and of moments on a body, inertia included, over weight and inertia of the machine.

    And the largest moment that a joint passes on about its axis, where nothing drives it.  Moments about the z axis
    through the centre of mass, over the largest distance of two centres.
    """
    bodies = {name: body for name, body in run.bodies.items() if name != "ground"}
    places, forces, moments, weight = {}, {}, {}, np.zeros(len(run.t))
    for name, body in bodies.items():
        com = np.array(body.com)
        a, beside = (run.acceleration(body.frame(tuple(com + step))) for step in (np.zeros(3), [1.0, 0.0, 0.0]))
        arm = run.rotation(body.frame())[:, :, 0]
        places[name] = run.position(body.frame(tuple(com)))
        forces[name] = body.mass * ([0.0, -G, 0.0] - a)
        moments[name] = -body.inertia[2] * np.cross(arm, beside - a)[:, 2]
        weight += body.mass * (G + np.linalg.norm(a, axis=1))
    size = max(np.linalg.norm(p - q, axis=1).max() for p in places.values() for q in places.values())
    topology, driving = run.scene.topology, []
    for joint in [*(branch.connection for branch in topology.branches), *topology.closures]:
        turn, wrench = run.rotation(joint.child), run.reaction(joint)
        force, moment = (np.einsum("tij,tj->ti", turn, part) for part in (wrench[:, :3], wrench[:, 3:]))
        driving.append(np.abs(moment[:, 2]) / size)
        for frame, sign in ((joint.child, 1.0), (joint.parent, -1.0)):
            name = frame.body.name
            if name in bodies:
                arm = run.position(joint.child) - places[name]
                forces[name] = forces[name] + sign * force
                moments[name] = moments[name] + sign * (moment + np.cross(arm, force))[:, 2]
    parts = [np.linalg.norm(force, axis=1) for force in forces.values()]
    parts += [np.abs(moment) / size for moment in moments.values()]
    return np.max(parts + driving, axis=0) / weight


def turn_over(way, scene, feet, inertia, lever):
    """Run one of the ways, compare with the pendulum, and every body's forces with Newton's and Euler's laws."""
    options, tolerance = WAYS[way]
    run = scene.simulate(T_END, **options)
    if way != "alpha":
        assert imbalance(run).max() < 1e-8
    pull = -G * lever / inertia
    start = [run.beta(feet[0])[0], run.beta_rate(feet[0])[0]]
    exact = solve_ivp(
        lambda t, y: [y[1], pull * np.cos(y[0])], (0.0, T_END), start, "DOP853", t_eval=run.t, rtol=1e-12, atol=1e-12
    ).y[0]
    passed = np.count_nonzero(np.diff(np.floor(exact / np.pi)))
    assert passed > 0
    for foot in feet:
        np.testing.assert_allclose(run.beta(foot), exact, rtol=0.0, atol=tolerance * np.ptp(exact))
