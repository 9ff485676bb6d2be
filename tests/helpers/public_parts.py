"""Right calls of what only parts of a run, of a record or of a file have: moments, kinematics, matrices, energies."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import public_bodies
import public_runs
import scipy.io
import scipy.sparse
from dolfinx import fem

import flexmbd as fm
from flexmbd import continuum, ensemble, export, force, joint, meshes, output, reduction
from flexmbd.beams import FrameMesh

_STORED = Path(__file__).parents[1] / "data" / "calculix_storage"
_CUBE = np.array([(x, y, z) for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)])
NODES = np.column_stack([np.arange(1.0, 9.0), _CUBE])  # number, x, y, z


@cache
def loaded_rod() -> fm.ReducedBody:
    """With a load by name."""
    model, push = public_bodies.model(), [reduction.Pressure("push", "y_max")]
    return reduction.craig_bampton(model, modes=1, frame="x_min", loads=push)


def _exudyn_system() -> Any:
    """A new one."""
    import exudyn

    return exudyn.SystemContainer().AddSystem()


@cache
def _bending() -> tuple[fm.EquilibriumPath, Any]:
    """A flexible rod that bends under its growing weight, and the rod."""
    scene = fm.System()
    rod = scene.add(fm.FlexibleBody(public_bodies.body()), name="rod")
    scene.connect(joint.Fixed(), scene.ground.frame(), rod.frame("x_min"))
    scene.add_force(force.FrameForce(rod.frame("x_max"), [0.0, 0.0, fm.Table((0.0, 1.0), (0.0, 1.0))]))
    return scene.equilibrium(path=fm.Continuation(to=1.0)), rod


@cache
def _during() -> tuple[fm.Moment, Any, list[Any], Any]:
    """What the machine hands to a user's functions: a moment and kinematics, with the slide and the block there."""
    scene, moments, kinematics = fm.System(), list[Any](), list[Any]()
    block = scene.add(fm.RigidBody(1.0, (1.0, 1.0, 1.0)), name="block")
    slide = scene.connect(joint.Prismatic("x"), scene.ground.frame(), block.frame(), name="slide")

    def seen(kinematic: Any) -> list[Any]:
        kinematics.append(kinematic)
        return []

    def looked(moment: fm.Moment) -> float:
        moments.append(moment)
        return 1.0

    scene.add_force(force.KaneForce(seen))
    scene.simulate(1e-3, events=[fm.Event(looked)])
    return moments[-1], slide, kinematics, block


def _kinematics() -> Any:
    return _during()[2][-1]


@cache
def _frame_mesh() -> FrameMesh:
    return public_runs.rich().beam.mesh


@cache
def _sheet() -> continuum.TaggedMesh:
    return meshes.sheet(0.2, 0.1, divisions=(2, 1), comm=public_bodies.ALONE)


@cache
def _line() -> continuum.TaggedMesh:
    return meshes.line(1.0, divisions=2, comm=public_bodies.ALONE)


@cache
def compiled_energy() -> fm.CompiledEnergy:
    return continuum.homogeneous_energy(_energy, comm=public_bodies.ALONE)


def _energy(F: Any) -> Any:
    import ufl

    E = 0.5 * (F.T * F - ufl.Identity(3))
    return ufl.inner(E, E)


def _displacement() -> fem.Function:
    return fem.Function(public_bodies.model().space)


def stiffness() -> scipy.sparse.csr_array:
    """(24, 24) of springs between all corners of a cube that resist all but rigid motions: with a lumped mass."""
    K = np.zeros((24, 24))
    for a in range(8):
        for b in range(a):
            along = _CUBE[b] - _CUBE[a]
            pull = np.outer(along, along) / (along @ along)
            for i, j, sign in ((a, a, 1), (b, b, 1), (a, b, -1), (b, a, -1)):
                K[3 * i : 3 * i + 3, 3 * j : 3 * j + 3] += sign * pull
    return scipy.sparse.csr_array(K)


def _interfaces() -> dict[str, export.NodeSet]:
    return {"low": export.NodeSet([1, 2, 3, 4])}


def _market_file() -> str:
    scipy.io.mmwrite("K.mtx", stiffness())
    return "K.mtx"


def _triplets_file() -> str:
    entries = scipy.sparse.coo_array(stiffness())
    rows, columns = entries.coords
    with Path("K.txt").open("w") as file:
        for i, j, value in zip(rows, columns, entries.data, strict=True):
            file.write(f"{i // 3 + 1}, {i % 3 + 1}, {j // 3 + 1}, {j % 3 + 1}, {value:.17g}\n")
    return "K.txt"


def _stored_nodes() -> list[list[float]]:
    lines = (_STORED / "beam.inp").read_text().splitlines()
    return [[float(word) for word in line.split(",")] for line in lines[1:13]]


def _samples() -> fm.ControllerSamples:
    return public_runs.rich().run.sampled(public_runs.rich().law)


def _ramp(t: float) -> float:
    return 2.0 * t


def _sided(t: float, y: float, v: float, side: float) -> float:
    return side


@cache
def _compiled() -> fm.Compiled:
    return fm.compiled(_ramp)


def _sampled() -> ensemble.Sampled:
    return ensemble.Sampled(output.Position(public_runs.rich().slide), (0.001, 0.002))


def _openfast_file() -> str:
    return public_runs.body_file(export.openfast, "b.dat", interface="x_min", lossy=True)


def _calculix_file() -> str:
    return public_runs.body_file(export.calculix, "b.inp", lossy=True)


BY_WORDS: dict[str, Callable[[Any], Any]] = {
    "Kinematics": lambda w: _kinematics(),
    "Machine": lambda w: _kinematics().scene,
    "Compiled": lambda w: _compiled(),
    "ControllerSamples": lambda w: _samples(),
    "fem.Function": lambda w: _displacement(),
    "ufl.core.expr.Expr": lambda w: _displacement(),
    "ExplicitOperator": lambda w: continuum.lumped_rotations(public_bodies.model()),
    "HistorySnapshot": lambda w: public_bodies.loaded().snapshot(),
    "Sparse": lambda w: stiffness(),
    "Mapping[str, NodeSet]": lambda w: _interfaces(),
}
OBJECTS: dict[str, Callable[[Any], Any]] = {
    "CompiledEnergy": lambda w: compiled_energy(),
    "Event": lambda w: fm.Event(lambda moment: 1.0),
    "FrameMesh": lambda w: _frame_mesh(),
    "Moment": lambda w: _during()[0],
    "Piecewise": lambda w: fm.Piecewise(lambda: 1.0, [0.5]),
    "PseudoRigidSwarm": lambda w: fm.PseudoRigidSwarm(
        [fm.Solid.box((1.0, 1.0, 1.0), density=1.0)], fm.StVenantKirchhoff(1.0, 0.3), r=[(0.0, 0.0, 0.0)]
    ),
    "Sampled": lambda w: _sampled(),
    "Slab": lambda w: fm.Slab((1.0, 0.0, 0.0), 0.0, 1.0),
    "Superelement": lambda w: export.superelement(public_bodies.body()),
    "TimeFactor": lambda w: fm.TimeFactor(_ramp, "a load"),
}
FOR_METHODS: dict[str, Callable[[], Any]] = {
    "CompiledMachine.ensemble": lambda: public_runs.falling()[0],
    "EquilibriumPath.q": lambda: _bending()[0],
    "continuum.NonlinearModel.restore": public_bodies.loaded,
    "continuum.TaggedMesh.edges": _sheet,
    "continuum.TaggedMesh.vertices": _line,
}
BY_NAME: dict[str, dict[str, Callable[[Any], Any]]] = {
    "CompiledEnergy.evaluate": {"F": lambda w: np.eye(3)},
    "CompiledMachine.ensemble": {
        "samples": lambda w: {"z": [0.0]}, "outputs": lambda w: {"end": lambda run: run.t[-1]}, "t_end": lambda w: 1e-3,
    },
    "ControllerSamples.followed_by": {"since": lambda w: 0.002},
    "EquilibriumPath.q": {"body": lambda w: _bending()[1]},
    "Moment.set_rate": {"connection": lambda w: _during()[1], "rate": lambda w: 1.0},
    "Piecewise": {"function": lambda w: _ramp, "breaks": lambda w: [0.5]},
    "Switched": {"law": lambda w: _sided, "when": lambda w: lambda t, y, v: y},
    "PseudoRigidSwarm.step": {"h": lambda w: 1e-3},
    "Slab.__call__": {"x": lambda w: np.zeros((3, 2))},
    "Solid.moved": {"p": lambda w: np.zeros(3), "R": lambda w: np.eye(3)},
    "beams.FrameMesh.node": {"place": lambda w: "tip"},
    "continuum.TaggedMesh.edges": {"name": lambda w: "x_min"},
    "continuum.TaggedMesh.vertices": {"name": lambda w: "start"},
    "continuum.homogeneous_energy": {"source": lambda w: _energy, "comm": lambda w: public_bodies.ALONE},
    "continuum.on_root": {"function": lambda w: lambda: 1},
    "ensemble.Sampled.__call__": {"run": lambda w: public_runs.rich().run},
    "export.Superelement.rigid_motions": {"origin": lambda w: np.zeros(3)},
    "export.add_to_exudyn": {
        "mbs": lambda w: _exudyn_system(), "body": lambda w: public_bodies.body(), "name": lambda w: "rod",
    },
    "export.read_calculix": {"path": lambda w: _calculix_file()},
    "export.read_matrix_market": {"path": lambda w: _market_file()},
    "export.read_matrix_storage": {"path": lambda w: str(_STORED / "beam.sti"), "nodes": lambda w: _stored_nodes()},
    "export.read_openfast": {"path": lambda w: _openfast_file()},
    "export.read_triplets": {"path": lambda w: _triplets_file(), "nodes": lambda w: NODES},
    "export.reduce_matrices": {
        "M": lambda w: scipy.sparse.csr_array(np.eye(24)), "nodes": lambda w: NODES, "modes": lambda w: 1,
        "frame": lambda w: "low",
    },
    "force.DistributedLoad": {
        "body": lambda w: w.scene.add(fm.FlexibleBody(loaded_rod())), "name": lambda w: "push",
    },
    "force.active_forces": {"contributions": lambda w: []},
}  # fmt: skip
