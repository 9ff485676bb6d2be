"""Right calls of what is public of parts on meshes: models, meshes, reduction; each object is made when asked for."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from mpi4py import MPI

import gmsh
import numpy as np
import step_shapes

import flexmbd as fm
from flexmbd import continuum, meshes, reduction
from flexmbd.forms import beam_timoshenko, solid_linear, updated_lagrangian

ALONE = MPI.COMM_SELF
STEEL = solid_linear.Parameters(E=2.0e11, nu=0.3, rho=7800.0)
YIELDING = updated_lagrangian.Parameters(E=2.0e11, nu=0.3, rho=7800.0, yield_stress=2.5e8)


@cache
def mesh() -> continuum.TaggedMesh:
    """A bar of two hexahedra along x."""
    return meshes.block(0.2, 0.1, 0.1, divisions=(2, 1, 1), comm=ALONE)


def interfaces() -> list[continuum.Interface]:
    return [continuum.Interface("x_min"), continuum.Interface("x_max")]


@cache
def model() -> continuum.ContinuumModel:
    return continuum.ContinuumModel(mesh(), solid_linear, STEEL, degree=1, interfaces=interfaces())


@cache
def prestressed() -> reduction.PrestressedModel:
    return reduction.prestressed(model(), frame="x_min", forces={"x_max": (1.0, 0.0, 0.0, 0.0, 0.0, 0.0)})


@cache
def body() -> fm.ReducedBody:
    """With everything that a record can hold on the mesh."""
    keep = reduction.Keep(modes=True, surface=True, stress=True)
    return reduction.craig_bampton(model(), modes=1, frame="x_min", keep=keep)


@cache
def nonlinear() -> continuum.NonlinearModel:
    """Of a steel that yields; wherever calls leave it, it is a body."""
    return continuum.NonlinearModel(mesh(), updated_lagrangian, YIELDING, degree=1, interfaces=interfaces())


@cache
def loaded() -> continuum.NonlinearModel:
    """Of the same steel; wherever loads leave it, nobody else has it."""
    return continuum.NonlinearModel(mesh(), updated_lagrangian, YIELDING, degree=1, interfaces=interfaces())


@cache
def followed() -> continuum.NonlinearModel:
    """Of the same steel, which loads leave where it can go on, whatever was done to the others before."""
    return continuum.NonlinearModel(mesh(), updated_lagrangian, YIELDING, degree=1, interfaces=interfaces())


@cache
def cut() -> continuum.CutMesh:
    return continuum.cut_mesh(mesh(), {"near": lambda x: x[0] < 0.11, "far": lambda x: x[0] > 0.09})


def mesh_file() -> str:
    meshes.write(mesh(), "part.h5")
    return "part.h5"


def deck_file() -> str:
    Path("part.bdf").write_text("MAT1,1,2.1+5,,0.3,7.85-9\nPSOLID,1,1\n")
    return "part.bdf"


def step_file() -> str:
    if not Path("part.step").exists():
        step_shapes.write(Path("part.step"), lambda: gmsh.model.occ.addBox(0, 0, 0, 200, 100, 100))
    return "part.step"


@cache
def beam() -> continuum.ExplicitOperator:
    """A beam's, whose rotations are condensed."""
    line = meshes.line(1.0, divisions=2, degree=1, comm=ALONE)
    section = beam_timoshenko.Parameters.rectangle(
        2.0e11, 0.3, 7800.0, width=0.02, height=0.01, orientation=(0.0, 0.0, 1.0)
    )
    model = continuum.ContinuumModel(line, beam_timoshenko, section, degree=1, interfaces=[_START])
    return continuum.condensed_rotations(model)


def still() -> Any:
    """No displacement."""
    return np.zeros(nonlinear().layout.n_local)


@dataclass(frozen=True)
class Elastic:
    """Parameters of a law."""

    E: float
    rho: float


def elastic_law(step: Any, p: Any) -> Any:
    """Without Poisson's contraction."""
    tangent = p.E * np.eye(6)
    return step.stress + tangent @ step.increment, tangent, step.state


def _everywhere(x: Any) -> Any:
    return x[0] > -1.0


_POINTS = [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)]
_TWO_POINTS = {"root": (0.0, 0.0, 0.0), "tip": (1.0, 0.0, 0.0)}
#: By the words of an annotation, what is right of it.
BY_WORDS: dict[str, Callable[[Any], Any]] = {
    "MPI.Comm": lambda w: ALONE,
    "TaggedMesh": lambda w: mesh(),
    "int | Mapping[str, int]": lambda w: 1,
    "LinearModel": lambda w: model(),
    "LinearModel | TaggedMesh": lambda w: model(),
    "Discretisation": lambda w: model(),
    "NonlinearModel": lambda w: nonlinear(),
    "StressField": lambda w: model().stress_field(body(), np.ones(body().n_modes)),
    "Sequence[Load]": lambda w: [reduction.Pressure("push", "y_max")],
    "Source | Pairs": lambda w: solid_linear,
    "str | Path | ModuleType": lambda w: solid_linear,
}
#: Objects whose methods are called.
OBJECTS: dict[str, Callable[[Any], Any]] = {
    "TaggedMesh": lambda w: mesh(),
    "ContinuumModel": lambda w: model(),
    "LinearModel": lambda w: model(),
    "PrestressedModel": lambda w: prestressed(),
    "NonlinearModel": lambda w: nonlinear(),
    "CutMesh": lambda w: cut(),
    "StressField": lambda w: model().stress_field(body(), np.ones(body().n_modes)),
    "RigidPlane": lambda w: continuum.RigidPlane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0)),
    "RegularCheckpoints": lambda w: continuum.RegularCheckpoints("a.npz", 1.0),
    "ExplicitOperator": lambda w: beam(),
    "ExplicitRun": lambda w: continuum.ExplicitRun(nonlinear()),
}
_START = continuum.Interface("start")
_STEPS = ("check_increment", "commit", "force", "step", "tangent")
_SIZES = {"length": lambda w: 0.2, "width": lambda w: 0.1, "height": lambda w: 0.1, "comm": lambda w: ALONE}
_THREE = {"divisions": lambda w: (2, 1, 1)}
#: Where the words do not tell, by the name of the call.
BY_NAME: dict[str, dict[str, Callable[[Any], Any]]] = {
    "meshes.beam": {**_SIZES, "h": lambda w: 0.1},
    "meshes.block": {**_SIZES, **_THREE},
    "meshes.connecting_rod": {"h": lambda w: 0.03, "degree": lambda w: 1, "comm": lambda w: ALONE},
    "meshes.crank": {"h": lambda w: 0.04, "degree": lambda w: 1, "comm": lambda w: ALONE},
    "meshes.crash_tube": {
        **_SIZES, "wall": lambda w: 0.002, "divisions": lambda w: (2, 1, 4), "fold": lambda w: 0.05,
        "dent": lambda w: 0.001,
    },
    "meshes.frame": {
        "points": lambda w: _TWO_POINTS, "beams": lambda w: {"bar": [("root", "tip")]}, "comm": lambda w: ALONE,
    },
    "meshes.from_arrays": {
        "points": lambda w: _POINTS, "cells": lambda w: [(0, 1, 2, 3)], "degree": lambda w: 1,
        "facet_groups": lambda w: {"all": _everywhere},
    },
    "meshes.join": {"parts": lambda w: {"one": mesh(), "two": mesh()}},
    "meshes.placed": {"p": lambda w: (0.1, 0.0, 0.0), "R": lambda w: None},
    "meshes.from_step": {
        "path": lambda w: step_file(), "tags": lambda w: {}, "h": lambda w: 0.1, "comm": lambda w: ALONE,
    },
    "meshes.line": {"comm": lambda w: ALONE},
    "meshes.plate": {**_SIZES, "thickness": lambda w: 0.02, "h": lambda w: 0.1},
    "meshes.quarter_ring": {
        "outer_radius": lambda w: 0.2, "inner_radius": lambda w: 0.1, "divisions": lambda w: (1, 2, 1),
        "comm": lambda w: ALONE,
    },
    "meshes.InBox": {"low": lambda w: (0.0, 0.0, 0.0), "high": lambda w: (1.0, 1.0, 1.0)},
    "meshes.OnCylinder": {
        "point": lambda w: (0.0, 0.0, 0.0), "axis": lambda w: (0.0, 0.0, 1.0), "radius": lambda w: 0.1,
    },
    "meshes.OnPlane": {"point": lambda w: (0.0, 0.0, 0.0), "normal": lambda w: (0.0, 0.0, 1.0)},
    "meshes.materials": {"path": lambda w: deck_file(), "units": lambda w: "mm-t-s", "comm": lambda w: ALONE},
    "meshes.with_facet_groups": {"groups": lambda w: {}},
    "meshes.read": {"path": lambda w: mesh_file(), "comm": lambda w: ALONE},
    "meshes.round_bar": {"divisions": lambda w: (2, 2, 2), "comm": lambda w: ALONE},
    "meshes.sheet": {**_SIZES, "divisions": lambda w: (2, 1)},
    "meshes.spur_gear": {
        "teeth": lambda w: 12, "module": lambda w: 0.01, "width": lambda w: 0.01, "bore": lambda w: 0.02,
        "divisions": lambda w: (2, 2, 1, 1), "degree": lambda w: 1, "comm": lambda w: ALONE,
    },
    "meshes.step_faces": {"path": lambda w: step_file(), "comm": lambda w: ALONE},
    "meshes.tube": {
        "length": lambda w: 0.2, "outer_radius": lambda w: 0.1, "inner_radius": lambda w: 0.05, "h": lambda w: 0.1,
        "degree": lambda w: 1, "comm": lambda w: ALONE,
    },
    "meshes.wall": {
        "part": lambda w: meshes.sheet(0.2, 0.1, divisions=(2, 1), comm=ALONE), "thickness": lambda w: 0.01,
        "offset": lambda w: 0.0, "layers": lambda w: 1, "normals": lambda w: None,
    },
    "meshes.write": {"path": lambda w: "part.h5"},
    "reduction.InterfaceModes": {"modes": lambda w: 2, "joints": lambda w: ["x_min"]},
    "reduction.KelvinVoigtDamping": {"tau": lambda w: 1e-4},
    "reduction.ModalDamping": {"ratio": lambda w: 0.02},
    "reduction.ModalDerivatives": {"loads": lambda w: {"x_max.y": 1.0}},
    "reduction.Patch": {"size": lambda w: 0.1},
    "reduction.Truncation": {"modes": lambda w: 1},
    "reduction.craig_bampton": {"modes": lambda w: 1, "frame": lambda w: "x_min"},
    "reduction.guyan": {"frame": lambda w: "x_min"},
    "reduction.linear_buckling": {
        "clamped": lambda w: ["x_min"], "forces": lambda w: {"x_max": (-1.0, 0.0, 0.0, 0.0, 0.0, 0.0)},
    },
    "reduction.prestressed": {"frame": lambda w: "x_min"},
    "reduction.static_condensation": {"retained": lambda w: [(node, axis) for node in (0, 1, 2, 5) for axis in "xyz"]},
    "reduction.truncation_errors": {"modes": lambda w: [1, 2], "frame": lambda w: "x_min", "count": lambda w: 1},
    "reduction.PrestressedModel.interface": {"name": lambda w: "x_min"},
    "reduction.PrestressedModel.rigid_motions": {"axes": lambda w: np.eye(3)},
    "reduction.PrestressedModel.tangent": {"u": lambda w: np.zeros(len(model().M.getVecs()[0].array))},
    "reduction.PrestressedModel.stress_field": {"body": lambda w: body(), "q": lambda w: np.zeros(body().n_modes)},
    "reduction.PrestressedModel.show": {"path": lambda w: "a.png"},
    "continuum.Weld": {"nodes": lambda w: "x_min", "facets": lambda w: "x_max"},
    "continuum.ContinuumModel": {"parameters": lambda w: STEEL, "interfaces": lambda w: interfaces()},
    "continuum.ContinuumModel.interface": {"name": lambda w: "x_min"},
    "continuum.LinearModel.interface": {"name": lambda w: "x_min"},
    "continuum.ContinuumModel.rigid_motions": {"axes": lambda w: np.eye(3)},
    "continuum.LinearModel.rigid_motions": {"axes": lambda w: np.eye(3)},
    "continuum.ContinuumModel.tangent": {"u": lambda w: np.zeros(len(model().M.getVecs()[0].array))},
    "continuum.LinearModel.tangent": {"u": lambda w: np.zeros(len(model().M.getVecs()[0].array))},
    "continuum.ContinuumModel.stress_field": {"body": lambda w: body(), "q": lambda w: np.zeros(body().n_modes)},
    "continuum.LinearModel.stress_field": {"body": lambda w: body(), "q": lambda w: np.zeros(body().n_modes)},
    "continuum.ContinuumModel.show": {"path": lambda w: "a.png"},
    "continuum.LinearModel.show": {"path": lambda w: "a.png"},
    "continuum.follow": {
        "body": lambda w: followed(), "times": lambda w: [1.0],
        "prescribed": lambda w: continuum.clamped_dofs(followed(), ["x_min"]),
    },
    "continuum.equilibrium_path": {
        "body": lambda w: loaded(),
        "path": lambda w: fm.Continuation(to=1.0),
        "prescribed": lambda w: continuum.clamped_dofs(loaded(), ["x_min"]),
        "loads": lambda w: [continuum.BodyAcceleration((0.0, 0.0, -1.0), lambda t: t)],
    },
    "continuum.NonlinearModel": {
        "formulation": lambda w: updated_lagrangian, "parameters": lambda w: YIELDING,
        "interfaces": lambda w: interfaces(),
    },
    "continuum.NonlinearModel.norm": {"values": lambda w: still()},
    "continuum.NonlinearModel.predict_stress": {"before": lambda w: still(), "after": lambda w: still()},
    **{f"continuum.NonlinearModel.{name}": {"increment": lambda w: still()} for name in _STEPS},
    "continuum.ExplicitOperator.complete": {"u": lambda w: np.zeros(len(beam().masses))},
    "continuum.ExplicitOperator.force": {"u": lambda w: np.zeros(len(beam().masses))},
    "continuum.law_form": {
        "law": lambda w: elastic_law, "parameters": lambda w: Elastic, "trial": lambda w: Elastic(1e9, 1e3),
    },
    "continuum.CentrifugalLoad": {},
    "continuum.CutMesh.interfaces": {"piece": lambda w: "near"},
    "continuum.ExplicitContinuum": {},
    "continuum.ExplicitRun.simulate": {"t_end": lambda w: 1e-5, "outputs": lambda w: 1},
    "continuum.ForceAtNodes": {"nodes": lambda w: [0]},
    "continuum.Voltage": {"electrode": lambda w: "top", "factor": lambda w: 1.0},
    "continuum.PressureOnFacets": {"facets": lambda w: "y_max", "factor": lambda w: 1.0},
    "continuum.TractionOnFacets": {"facets": lambda w: "y_max"},
    "continuum.TaggedMesh.cells": {"name": lambda w: "block"},
    "continuum.TaggedMesh.facets": {"name": lambda w: "x_min"},
    "continuum.Support": {"group": lambda w: "x_min", "x": lambda w: True},
    "continuum.clamped_dofs": {"groups": lambda w: ["x_min"]},
    "continuum.prescribed_dofs": {"groups": lambda w: {"x_min": "xyz"}},
    "continuum.cut_mesh": {
        "regions": lambda w: {"near": lambda x: x[0] < 0.11, "far": lambda x: x[0] > 0.09},
    },
    "continuum.RegularCheckpoints": {"path": lambda w: "a.npz"},
    "continuum.RegularCheckpoints.next": {"t": lambda w: 1.0},
    "StressField.show": {"path": lambda w: "a.png"},
}  # fmt: skip
