"""A machine's parts compiled, started and shown: the base of `System`."""

from __future__ import annotations

import gc
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import NoneType
from typing import Any, TypeAlias, cast

import numpy as np
from numpy.typing import ArrayLike

from flexmbd.given import checked, refuse_other
from flexmbd.machine.assembly import MachineAssembly
from flexmbd.machine.compiled_machine import CompiledMachine
from flexmbd.machine.variable_scene import STARTING
from flexmbd.multibody.bodies.body import Body
from flexmbd.multibody.bodies.pseudo_rigid_body import PseudoRigidBody
from flexmbd.multibody.contact.nodes import interior_forces
from flexmbd.multibody.energy_force import EnergyForce
from flexmbd.multibody.force.protocol import Force
from flexmbd.multibody.kernels.base.compiling import is_compiled
from flexmbd.multibody.linear.working_point import WorkingPoint
from flexmbd.multibody.parameter.protocol import Parameter
from flexmbd.multibody.plan.built_of import GivenParts, KeptWhile
from flexmbd.multibody.plan.compiled_scene import CompiledScene, build
from flexmbd.multibody.start.consistent_start import Start
from flexmbd.multibody.start.given_start import with_given_start
from flexmbd.multibody.team import Team
from flexmbd.multibody.topology import spanning_tree
from flexmbd.run.stats import NOTHING_SPENT
from flexmbd.run.trajectory import Trajectory

#: What may take other values in a compiled machine, by its name.
NamedParameters: TypeAlias = Mapping[str, Parameter | Sequence[Parameter]]


class CompilableMachine(MachineAssembly):
    """The parts of a machine, compiled into flat arrays as they are now."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self._kept: KeptWhile[CompiledMachine] = KeptWhile()

    def compile(self, *, parameters: NamedParameters | None = None) -> CompiledMachine:
        """Compile the scene as it is now into the flat arrays of the machine that runs.

        Args:
            parameters: by their names what may take other values in each run, as {"m": fm.parameter.Mass(piston)}; a
                list of several that have the same value.  See docs/ensembles.md.

        Raises:
            SceneError: a body that nothing connects, a force or motion on a joint that has no coordinate, or a
                parameter that does not fit the scene.
        """
        refuse_other(parameters, (Mapping, NoneType), "parameters", wanted='quantities by name, {"m": fm.parameter...}')
        named = {name: _listed(meant) for name, meant in (parameters or {}).items()}
        varied = [one.of for meant in named.values() for one in meant if isinstance(one, Parameter)]
        return self._machine(self._compile((), varied=varied), named)

    def _compile(
        self, more: Sequence[Force], *, without: Sequence[Force] = (), varied: Sequence[object] = ()
    ) -> CompiledScene:
        """As ``compile``, with ``more`` forces and without others; other values are to be given to ``varied``."""
        with _no_collection():
            return self._compiled(more, without, varied)

    def _compiled(
        self, more: Sequence[Force], without: Sequence[Force], varied: Sequence[object]
    ) -> CompiledScene:
        self._refuse_renamed()
        left_out = {id(force) for force in without}
        own = [force for force in self._forces if id(force) not in left_out]
        wanted = {id(c) for force in (*own, *more) for c in force.connections}
        wanted |= {id(term.connection) for coupling in self._couplings for term in coupling.terms}
        for c in self._connections:
            if not (c.position is None and c.velocity is None and c.motion is None):
                wanted.add(id(c))
        together = [body.parts for body in self._continua]
        topology = spanning_tree(self.ground, self._bodies, self._connections, wanted=wanted, together=together)
        gravity = self._weight()
        energies = [EnergyForce(b) for b in self._bodies if isinstance(b, PseudoRigidBody) and b.material.address]
        forces = [*own, *interior_forces(self._continua, self._nodal), *energies, *more]
        return build(topology, self.ground, forces, self._couplings, gravity, self.team, varied)

    def compiled_parts(self, values: Mapping[str, Any]) -> tuple[CompiledScene, tuple[Body, ...], Team]:
        """The compiled scene, bodies and team of a trajectory of this machine; for ``Trajectory.load``.

        Raises:
            SceneError: as ``compile``; or there are values, and a System has no parameters.
        """
        return self.compile().compiled_parts(values)

    @checked()
    def start(self, *, t: float = 0.0) -> Start:
        """The consistent start at time ``t`` (s): loops closed, accelerations and reactions.

        Raises:
            SceneError: as ``compile``.
            AssemblyError: the mechanism cannot be assembled.
        """
        return self._start(self._compile(()), t)

    @checked()
    def at_start(self, *, t: float = 0.0) -> Trajectory:
        """The machine at its consistent start, t (s), as a trajectory of one instant: to be shown, asked and exported.

        Raises:
            SceneError, AssemblyError: as ``start``.
        """
        start = self.start(t=t)
        rows = (np.array([t]), start.x[None], start.v[None], start.a[None], start.multipliers[None])
        bodies = {body.name: body for body in self._bodies}
        return Trajectory(start.scene, *rows, NOTHING_SPENT, bodies, self.team)

    @checked("frames")
    def show(
        self,
        *,
        path: str | Path | None = None,
        size: tuple[int, int] = (1280, 720),
        view: ArrayLike | None = None,
        frames: bool = False,
    ) -> Path | None:
        """Show the machine at its start in a window or a notebook; or write it to ``path``, a .png.

        Bodies are shown by their shapes and surfaces, others by symbols; see ``flexmbd.visual.show`` for the arguments.

        Raises:
            SceneError, AssemblyError: as ``start``.
            PictureError: as ``flexmbd.visual.show``.
        """
        return self.at_start().show(path=path, size=size, view=view, frames=frames)

    def to_pyvista(self) -> Any:
        """The scene of ``show`` as a pyvista.MultiBlock, a block for each body and joint (m). Not collective.

        Raises:
            SceneError, AssemblyError: as ``start``.
            PictureError: pyvista is not installed.
        """
        return self.at_start().to_pyvista(0.0)

    def _repr_html_(self) -> str:
        """Its text and a picture of its start, where pyvista can draw here and the start's kernels are compiled."""
        import flexmbd.visual.notebook as notebook  # pyvista loads only here

        quick = is_compiled(STARTING) and self.team.size == 1
        return notebook.html_of(repr(self), lambda: notebook.still_of(self.at_start()) if quick else None)

    @checked()
    def start_with(
        self,
        forces: Sequence[Force],
        *,
        instead_of: Sequence[Force] = (),
        t: float = 0.0,
        about: WorkingPoint | None = None,
    ) -> Start:
        """As ``start``, with further forces, and without those of ``instead_of`` that the scene holds.

        It begins at ``about``, of ``equilibrium``, or with the initial values of joints and bodies.

        Raises:
            SceneError, AssemblyError: as ``start``; or a force does not fit.
        """
        for force in forces:
            self._check_force(force)
        return self._start(self._compile(forces, without=instead_of), t, about)

    def _machine(
        self, scene: CompiledScene, named: Mapping[str, tuple[Parameter, ...]] | None = None
    ) -> CompiledMachine:
        kept = with_given_start(scene, self._connections, self._bodies)
        parts = tuple(self._connections), tuple(self._bodies), named or {}, self.team, tuple(self._controllers)
        return CompiledMachine(kept, *parts)

    def _start(self, scene: CompiledScene, t: float, about: WorkingPoint | None = None) -> Start:
        return self._machine(scene).start_of(scene, t, about)

    def _as_it_is(self) -> CompiledMachine:
        """The machine as it is now: with its plan and workspaces that of the run before, if nothing changed since."""
        if self.team.size > 1 or self._continua or self._controllers:
            return self.compile()
        parts = GivenParts(
            self.ground, self._bodies, self._connections, self._forces, self._couplings, self.gravity, self.team
        )
        return self._kept.of(parts, self.compile)


@contextmanager
def _no_collection() -> Iterator[None]:
    """Let Python look for no garbage: nothing that a scene is compiled into is any, and it looks often."""
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_on:
            gc.enable()


def _listed(meant: Parameter | Sequence[Parameter]) -> tuple[Parameter, ...]:
    """One parameter or several of one name."""
    return tuple(meant) if isinstance(meant, list | tuple) else (cast(Parameter, meant),)
