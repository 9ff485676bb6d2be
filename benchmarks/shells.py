"""Thin walls: error over unknowns and processor time, by solid-shells, by bricks, and by shells of Kratos and CalculiX.

Scordelis-Lo roof, pinched cylinder and pinched hemisphere, linear, and the hemisphere under half the load of Sze, Liu
& Lo (2004), on n x n cells, one through the thickness: `solid_shell`; `solid_enhanced`, whose incompatible modes bend;
quadratic bricks (`solid_linear`, far `st_venant_kirchhoff`); Kratos' thin shell of four nodes; CalculiX's S8R of eight
(shells_calculix.py), where it is not installed by its errors as kept here. Errors are of the displacement that the
literature gives. Times are of processor time of one thread: matrix, factor, solution; of CalculiX the whole program;
far, of the whole path.

    bash benchmarks/install_peers.sh            # once: Kratos, CalculiX
    ./run python -m benchmarks shells [--quick]
    ./run python benchmarks/shells.py [--short]
"""

from __future__ import annotations

import argparse
import os
import time
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

os.environ.setdefault("OMP_NUM_THREADS", "1")

from mpi4py import MPI

import numpy as np
from benchmark import Report
from peer_process import peer_task
from shells_problems import FAR, LINEAR, Problem

import flexmbd as fm
from flexmbd import meshes
from flexmbd.continuum import NonlinearModel, equilibrium_path
from flexmbd.continuum.history.displacement_newton import Newton
from flexmbd.errors import FlexmbdError, LockingWarning
from flexmbd.forms import solid_enhanced, solid_linear, solid_shell, st_venant_kirchhoff

MINUTES = 6.0
PEERS: tuple[str, ...] = ()  # programs of their own environments
ROUNDS = 3
OURS: dict[str, tuple[ModuleType, int]] = {
    "solid_shell": (solid_shell, 1), "solid_enhanced": (solid_enhanced, 1), "quadratic bricks": (solid_linear, 2)
}  # fmt: skip

KRATOS, CALCULIX = "Kratos, thin shell", "CalculiX, S8R"
#: Unknowns and errors by CalculiX 2.20 (Debian 12) on n x n cells.
KEPT: dict[str, dict[int, tuple[int, float]]] = {
    "Scordelis-Lo roof": {4: (376, 0.00547), 8: (1424, 0.00275), 16: (5536, 0.00267), 32: (21824, 0.00267)},
    "pinched cylinder": {4: (356, -0.1317), 8: (1384, -0.02958), 16: (5456, -0.00031), 32: (21664, 0.00819)},
    "pinched hemisphere": {4: (418, -0.22359), 8: (1506, -0.00942), 16: (5698, -0.00348), 32: (22146, -0.00306)},
}


@dataclass(frozen=True)
class Found:
    """What a program found: s, unknowns, m; seconds of each round, none where it was not run."""

    seconds: list[float]
    unknowns: float
    moved: float


class Bricks:
    """A problem by bricks: the body, dofs (points, nodes through the thickness, 3), what is held, forces."""

    def __init__(self, problem: Problem, form: ModuleType, degree: int, n: int) -> None:
        points, cells, number = problem.grid(n)
        basix = cells[:, [0, 1, 3, 2]]
        surface = meshes.from_arrays(
            MPI.COMM_SELF, points, basix, cell="quadrilateral", degree=1, facet_groups={}
        )
        mesh = meshes.wall(surface, problem.thickness, normals=problem.normals)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", LockingWarning)  # that they lock is what is measured
            self.body = NonlinearModel(
                mesh, form, form.Parameters(E=problem.E, nu=problem.nu, rho=1.0), degree=degree, cell_means=False
            )
        x, self.dofs = self.body.layout.node_x, self.body.layout.displacement_dofs
        normal = problem.normals(points.T).T
        normal = normal / np.linalg.norm(normal, axis=1)[:, None]
        self.held = np.unique(
            np.concatenate([
                # a point that is held may turn: by its node below alone
                self._through(x, nodes, points, normal, problem.thickness, below=len(nodes) == 1)[
                    :, ["xyz".index(a) for a in axes]
                ].ravel()
                for nodes, axes, _ in problem.sides(number)
                if axes
            ])
        ).astype(np.int32)
        loads = problem.loads(points, cells, number)
        self.force = np.zeros(self.body.n_owned)
        if any(problem.weight):  # per volume, so that quadratic nodes have their shares
            one, found = (mass := self.body.mass()).createVecs()
            one.array[self.dofs] = np.asarray(problem.weight) / problem.thickness
            mass.mult(one, found)
            self.force += found.array
            loads = np.zeros_like(loads)
        for k in np.flatnonzero(loads.any(axis=1)):
            dofs = self._through(x, np.array([k]), points, normal, problem.thickness)
            self.force[dofs] += loads[k] / len(dofs)
        self._watched = self._through(x, np.array([problem.at(number)]), points, normal, problem.thickness)
        self._along = np.asarray(problem.watched[1])

    def _through(
        self, x: np.ndarray, nodes: np.ndarray, points: np.ndarray, normal: np.ndarray, thickness: float,
        *, below: bool = False,
    ) -> np.ndarray:  # fmt: skip
        """(k, 3) Dofs of what lies on the line of the points, or on a point's normal, through the thickness."""
        line = points[nodes]
        # nodes in the middle of edges of quadratic cells too
        ends = np.concatenate([line, 0.5 * (line[1:] + line[:-1])])
        across = np.concatenate([normal[nodes], 0.5 * (normal[nodes][1:] + normal[nodes][:-1])])
        found = []
        for share in (-0.5,) if below else (-0.5, 0.0, 0.5):
            place = ends + share * thickness * across
            apart = np.linalg.norm(x[:, None] - place[None], axis=2)
            found.append(np.flatnonzero(apart.min(axis=1) < 1e-3 * thickness))
        return np.asarray(self.dofs[np.unique(np.concatenate(found))])

    @property
    def unknowns(self) -> float:
        """Of the body."""
        return float(self.body.n_owned)

    def moved(self, u: np.ndarray) -> float:
        """m, of the watched point."""
        return float((u[self._watched] @ self._along).mean())

    def linear(self) -> Found:
        """Matrix, factor, solution."""
        still, seconds = np.zeros(self.body.layout.n_local), []
        for _ in range(1 + ROUNDS):  # the first one compiles
            begin = time.process_time()
            newton = Newton(self.body, self.held)
            u = newton.solve_columns(self.body.tangent(still), self.force[:, None])[:, 0]
            seconds.append(time.process_time() - begin)
        return Found(seconds[1:], self.unknowns, self.moved(u))

    def far(self) -> Found:
        """The whole path."""
        self.body.tangent(np.zeros(self.body.layout.n_local))
        begin = time.process_time()
        equilibrium_path(
            self.body, fm.Continuation(to=1.0), prescribed=self.held, load=lambda t: t * self.force
        )
        return Found([time.process_time() - begin], self.unknowns, self.moved(self.body.displacement))


def by_peer(peer: str, script: str, arguments: list[str]) -> Found | None:
    """By another program; None where it is not there."""
    task = peer_task(peer, script, arguments)
    if task is None:
        return None
    found = [task() for _ in range(ROUNDS)]
    return Found([one["seconds"] for one in found], found[0]["unknowns"], found[0]["moved"])


def calculix(name: str, n: int, exact: float) -> Found | None:
    """By its shells, or as kept."""
    found = by_peer("calculix", "shells_calculix.py", [name, str(n)])
    if found is not None or n not in KEPT[name]:
        return found
    unknowns, error = KEPT[name][n]
    return Found([], unknowns, (1.0 + error) * exact)


def measure(report: Report, linear: Sequence[int], far: Sequence[int]) -> None:
    """Tables on n x n cells."""
    report.table("wall", "by", "n", "unknowns", "s", "error")
    for name, problem in LINEAR.items():
        rows: dict[str, list[tuple[float, float]]] = {}
        for n in linear:
            found: dict[str, Found | None] = {
                by: Bricks(problem, form, degree, n).linear() for by, (form, degree) in OURS.items()
            }
            found[KRATOS] = by_peer("kratos", "shells_kratos.py", [name, "thin", str(n)])
            found[CALCULIX] = calculix(name, n, problem.exact)
            for by, one in found.items():
                if one is not None:
                    _say(report, name, by, n, one, problem.exact)
                    seconds = min(one.seconds, default=float("nan"))
                    rows.setdefault(by, []).append((abs(one.moved / problem.exact - 1.0), seconds))
        _compare(report, name, rows)
    for by, (form, degree) in {"solid_shell": (solid_shell, 1), "quadratic bricks": (st_venant_kirchhoff, 2)}.items():
        for n in far:
            try:
                one = Bricks(FAR, form, degree, n).far()
            except FlexmbdError as error:
                report.say(f"| hemisphere, far | {by} | {n} | | | {error!s:.80} |")
                continue
            _say(report, "hemisphere, far", by, n, one, FAR.exact)


def _say(report: Report, name: str, by: str, n: int, one: Found, exact: float) -> None:
    error = one.moved / exact - 1.0
    seconds = f"{min(one.seconds):.3f}" if one.seconds else "kept"
    report.say(f"| {name} | {by} | {n} | {one.unknowns:.0f} | {seconds} | {error:+.2%} |")


def _compare(report: Report, name: str, rows: dict[str, list[tuple[float, float]]]) -> None:
    """Other programs' times over the solid-shell's, each by the first mesh that comes within 2 %."""
    times = {by: next((s for error, s in found if error < 0.02), float("nan")) for by, found in rows.items()}
    for peer in (KRATOS, CALCULIX):
        report.beside(
            name, task="linear, to 2 %", peer=peer, theirs=times.get(peer, float("nan")), ours=times["solid_shell"]
        )


def quick(report: Report) -> None:
    """Coarse meshes."""
    measure(report, (4, 8), (4,))


def full(report: Report) -> None:
    """All."""
    measure(report, (4, 8, 16, 32), (8, 16))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--short", action="store_true", help="coarse meshes")
    (quick if parser.parse_args().short else full)(Report(Path()))
