"""Plasticity: assembly by the cell, and a thick cylinder loaded to its limit, against Kratos and CalculiX.

    ./run python benchmarks/plasticity.py --small          # a few seconds
    ./run python benchmarks/plasticity.py                  # 20 000 bricks, about two minutes
    ./run python benchmarks/plasticity.py --kratos PYTHON  # and by a python that has Kratos, some minutes more
    ./run python benchmarks/plasticity.py --calculix CCX   # and CalculiX, a folder with its `ccx`, ten minutes more

Kratos: KratosMultiphysics, KratosStructuralMechanicsApplication, KratosConstitutiveLawsApplication,
KratosLinearSolversApplication and numpy of PyPI in an environment of its own; CalculiX: Debian's `calculix-ccx`. Both
must be seen from where this runs, or are run apart by plasticity_peers.py. All times are processor time of one thread.

The cylinder: a quarter, inner radius 1 m, outer 2 m, plane strain, 8-node bricks with mean dilatation, perfectly
plastic and with a hardening of 700 MPa; 20 equal steps to 0.98 of the perfectly plastic limit, Newton's method to 1e-9.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import plasticity_peers as case
from dolfinx import fem

from flexmbd import meshes
from flexmbd.continuum.history.displacement_newton import Newton
from flexmbd.continuum.history.nonlinear_model import NonlinearModel
from flexmbd.continuum.history.static_path import PathError, StaticPath, follow, prescribed_dofs
from flexmbd.continuum.history.tangent_solver import TangentSolver
from flexmbd.continuum.interior.nodal_motion import NodalMotion
from flexmbd.forms import j2_plasticity as j2
from flexmbd.forms import solid_linear
from flexmbd.reduction.unit_loads import Pressure, load_vectors

FULL, SMALL, COARSE = (40, 50, 10), (10, 12, 3), (8, 12, 1)
HELD = {"x_min": "x", "y_min": "y", "bottom": "z", "top": "z"}
# of the steps at which a body yields all over, and the times each thing is measured
STRAIN, REPEATS = 3e-3, 7
TOLERANCE = 0.01


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--small", action="store_true", help="a small mesh")
    parser.add_argument("--kratos", metavar="PYTHON", help="a python that has Kratos")
    parser.add_argument("--calculix", metavar="FOLDER", help="the folder of ccx")
    arguments = parser.parse_args()
    divisions = SMALL if arguments.small else FULL
    print(per_cell(divisions), flush=True)
    for means in (True, False):
        print(f"limit pressure with{'' if means else 'out'} mean dilatation: {limit(means):.4f} of the exact one")
    ours = {hardening: cylinder(divisions, hardening) for hardening in (700e6, 0.0)}
    for peer, where, hardening in (("kratos", arguments.kratos, 0.0), ("calculix", arguments.calculix, 700e6)):
        if where is None:
            print(f"{peer}: left out; see --{peer}")
            continue
        found = run_peer(peer, where, divisions, hardening)
        times = found["seconds"] / ours[hardening]["seconds"]
        print(f"{peer}, hardening {hardening:.0e}: {found}, {times:.1f} times flexmbd's time")
        for name in ("u_a", "u_b"):
            if abs(found[name] / ours[hardening][name] - 1.0) > TOLERANCE:
                print(f"{name} of {peer} differs by more than {TOLERANCE}")
    return 0


def per_cell(divisions: tuple[int, int, int]) -> str:
    """A table of us a cell, of a body that yields all over, and of an elastic one."""
    rows = {}
    for name, form, means in (
        ("linear elastic", solid_linear, False),
        ("J2", j2, False),
        ("J2, mean dilatation", j2, True),
    ):
        body = ring(divisions, form=form, hardening=700e6, means=means)
        n = body.mesh.mesh.topology.index_map(3).size_local
        stretched = STRAIN * body.layout.node_x * [1.0, -0.5, -0.3]
        u = np.zeros(body.layout.n_local)
        u[body.displacement_dofs] = stretched
        body.tangent(u)
        tasks = [partial(assemble, body), partial(body.force, u), partial(body.tangent, u)]
        times = [least(task) for task in tasks]
        body.revert()
        times.append(least(explicit_step(body)))
        rows[name] = [1e6 / n * seconds for seconds in times]
    head = f"{'us a cell':22} {'residual':>9} {'pass':>9} {'tangent':>9} {'explicit':>9}"
    lines = [f"{name:22}" + "".join(f" {value:9.2f}" for value in values) for name, values in rows.items()]
    elastic, plain, means_ = rows.values()
    claims = [
        f"{name}: tangent / elastic tangent {row[2] / elastic[2]:.2f} (at most 1.3), what history and means add to the "
        f"residual {row[1] / row[0] - 1.0:.2f} of it (1.1), explicit step / residual {row[3] / row[0]:.2f} (2.2)"
        for name, row in (("J2", plain), ("J2, mean dilatation", means_))
    ]
    told = "residual: DOLFINx's assembly alone; pass: forces, history and means"
    return "\n".join([head, *lines, told, *claims, ""])


def assemble(body: NonlinearModel) -> None:
    """The forces alone, for the present trial displacement, by DOLFINx."""
    if body not in _FORMS:
        _FORMS.clear()
        _FORMS[body] = [fem.form(term) for history in body._histories for term in history.terms], body.vector().array
    forms, forces = _FORMS[body]
    forces[:] = 0.0
    for form in forms:
        fem.assemble_vector(forces, form)


_FORMS: dict[NonlinearModel, tuple] = {}


def explicit_step(body: NonlinearModel) -> Callable[[], None]:
    """A step of central differences of a body that yields."""
    motion = NodalMotion(body)
    motion.begin(np.zeros(3), np.eye(3), np.zeros(3))
    motion.v[:] = 100.0 * motion.x * [1.0, -0.5, -0.3]
    h = 0.5 * motion.limit
    for _ in range(int(STRAIN / (100.0 * h)) + 1):
        motion.advance(h)
    return partial(motion.advance, h)


def least(task: Callable[[], object]) -> float:
    """The least processor time of several runs, s."""
    spent = []
    for _ in range(REPEATS):
        begin = time.process_time()
        task()
        spent.append(time.process_time() - begin)
    return min(spent)


def ring(divisions, *, form, hardening, means=True):
    """The body of the cylinder."""
    mesh = meshes.quarter_ring(case.HEIGHT, case.OUTER, case.INNER, divisions=divisions)
    elastic = {"E": case.YOUNG, "nu": case.POISSON, "rho": 2700.0}
    if form is solid_linear:
        p = form.Parameters(**elastic)
    else:
        p = form.Parameters(**elastic, yield_stress=case.YIELD, hardening=j2.LinearHardening(hardening))
    return NonlinearModel(mesh, form, p, degree=1, cell_means=means)


class Split:
    """Processor time by what it is spent on, for methods that are wrapped while a block runs."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._kept: list[tuple[type, str, Callable]] = []

    def wrap(self, owner: type, name: str, part: str) -> None:
        """Count a method's time as a part's."""
        method = getattr(owner, name)
        self._kept.append((owner, name, method))

        def timed(*arguments, **named):
            begin = time.process_time()
            try:
                return method(*arguments, **named)
            finally:
                self.seconds[part] = self.seconds.get(part, 0.0) + time.process_time() - begin

        setattr(owner, name, timed)

    def unwrap(self) -> None:
        """Put the methods back."""
        for owner, name, method in self._kept:
            setattr(owner, name, method)


def limit(means: bool) -> float:
    """The largest pressure, over the exact limit, that a ring of few bricks carries; up to 1.1 is tried."""
    body = ring(COARSE, form=j2, hardening=0.0, means=means)
    held = prescribed_dofs(body, HELD)
    force = case.LIMIT * load_vectors(body, [Pressure("p", "inner")])[:, 0]
    try:
        path = follow(body, [0.9, 1.1], prescribed=held, load=lambda t: t * force, smallest=0.002)
    except PathError as error:
        if error.path is None:
            raise
        path = error.path
    return path.steps[-1].t


def cylinder(divisions, hardening) -> dict[str, float]:
    """The steps of the cylinder, printed."""
    body = ring(divisions, form=j2, hardening=hardening)
    held = prescribed_dofs(body, HELD)
    force = case.LIMIT * load_vectors(body, [Pressure("p", "inner")])[:, 0]
    # compiled before the clock starts
    body.tangent(np.zeros(body.layout.n_local))
    split = Split()
    for owner, name, part in (
        (NonlinearModel, "tangent", "tangent"), (NonlinearModel, "force", "residual"),
        (NonlinearModel, "commit", "update"), (TangentSolver, "take", "factor"), (Newton, "_direction", "solve"),
    ):
        split.wrap(owner, name, part)
    begin, wall = time.process_time(), time.perf_counter()
    steps = np.linspace(0.0, case.SHARE, case.STEPS + 1)[1:]
    try:
        path: StaticPath = follow(body, list(steps), prescribed=held, load=lambda t: t * force)
    finally:
        split.unwrap()
    seconds, wall = time.process_time() - begin, time.perf_counter() - wall
    split.seconds["solve"] -= split.seconds["factor"]
    found = {"seconds": seconds}
    for name, group in (("u_a", "inner"), ("u_b", "outer")):
        nodes = body.layout.nodes_on(2, body.mesh.facets(group))
        found[name] = float(np.linalg.norm(body.displacement[body.displacement_dofs[nodes, :2]], axis=1).mean())
    tangents = sum(len(step.residuals) - 1 for step in path.steps)
    print(
        f"flexmbd, hardening {hardening:.0e} Pa, {len(body.layout.node_x) * 3} dofs: {seconds:.1f} s ({wall:.1f} s by "
        f"the clock), {len(path.steps)} steps, {tangents} tangents, {path.factorisations} factorisations, "
        f"{path.iterations} iterations, u_a {found['u_a']:.7e}, u_b {found['u_b']:.7e} m"
    )
    print("  " + ", ".join(f"{part} {value:.2f} s" for part, value in split.seconds.items()))
    print("  last step: " + " ".join(f"{value:.0e}" for value in path.steps[-1].residuals) + "\n", flush=True)
    return found


def run_peer(peer: str, where: str, divisions: tuple[int, ...], hardening: float) -> dict[str, float]:
    """Times of another program in a process of its own."""
    python = where if peer == "kratos" else sys.executable
    path = os.environ["PATH"] if peer == "kratos" else f"{where}:{os.environ['PATH']}"
    called = [python, case.__file__, peer, ",".join(map(str, divisions)), str(hardening / 1e6)]
    run = subprocess.run(
        called, capture_output=True, text=True, check=True, env=os.environ | {"OMP_NUM_THREADS": "1", "PATH": path},
        cwd=Path(__file__).parent,
    )
    line = next(line for line in reversed(run.stdout.splitlines()) if line.startswith("{"))
    return json.loads(line)


if __name__ == "__main__":
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    sys.exit(main())
