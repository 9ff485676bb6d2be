"""Beams by finite elements and by discrete elements, whole and reduced: error against coordinates and run time.

First a cantilever of Euler and Bernoulli, whose frequencies are known: masses in the nodes, rigid pieces on the nodes,
Hencky's chain, and Hermite's finite element with its consistent mass, of the same stiffness. Then a boom of seven
beams, the frame of `docs/beams.md` with straight tips, on a hinge that is tilted by half a degree in 0.3 s: each
method's six lowest frequencies, and where a tip is within a second, against finite elements four times as fine. All
bodies step with the same method and the same step, so that errors are those of the bodies. Processor time is of the
stepping, the least of several runs taken in turn.

    ./run python benchmarks/beams.py [--quick]
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import SimpleNamespace

from mpi4py import MPI

import matplotlib.pyplot as plt
import numpy as np
import scipy.linalg
from benchmark import Report
from scipy.interpolate import PPoly

import flexmbd as fm
from flexmbd import meshes
from flexmbd.beams import DiscreteFrame, Lumping, discrete_body
from flexmbd.continuum import ContinuumModel, Interface
from flexmbd.forms import beam_timoshenko
from flexmbd.reduction import craig_bampton

POINTS = {
    "hitch": (0.0, 0.0, 1.0), "left": (0.0, 3.0, 1.0), "right": (0.0, -3.0, 1.0),
    "top": (0.0, 0.0, 1.6), "left tip": (-0.4, 6.0, 1.0), "right tip": (-0.4, -6.0, 1.0),
}  # fmt: skip
BEAMS = {
    "arms": [("hitch", "left"), ("hitch", "right")],
    "mast": [("hitch", "top")],
    "stays": [("top", "left"), ("top", "right")],
    "tips": [("left", "left tip"), ("right", "right tip")],
}
ARM = beam_timoshenko.Parameters.rectangle(2.1e11, 0.3, 7850.0, width=0.06, height=0.08, orientation=(1.0, 0.0, 0.0))
ROD = beam_timoshenko.Parameters.tube(
    2.1e11, 0.3, 7850.0, outer_radius=0.015, inner_radius=0.012, orientation=(1.0, 0.0, 0.0)
)
SECTIONS = {"arms": ARM, "mast": ARM, "stays": ROD, "tips": ROD}
HELD = ("hitch", "left tip", "right tip")
COUNT = 6  # frequencies
FINE = 8  # elements a beam, of what is reduced

ANGLE, RISE, END, H = np.deg2rad(0.5), 0.3, 1.0, 2e-3  # rad, s
RUNS = 5
MINUTES = 1.5
PEERS: tuple[str, ...] = ()

BETA = np.array([1.87510406871, 4.69409113297, 7.85475743824])
# the unit beam: mass, length and bending stiffness one, neither shear nor rotary inertia
UNIT = SimpleNamespace(
    E=1.0, nu=0.0, rho=1.0, A=1.0, Iy=1.0, Iz=1.0, Iyz=0.0, J=1.0, ky=np.inf, kz=np.inf, orientation=(0.0, 1.0, 0.0)
)
# as stiff, and with as much rotary inertia as next to none: for pieces, whose length has some by itself
THIN = SimpleNamespace(**{**vars(UNIT), "E": 1e8, "Iy": 1e-8, "Iz": 1e-8})


@dataclass(frozen=True)
class Row:
    """A body: its method and size, its worst frequency's error, its tip's, and microseconds a step."""

    method: str
    elements: int
    coordinates: int
    frequencies: float
    tip: float
    step: float


def cantilever(method: str, n: int) -> np.ndarray:
    """(3,) relative errors of the frequencies of the unit cantilever of n elements."""
    if method == "Hencky's chain":
        h = 1.0 / n
        k = (2.0 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)) / h
        k[0, 0], k[-1, -1] = 3.0 / h, 1.0 / h
        middles = h * (np.tril(np.ones((n, n)), -1) + np.eye(n) / 2.0)
        m = h * middles.T @ middles + h**3 / 12.0 * np.eye(n)
    else:
        points = method == "masses in the nodes"
        lumping = Lumping.POINTS if points else Lumping.PIECES
        ends = {"root": (0.0, 0.0, 0.0), "tip": (1.0, 0.0, 0.0)}
        section = UNIT if points else THIN
        frame = DiscreteFrame(
            ends, {"rod": [("root", "tip")]}, {"rod": section}, divisions=n, lumping=lumping, coordinates=("y", "rz")
        )
        if method != "consistent mass (finite elements)":
            body = discrete_body(frame, interfaces=["root"], frame="root")
            return np.sqrt(body.stiffness[:3]) / BETA**2 - 1.0
        rows = np.concatenate([6 * node + np.array([1, 5]) for node in [*range(2, n + 1), 1]])
        k, m = frame.K[np.ix_(rows, rows)], consistent_mass(n)[2:, 2:]
    return np.sqrt(scipy.linalg.eigh(k, m, eigvals_only=True)[:3]) / BETA**2 - 1.0


def consistent_mass(n: int) -> np.ndarray:
    """(2 n + 2, 2 n + 2) of Hermite's cubic elements of the unit beam, w and w' in turn from root to tip."""
    h = 1.0 / n
    one = (
        np.array([[156, 22 * h, 54, -13 * h], [22 * h, 4 * h**2, 13 * h, -3 * h**2],
                  [54, 13 * h, 156, -22 * h], [-13 * h, -3 * h**2, -22 * h, 4 * h**2]]) * h / 420.0
    )  # fmt: skip
    mass = np.zeros((2 * n + 2,) * 2)
    for e in range(n):
        mass[2 * e : 2 * e + 4, 2 * e : 2 * e + 4] += one
    return mass


CANTILEVERS = ("masses in the nodes", "Hencky's chain", "rigid pieces", "consistent mass (finite elements)")


def finite_elements(divisions: int, modes: int | None) -> fm.ReducedBody:
    """The boom on a mesh; without a number of modes all of them."""
    mesh = meshes.frame(POINTS, BEAMS, divisions=divisions, comm=MPI.COMM_SELF)
    pairs = {group: (beam_timoshenko, section) for group, section in SECTIONS.items()}
    model = ContinuumModel(mesh, pairs, degree=2, interfaces=[Interface(name) for name in HELD])
    every = model.n_owned - 6 * len(HELD)
    return craig_bampton(model, modes=every if modes is None else modes, frame="hitch", geometric_stiffness=False)


def discrete_elements(divisions: int, modes: int | None) -> fm.ReducedBody:
    """The boom of discrete elements."""
    frame = DiscreteFrame(POINTS, BEAMS, SECTIONS, divisions=divisions)
    return discrete_body(frame, interfaces=HELD, frame="hitch", modes=modes)


class Tilted:
    """The boom on a hinge that is tilted."""

    def __init__(self, body: fm.ReducedBody) -> None:
        self.scene = fm.System()
        boom = self.scene.add(fm.FlexibleBody(body), name="boom")
        hinge = self.scene.connect(fm.joint.Revolute("x"), self.scene.ground.frame(), boom.frame("hitch"))
        rise = ANGLE * np.array([6 / RISE**5, -15 / RISE**4, 10 / RISE**3, 0.0, 0.0, 0.0])
        rest = np.array([0.0, 0.0, 0.0, 0.0, 0.0, ANGLE])
        hinge.prescribe(PPoly(np.stack([rise, rest], axis=1), [0.0, RISE, 10.0]))
        self.tip = boom.frame("left tip")

    def run(self) -> np.ndarray:
        """(steps, 3) m, where the left tip goes."""
        run = self.scene.simulate(END, integrator=fm.GeneralizedAlpha(), h=H, rtol=1e-6)
        return np.asarray(run.position(self.tip))


def measured(cases: list[tuple[str, int, fm.ReducedBody]], reference: fm.ReducedBody) -> list[Row]:
    """All bodies beside the reference, timed in turn."""
    exact = reference.frequencies(["hitch"])[:COUNT]
    place = Tilted(reference).run()
    size = np.ptp(place[:, 2])
    machines = [Tilted(body) for *_, body in cases]
    spent = np.full(len(cases), np.inf)
    tips = [machine.run() for machine in machines]
    for _ in range(RUNS):
        for i, machine in enumerate(machines):
            began = time.thread_time()
            machine.run()
            spent[i] = min(spent[i], time.thread_time() - began)
    rows = []
    for (method, elements, body), at, seconds in zip(cases, tips, spent, strict=True):
        frequencies = abs(body.frequencies(["hitch"])[:COUNT] / exact - 1.0).max()
        off = float(np.linalg.norm(at - place, axis=1).max() / size)
        rows.append(Row(method, elements, body.n_modes, frequencies, off, 1e6 * seconds * H / END))
    return rows


METHODS = {
    "discrete elements": "C3o-", "discrete elements, Craig-Bampton": "C1s--",
    "finite elements": "C0o-", "finite elements, Craig-Bampton": "C9s--",
}  # fmt: skip


def cases(*, quick: bool) -> list[tuple[str, int, fm.ReducedBody]]:
    """Method, elements a beam, and body."""
    divisions, modes = ((1, 2), (0, 4)) if quick else ((1, 2, 3, 4, 6), (0, 2, 4, 8, 16, 32))
    return [
        *(("discrete elements", n, discrete_elements(n, None)) for n in divisions),
        *(("discrete elements, Craig-Bampton", FINE, discrete_elements(FINE, n)) for n in modes),
        *(("finite elements", n, finite_elements(n, None)) for n in divisions[:4]),
        *(("finite elements, Craig-Bampton", FINE, finite_elements(FINE, n)) for n in modes),
    ]


def draw(errors: dict[str, np.ndarray], numbers: np.ndarray, rows: list[Row], path: Path) -> None:
    """Three panels: the cantilever; the boom's frequencies by coordinates; its tip by run time."""
    figure, (first, second, third) = plt.subplots(1, 3, figsize=(14.0, 6.0), layout="constrained")
    for style, (method, found) in zip(("C3o-", "k.:", "C1s-", "C0^-"), errors.items(), strict=True):
        for mode, alpha in ((0, 1.0), (2, 0.4)):
            label = method if mode == 0 else None
            first.loglog(numbers, abs(found[:, mode]), style, alpha=alpha, label=label)
    first.set(xlabel="elements", ylabel="error of a frequency", title="cantilever, modes 1 and 3 (pale)")
    for method, style in METHODS.items():
        mine = [row for row in rows if row.method == method]
        second.loglog([r.coordinates for r in mine], [r.frequencies for r in mine], style, label=method)
        third.loglog([r.step for r in mine], [r.tip for r in mine], style, label=method)
    second.set(xlabel="coordinates", ylabel=f"worst error of {COUNT} frequencies", title="boom: frequencies")
    third.set(xlabel="microseconds a step", ylabel="error of the tip over its travel", title="boom: tilted in 0.3 s")
    for axes in (first, second, third):
        axes.grid(which="both", alpha=0.25)
        axes.legend(fontsize=10, frameon=False, loc="upper center", bbox_to_anchor=(0.5, -0.14))
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)
    plt.close(figure)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="a few small bodies: does it work?")
    report = Report(Path("out_beams"))
    report.folder.mkdir(exist_ok=True)
    (quick if parser.parse_args().quick else full)(report)


def quick(report: Report) -> None:
    """A few small bodies."""
    tell(report, np.array([4, 8, 16]), cases(quick=True), finite_elements(4, 60))


def full(report: Report) -> None:
    """All bodies."""
    tell(report, np.array([4, 8, 16, 32, 64]), cases(quick=False), finite_elements(4 * FINE, 60))


def tell(
    report: Report, numbers: np.ndarray, bodies: list[tuple[str, int, fm.ReducedBody]], reference: fm.ReducedBody
) -> None:
    """Tables of the cantilever by numbers of elements, and of the boom's bodies beside a reference; the picture."""
    errors = {method: np.array([cantilever(method, n) for n in numbers]) for method in CANTILEVERS}
    report.table("cantilever", "elements", "mode 1", "mode 2", "mode 3")
    for method, found in errors.items():
        for n, row in zip(numbers, found, strict=True):
            report.say(f"| {method} | {n} | " + " | ".join(f"{value:.3e}" for value in row) + " |")
    rows = measured(bodies, reference)
    report.say()
    report.table("boom", "elements a beam", "coordinates", "error of frequencies", "of the tip", "us a step")
    for row in rows:
        size = f"{row.elements} | {row.coordinates}"
        report.say(f"| {row.method} | {size} | {row.frequencies:.1e} | {row.tip:.1e} | {row.step:.0f} |")
    report.picture("beams.png", partial(draw, errors, numbers, rows))


if __name__ == "__main__":
    main()
