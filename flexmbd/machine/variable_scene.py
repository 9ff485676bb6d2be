"""A compiled scene with named parameters: its variants with other values, and their consistent starts."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmbd.ensemble.stamp import meaning
from flexmbd.errors import SceneError, StartWarning, warn
from flexmbd.given import checked, refuse_other
from flexmbd.multibody.bodies.body import Body
from flexmbd.multibody.joint.connection import Connection
from flexmbd.multibody.kernels.base.arrays import Work, new_work, open_horizon
from flexmbd.multibody.kernels.base.compiling import announce_compilation, mark_compiled
from flexmbd.multibody.linear.working_point import WorkingPoint
from flexmbd.multibody.parameter.protocol import Parameter
from flexmbd.multibody.plan.agreement import refuse_different
from flexmbd.multibody.plan.compiled_scene import CompiledScene
from flexmbd.multibody.plan.misplaced_elements import refuse_misplaced_elements
from flexmbd.multibody.plan.variation import vary
from flexmbd.multibody.scene_index import IdentityMap
from flexmbd.multibody.start.consistent_start import Start, consistent_start
from flexmbd.multibody.start.energy_check import refuse_false_energies
from flexmbd.multibody.start.given_coordinates import refuse_against_motions
from flexmbd.multibody.start.given_start import given_start
from flexmbd.multibody.start.kept_starts import KeptStarts, can_be_kept
from flexmbd.multibody.start.report import changed_velocities
from flexmbd.multibody.team import Team
from flexmbd.run.controller import Controller
from flexmbd.run.input_values import evaluate_inputs

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

#: What kernels are compiled for before any integrator's.
STARTING = "the start"


@dataclass(frozen=True, eq=False, repr=False)
class VariableScene:
    """A compiled scene whose parameters take other values.

    Attributes:
        scene: its flat arrays, and where its bodies, joints and forces stand in them.
        connections: its joints.
        bodies: its bodies.
        parameters: the quantities of each name.
        team: the processes that run it side by side.
        controllers: its sampled controllers.

    Raises:
        SceneError: a parameter does not fit the scene.
    """

    scene: CompiledScene
    connections: tuple[Connection, ...]
    bodies: tuple[Body, ...]
    parameters: Mapping[str, tuple[Parameter, ...]]
    team: Team
    controllers: tuple[Controller, ...] = ()
    _starts: KeptStarts = field(default_factory=KeptStarts, init=False)

    def __post_init__(self) -> None:
        known: dict[str, str] = {}
        for name, meant in self.parameters.items():
            if not meant:
                raise SceneError(f"parameter {name!r} is of no quantity: its list is empty")
            for parameter in meant:
                refuse_other(parameter, Parameter, f"parameter {name!r}", wanted="as fm.parameter.Mass(body)")
                try:
                    parameter.check(self.scene)
                except SceneError as reason:
                    raise SceneError(f"parameter {name!r}: {reason}") from reason
                other = known.setdefault(meaning(parameter, self.scene), name)
                if other != name:
                    raise SceneError(f"parameters {other!r} and {name!r} are the same quantity; give it one name")

    def variant(self, values: Mapping[str, Any]) -> CompiledScene:
        """The compiled scene with these values of the parameters; those not given stay as compiled.

        Raises:
            SceneError: a name is no parameter's; a value is not possible, or changes what is computed.
        """
        refuse_other(values, Mapping, "values", wanted='a mapping of parameters, {"m": 2.0}')
        self._refuse_unknown(values)
        if not values:
            return self.scene
        now = self.scene.index.now
        substitutes: IdentityMap[object, Any] = IdentityMap()
        try:
            for name, value in values.items():
                for parameter in self.parameters[name]:
                    of = parameter.of
                    substitutes[of] = parameter.changed(substitutes[of] if of in substitutes else now(of), value)
            return vary(self.scene, substitutes)
        except SceneError as reason:
            raise SceneError(f"with {told(values)}: {reason}") from reason

    def compiled_parts(self, values: Mapping[str, Any]) -> tuple[CompiledScene, tuple[Body, ...], Team]:
        """The compiled scene, bodies and team of a trajectory with these values; for ``Trajectory.load``.

        Raises:
            SceneError: as ``variant``.
        """
        return self.variant(values), self.bodies, self.team

    def _refuse_unknown(self, names: Iterable[object]) -> None:
        unknown = [name for name in names if name not in self.parameters]
        if unknown:
            there = ", ".join(self.parameters) or "none: compile(parameters={...}) names them"
            raise SceneError(f"the machine has no parameter {unknown[0]!r}; it has {there}")

    @checked()
    def start(self, *, t: float = 0.0, **values: Any) -> Start:
        """The consistent start at time ``t`` (s) with these values of the parameters.

        Raises:
            SceneError, AssemblyError: as ``System.start``, and as ``variant``.
        """
        return self.start_of(self.variant(values), t)

    def start_of(self, scene: CompiledScene, t: float, about: WorkingPoint | None = None) -> Start:
        """The consistent start of a variant: from the initial values of joints and bodies, or a state found before."""
        if self.team.is_root:
            announce_compilation(STARTING)
        work = new_work(scene.plan)
        scene.plan.horizon[:] = open_horizon()  # whatever was asked of the machine before
        evaluate_inputs(scene, work, t)
        start, v, held = self._found_start(scene, work, t, about)
        mark_compiled(STARTING)
        if about is None:  # a machine that has settled on a stop presses it
            refuse_misplaced_elements(scene.element_names, scene.plan, start.x)
        refuse_false_energies(scene, work, start.x)
        forbidden = "" if about is not None else changed_velocities(start.scene, v, start.v, held=held)
        for complaint in (start.strain.warning, forbidden):
            if complaint and self.team.is_root:
                warn(complaint, StartWarning)
        return start

    def _found_start(
        self, scene: CompiledScene, work: Work, t: float, about: WorkingPoint | None
    ) -> tuple[Start, FloatArray, BoolArray]:
        """The start at the time of ``work``; the velocities (nv,) wanted, and which of them are set (nv,)."""
        if about is not None:
            about.scene.refuse_other(scene)
            x, v, held = about.x.copy(), about.v.copy(), np.zeros(scene.nv, bool)
            refuse_different(scene, x, v, self.team)
            return consistent_start(scene, work, x, v, held_x=held, held_v=held, memories=about.interiors), v, held
        refuse_against_motions(scene, work, self.connections)
        x, v, held_x, held_v = given_start(scene, self.connections, self.bodies)
        refuse_different(scene, x, v, self.team)
        known: Start | None = None
        if len(scene.plan.rows) and can_be_kept(scene):
            known = self._starts.at(t, partial(self._own_start, t))
        if known is not None and scene is self.scene:
            return known.copied(), v, held_v
        position = None if known is None else known.position
        return consistent_start(scene, work, x, v, held_x=held_x, held_v=held_v, known=position), v, held_v

    def _own_start(self, t: float) -> Start:
        """The start at t (s) with the numbers that the machine was compiled with; nothing is told of it."""
        scene, work = self.scene, new_work(self.scene.plan)
        evaluate_inputs(scene, work, t)
        x, v, held_x, held_v = given_start(scene, self.connections, self.bodies)
        return consistent_start(scene, work, x, v, held_x=held_x, held_v=held_v)

    def _given(self, scene: CompiledScene) -> tuple[FloatArray, FloatArray]:
        """x (nx,) and v (nv,) that joints and bodies are given in a variant."""
        x, v, *_ = given_start(scene, self.connections, self.bodies)
        return x, v


def told(values: Mapping[str, Any]) -> str:
    """Values of parameters, in a message."""
    return ", ".join(f"{name} = {value!r:.60}" for name, value in values.items())
