"""Right calls of what is public of machines with more than a rod: states, controllers, stress, beams, pictures."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from functools import cache, cached_property
from pathlib import Path
from typing import Any

import numpy as np
import public_bodies
import pyvista

import flexmbd as fm
from flexmbd import beams, continuum, ensemble, export, force, joint, output
from flexmbd.forms import beam_timoshenko
from flexmbd.visual import Look  # noqa: F401  (annotations of films name it)

SECTION = beam_timoshenko.Parameters.rectangle(
    2.0e11, 0.3, 7800.0, width=0.02, height=0.01, orientation=(0.0, 1.0, 0.0)
)
POINTS = {"root": (0.0, 0.0, 0.0), "tip": (1.0, 0.0, 0.0)}
OF_A_FRAME = (POINTS, {"bar": [("root", "tip")]}, {"bar": SECTION}, 2)


class RichWorld:
    """A slider with a controller and states, a rod that shows its stress, a beam, a body that strains homogeneously."""

    def __init__(self) -> None:
        scene = self.scene = fm.System(gravity=(0.0, 0.0, -9.81))
        self.cart = scene.add(fm.RigidBody(1.0, (1.0, 1.0, 1.0)), name="cart")
        self.slide = scene.connect(joint.Prismatic("x"), scene.ground.frame(), self.cart.frame(), name="slide")
        self.push, self.pull = fm.Signal("push"), fm.Signal("pull")
        for signal in (self.push, self.pull):
            scene.add_force(force.JointForce(self.slide, signal))
        self.law = scene.add_controller(
            lambda t, y: -y, period=0.002, measurements=[output.Position(self.slide)], inputs=[self.push], name="law"
        )
        self.slide.position = self.slide.velocity = 0.0
        self.lag = scene.add_states(
            _decay, initial=[1.0], scale=1.0, inputs=[self.pull], measurements=[output.Position(self.slide)], name="lag"
        )
        self.rod = scene.add(fm.FlexibleBody(public_bodies.body()), name="rod")
        scene.connect(joint.Fixed(), self.cart.frame(), self.rod.frame("x_min"))
        self.rod.q = self.rod.q_rate = np.zeros(self.rod.record.n_modes)
        self.beam = scene.add(fm.ExactBeam(*OF_A_FRAME), name="beam")
        scene.connect(joint.Fixed(), scene.ground.frame(), self.beam.frame("root"))
        self.soft = scene.add(
            fm.PseudoRigidBody(fm.Solid.box((1.0, 1.0, 1.0), density=1e3), fm.StVenantKirchhoff(1e6, 0.3)), name="soft"
        )
        scene.connect(joint.Free(), scene.ground.frame(), self.soft.frame())
        self.spring = scene.add_force(
            force.PlasticJointSpring(self.slide, deformation=(0.0, 1.0, 2.0), force=(0.0, 1.0, 1.5))
        )

    @cached_property
    def run(self) -> fm.Trajectory:
        return self.scene.simulate(0.004, rtol=1e-2)


def _decay(t: float, z: Any, u: Any) -> Any:
    return [-z[0]]


def _law(t: float, x: Any, v: Any) -> Any:
    return -v


def _nothing(kinematics: Any) -> list[Any]:
    return []


@cache
def rich() -> RichWorld:
    """One that is only asked."""
    return RichWorld()


@cache
def linear() -> fm.LinearizedMachine:
    """A mass on a spring, with an input and an output."""
    scene = fm.System()
    cart = scene.add(fm.RigidBody(1.0, (1.0, 1.0, 1.0)))
    slide = scene.connect(joint.Prismatic("x"), scene.ground.frame(), cart.frame(), name="slide")
    scene.add_force(force.JointSpring(slide, 1.0, damping=0.1))
    push = scene.add_force(force.JointForce(slide, 0.0))
    return scene.linearize(inputs=[push], outputs=[output.Position(slide)])


def rotor(speed: float) -> fm.LinearizedMachine:
    return linear()


@cache
def diagram() -> fm.Campbell:
    return fm.campbell(rotor, (0.0, 1.0, 2.0))


@cache
def frame() -> beams.DiscreteFrame:
    return beams.DiscreteFrame(*OF_A_FRAME)


@cache
def _of_the_path() -> tuple[fm.EquilibriumPath, Any]:
    """A mass on a spring that a force pulls, and its slide."""
    scene = fm.System()
    cart = scene.add(fm.RigidBody(1.0, (1.0, 1.0, 1.0)), name="cart")
    slide = scene.connect(joint.Prismatic("x"), scene.ground.frame(), cart.frame(), name="slide")
    scene.add_force(force.JointSpring(slide, 1.0))
    scene.add_force(force.JointForce(slide, fm.Table((0.0, 1.0), (0.0, 1.0))))
    return scene.equilibrium(path=fm.Continuation(to=1.0)), slide


@cache
def falling() -> tuple[fm.CompiledMachine, Any]:
    """A mass that falls, with its place as a parameter, and its slide."""
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    cart = scene.add(fm.RigidBody(1.0, (1.0, 1.0, 1.0)), name="cart")
    slide = scene.connect(joint.Prismatic("z"), scene.ground.frame(), cart.frame(), name="slide")
    slide.position = 0.0
    return scene.compile(parameters={"z": fm.parameter.InitialPosition(slide)}), slide


@cache
def studied() -> ensemble.Ensemble:
    """Two variants of it."""
    machine, slide = falling()
    return machine.ensemble({"z": [0.0, 1.0]}, {"end": lambda run: run.beta(slide)[-1]}, t_end=0.01)


@cache
def kept() -> fm.Checkpoint:
    """Of a mass that falls."""
    return falling()[0].simulate(0.01, checkpoints=[0.005]).checkpoints[0]


@cache
def recorded() -> tuple[fm.Trajectory, fm.ContinuumBody]:
    """A body with history that falls, with the recording of its fields; the file is this process's."""
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    body = scene.add(fm.ContinuumBody(continuum.ImplicitContinuum(public_bodies.nonlinear())), name="bar")
    scene.connect(joint.Fixed(), scene.ground.frame(), body.frame("x_min"))
    path = Path(tempfile.mkdtemp()) / "bar.h5"
    return scene.simulate(1e-4, rtol=1e-2, recording=fm.Recording(path, every=5e-5)), body


def body_file(write: Callable[..., Any], name: str, **options: Any) -> str:
    """One that the package writes of a body."""
    if not Path(name).exists():
        write(public_bodies.body(), name, **options)
    return name


def run_file() -> str:
    rich().run.save("a.h5")
    return "a.h5"


def sphere_file() -> str:
    pyvista.Sphere().save("a.stl")
    return "a.stl"


BY_WORDS: dict[str, Callable[[Any], Any]] = {
    "ContinuumBody": lambda w: recorded()[1],
    "CouplingT": lambda w: joint.Gear(w.hinge, w.root, 2.0),
    "Interior": lambda w: continuum.ImplicitContinuum(public_bodies.nonlinear()),
    "StateEquation": lambda w: _decay,
    "StateEquation | Any": lambda w: _decay,
    "Compiled | Law | Switched": lambda w: _law,
    "Compiled | StateFunction | Switched": lambda w: _law,
    "Callable[[Kinematics], Iterable[Contribution]]": lambda w: _nothing,
    "Position | Velocity | Acceleration": lambda w: output.Position(rich().slide),
    "ExactBeam": lambda w: rich().beam,
    "Controller": lambda w: rich().law,
    "States": lambda w: rich().lag,
    "States | WithStates": lambda w: rich().lag,
    "object": lambda w: rich().lag,
    "PseudoRigidBody": lambda w: rich().soft,
    "Campbell": lambda w: diagram(),
    "Responding": lambda w: linear(),
    "Surface": lambda w: public_bodies.body().surface,
    "System": lambda w: w.scene,
    "DiscreteFrame": lambda w: frame(),
    "str | ArrayLike": lambda w: "tip",
    "Callable[[float], FirstOrderMachine]": lambda w: rotor,
}
OBJECTS: dict[str, Callable[[Any], Any]] = {
    # an instant: all that tell of one share its methods
    "CriticalPoint": lambda w: rich().run.at(0.002),
    "Instant": lambda w: rich().run.at(0.002),
    "EquilibriumPath": lambda w: _of_the_path()[0],
    "ExactBeam": lambda w: rich().beam,
    "BodyRecording": lambda w: recorded()[0].recorded(recorded()[1]),
    "ContinuumBody": lambda w: recorded()[1],
    "Checkpoint": lambda w: kept(),
    "SteppedMachine": lambda w: w.scene.stepper(rtol=1e-2),
    "ControllerSamples": lambda w: rich().run.sampled(rich().law),
    "YieldMonitor": lambda w: fm.YieldMonitor(rich().rod, yield_stress=2.5e8),
    "DiscreteFrame": lambda w: frame(),
    "Ensemble": lambda w: studied(),
}


def _always(value: Any) -> Callable[[Any], Any]:
    return lambda w: value


_FRAME = {
    name: _always(value) for name, value in zip(("points", "beams", "sections", "divisions"), OF_A_FRAME, strict=True)
}
_SLIDE = {"connection": lambda w: rich().slide}
_SIX = {"stiffness": lambda w: np.eye(6)}
_OF_THE_RICH: dict[str, Callable[[Any], Any]] = {"frame": lambda w: rich().cart.frame()}
#: Where the words do not tell, by the name of the call.
BY_NAME: dict[str, dict[str, Callable[[Any], Any]]] = {
    **{
        f"CriticalPoint.{name}": _OF_THE_RICH
        for name in (
            "acceleration", "angular_acceleration", "angular_velocity", "position", "rotation", "velocity"
        )
    },
    "CriticalPoint.beta": _SLIDE,
    "CriticalPoint.beta_rate": _SLIDE,
    "CriticalPoint.reaction": _SLIDE,
    "CriticalPoint.q": {"body": lambda w: rich().rod},
    "CriticalPoint.q_rate": {"body": lambda w: rich().rod},
    "CriticalPoint.remembered": {"force": lambda w: rich().spring},
    **{
        f"BodyRecording.{name}": {"field": lambda w: "position", "t": lambda w: 5e-5, "node": lambda w: 0}
        for name in ("acceleration", "between", "position", "series", "stress", "values", "velocity")
    },
    "ContinuumBody.frame": {"name": lambda w: "x_min"},
    "Trajectory.interior_wrench": {"interface": lambda w: "x_min"},
    "Checkpoint.load": {"path": lambda w: str(kept().save("kept.npz"))},
    "ResultTable.load": {"path": lambda w: _table_file()},
    "Trajectory.load": {"path": lambda w: _falling_file(), "machine": lambda w: falling()[0]},
    "load_recording": {"path": lambda w: str(recorded()[0].recorded(recorded()[1]).path)},
    "SteppedMachine.step": {"dt": lambda w: 1e-3},
    "SteppedMachine.step_to": {"t": lambda w: 1e-3},
    "CompiledMachine.variant": {"values": lambda w: {"z": 0.5}},
    "CompiledMachine.compiled_parts": {"values": lambda w: {"z": 0.5}},
    "EquilibriumPath.q": {"body": lambda w: rich().rod},
    "EquilibriumPath.beta": {"connection": lambda w: _of_the_path()[1]},
    "EquilibriumPath.reaction": {"connection": lambda w: _of_the_path()[1]},
    "EquilibriumPath.position": {"frame": lambda w: _of_the_path()[1].child},
    "EquilibriumPath.rotation": {"frame": lambda w: _of_the_path()[1].child},
    "ControllerSamples.held": {"t": lambda w: np.array([0.001])},
    "ControllerSamples.since": {"t": lambda w: 0.001},
    "ExactBeam": _FRAME,
    "ExactBeam.line_load": {"group": lambda w: "bar"},
    "beams.DiscreteFrame": _FRAME,
    "beams.DiscreteFrame.displaced": {
        "loads": lambda w: frame().load("tip", force=(0.0, 0.0, 1.0)), "clamped": lambda w: ["root"],
    },
    "beams.discrete_body": {"interfaces": lambda w: ["root", "tip"], "frame": lambda w: "root"},
    "FlexibleBody.show": {"path": lambda w: "a.png"},
    "LinearizedMachine.plot": {"omega": lambda w: (0.5, 1.5), "path": lambda w: "a.png"},
    "ReducedBody.animate": {
        "path": lambda w: "a.gif", "mode": lambda w: 0, "fps": lambda w: 2, "seconds": lambda w: 0.5,
    },
    "ReducedBody.load": {"path": lambda w: body_file(lambda body, name: body.save(name), "b.h5")},
    "ReducedBody.show": {"path": lambda w: "a.png"},
    "ReducedBody.strained": {"q": lambda w: np.zeros((1, public_bodies.body().n_modes))},
    "Shape.from_file": {"path": lambda w: sphere_file()},
    "Shape.show": {"path": lambda w: "a.png"},
    "System.add_states": {"initial": lambda w: [1.0], "scale": lambda w: 1.0},
    "System.add_controller": {
        "step": lambda w: lambda t, y: [], "period": lambda w: 0.1, "inputs": lambda w: [fm.Signal("push")],
    },
    "States": {"initial": lambda w: [1.0], "scale": lambda w: 1.0},
    "Trajectory.remembered": {"force": lambda w: rich().spring},
    "Trajectory.show": {"path": lambda w: "a.png", "t": lambda w: 0.002},
    "Trajectory.stress": {
        "body": lambda w: rich().rod, "t": lambda w: 0.002, "model": lambda w: public_bodies.model(),
    },
    "YieldMonitor": {"body": lambda w: rich().rod, "yield_stress": lambda w: 2.5e8},
    "YieldMonitor.over": {"run": lambda w: rich().run},
    "YieldMonitor.utilisation": {"q": lambda w: np.zeros(public_bodies.body().n_modes)},
    "campbell": {"speeds": lambda w: (0.0, 1.0)},
    "hot_spots": {"run": lambda w: rich().run, "body": lambda w: rich().rod},
    "yielding_slabs": {
        "history": lambda w: fm.YieldMonitor(rich().rod, yield_stress=1.0).over(rich().run),
    },
    "ensemble.Ensemble.output": {"name": lambda w: "end"},
    "ensemble.Ensemble.values": {"k": lambda w: 0},
    "ensemble.Sampled": {"t": lambda w: (0.001, 0.002)},
    "export.fmu_machine": {"h": lambda w: 1e-4, "path": lambda w: "a.fmu", "binary": lambda w: False},
    "export.openfast": {"lossy": lambda w: True, "interface": lambda w: "root"},
    "export.read_npz": {"path": lambda w: body_file(export.npz, "b.npz")},
    "export.read_dmig": {"path": lambda w: body_file(export.dmig, "b.pch")},
    "export.read_op4": {"path": lambda w: body_file(export.op4, "b.op4")},
    "export.read_sid": {"path": lambda w: body_file(export.sid, "b.SID_FEM")},
    "export.read_simscape": {"path": lambda w: body_file(export.simscape, "b.mat")},
    "export.read_mbdyn": {"path": lambda w: body_file(export.mbdyn, "b.fem")},
    "export.read_exudyn": {"path": lambda w: body_file(export.exudyn, "c.npz")},
    "export.vtkhdf_modes": {"body": lambda w: public_bodies.body()},
    "force.JointForce": {"connection": lambda w: w.slide},
    "joint.RackAndPinion": {"pinion": lambda w: w.hinge, "rack": lambda w: w.slide},
    "parameter.FrameAxes": {"frame": lambda w: w.hinge.child},
    "parameter.FrameOrigin": {"frame": lambda w: w.hinge.child},
    "force.BeamElement": {
        **_SIX, "frame_G": lambda w: w.scene.ground.frame(), "rest": lambda w: (0.0, 0.0, -1.0, 0.0, 0.0, 0.0),
    },
    "force.Bushing": {**_SIX, "frame_G": lambda w: w.scene.ground.frame()},
    "force.BearingFriction": {"radius": lambda w: 0.01},
    "force.PlasticJointSpring": {"deformation": lambda w: (0.0, 1.0, 2.0), "force": lambda w: (0.0, 1.0, 1.5)},
    "force.PlasticSpring": {
        "frame_G": lambda w: w.scene.ground.frame(), "deformation": lambda w: (0.0, 1.0, 2.0),
        "force": lambda w: (0.0, 1.0, 1.5),
    },
    "force.KaneBody": {"at": lambda w: [w.bob.frame()], "function": lambda w: _nothing},
    "parameter.InitialPosition": {"joint": lambda w: _set(w.hinge, "position", 0.1)},
    "parameter.InitialVelocity": {"joint": lambda w: _set(w.hinge, "velocity", 0.1)},
    "parameter.ModalPosition": {"body": lambda w: _set(w.rod, "q", np.zeros(w.rod.record.n_modes))},
    "parameter.ModalVelocity": {"body": lambda w: _set(w.rod, "q_rate", np.zeros(w.rod.record.n_modes))},
    "parameter.PrescribedMotion": {"joint": lambda w: _driven(w.hinge)},
    "parameter.OfForce": {
        "force": lambda w: w.scene.add_force(force.JointSpring(w.hinge, 1.0)), "argument": lambda w: "stiffness",
    },
    "visual.animate": {
        "trajectory": lambda w: rich().run, "path": lambda w: "a.gif", "fps": lambda w: 1,
        "slow_motion": lambda w: 250.0,
    },
    "visual.machine_meshes": {"motion": lambda w: rich().run, "t": lambda w: 0.002},
    "visual.plot_campbell": {"path": lambda w: "a.png"},
    "visual.plot_response": {"omega": lambda w: (0.5, 1.5), "path": lambda w: "a.png"},
    "visual.plot_shape": {"path": lambda w: "a.png"},
    "visual.plot_stress": {"path": lambda w: "a.png"},
    "visual.plot_series": {"series": lambda w: [w.hinge], "path": lambda w: "a.png"},
    "visual.show": {"motion": lambda w: rich().run, "path": lambda w: "a.png"},
    "StressField.show": {"path": lambda w: "a.png"},
}  # fmt: skip
#: Objects for single methods, which those of their class lack what it takes for.
FOR_METHODS: dict[str, Callable[[], Any]] = {
    **{
        f"Trajectory.{name}": lambda: rich().run
        for name in (
            "remembered", "sampled", "states", "resultants", "strain_power", "stress", "stretch",
            "deformation_gradient", "show",
        )
    },
    **{
        f"Trajectory.{name}": lambda: recorded()[0]
        for name in ("energies", "interior_wrench", "outer_forces", "recorded")
    },
    **{f"ReducedBody.{name}": public_bodies.body for name in ("show", "animate", "to_pyvista", "strained")},
    "CompiledMachine.variant": lambda: falling()[0],
    "CompiledMachine.compiled_parts": lambda: falling()[0],
    "FlexibleBody.show": lambda: rich().rod,
    "LinearizedMachine.plot": linear,
}  # fmt: skip


def _table_file() -> str:
    run = falling()[0].simulate(0.01)
    run.table(falling()[1]).save("table.csv")
    return "table.csv"


def _falling_file() -> str:
    falling()[0].simulate(0.01).save("falling.h5")
    return "falling.h5"


def _set(thing: Any, name: str, value: Any) -> Any:
    setattr(thing, name, value)
    return thing


def _driven(hinge: Any) -> Any:
    hinge.prescribe(fm.Sine(1.0, 1.0))
    return hinge
