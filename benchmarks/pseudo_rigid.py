"""Many pseudo-rigid bodies: processor time per body and step against their number, and error against time.

    ./run python benchmarks/pseudo_rigid.py [--quick]

Boxes and ellipsoids of many sizes, deformed, spinning and vibrating freely, by `fm.PseudoRigidSwarm`; beside it the
same steps written with numpy over all bodies at once, and one body in a machine.  Least of several, processor time.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
from benchmark import Report

import flexmbd as fm
from flexmbd.multibody.swarm.pseudo_rigid_swarm import FloatArray

MATERIAL = fm.StVenantKirchhoff(E=1.0e5, nu=0.3)
REPEATS = 5
MINUTES = 3.0
PEERS: tuple[str, ...] = ()


def solids(n: int) -> list[fm.Solid]:
    """At most 1000 different ones, again and again."""
    sizes = np.random.default_rng(0).uniform(0.1, 0.3, (min(n, 1000), 3))
    makers = (fm.Solid.box, fm.Solid.ellipsoid)
    different = [makers[k % 2](size, density=1000.0) for k, size in enumerate(sizes)]
    return [different[k % len(different)] for k in range(n)]


def swarm(n: int) -> fm.PseudoRigidSwarm:
    """Bodies on their way."""
    rng = np.random.default_rng(1)
    many = fm.PseudoRigidSwarm(solids(n), MATERIAL, r=rng.normal(size=(n, 3)), gravity=(0.0, 0.0, -9.81))
    many.F = many.F + 0.05 * rng.normal(size=(n, 3, 3))
    many.F_rate = 3.0 * rng.normal(size=(n, 3, 3))
    return many


class Plain:
    """The same steps with numpy."""

    def __init__(self, many: fm.PseudoRigidSwarm, bodies: list[fm.Solid]) -> None:
        self.F, self.G = many.F.copy(), many.F_rate.copy()
        self.inverse = np.array([body.volume * np.linalg.inv(body.second) for body in bodies])

    def step(self, h: float, count: int) -> None:
        """Velocity Verlet."""
        self.G += 0.5 * h * self.acceleration()
        for k in range(count):
            self.F += h * self.G
            self.G += (h if k < count - 1 else 0.5 * h) * self.acceleration()

    def acceleration(self) -> FloatArray:
        """-dW/dF V J^-1."""
        lam, mu = MATERIAL.lame
        E = 0.5 * (self.F.transpose(0, 2, 1) @ self.F - np.eye(3))
        S = lam * np.trace(E, axis1=1, axis2=2)[:, None, None] * np.eye(3) + 2.0 * mu * E
        return np.asarray(-self.F @ S @ self.inverse)


def least(work: Callable[[], None]) -> float:
    """Processor time (s) of the quickest of several."""
    times = []
    for _ in range(REPEATS):
        begun = time.thread_time()
        work()
        times.append(time.thread_time() - begun)
    return min(times)


def time_per_body(report: Report, numbers: list[int]) -> None:
    """A table."""
    each = "ns per body and step, 100 steps a call"
    report.table("bodies", each, "1 step a call", "numpy", "ratio", "energy's error")
    for n in numbers:
        many = swarm(n)
        h, energy = 0.1 * many.stable_step(), many.energy().total.sum()
        plain = Plain(many, solids(n))
        many.step(h, 100)
        plain.step(h, 100)
        off = abs(many.F - plain.F).max()
        if off > 1e-9:
            raise SystemExit(f"numpy's bodies went elsewhere, by {off:.1e}")
        error = many.energy().total.sum() / energy - 1.0
        long = least(partial(many.step, h, 100)) / n / 100
        single = least(partial(many.step, h)) / n
        count = max(1, min(100, 20_000 // n))
        slow = least(partial(plain.step, h, count)) / n / count
        times = f"{long * 1e9:.1f} | {single * 1e9:.0f} | {slow * 1e9:.0f} | {slow / long:.0f}"
        report.say(f"| {n} | {times} | {error:.1e} |")


def error_over_time(report: Report) -> None:
    """One body: the swarm's method beside error-controlled integration of the machine."""
    solid, U = fm.Solid.box((0.3, 0.1, 0.2), density=1000.0), np.diag([1.1, 0.95, 1.0])
    spin, t_end = np.array([3.0, -2.0, 5.0]), 0.2

    def machine(rtol: float) -> tuple[FloatArray, float]:
        scene = fm.System()
        body = scene.add(fm.PseudoRigidBody(solid, MATERIAL, stretch=U))
        joint = scene.connect(fm.joint.Free(), scene.ground.frame(), body.frame())
        joint.velocity = np.array([0.0, 0.0, 0.0, *spin])
        eight = fm.ExplicitRungeKutta(fm.Pair.DORMAND_PRINCE_8)
        scene.simulate(1e-3, rtol=rtol, integrator=eight)
        run = scene.simulate(t_end, rtol=rtol, integrator=eight)
        return run.deformation_gradient(body)[-1], run.stats.seconds

    exact, _ = machine(1e-13)
    report.say()
    report.table("one body for 0.2 s", "error of F", "ms")
    for rtol in (1e-4, 1e-6, 1e-8):
        found, seconds = machine(rtol)
        report.say(f"| machine, order 8, rtol {rtol:g} | {abs(found - exact).max():.1e} | {seconds * 1e3:.2f} |")
    for count in (200, 2000, 20000):
        best = np.inf
        for _ in range(REPEATS):
            many = fm.PseudoRigidSwarm([solid], MATERIAL, r=np.zeros((1, 3)))
            many.F, many.F_rate = U[None], np.cross(spin, U.T).T[None]
            begun = time.thread_time()
            many.step(t_end / count, count)
            best = min(best, time.thread_time() - begun)
        report.say(f"| swarm of one, {count} steps | {abs(many.F[0] - exact).max():.1e} | {best * 1e3:.2f} |")


def quick(report: Report) -> None:
    """No more than 1000 bodies."""
    time_per_body(report, [10, 100, 1000])
    error_over_time(report)


def full(report: Report) -> None:
    """To a million bodies."""
    time_per_body(report, [10, 100, 1000, 10_000, 100_000, 1_000_000])
    error_over_time(report)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="no more than 1000 bodies")
    (quick if parser.parse_args().quick else full)(Report(Path("out_pseudo_rigid")))
