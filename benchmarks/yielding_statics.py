"""Slow loading in yielding.py: a thick cylinder, a ring and a slope, by flexmbd."""

from __future__ import annotations

import time
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import yielding_peers as case
from numpy.typing import NDArray

from flexmbd import meshes
from flexmbd.continuum import BodyAcceleration, NonlinearModel, PathError, follow, load_form, prescribed_dofs
from flexmbd.forms import j2_plasticity as j2
from flexmbd.forms import solid_linear
from flexmbd.reduction.unit_loads import Pressure, load_vectors

HELD = {"x_min": "x", "y_min": "y", "bottom": "z", "top": "z"}
SOIL = Path(__file__).parents[1] / "tests" / "data" / "mohr_coulomb.py"
# of the steps at which a body yields all over
STRAIN = 3e-3


def ring(divisions: tuple[int, int, int], *, form: Any, hardening: float, means: bool = True) -> NonlinearModel:
    """The body of the cylinder: a quarter in plane strain, of 8-node bricks."""
    mesh = meshes.quarter_ring(case.HEIGHT, case.OUTER, case.INNER, divisions=divisions)
    elastic = {"E": case.YOUNG, "nu": case.POISSON, "rho": 2700.0}
    if form is solid_linear:
        return NonlinearModel(mesh, form, form.Parameters(**elastic), degree=1, cell_means=means)
    p = form.Parameters(**elastic, yield_stress=case.YIELD, hardening=j2.LinearHardening(hardening))
    return NonlinearModel(mesh, form, p, degree=1, cell_means=means)


def cylinder(divisions: tuple[int, int, int], hardening: float) -> dict[str, float]:
    """Its steps to the given share of the limit pressure; seconds of processor time, and displacements, m."""
    body = ring(divisions, form=j2, hardening=hardening)
    held = prescribed_dofs(body, HELD)
    force = case.LIMIT * load_vectors(body, [Pressure("p", "inner")])[:, 0]
    body.tangent(np.zeros(body.layout.n_local))  # compiled before the clock starts
    steps = list(np.linspace(0.0, case.SHARE, case.STEPS + 1)[1:])
    begin = time.process_time()
    path = follow(body, steps, prescribed=held, load=lambda t: t * force)
    found = {"seconds": time.process_time() - begin, "cells": float(np.prod(divisions))}
    for name, group in (("u_a", "inner"), ("u_b", "outer")):
        nodes = body.layout.nodes_on(2, body.mesh.facets(group))
        found[name] = float(np.linalg.norm(body.displacement[body.displacement_dofs[nodes, :2]], axis=1).mean())
    found["iterations"] = float(sum(len(step.residuals) - 1 for step in path.steps))
    return found


def limit(divisions: tuple[int, int, int], *, means: bool) -> float:
    """The largest pressure, over the exact limit, that a ring of bricks carries; up to 1.1 is tried."""
    body = ring(divisions, form=j2, hardening=0.0, means=means)
    held = prescribed_dofs(body, HELD)
    force = case.LIMIT * load_vectors(body, [Pressure("p", "inner")])[:, 0]
    try:
        path = follow(body, [0.9, 1.1], prescribed=held, load=lambda t: t * force, smallest=0.002)
    except PathError as error:
        if error.path is None:
            raise
        path = error.path
    return path.steps[-1].t


def thin_ring(n: int) -> dict[str, Any]:
    """The ring of dolfinx-external-operator's von Mises demo: n biquadratic cells along the radius, 3 n around."""
    young, ratio, strength, outer = 70e3, 0.3, 250.0, 1.3  # mm, t, s: MPa
    slope = young / 100
    law = j2.LinearHardening(young * slope / (young - slope))
    p = j2.Parameters(E=young, nu=ratio, rho=2.7e-9, yield_stress=strength, hardening=law)
    mesh = meshes.sheet(outer - 1.0, 1.0, divisions=(n, 3 * n))
    x = mesh.mesh.geometry.x
    r, angle = 1.0 + x[:, 0], np.pi / 2 * (x[:, 1] + 0.5)
    x[:, :2] = np.stack([r * np.cos(angle), r * np.sin(angle)], axis=1)
    body = NonlinearModel(mesh, in_plane(j2), p, degree=2)
    held = _held_in_plane(body, {"y_max": "x", "y_min": "y"})
    force = load_vectors(body, [Pressure("p", "x_min")])[:, 0]
    limit = 2 / np.sqrt(3) * strength * np.log(outer)
    body.tangent(np.zeros(body.layout.n_local))
    moved: list[float] = []
    at = _dof_at(body, (1.0, 0.0, 0.0), axis=0)
    begin = time.process_time()
    path = follow(
        body, list(limit * ring_loads()), prescribed=held, load=lambda t: t * force,
        accepted=lambda t: moved.append(float(body.displacement[at])),
    )
    seconds = time.process_time() - begin
    return {"seconds": seconds, "cells": 3 * n * n, "moved": moved, "iterations": _iterations(path)}


def slope(n: int, loads: list[float]) -> dict[str, Any]:
    """The slope of its Mohr-Coulomb demo: n x n biquadratic cells, with weights up to the last that it stands.

    MPa and mm; held on the right and below, heavy. `tests/data/mohr_coulomb.py` is the soil, a user's form.
    """
    form: Any = load_form(SOIL)
    angle = np.radians(30)
    soil = form.Parameters(E=6778.0, nu=0.25, rho=1.0, cohesion=3.45, friction=angle, dilatancy=angle)
    mesh = meshes.sheet(1.2, 1.0, divisions=(n, n))
    body = NonlinearModel(mesh, in_plane(form), soil, degree=2)
    held = _held_in_plane(body, {"x_max": "xy", "y_min": "xy"})
    body.tangent(np.zeros(body.layout.n_local))
    moved: list[float] = []
    at = _dof_at(body, (0.0, 0.5, 0.0), axis=0)
    weight = BodyAcceleration((0.0, -1.0, 0.0), lambda gamma: gamma)
    begin = time.process_time()
    try:
        path = follow(
            body, loads, prescribed=held, loads=[weight], smallest=0.2,
            accepted=lambda t: moved.append(-float(body.displacement[at])),
        )
    except PathError as error:
        if error.path is None:
            raise
        path = error.path
    seconds = time.process_time() - begin
    return {"seconds": seconds, "cells": n * n, "moved": moved, "iterations": _iterations(path)}


def in_plane(form: Any) -> Any:
    """A solid's form for flat cells at z = 0, in plane strain where no node moves along z; energies per thickness.

    Gradients on a flat mesh have no part along z, so that the form is that of the solid as it stands.
    """
    flat = ModuleType(f"{form.__name__}_in_plane")
    vars(flat).update({name: value for name, value in vars(form).items() if not name.startswith("__")})
    flat.CELLS = ("triangle", "quadrilateral")  # type: ignore[attr-defined]
    return flat


def ring_loads() -> NDArray[np.float64]:
    """Of the thin ring, over its limit without hardening."""
    return np.sqrt(np.linspace(0.0, 1.1, 20))[1:]


def slope_loads(*, first: float = 2.0, step: float = 0.5, last: float = 24.0) -> list[float]:
    """Weights per volume of the slope, MN/m^3."""
    return [float(load) for load in np.arange(first, last + step / 2, step)]


def _held_in_plane(body: NonlinearModel, groups: dict[str, str]) -> NDArray[np.int32]:
    """Prescribed dofs of groups, and z of all nodes."""
    along_z = body.displacement_dofs[:, 2]
    return np.union1d(prescribed_dofs(body, groups), along_z[along_z < body.n_owned]).astype(np.int32)


def _dof_at(body: NonlinearModel, place: tuple[float, float, float], *, axis: int) -> int:
    """The displacement's dof of the node at a place."""
    distance = np.linalg.norm(body.layout.node_x - place, axis=1)
    return int(body.displacement_dofs[distance.argmin(), axis])


def _iterations(path: Any) -> int:
    return sum(len(step.residuals) - 1 for step in path.steps)
