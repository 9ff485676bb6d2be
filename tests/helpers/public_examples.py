"""A right call of what is public: required arguments by the words of their annotations, or from a small table."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache, cached_property
from typing import Any

import numpy as np
import public_bodies
import public_parts
import public_runs
from public_calls import Public
from random_misuse.scenes import record

import flexmbd as fm
from flexmbd import contact, force, joint
from flexmbd.record.reduced_body import Ports

#: Called by the machine, on types of its inside (tests/packaging/test_public_names.py).
BY_THE_MACHINE = {
    "rows", "steps", "assemble", "stepper", "check", "rule", "force_elements", "tableau", "changed", "meaning",
    "of_motion", "shaped", "record", "start_of", "from_tree", "answer", "index", "act", "coefficients", "run",
}  # fmt: skip
#: Types of the inside with all that they can do.
CALLED_BY_THE_MACHINE = (
    "Port.", "InducedFlow.", "PortFlow.", "StrainFlow.",
    # of machines with electrodes, which tests/multibody/force/test_port_effort.py has
    "CriticalPoint.port_", "WorkingPoint.port_", "FlexibleBody.port", "Trajectory.port", "force.PortEffort",
    "CompiledScene.", "Scheme.", "force.Kinematics.", "CentralDifference.", "continuum.CorotatedInterior.",
    "continuum.ExplicitContinuum.", "continuum.ImplicitContinuum.", "continuum.RegularCheckpoints.",
    "continuum.RigidPlane.", "continuum.SurfaceGroup.", "continuum.MpiTeam.", "continuum.DofLayout.",
    "continuum.CellFields.", "continuum.CellGroup.", "continuum.CondensedStiffness.", "continuum.FieldConditions.",
    "continuum.ContinuumModel.unknown_columns", "continuum.LinearModel.unknown_columns",
    "continuum.NonlinearModel.refuse_surface_energy", "continuum.NodalTies.",
    *(f"{model}.{name}" for name in ("complete", "condense", "tied", "with_slopes") for model in (
        "continuum.NonlinearModel", "continuum.LinearModel", "continuum.ContinuumModel", "reduction.PrestressedModel",
    )),
    "continuum.NonlinearModel.set_temperature", "continuum.NonlinearModel.set_voltages", "continuum.PortStates.",
    "Event.value", "Event.passes", "Checkpoint.of",
    "ExactBeam.resultants", "RunSettings.method",
)
#: Made by flexmbd and handed to users: nobody calls their constructors.
MADE_BY_FLEXMBD = {
    "BodyRecording", "Campbell", "Checkpoint", "Compiled", "CompiledEnergy", "CompiledMachine", "CompiledScene",
    "ContactPatches", "InducedFlow", "Port", "PortFlow", "PortSeries", "Ports", "StrainFlow",
    "ControllerSamples", "CriticalPoint", "CriticalSpeed", "Departure", "DistributedLoads", "Energy", "EquilibriumPath",
    "Frame", "FurtherUnknowns", "GeometricStiffness", "Gyroscopic", "Heat", "HotSpot", "Instant", "InterfaceFrame",
    "InteriorFields", "InteriorFrame", "InteriorIteration", "InteriorMesh", "LinearInterior", "LinearizedMachine",
    "ModalStretch", "Moment", "Momentum", "NodalInterfaces", "NodalModes", "NonlinearStiffness", "Occurrence",
    "FacingSurface", "Obstacle", "ReducedFacets",
    "Outline", "Push", "ReducedBody", "ResultTable", "Scheme", "SimulationInterrupted",
    "Solid", "Start", "StateSpace",
    "Stats", "StressField", "StressModes", "Surface", "SwarmContacts", "SwarmEnergy", "TimeFactor", "Trajectory",
    "WorkingPoint",
    "YieldHistory", "YieldPoint", "FrameMotion", "RunSettings", "SteppedMachine", "SteppedState",
    "joint.Connection", "joint.Row", "joint.Step",
    "joint.KinematicPair", "joint.CarriedBySteps", "joint.Term", "export.Capabilities", "export.ExudynBody",
    "export.Format", "export.MbdynPendulum", "export.Superelement", "beams.ElementAtRest", "beams.FrameMesh",
    "force.Kinematics", "ensemble.Ensemble", "ensemble.Failure", "meshes.Cylinder", "meshes.DeckMaterial",
    "meshes.MeshQuality", "meshes.StepFace", "visual.Marked",
    "force.BetweenFrames", "force.OnCoordinate", "Controller", "Ground", "Shape", "export.check_losses",
    "force.check_numbers", "reduction.StaticState", "reduction.BucklingModes", "reduction.CondensedMatrices",
    "reduction.TruncationErrors", "reduction.PrestressedModel",
    "continuum.BodyCriticalPoint", "continuum.BodyEquilibrium", "continuum.BodyPath", "continuum.Bond",
    "continuum.CellFields", "continuum.CondensedStiffness", "continuum.FieldConditions", "continuum.FloatingGroup",
    "continuum.UniformShift", "continuum.CellGroup", "continuum.CheckResult", "continuum.Cut", "continuum.CutMesh",
    "continuum.DiscreteForms", "continuum.DofLayout", "continuum.EnergyAccount", "continuum.Equilibrium",
    "continuum.ExplicitOperator", "continuum.FormReport", "continuum.HeldSurface", "continuum.HistorySnapshot",
    "continuum.LinearModel", "continuum.NodalGroup", "continuum.NodalTies", "continuum.OptionalEntries",
    "continuum.PieceSummary", "continuum.PointStep", "continuum.PortStates",
    "continuum.StaticPath", "continuum.SurfaceGroup", "continuum.TaggedMesh",
}  # fmt: skip


def left_out(public: Public) -> bool:
    """Whether it is not for users to call, or takes nothing."""
    room, _, _ = public.name.partition(".")
    last = public.name.split(".")[-1]
    return (
        room == "integrate"
        or (public.owner is None and public.name in MADE_BY_FLEXMBD)
        or (public.owner is not None and last in BY_THE_MACHINE)
        or public.name.startswith(CALLED_BY_THE_MACHINE)
        or not public.parameters
    )


def _with_port(body: fm.ReducedBody) -> fm.ReducedBody:
    """The record with one electrode."""
    load, capacity = np.full((1, body.n_modes), 0.1), np.ones((1, 1))
    return replace(body, ports=Ports(("top",), ("voltage",), ("V",), ("charge",), ("C",), load, capacity))


class World:
    """A small machine and what belongs to it, each made when it is asked for."""

    def __init__(self) -> None:
        self.scene = fm.System(gravity=(0.0, 0.0, -9.81))
        self.rod = self.scene.add(fm.FlexibleBody(record(2)), name="rod")
        self.bob = self.scene.add(fm.RigidBody(1.0, (1e-2,) * 3, (0.0, 0.0, -1.0)), name="bob")
        self.hinge = self.scene.connect(joint.Revolute("y"), self.scene.ground.frame(), self.bob.frame(), name="hinge")
        self.root = self.scene.connect(joint.Revolute("y"), self.scene.ground.frame(), self.rod.frame("root"), name="a")

    @cached_property
    def electric(self) -> fm.FlexibleBody:
        """A body with an electrode."""
        return self.scene.add(fm.FlexibleBody(_with_port(record(2))), name="electric")

    @cached_property
    def slide(self) -> joint.Connection:
        """A joint with a translation, of one more body."""
        block = self.scene.add(fm.RigidBody(1.0, (1.0, 1.0, 1.0)), name="block")
        return self.scene.connect(joint.Prismatic("x"), self.scene.ground.frame(), block.frame(), name="slide")

    @cached_property
    def run(self) -> fm.Trajectory:
        return self.scene.simulate(0.01, rtol=1e-2)

    @cached_property
    def linear(self) -> fm.LinearizedMachine:
        return self.scene.linearize(about=self.point)

    @cached_property
    def point(self) -> fm.WorkingPoint:
        return self.scene.equilibrium()


@cache
def asked() -> World:
    """One that is only asked."""
    found = World()
    found.run  # noqa: B018
    return found


#: By the words of an annotation, what is right of it.
BY_WORDS: dict[str, Callable[[World], Any]] = {
    "float": lambda w: 0.5,
    "int": lambda w: 1,
    "bool": lambda w: True,
    "str": lambda w: "name",
    "str | Path": lambda w: "a_file",
    "ArrayLike": lambda w: (0.0, 0.0, 1.0),
    "Sequence[float]": lambda w: (0.0, 0.0, 1.0),
    "Axis": lambda w: "z",
    "Frame": lambda w: w.bob.frame(),
    "Frame | DrawnBody": lambda w: w.bob.frame(),
    "Observed": lambda w: w.bob.frame(),
    "Connection": lambda w: w.hinge,
    "Body": lambda w: w.rod,
    "FlexibleBody": lambda w: w.rod,
    "RigidBody": lambda w: w.bob,
    "ReducedBody": lambda w: w.rod.record,
    "ReducedBody | str | Path": lambda w: w.rod.record,
    "AnyBodyT": lambda w: fm.RigidBody(1.0, (1.0, 1.0, 1.0)),
    "AnyForceT": lambda w: force.JointSpring(w.hinge, 1.0),
    "Force": lambda w: force.JointSpring(w.hinge, 1.0),
    "Joint": lambda w: joint.Fixed(),
    "Trajectory": lambda w: w.run,
    "RecordedMotion": lambda w: w.run,
    "TimeFunction": lambda w: 1.0,
    "Solid": lambda w: fm.Solid.box((1.0, 1.0, 1.0), density=1.0),
    "HomogeneousEnergy": lambda w: fm.StVenantKirchhoff(1.0, 0.3),
    "StVenantKirchhoff | Sequence[StVenantKirchhoff]": lambda w: fm.StVenantKirchhoff(1.0, 0.3),
    "Sequence[Solid]": lambda w: [fm.Solid.box((1.0, 1.0, 1.0), density=1.0)],
    "Shape": lambda w: fm.Shape.box((1.0, 1.0, 1.0)),
    "Sequence[Force]": lambda w: [],
    "Port": lambda w: w.electric.port("top"),
    "Elastic | Nodes | Touching": lambda w: contact.Sphere(w.bob.frame(), 0.1),
    "Elastic | Nodes | SurfaceFacets | Touching": lambda w: contact.Sphere(w.bob.frame(), 0.1),
    "AnyContact | Sequence[AnyContact]": lambda w: [],
    "SurfaceContact | Sequence[SurfaceContact]": lambda w: [],
    "Touching | Nodes": lambda w: contact.Sphere(w.bob.frame(), 0.1),
    "Touching | Nodes | SurfaceFacets": lambda w: contact.Sphere(w.bob.frame(), 0.1),
    "NormalLaw": lambda w: contact.PowerLaw(k=1.0),
    "NormalLaw | Hard": lambda w: contact.PowerLaw(k=1.0),
    "Friction | None": lambda w: None,
    "Contact | HardContact | HardGroup | Sequence[Contact | HardContact | HardGroup]": lambda w: [],
    "Sequence[Frame]": lambda w: [w.bob.frame(), w.rod.frame("tip")],
    "Sequence[RigidBody]": lambda w: [w.bob, w.slide.child.body],
    "Sequence[TimeFunction]": lambda w: (1.0, 0.0, 0.0),
    "float | Points": lambda w: 1.0,
    "ResultTable": lambda w: w.run.table(w.hinge),
    "Interfaces | None": lambda w: None,
}
#: Objects whose methods are called.
OBJECTS: dict[str, Callable[[World], Any]] = {
    "System": lambda w: w.scene,
    "Trajectory": lambda w: w.run,
    "RigidBody": lambda w: w.bob,
    "PointMass": lambda w: fm.PointMass(1.0),
    "FlexibleBody": lambda w: w.rod,
    "ReducedBody": lambda w: w.rod.record,
    "WorkingPoint": lambda w: w.point,
    "CompiledMachine": lambda w: w.scene.compile(),
    "Connection": lambda w: w.hinge,
    "Ground": lambda w: w.scene.ground,
    "Shape": lambda w: fm.Shape.box((1.0, 1.0, 1.0)),
    "Solid": lambda w: fm.Solid.box((1.0, 1.0, 1.0), density=1.0),
    "LinearizedMachine": lambda w: w.linear,
    "ResultTable": lambda w: w.run.table(w.hinge),
    "PseudoRigidBody": lambda w: fm.PseudoRigidBody(
        fm.Solid.box((1.0, 1.0, 1.0), density=1.0), fm.StVenantKirchhoff(1.0, 0.3)
    ),
}
_TETRAHEDRON = [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)]
_FACES = [(0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2)]


@cache
def _pulling() -> fm.Compiled:
    def law(t, data, a, b, r, rate, out):  # type: ignore[no-untyped-def]
        out[0] = -r

    return fm.compiled(law)


def _one(moment: fm.Moment) -> float:
    return 1.0


#: Where the words do not tell, by the name of the call.
BY_NAME: dict[str, dict[str, Callable[[World], Any]]] = {
    "System.simulate": {"t_end": lambda w: 0.001},
    "CompiledMachine.simulate": {"t_end": lambda w: 0.001},
    "RigidBody": {"inertia": lambda w: (1.0, 1.0, 1.0)},
    "ReducedBody.interface": {"name": lambda w: "root"},
    "Connection.position=": {"value": lambda w: 0.1},
    "joint.Connection.position=": {"value": lambda w: 0.1},
    "joint.Connection.velocity=": {"value": lambda w: 0.1},
    "force.JointStop": {"lower": lambda w: -1.0, "upper": lambda w: 1.0},
    "Tableau": {"a": lambda w: [[0.0]], "b": lambda w: [1.0]},
    "Table": {"t": lambda w: (0.0, 1.0, 2.0, 3.0), "y": lambda w: (0.0, 1.0, 2.0, 3.0)},
    "StVenantKirchhoff": {"nu": lambda w: 0.3},
    "Trajectory.animate": {"path": lambda w: "a.gif", "fps": lambda w: 1, "slow_motion": lambda w: 100.0},
    "Trajectory.at": {"t": lambda w: 0.005},
    "Trajectory.motion": {"t": lambda w: 0.005},
    "Trajectory.configuration": {"t": lambda w: 0.005},
    "joint.Gear": {"second": lambda w: w.root},
    "Shape.box": {"sides": lambda w: (1.0, 1.0, 1.0)},
    "Shape.floor": {"size": lambda w: (1.0, 1.0)},
    "Shape.rod": {"start": lambda w: (0.0, 0.0, 0.0)},
    "Solid.box": {"sides": lambda w: (1.0, 1.0, 1.0)},
    "Solid.ellipsoid": {"semi_axes": lambda w: (1.0, 1.0, 1.0)},
    "System.touch": {"other": lambda w: contact.HalfSpace(w.scene.ground.frame())},
    "System.connect": {"child": lambda w: w.rod.frame("tip")},
    "System.linearize": {"about": lambda w: w.point},
    "System.compiled_parts": {"values": lambda w: {}},
    "System.show": {"path": lambda w: "a.png"},
    "Event": {"function": lambda w: _one},
    "ResultTable.column": {"name": lambda w: "t"},
    "ResultTable.save": {"path": lambda w: "a.csv"},
    "Slab": {"end": lambda w: 1.0},
    "polar": {"F": lambda w: np.eye(3)},
    "PseudoRigidBody.coordinates_of": {"stretch": lambda w: np.eye(3)},
    "PseudoRigidBody.stretch_of": {"q": lambda w: np.zeros(6)},
    "RigidBody.from_surface": {"points": lambda w: _TETRAHEDRON, "triangles": lambda w: _FACES},
    "PointMass.from_surface": {"points": lambda w: _TETRAHEDRON, "triangles": lambda w: _FACES},
    "PointMass.frame": {"p": lambda w: (0.0, 0.0, 0.0)},
    "force.SharedNumbers": {"values": lambda w: np.ones(2)},
    "force.BetweenPairs": {"law": lambda w: _pulling()},
    "Solid.from_surface": {"points": lambda w: _TETRAHEDRON, "triangles": lambda w: _FACES},
    "Shape.from_surface": {"points": lambda w: _TETRAHEDRON, "triangles": lambda w: _FACES},
    "FlexibleBody.q=": {"values": lambda w: np.zeros(w.rod.record.n_modes)},
    "FlexibleBody.q_rate=": {"values": lambda w: np.zeros(w.rod.record.n_modes)},
    "PseudoRigidSwarm": {"r": lambda w: [(0.0, 0.0, 0.0)]},
    "Trajectory.to_pyvista": {"t": lambda w: 0.005},
    "export.format_named": {"name": lambda w: "npz"},
}


_WORDED = {**public_bodies.BY_WORDS, **public_runs.BY_WORDS, **public_parts.BY_WORDS, **BY_WORDS}
_NAMED = {**public_bodies.BY_NAME, **public_runs.BY_NAME, **public_parts.BY_NAME, **BY_NAME}
_OWNERS = {**public_bodies.OBJECTS, **public_runs.OBJECTS, **public_parts.OBJECTS, **OBJECTS}
_FOR_METHODS = {**public_runs.FOR_METHODS, **public_parts.FOR_METHODS}


def _object(public: Public, world: World) -> Any:
    """The object whose method is called."""
    if public.name in _FOR_METHODS:
        return _FOR_METHODS[public.name]()
    return _OWNERS[public.owner.__name__ if public.owner is not None else ""](world)


def right_call(public: Public) -> Callable[[dict[str, Any]], Any]:
    """Of a new machine: takes what replaces right arguments; KeyError where none is known."""
    changes_nothing = ("Trajectory", "WorkingPoint", "ResultTable", "LinearizedMachine", "ReducedBody")
    world = asked() if public.owner is not None and public.owner.__name__ in changes_nothing else World()
    known = _NAMED.get(public.name, {})
    given = {}
    for name, parameter in public.parameters.items():
        if name in known:
            given[name] = known[name](world)
        elif parameter.default is parameter.empty and parameter.kind not in (
            parameter.VAR_KEYWORD, parameter.VAR_POSITIONAL,
        ):  # fmt: skip
            given[name] = _WORDED[str(parameter.annotation)](world)
    first = [] if public.owner is None or public.is_classmethod else [_object(public, world)]

    def call(instead: dict[str, Any]) -> Any:
        made = called(instead)
        if public.owner is None:  # forces, joints and functions of time may be judged where they are used
            if isinstance(made, force.Force):
                world.scene.add_force(made)
            elif public.name.startswith("parameter."):
                world.scene.compile(parameters={"value": made})
            elif public.name.startswith("output."):
                world.scene.linearize(about=world.point, outputs=[made])
            elif public.name in ("Table", "Sine"):
                world.hinge.prescribe(made)
        return made

    def called(instead: dict[str, Any]) -> Any:
        whole = {**given, **instead}
        parameters = public.parameters
        positional = [n for n in parameters if parameters[n].kind in (0, 1) and n in whole]
        plain = [] if any(n not in whole for n in list(parameters)[: len(positional)]) else positional
        keyword = {n: v for n, v in whole.items() if n not in plain}
        return public.function(*first, *(whole[n] for n in plain), **keyword)

    return call
