"""Parallel cranks through flat positions, where the loops lose rank and other motions branch off.

So do, of a plate on three cranks, the rows that are kept, though all of them together never do.  The reference is the
pendulum that all cranks together are, by scipy: I angle'' = - g lever cos(angle).  The reactions of each stored instant
are compared with the laws of Newton and Euler of every body.
"""

from __future__ import annotations

from mpi4py import MPI

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import flexmbd as fm
from flexmbd.continuum import MpiTeam
from flexmbd.multibody.start.independent_rows import RowDecomposition

G = 9.81
T_END = 2.0
#: How each goes, and by how much it may be off per radian that the cranks turn.
WAYS = {
    "radau-4": ({"integrator": fm.RadauIIA(), "rtol": 1e-4}, 1e-3),
    "radau-6": ({"integrator": fm.RadauIIA(), "rtol": 1e-6}, 1e-5),
    "radau-8": ({"integrator": fm.RadauIIA(), "rtol": 1e-8}, 1e-7),
    "radau-fixed": ({"integrator": fm.RadauIIA(), "h": 5e-3}, 1e-8),
    "alpha": ({"integrator": fm.GeneralizedAlpha(), "h": 2e-3}, 1e-4),
    "alpha-3": ({"integrator": fm.GeneralizedAlpha(index=3), "h": 2e-3}, 1e-4),
    "alpha-5": ({"integrator": fm.GeneralizedAlpha(), "rtol": 1e-5}, 1e-4),
    "central": ({"integrator": fm.CentralDifference(), "h": 1e-3}, 1e-4),
    "energy-momentum": ({"integrator": fm.EnergyMomentum(), "h": 2e-3}, 1e-4),
    "explicit": ({"integrator": fm.ExplicitRungeKutta(), "rtol": 1e-6}, 1e-5),
}


def machine(n, seed, *, plate=False, **system):
    """n equal cranks under a rod or a plate, of random sizes, turning over from a random angle; inertia and lever."""
    rng = np.random.default_rng(seed)
    length, base = rng.uniform(0.3, 1.5), rng.uniform(0.5, 2.0)
    masses = rng.uniform(0.2, 3.0, n + 1)
    angle, rate = rng.uniform([0.3, 2.0], [2.8, 4.0]) * rng.choice([-1, 1], 2) * [1.0, np.sqrt(G / length)]
    scene = fm.System(gravity=(0.0, -G, 0.0), **system)
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
    turn_over(WAYS[way], *machine(n, seed))


@pytest.mark.parametrize("way", sorted(WAYS))
@pytest.mark.parametrize("seed", range(4))
def test_kept_rows_lose_rank_and_others_take_over(way, seed):
    """All rows together hold the plate as firmly as ever, so that no reaction is out of proportion."""
    run = turn_over(WAYS[way], *machine(3, seed, plate=True))
    weight = np.linalg.norm(forces_of_inertia(run), axis=1).max()
    assert np.abs(run.multipliers).max() < 10.0 * weight


def test_a_sharp_run_passes_where_kept_rows_lose_rank():
    turn_over(({"integrator": fm.GeneralizedAlpha(), "rtol": 1e-7}, 1e-5), *machine(3, 3, plate=True))


@pytest.mark.parametrize("seed", [10, 12])
def test_a_sharp_run_passes_where_all_rows_lose_rank(seed):
    turn_over(({"integrator": fm.GeneralizedAlpha(), "rtol": 1e-8}, 1e-6), *machine(2, seed), t_end=0.12)


@pytest.mark.parametrize("method", [fm.RadauIIA(), fm.GeneralizedAlpha(), fm.ExplicitRungeKutta(), fm.EnergyMomentum()])
def test_a_restart_keeps_the_rows_chosen_last(method, tmp_path):
    """To the bit, from a checkpoint at which other rows are kept than at the start."""
    scene = machine(3, 2, plate=True)[0]
    places = [0.25, 0.5, 0.75, 1.0, 1.25]
    how = {"integrator": method, "h": 2.0**-9}
    whole = scene.simulate(T_END, checkpoints=places, **how)
    begun = scene.start().choice.rows
    changed = [c for c in whole.checkpoints if list(c.snapshot.rows) != begun]
    assert changed
    kept = fm.Checkpoint.load(changed[0].save(tmp_path / "kept.npz"))
    places = [place for place in places if place > kept.t]
    rest = machine(3, 2, plate=True)[0].simulate(T_END, restart=kept, checkpoints=places, **how)
    same = whole.t > kept.t
    for name in ("t", "x", "v", "a", "multipliers"):
        np.testing.assert_array_equal(getattr(rest, name)[1:], getattr(whole, name)[same])


@pytest.mark.mpi
def test_ranks_choose_rows_together():
    how = {"integrator": fm.GeneralizedAlpha(), "h": 2e-3}
    together = machine(3, 2, plate=True, team=MpiTeam(MPI.COMM_WORLD))[0].simulate(1.0, **how)
    alone = machine(3, 2, plate=True)[0].simulate(1.0, **how)
    np.testing.assert_array_equal(together.x, alone.x)
    np.testing.assert_array_equal(together.multipliers, alone.multipliers)


def test_rows_are_watched_where_the_best_ones_change_alone():
    """In a plane machine of joints in space it is always the same rows that add nothing."""
    assert not machine(3, 0, plate=True)[0].start().choice.for_good
    rod = machine(3, 0)[0].start()
    assert rod.scene.redundant
    assert rod.choice.for_good


@pytest.mark.parametrize("angle", [0.3, 1.0, 2.5])
def test_firmness_of_rows(angle):
    """Of rows (1, 0), (cos, sin) and (0, 1): the last two hold as cos^2/2 says, by hand."""
    rows = np.array([[1.0, 0.0], [np.cos(angle), np.sin(angle)], [0.0, 1.0]])
    left, sigma, _ = np.linalg.svd(rows)
    driven, holds = np.zeros((3, 0)), np.ones(3, bool)
    place = RowDecomposition(rows, driven, holds, left, np.append(sigma, 0.0), 1e-12)
    # U = C (C^T C)^-1/2 V, C^T C = 1 + n n^T of eigenvalues 2 along n and 1 across
    half = np.eye(2) + (1 / np.sqrt(2.0) - 1.0) * np.outer(rows[1], rows[1])
    assert place.conditioning([0, 2]) == pytest.approx(np.linalg.svd(half)[1][-1], rel=1e-12)
    assert place.conditioning([0, 2]) == pytest.approx(np.sqrt(0.5), rel=1e-12)
    assert place.conditioning(place.best_conditioned(2)) >= place.conditioning([0, 2]) - 1e-12


def forces_of_inertia(run):
    """(nt, bodies) sizes of mass times acceleration against gravity."""
    bodies = [body for name, body in run.bodies.items() if name != "ground"]
    parts = [body.mass * (run.acceleration(body.frame(body.com)) + np.array([0.0, G, 0.0])) for body in bodies]
    return np.linalg.norm(parts, axis=2).T


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


def turn_over(way, scene, feet, inertia, lever, t_end=T_END):
    """Run one of the ways, compare with the pendulum, and every body's forces with Newton's and Euler's laws."""
    options, tolerance = way
    run = scene.simulate(t_end, **options)
    assert imbalance(run).max() < 0.1 * tolerance
    pull = -G * lever / inertia
    start = [run.beta(feet[0])[0], run.beta_rate(feet[0])[0]]
    exact = solve_ivp(
        lambda t, y: [y[1], pull * np.cos(y[0])], (0.0, t_end), start, "DOP853", t_eval=run.t, rtol=1e-12, atol=1e-12
    ).y[0]
    passed = np.count_nonzero(np.diff(np.floor(exact / np.pi)))
    assert passed > 0
    for foot in feet:
        np.testing.assert_allclose(run.beta(foot), exact, rtol=0.0, atol=tolerance * np.ptp(exact))
    # what little the loops still hold beside a flat position tells accelerations in proportion
    fallen = -G * lever / inertia * np.cos(run.beta(feet[0]))
    error = np.abs(run.a[:, run.scene.index.joints[feet[0]].v][:, 0] - fallen) * np.abs(np.sin(run.beta(feet[0])))
    assert error.max() < 10.0 * max(tolerance, 1e-6) * abs(pull)
    return run
